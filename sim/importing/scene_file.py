"""Gazebo worlds, ROS maps and bags, meshes and motions as scenes: MJCF files by the conventions of `sim.mjcf`.

Neither a world nor a map says anything of a task, so start and goal are the caller's; the workspace is, too, unless
the ground plane has a size that is meant, or the map is not turned. The new file is loaded before it takes its place,
so that a file that is there already is never replaced by a broken one.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.collision import Collision
from pirrht.geometry.fitting import fitted
from sim.importing import dynabarn, meshes, ros_bag, ros_map, voxels
from sim.importing.sdf import read_sdf
from sim.importing.solids import World, distinct, raised_floor, text
from sim.mjcf import load, models_folder
from sim.mjcf.library import FARTHEST, FINEST, content_of
from sim.mjcf.load import SMALLER
from sim.states import ADAPTERS

WIDEST = 50.0  # a larger ground is Gazebo's usual 100 m, and not meant as a workspace [m]
ROVER = "rover"  # robots that map with a lidar turn on the spot, or nearly
_OPTIONS = {
    **{"period": "0.1", "dt": "0.1", "samples": "300", "limit": "0.8", "vertices": "2000"},
    **{"classes": "16", "phi": "1000", "max_time": "60"},
}
IN_SPACE = {"robot": "ball", "noise": "0.35", "vertices": "2000", "classes": "16", "phi": "1000", "max_time": "60"}
_SUFFIXES = {
    "motions": dynabarn.SUFFIXES, "map": ros_map.SUFFIXES, "bag": ros_bag.SUFFIXES, "mesh": meshes.SUFFIXES,
    "grid": voxels.SUFFIXES,
}  # fmt: skip
_KINDS = {suffix: kind for kind, suffixes in _SUFFIXES.items() for suffix in suffixes}  # all others are worlds
_MATERIALS = {"box": "crate", "mesh": "crate", "cylinder": "drum", "capsule": "log"}  # others are boulders


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """A scene that was made from a world."""

    path: Path  # of the new MJCF file
    geoms: int  # shapes taken over
    obstacles: int  # of these, static and in the height range of the robot
    movers: int = 0  # moving obstacles
    notes: tuple[str, ...] = ()  # sentences on what the scene has otherwise than the source


def import_world(
    source: Path, target: Path, *, start: Sequence[float] | None = None, goal: Sequence[float] | None = None,
    workspace: Sequence[float] | None = None, unknown: str | None = None, motion: bool = False,
    number: str | None = None, decompose: bool = False, cell: float | None = None, models: Sequence[Path] = (),
    without: Sequence[str] = (), topics: Sequence[str] = (),
) -> Imported:  # fmt: skip
    """Write the obstacles of an SDF world as a scene for the unicycle, of a ROS map for the rover.

    A mesh or world is a scene in space, for the ball, if the goal has four numbers, and a grid of voxels always is.

    Args:
        source: an SDF file with one world or with models, the YAML file of a map, a mesh, a grid of voxels, a bag of
            ROS, or a file of motions.
        target: the MJCF file to write; replaced in one go if it exists.
        start: x, y [m] and optionally the heading [rad]; in space x, y, z.
        goal: x, y, radius [m]; in space x, y, z, radius.
        workspace: x0, x1, y0, y1 and in space z0, z1, the box that holds the robot's centre [m].
        unknown: whether cells of a map that are unknown are "occupied" (default) or "free".
        motion, number: it is a file of motions, whatever its name ends in, and which of its worlds.
        decompose: it is a mesh, of which convex parts are made; so they are without.
        cell: side of a voxel [m], where the file of a grid does not have it.
        models: folders where models and meshes of an SDF world are searched for, before those around the file.
        without: names of models of an SDF world to leave out, like the robot.
        topics: choose among several of a kind in a bag.

    Raises:
        SceneError: something cannot be taken over, start, goal or workspace are missing or do not fit, or the target
            cannot be written. It is then as it was.
    """
    kind = "motions" if motion else _KINDS.get(source.suffix.lower(), "world")
    kind = "bag" if (source / ros_bag.INSIDE).is_file() else kind
    what = "the JSON file of a set of motions" if kind == "motions" else "an SDF world file or the YAML file of a map"
    dimension = 3 if kind == "grid" or (kind in ("mesh", "world") and len(goal or ()) == 4) else 2
    remedy = {"grid": "cut out a part, or join voxels"}.get(kind, "remove what is no obstacle")
    content = b"" if kind == "bag" else content_of(source, what, remedy)
    _check_target(source, target)
    _check_options(source, kind, decompose=decompose, without=without, unknown=unknown, number=number, cell=cell,
                   topics=topics)  # fmt: skip
    if kind == "world":
        _check_world(source, content)
    read: dict[str, Callable[[], World]] = {
        "motions": lambda: dynabarn.read(source, number),
        "map": lambda: ros_map.read_map(source, unknown or "occupied"),
        "bag": lambda: ros_bag.read_bag(source, topics, unknown or "occupied"),
        "mesh": lambda: meshes.read_mesh(source, dimension),
        "grid": lambda: voxels.read_voxels(source, cell),
        "world": lambda: read_sdf(source, models, without),
    }
    world = read[kind]()
    scene = _scene_text(source, target.stem, world, (start, goal, workspace), dimension)
    obstacles, movers = _write(scene, source, target, world, (start or world.start, goal or world.goal))
    turns = f"{target}: the scene is for the {ROVER}, which turns on the spot; --robot takes another robot"
    notes = (*world.notes, *([turns] if kind in ("map", "bag", "mesh") and dimension == 2 else []))
    geoms = len(world.solids) + len(world.bodies)
    return Imported(path=target, geoms=geoms, obstacles=obstacles, movers=movers, notes=notes)


def _check_options(
    source: Path, kind: str, *, decompose: bool, without: Sequence[str], unknown: str | None, number: str | None,
    cell: float | None, topics: Sequence[str],
) -> None:  # fmt: skip
    """Refuse options of other kinds of files."""
    for given, of, words in (
        (decompose, "mesh", f"--decompose is for meshes, {', '.join(meshes.SUFFIXES)}; leave it out"),
        (without, "world", f"{source}: only models of a Gazebo world can be left out by name"),
        (unknown, "map bag", f"--unknown is for maps, {' or '.join(ros_map.SUFFIXES)}, and bags; leave it out"),
        (topics, "bag", f"--topic is for bags of ROS, {', '.join(ros_bag.SUFFIXES)} or a folder; leave it out"),
        (number, "motions", "--world is for files of motions (--motion); leave it out"),
        (cell is not None, "grid", f"--cell is for grids of voxels, {', '.join(voxels.SUFFIXES)}; leave it out"),
    ):
        if given and kind not in of.split():
            raise OptionError(words)


def _check_target(source: Path, target: Path) -> None:
    """Refuse a name under which no scene can be written."""
    if target.suffix.lower() != ".xml":
        raise SceneError(f"{target}: MuJoCo reads MJCF from files that end in .xml; name it so")
    if target.exists() and target.samefile(source):
        raise SceneError(f"{target}: this is the world itself; choose another name")


def _check_world(source: Path, content: bytes) -> None:
    """Refuse files that are no worlds, by name of what they are."""
    if source.suffix.lower() in ros_map.PICTURES:
        raise SceneError(f"{source}: a picture has neither scale nor place; give the map's .yaml")
    if content.lstrip()[:1] == b"{":
        raise SceneError(f"{source}: this is no SDF world but JSON; if it is a file of motions, add --motion")


def _write(
    scene: str, source: Path, target: Path, world: World, ends: Sequence[Sequence[float] | None]
) -> tuple[int, int]:
    """Write a scene next to its target, load it, and let it take the target's place; its obstacles and movers.

    Start and goal, the `ends`, must be free for the robot and the margin with which it is planned in.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=".import-", dir=target.parent) as folder:
            new = Path(folder) / f"{source.stem}.xml"
            new.write_text(scene, encoding="utf-8")
            robot = ""
            try:
                loaded = load(new, start=ends[0])
                found, robot = loaded.scene, f"; its robot is the {loaded.robot}"
                fitted(found, Collision(found.world, found.footprint))
            except SceneError as error:
                reason = str(error).removeprefix(f"{new}: ").removeprefix(f"{new.stem}: ").removesuffix(SMALLER)
                under = ends if len(ends[1] or ()) == 3 else ()  # of a robot in the plane
                reason = raised_floor(world, under) or reason.replace(str(new), "as a scene")
                raise SceneError("; ".join((f"{source}: {reason}{robot}", *world.notes))) from None
            new.replace(target)
    except OSError as error:
        raise SceneError(f"{target}: cannot be written ({error.strerror}); choose another folder") from None
    return len(found.obstacles), len(found.movers)


