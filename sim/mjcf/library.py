"""Where scenes and robots are found, and how their files become MuJoCo specs."""

from __future__ import annotations

import logging
from pathlib import Path

import mujoco

from pirrht.errors import SceneError
from sim.mjcf.numbers import refuse_nan

# Without a handler MuJoCo leaves a MUJOCO_LOG.TXT in the folder one happens to work in.
mujoco.set_mju_user_warning(logging.getLogger("mujoco").warning)


def models_folder() -> Path:
    """The folder with `scenes` and `robots`: inside the package when installed, beside it in a checkout."""
    here = Path(__file__).resolve().parents[1]
    return here / "models" if (here / "models").is_dir() else here.parent / "models"


def scene_names() -> tuple[str, ...]:
    """Names of the built-in scenes, sorted."""
    return _names("scenes")


def robot_names() -> tuple[str, ...]:
    """Names of the built-in robots, sorted."""
    return _names("robots")


def find(kind: str, which: str | Path) -> Path:
    """The file of a built-in scene or robot, or the path itself; `kind` is "scene" or "robot".

    Raises:
        SceneError: no such name and no such file.
    """
    names = _names(kind + "s")
    if isinstance(which, str) and which in names:
        return models_folder() / (kind + "s") / f"{which}.xml"
    path = Path(which)
    if not path.exists():
        known = ", ".join(names) or "none"
        raise SceneError(f"{path}: no such {kind}; give the path of an MJCF file or one of {known}")
    return path


def parse(path: Path) -> mujoco.MjSpec:
    """The spec of an MJCF file.

    Raises:
        SceneError: it is no file, not named .xml, unreadable, no MJCF, or holds what is not a number.
    """
    if not path.is_file():
        raise SceneError(f"{path}: this is a folder or device; give the path of an MJCF file in it")
    if path.suffix.lower() != ".xml":
        raise SceneError(f"{path}: MuJoCo reads MJCF from files that end in .xml; rename it")
    try:
        with path.open("rb") as stream:
            empty = not stream.read(1)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None
    if empty:
        raise SceneError(f"{path}: the file is empty; write an MJCF model with a <worldbody>")
    try:
        refuse_nan(path)
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError(f"{path}: not MJCF: {_one_line(error)}; mend the XML there") from None


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """The compiled model; SceneError names the file that is to blame."""
    try:
        return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError(f"{path}: MuJoCo cannot compile it: {_one_line(error)}; mend that element") from None


def _names(folder: str) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in (models_folder() / folder).glob("*.xml")))


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
