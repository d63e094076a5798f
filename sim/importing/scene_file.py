"""Gazebo worlds, ROS maps and motions as scenes: they become MJCF files by the conventions of `sim.mjcf`.

Neither a world nor a map says anything of a task, so start and goal are the caller's; the workspace is, too, unless
the ground plane has a size that is meant, or the map is not turned. The new file is loaded before it takes its place,
so that a file that is there already is never replaced by a broken one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from sim.files import why_unreadable
from sim.importing import decomposed, dynabarn, ros_map
from sim.importing.limits import content_of
from sim.importing.sdf import Solid, World, read_sdf
from sim.importing.target import (
    BORDER,
    GOAL,
    START,
    Imported,
    check_borders,
    check_target,
    draft,
    loaded,
    numbers_of,
    scene_text,
    text,
)

__all__ = ["Imported", "import_world"]

WIDEST = 50.0  # a larger ground is Gazebo's usual 100 m, and not meant as a workspace [m]
ROVER = "rover"  # robots that map with a lidar turn on the spot, or nearly
_ROBOTS = {
    "world": ('<text name="pirrht_robot" data="unicycle"/>', '<numeric name="pirrht_noise" data="0.03"/>'),
    "map": (f'<text name="pirrht_robot" data="{ROVER}"/>',),
}
_CUSTOM = (
    '<numeric name="pirrht_period" data="0.1"/>',
    '<numeric name="pirrht_dt" data="0.1"/>',
    '<numeric name="pirrht_samples" data="300"/>',
    '<numeric name="pirrht_limit" data="0.8"/>',
    '<numeric name="pirrht_vertices" data="2000"/>',
    '<numeric name="pirrht_classes" data="16"/>',
    '<numeric name="pirrht_phi" data="1000"/>',
    '<numeric name="pirrht_max_time" data="60"/>',
)  # what imported worlds and maps ask for, in addition to their robots
_MATERIALS = {
    "box": "crate",
    "mesh": "crate",
    "cylinder": "drum",
    "capsule": "log",
    "sphere": "boulder",
    "ellipsoid": "boulder",
}


def import_world(
    source: Path,
    target: Path,
    *,
    start: Sequence[float] | None = None,
    goal: Sequence[float] | None = None,
    workspace: Sequence[float] | None = None,
    unknown: str | None = None,
    motion: bool = False,
    number: str | None = None,
    decompose: bool = False,
    models: Sequence[Path] = (),
    without: Sequence[str] = (),
    progress: Callable[[int, int], object] | None = None,
) -> Imported:
    """Write the obstacles of an SDF world as a scene for the unicycle, or the walls of a ROS map for the rover.

    Args:
        source: an SDF file with one world or with models, the YAML file of a map, or a file of motions
            (`sim.importing.dynabarn`).
        target: the MJCF file to write; replaced in one go if it exists.
        start: x, y [m] and optionally the heading [rad].
        goal: x, y, radius [m].
        workspace: x0, x1, y0, y1, the box that holds the robot's centre [m].
        motion: it is a file of motions, whatever its name ends in.
        number: which of its worlds.
        decompose: it is a mesh, of which convex parts are made.
        unknown: whether cells of a map that are unknown are "occupied" (default) or "free".
        models: folders where models and meshes of an SDF world are searched for, before those around the file.
        without: names of models of an SDF world to leave out, like the robot.
        progress: called with how many of how many shapes of a world are done, now and then.

    Raises:
        SceneError: the world has something that cannot be taken over, start, goal or workspace are missing or
            do not fit, or the target cannot be written. The target is then as it was.
    """
    source, target = Path(source), Path(target)
    moves, why = motion or source.suffix.lower() in dynabarn.SUFFIXES, why_unreadable(source)
    if why is not None:
        what = "the JSON file of a set of motions" if moves else "an SDF world file or the YAML file of a map"
        raise SceneError(f"{source}: it {why}, so it cannot be read; give {what}")
    check_target(source, target)
    if decompose != (source.suffix.lower() in decomposed.SUFFIXES):
        kinds = ", ".join(decomposed.SUFFIXES)
        raise OptionError(
            f"--decompose is for meshes, whose names end in {kinds}; leave it out" if decompose else
            f"{source}: MuJoCo collides with the convex hull of a mesh; add --decompose for its convex parts"
        )  # fmt: skip
    mapped = not moves and source.suffix.lower() in ros_map.SUFFIXES
    if without and (moves or mapped or decompose):
        raise OptionError(f"{source}: only models of a Gazebo world can be left out by name")
    if moves:
        if unknown is not None:
            raise OptionError("--unknown is for maps, and this is a file of motions; leave it out")
        return dynabarn.import_motions(source, target, number=number, start=start, goal=goal, workspace=workspace)
    if number is not None:
        raise OptionError("--world is for files of motions, of which --motion tells; leave it out")
    if source.suffix.lower() in ros_map.PICTURES:
        raise SceneError(f"{source}: a picture tells neither scale nor place; give the map's .yaml")
    if mapped:
        grid = ros_map.read_map(source)
        world, notes = grid.world(unknown or "occupied"), grid.notes
        workspace = world.ground.tolist() if workspace is None and world.ground is not None else workspace
    elif unknown is not None:
        raise OptionError(f"--unknown is for maps, whose names end in {' or '.join(ros_map.SUFFIXES)}; leave it out")
    elif decompose:
        world, notes = decomposed.read_mesh(source), ()
    else:
        _refuse_motions(source)
        world = read_sdf(source, progress, folders=models, without=without)
        notes = world.notes
    kind = "map" if mapped else "mesh" if decompose else "world"
    place, goal_disc = _task(source, kind, start, goal)
    if workspace is None and mapped and world.ground is None:
        raise SceneError(f"{source}: a turned map needs {_example(world, place, goal_disc)}")
    bounds = _workspace(source, world, workspace, place, goal_disc)
    assets, geoms = zip(*_elements(world.solids), strict=True) if world.solids else ((), ())
    meshes = [mesh for mesh in assets if mesh]
    custom = (*_ROBOTS["map" if mapped or decompose else "world"], *_CUSTOM)
    scene = scene_text(target.stem, custom, geoms, place, goal_disc, bounds, meshes)
    with draft(scene, target) as new:
        try:
            obstacles = len(loaded(new, source).scene.obstacles)
        except SceneError as error:
            raise SceneError("; ".join((str(error), *notes))) from None
        new.replace(target)
    if mapped or decompose:
        notes += (f"{target}: its robot is the {ROVER}, which turns almost on the spot; a command may name another",)
    return Imported(path=target, geoms=len(world.solids), obstacles=obstacles, notes=notes)


def _refuse_motions(source: Path) -> None:
    """Refuse what is no XML but opens as JSON does."""
    if content_of(source, "an SDF world file or the YAML file of a map").lstrip()[:1] == b"{":
        raise SceneError(f"{source}: this is no SDF world but JSON; if it is a file of motions, add --motion")


def _task(source: Path, kind: str, start: Sequence[float] | None, goal: Sequence[float] | None) -> tuple[Array, Array]:
    """Start (2,) or (3,) and goal disc (3,)."""
    options = START, GOAL
    if start is None or goal is None:
        missing = " and ".join(f"the {name}" for name, given in (("start", start), ("goal", goal)) if given is None)
        raise SceneError(f"{source}: a {kind} does not tell {missing}: give {' and '.join(options)}")
    place, disc = numbers_of(source, options[0], start, (2, 3)), numbers_of(source, options[1], goal, (3,))
    return place, disc


def _workspace(source: Path, world: World, given: Sequence[float] | None, start: Array, goal: Array) -> Array:
    """Left, right, low and high border [m]."""
    if given is not None:
        bounds = numbers_of(source, BORDER, given, (4,))
    elif world.ground is not None and max(np.diff(world.ground)[::2]) <= WIDEST:
        bounds = world.ground
    else:
        raise SceneError(f"{source}: no ground plane bounds it: add {_example(world, start, goal)}")
    check_borders(source, bounds)
    return bounds


def _example(world: World, start: Array, goal: Array) -> str:
    """How to say the workspace, with numbers that hold start, goal and what is in the world."""
    points = np.vstack([start[:2], goal[:2], *(solid.pose[None, :2, 3] for solid in world.solids)])
    low, high = np.floor(points.min(axis=0) - 1), np.ceil(points.max(axis=0) + 1)
    return f"{BORDER}, for example {low[0]:g} {high[0]:g} {low[1]:g} {high[1]:g}"


def _elements(solids: Sequence[Solid]) -> Iterator[tuple[str, str]]:
    """Write each solid as MJCF: its mesh, if it is one, and its geom; names that are taken get a number."""
    taken = {"floor"}
    for solid in solids:
        name, count = solid.name, 1
        while name in taken:
            count += 1
            name = f"{solid.name} {count}"
        taken.add(name)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, solid.pose[:3, :3].ravel())
        label, mesh, shape = quoteattr(name), "", f'size="{text(*solid.size)}"'
        if solid.vertices is not None:
            mesh, shape = f'<mesh name={label} vertex="{text(*solid.vertices.ravel())}"/>', f"mesh={label}"
        yield (
            mesh,
            f'<geom name={label} type="{solid.shape}" material="{_MATERIALS[solid.shape]}" {shape} '
            f'pos="{text(*solid.pose[:3, 3])}" quat="{text(*quaternion)}"/>',
        )