def _scene_text(source: Path, name: str, world: World, task: Sequence[Sequence[float] | None], dimension: int) -> str:
    """The MJCF text of a world, given start, goal and workspace, if they were, for a robot in the plane or in space."""
    place, ball = _task(source, world, task, dimension)
    bounds = _workspace(source, world, task[2], np.vstack([place[:dimension], ball[:-1]]))
    bounds = np.append(bounds, [0.0, 1.0])[:6]  # the site of a workspace in the plane is a metre high
    centre = (bounds[1::2] + bounds[::2]) / 2
    half = (bounds[1::2] - bounds[::2]) / 2
    above = 1.15 * max(half[1], half[0] * 3 / 4) / np.tan(np.radians(42 / 2))  # of an eye for pictures of 4 to 3
    assets, geoms = _elements(world)
    lines = {"custom": _custom(world, dimension), "assets": assets, "parts": [*geoms, *world.bodies]}
    template = Template((models_folder() / "templates" / "imported.xml").read_text())
    heading = text(*place[2:]) if len(place) > dimension else "0"
    if dimension == 3:
        begin = f'pos="{text(*place)}" size="0.06"'
        end = f'type="sphere" pos="{text(*ball[:3])}" size="{text(ball[3])}"'
    else:
        begin = f'type="cylinder" pos="{text(*place[:2])} 0.002" size="0.08 0.002" euler="0 0 {heading}"'
        end = f'type="cylinder" pos="{text(*ball[:2])} 0.01" size="{text(ball[2])} 0.01"'
    return template.substitute(
        {key: "\n".join(f"    {element}" for element in elements) for key, elements in lines.items()},
        name=quoteattr(name), centre=text(*centre), half=text(*half), start=begin, goal=end,
        middle=text(*centre[:2]), sides=text(*half[:2]), floor=text(bounds[4]), sun=text(bounds[4] + 8),
        height=text(bounds[4] + above), seen=' contype="0" conaffinity="0"' if dimension == 3 else "",
    )  # fmt: skip


