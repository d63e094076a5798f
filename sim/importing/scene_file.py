"""Gazebo worlds and ROS maps as scenes: they become MJCF files by the conventions of `sim.mjcf`.

Neither says anything of a task, so start and goal are the caller's; the workspace is, too, unless the ground
plane has a size that is meant, or the map is not turned. The new file is loaded before it takes its place, so that a
file that is there already is never replaced by a broken one.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from string import Template
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from sim.importing import ros_map
from sim.importing.limits import FARTHEST, FINEST
from sim.importing.sdf import Solid, World, read_sdf
from sim.mjcf import load

BORDER = "--workspace X0 X1 Y0 Y1"
WIDEST = 50.0  # a larger ground is Gazebo's usual 100 m, and not meant as a workspace [m]
_MATERIALS = {
    "box": "crate",
    "cylinder": "drum",
    "capsule": "log",
    "sphere": "boulder",
    "ellipsoid": "boulder",
}
_SCENE = Template("""\
<mujoco model=$name>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="Euler"/>
  <custom>
    <text name="pirrht_robot" data="unicycle"/>
    <numeric name="pirrht_noise" data="0.03"/>
    <numeric name="pirrht_period" data="0.1"/>
    <numeric name="pirrht_dt" data="0.1"/>
    <numeric name="pirrht_samples" data="300"/>
    <numeric name="pirrht_limit" data="0.8"/>
    <numeric name="pirrht_vertices" data="2000"/>
    <numeric name="pirrht_classes" data="16"/>
    <numeric name="pirrht_phi" data="1000"/>
    <numeric name="pirrht_max_time" data="60"/>
  </custom>
  <visual>
    <global offwidth="1280" offheight="960"/>
    <quality shadowsize="4096"/>
    <headlight ambient="0.42 0.42 0.42" diffuse="0.22 0.22 0.22" specular="0 0 0"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" width="256" height="256"
             rgb1="0.86 0.90 0.94" rgb2="0.55 0.63 0.72"/>
    <texture name="tiles" type="2d" builtin="checker" width="512" height="512"
             rgb1="0.86 0.87 0.88" rgb2="0.82 0.835 0.85"/>
    <material name="floor" texture="tiles" texrepeat="1 1" texuniform="true"/>
    <material name="crate" rgba="0.27 0.33 0.42 1" specular="0.3" shininess="0.4"/>
    <material name="drum" rgba="0.66 0.36 0.28 1" specular="0.2" shininess="0.3"/>
    <material name="log" rgba="0.80 0.68 0.47 1" specular="0.2" shininess="0.3"/>
    <material name="boulder" rgba="0.42 0.52 0.38 1" specular="0.2" shininess="0.3"/>
  </asset>
  <worldbody>
    <light name="sun" directional="true" pos="$centre 8" dir="0.30 0.45 -1" diffuse="0.40 0.40 0.38"/>
    <camera name="top" pos="$centre $height" xyaxes="1 0 0 0 1 0" fovy="42"/>
    <geom name="floor" type="plane" pos="$centre 0" size="$half 0.1" material="floor"/>
$geoms
    <site name="workspace" type="box" pos="$centre 0.5" size="$half 0.5" group="4" rgba="0.4 0.5 0.6 0.05"/>
    <site name="start" type="cylinder" pos="$start 0.002" size="0.08 0.002" euler="0 0 $heading"
          rgba="0.20 0.45 0.75 0.8"/>
    <site name="goal" type="cylinder" pos="$goal 0.01" size="$radius 0.01" rgba="0.25 0.65 0.35 0.7"/>
  </worldbody>
