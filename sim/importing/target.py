"""The scene that an import writes: its text, and a draft that is loaded before it takes its place."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from string import Template
from xml.sax.saxutils import quoteattr

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.limits import FARTHEST, FINEST
from sim.mjcf import Loaded, load

START, GOAL, BORDER = "--start X Y [TH]", "--goal X Y R", "--workspace X0 X1 Y0 Y1"

_SCENE = Template("""\
<mujoco model=$name>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="Euler"/>
  <custom>
$custom
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
$assets
  </asset>
  <worldbody>
    <light name="sun" directional="true" pos="$centre 8" dir="0.30 0.45 -1" diffuse="0.40 0.40 0.38"/>
    <camera name="top" pos="$centre $height" xyaxes="1 0 0 0 1 0" fovy="42"/>
    <geom name="floor" type="plane" pos="$centre 0" size="$half 0.1" material="floor"/>
$parts
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
    obstacles: int  # of these, in the way of the robot and standing
    movers: int = 0  # bodies that move
    notes: tuple[str, ...] = ()  # sentences on what the scene has otherwise than the source


def check_target(source: Path, target: Path) -> None:
    """Refuse a target that can hold no scene, or is what is imported.

    Raises:
        SceneError: names the target and what would do.
    """
    if target.suffix.lower() != ".xml":
        raise SceneError(f"{target}: MuJoCo reads MJCF from files that end in .xml; name it so")
    if not target.parent.is_dir():
        raise SceneError(f"{target}: there is no folder {target.parent}; make it first")
    if target.is_dir() or (target.exists() and source.exists() and target.samefile(source)):
        raise SceneError(f"{target}: this is a folder or the world itself; choose another name")


@contextmanager
def draft(scene: str, target: Path) -> Iterator[Path]:
    """A file with the scene beside its target; gone at the end unless it took the target's place.

    Raises:
        SceneError: it cannot be written.
    """
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".import-", suffix=".xml")
        new = Path(name)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(scene)
            new.chmod(0o644)  # mkstemp's files are for their owner alone
            yield new
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        raise SceneError(f"{target}: cannot be written ({error.strerror}); choose another folder") from None


def loaded(draft: Path, source: Path) -> Loaded:
    """The scene as everybody will load it.

    Raises:
        SceneError: it breaks a convention; names the source.
    """
    try:
        return load(draft)
    except SceneError as error:
        reason = str(error).replace(str(draft), "as a scene").replace(draft.stem, source.stem)
        raise SceneError(f"{source}: {reason}") from None


def scene_text(
    name: str,
    custom: Sequence[str],
    parts: Sequence[str],
    start: Array,
    goal: Array,
    bounds: Array,
    assets: Sequence[str] = (),
) -> str:
    """The MJCF text.

    Args:
        custom: elements with defaults of options and with motions.
        parts: elements of the worldbody.
        start: x, y [m] and optionally the heading [rad].
        goal: x, y, radius [m].
        bounds: left, right, low and high border [m].
        assets: elements of the assets, as meshes.
    """
    half = (bounds[1::2] - bounds[::2]) / 2
    return _SCENE.substitute(
        name=quoteattr(name),
        centre=text(*(bounds[1::2] + bounds[::2]) / 2),
        half=text(*half),
        height=text(1.15 * max(half[1], half[0] * 3 / 4) / np.tan(np.radians(42 / 2))),  # of 4 to 3 pictures
        custom="\n".join(f"    {element}" for element in custom),
        assets="\n".join(f"    {element}" for element in assets),
        parts="\n".join(f"    {element}" for element in parts),
        start=text(*start[:2]),
        heading=text(*start[2:]) or "0",
        goal=text(*goal[:2]),
        radius=text(goal[2]),
    )


def numbers_of(source: Path, option: str, given: Sequence[float] | Array, counts: tuple[int, ...]) -> Array:
    """What was said under an option, as many numbers as it may have.

    Raises:
        SceneError: it is something else; names the option.
    """
    values = np.array(given, dtype=float)
    if len(values) not in counts or not np.all(np.abs(values) <= FARTHEST):
        raise SceneError(f"{source}: {list(given)} is no {option}; give {counts[-1]} finite numbers up to {FARTHEST:g}")
    if option == GOAL and not values[2] >= FINEST:
        raise SceneError(f"{source}: --goal: its radius is {values[2]:g}; it must be positive, {FINEST:g} or more")
    return values


def check_borders(source: Path, bounds: Array) -> None:
    """Refuse a workspace (4,) [m] without an inside.

    Raises:
        SceneError: names the option and what would do.
    """
    if not (bounds[0] < bounds[1] and bounds[2] < bounds[3]):
        raise SceneError(f"{source}: the workspace {bounds.tolist()} is empty; write {BORDER}, least first")


def text(*values: float) -> str:
    """Numbers as MJCF has them."""
    return " ".join(f"{value:.10g}" for value in values)