def _task(source: Path, world: World, task: Sequence[Sequence[float] | None], dimension: int) -> tuple[Array, Array]:
    """Start and goal, as given, or else the world's: (2,) or (3,) and (3,), in space (3,) and (4,)."""
    start = task[0] or world.start
    goal = task[1] or world.goal
    begin = f"--start {' '.join(ADAPTERS[dimension - 2].start_form)}"
    end = f"--goal {' '.join(ADAPTERS[dimension - 2].goal_form)}"

    if start is None or goal is None:
        missing = " and ".join(f"the {what}" for what, one in (("start", start), ("goal", goal)) if one is None)
        more = ", or X Y Z and X Y Z R in space" if world.kind == "mesh" and dimension == 2 else ""
        raise SceneError(f"{source}: this {world.kind} does not name {missing}: give {begin} and {end}{more}")
    place = _numbers(source, begin, start, (dimension, 3))
    ball = _numbers(source, end, goal, (dimension + 1,))

    if not ball[-1] >= FINEST:
        raise SceneError(f"{source}: --goal: its radius is {ball[-1]:g}; it must be positive, {FINEST:g} or more")
    return place, ball


def _custom(world: World, dimension: int) -> list[str]:
    """Elements with the options and motions of a scene."""
    gazebo = world.kind == "world"
    own = {"robot": "unicycle", "noise": "0.03"} if gazebo else {"robot": ROVER}
    options = IN_SPACE if dimension == 3 else world.options or {**own, **_OPTIONS}
    kinds = {"robot": "text"}  # all others are numbers
    return [
        *(f'<{kinds.get(key, "numeric")} name="pirrht_{key}" data="{value}"/>' for key, value in options.items()),
        *world.custom,
    ]