</mujoco>
""")


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """A scene that was made from a world."""

    path: Path  # of the new MJCF file
    geoms: int  # shapes taken over
    obstacles: int  # of these, in the way of the robot


def import_world(
    source: Path,
    target: Path,
    *,
    start: Sequence[float] | None = None,
    goal: Sequence[float] | None = None,
    workspace: Sequence[float] | None = None,
    unknown: str | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Imported:
    """Write the static obstacles of an SDF world, or the walls of a ROS map, as a scene for the unicycle.

    Args:
        source: an SDF file with one world, or the YAML file of a map.
        target: the MJCF file to write; replaced in one go if it exists.
        start: x, y [m] and optionally the heading [rad].
        goal: x, y, radius [m].
        workspace: x0, x1, y0, y1, the box that holds the robot's centre [m].
        unknown: whether cells of a map that are unknown are "occupied" (default) or "free".
        progress: told how many of how many cells of a map, or shapes of a world, are done, now and then.

    Raises:
        SceneError: the world has something that cannot be taken over, start, goal or workspace are missing or
            do not fit, or the target cannot be written. The target is then as it was.
    """
    source, target = Path(source), Path(target)
    _check_target(source, target)
    if source.suffix.lower() in ros_map.PICTURES:
        raise SceneError(f"{source}: a picture tells neither scale nor place; give the map's .yaml")
    mapped = source.suffix.lower() in ros_map.SUFFIXES
    if mapped:
        world = ros_map.read_map(source).world(unknown or "occupied", progress)
        workspace = world.ground.tolist() if workspace is None and world.ground is not None else workspace
    elif unknown is not None:
        raise OptionError(f"--unknown is for maps, whose names end in {' or '.join(ros_map.SUFFIXES)}; leave it out")
    else:
        world = read_sdf(source, progress)
    place, goal_disc = _task(source, "map" if mapped else "world", start, goal)
    if workspace is None and mapped and world.ground is None:
        raise SceneError(f"{source}: a turned map needs {_example(world, place, goal_disc)}")
    bounds = _workspace(source, world, workspace, place, goal_disc)
    scene = _scene(target.stem, world.solids, place, goal_disc, bounds)
    with _draft(scene, target) as draft:
        obstacles = _count_obstacles(draft, source)
        draft.replace(target)
    return Imported(path=target, geoms=len(world.solids), obstacles=obstacles)


def _check_target(source: Path, target: Path) -> None:
    if target.suffix.lower() != ".xml":
        raise SceneError(f"{target}: MuJoCo reads MJCF from files that end in .xml; name it so")
    if not target.parent.is_dir():
        raise SceneError(f"{target}: there is no folder {target.parent}; make it first")
    if target.is_dir() or (target.exists() and source.exists() and target.samefile(source)):
        raise SceneError(f"{target}: this is a folder or the world itself; choose another name")


def _task(source: Path, kind: str, start: Sequence[float] | None, goal: Sequence[float] | None) -> tuple[Array, Array]:
    """Start (2,) or (3,) and goal disc (3,)."""
    options = "--start X Y [TH]", "--goal X Y R"
    if start is None or goal is None:
        missing = " and ".join(f"the {name}" for name, given in (("start", start), ("goal", goal)) if given is None)
        raise SceneError(f"{source}: a {kind} does not tell {missing}: give {' and '.join(options)}")
    place, disc = _numbers(source, options[0], start, (2, 3)), _numbers(source, options[1], goal, (3,))
    if not disc[2] >= FINEST:
        raise SceneError(f"{source}: --goal: its radius is {disc[2]:g}; it must be positive, {FINEST:g} or more")
    return place, disc


def _numbers(source: Path, option: str, given: Sequence[float] | Array, counts: tuple[int, ...]) -> Array:
    values = np.array(given, dtype=float)
    if len(values) not in counts or not np.all(np.abs(values) <= FARTHEST):
        raise SceneError(f"{source}: {list(given)} is no {option}; give {counts[-1]} finite numbers up to {FARTHEST:g}")
    return values


def _workspace(source: Path, world: World, given: Sequence[float] | None, start: Array, goal: Array) -> Array:
    """Left, right, low and high border [m]."""
    if given is not None:
        bounds = _numbers(source, BORDER, given, (4,))
    elif world.ground is not None and max(np.diff(world.ground)[::2]) <= WIDEST:
        bounds = world.ground
    else:
        raise SceneError(f"{source}: no ground plane bounds it: add {_example(world, start, goal)}")
    if not (bounds[0] < bounds[1] and bounds[2] < bounds[3]):
        raise SceneError(f"{source}: the workspace {bounds.tolist()} is empty; write {BORDER}, least first")
    return bounds


def _example(world: World, start: Array, goal: Array) -> str:
    """How to say the workspace, with numbers that hold start, goal and what is in the world."""
    points = np.vstack([start[:2], goal[:2], *(solid.pose[None, :2, 3] for solid in world.solids)])
    low, high = np.floor(points.min(axis=0) - 1), np.ceil(points.max(axis=0) + 1)
    return f"{BORDER}, for example {low[0]:g} {high[0]:g} {low[1]:g} {high[1]:g}"


def _count_obstacles(draft: Path, source: Path) -> int:
    """Load the scene as everybody will; its obstacles count."""
    try:
        loaded = load(draft)
    except SceneError as error:
        reason = str(error).replace(str(draft), "as a scene").replace(draft.stem, source.stem)
        raise SceneError(f"{source}: {reason}") from None
    return len(loaded.scene.obstacles)


@contextmanager
def _draft(scene: str, target: Path) -> Iterator[Path]:
    """A file with the scene beside its target; gone at the end unless it took the target's place."""
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".import-", suffix=".xml")
        draft = Path(name)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(scene)
            draft.chmod(0o644)  # mkstemp's files are for their owner alone
            yield draft
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise SceneError(f"{target}: cannot be written ({error.strerror}); choose another folder") from None


def _scene(name: str, solids: Sequence[Solid], start: Array, goal: Array, bounds: Array) -> str:
    """The MJCF text."""
    half = (bounds[1::2] - bounds[::2]) / 2
    return _SCENE.substitute(
        name=quoteattr(name),
        centre=_text(*(bounds[1::2] + bounds[::2]) / 2),
        half=_text(*half),
        height=_text(1.15 * max(half[1], half[0] * 3 / 4) / np.tan(np.radians(42 / 2))),  # of 4 to 3 pictures
        geoms="\n".join(_geoms(solids)),
        start=_text(*start[:2]),
        heading=_text(*start[2:]) or "0",
        goal=_text(*goal[:2]),
        radius=_text(goal[2]),
    )


def _geoms(solids: Sequence[Solid]) -> Iterator[str]:
    """MJCF elements, with a number after names that are taken."""
    taken = {"floor"}
    for solid in solids:
        name, count = solid.name, 1
        while name in taken:
            count += 1
            name = f"{solid.name} {count}"
        taken.add(name)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, solid.pose[:3, :3].ravel())
        yield (
            f'    <geom name={quoteattr(name)} type="{solid.shape}" material="{_MATERIALS[solid.shape]}" '
            f'size="{_text(*solid.size)}" pos="{_text(*solid.pose[:3, 3])}" quat="{_text(*quaternion)}"/>'
        )


def _text(*values: float) -> str:
    return " ".join(f"{value:.10g}" for value in values)