def _elements(world: World) -> tuple[list[str], list[str]]:
    """Elements of the meshes and geoms of a world's solids."""
    assets: list[str] = []
    geoms: list[str] = []
    for solid, label in zip(world.solids, distinct((solid.name for solid in world.solids), {"floor"}), strict=True):
        material = _MATERIALS.get(solid.shape, "boulder")
        quaternion = np.zeros(4)
        called = quoteattr(label)
        shape = f'size="{text(*solid.size)}"'
        mujoco.mju_mat2Quat(quaternion, solid.pose[:3, :3].ravel())
        if solid.vertices is not None:
            assets.append(f'<mesh name={called} vertex="{text(*solid.vertices.ravel())}"/>')
            shape = f"mesh={called}"
        geoms.append(
            f'<geom name={called} type="{solid.shape}" material="{material}" {shape} '
            f'pos="{text(*solid.pose[:3, 3])}" quat="{text(*quaternion)}"/>'
        )
    return assets, geoms


def _numbers(source: Path, option: str, given: Sequence[float] | Array, counts: tuple[int, ...]) -> Array:
    """Read the numbers given under an option, as many as it may have."""
    values = np.array(given, dtype=float)
    if len(values) not in counts or not np.all(np.abs(values) <= FARTHEST):
        raise SceneError(f"{source}: {list(given)} is no {option}; give {counts[-1]} finite numbers up to {FARTHEST:g}")
    return values


def _workspace(source: Path, world: World, given: Sequence[float] | None, points: Array) -> Array:
    """Least and greatest border by axis [m]; the error has an example that holds points (k, d) and the world."""
    d = points.shape[1]
    border = f"--workspace {' '.join(ADAPTERS[d - 2].workspace_form)}"
    known = np.empty(0) if world.ground is None else world.ground[: 2 * d]
    meant = len(known) == 2 * d and (world.kind == "map" or d == 3 or max(np.diff(known)[::2]) <= WIDEST)
    if meant and world.kind == "mesh":
        meant = bool(np.all((points > known[::2]) & (points < known[1::2])))
    if given is None and not meant:
        points = np.vstack([points, *(solid.pose[None, :d, 3] for solid in world.solids)])
        ends = np.column_stack([np.floor(points.min(axis=0) - 1), np.ceil(points.max(axis=0) + 1)]).ravel()
        mesh = f"the box around the mesh leaves out start or goal, or is wider than {WIDEST:g} m: add"
        why = {"map": "a turned map needs", "mesh": mesh}.get(world.kind, "no ground plane bounds it: add")
        raise SceneError(f"{source}: {why} {border}, for example {' '.join(f'{end:g}' for end in ends)}")
    bounds = _numbers(source, border, known if given is None else given, (2 * d,))
    if not np.all(bounds[::2] < bounds[1::2]):
        raise SceneError(f"{source}: the workspace {bounds.tolist()} is empty; write {border}, least first")
    return bounds
