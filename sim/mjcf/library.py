"""Where scenes and robots are found, and how their files become MuJoCo specs."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import mujoco

from pirrht.errors import SceneError
from sim.files import MISSING, why_unreadable
from sim.mjcf import limits

# Without a handler MuJoCo leaves a MUJOCO_LOG.TXT in the folder one happens to work in, and Python prints the warning.
logging.getLogger("mujoco").addHandler(logging.NullHandler())
mujoco.set_mju_user_warning(logging.getLogger("mujoco").warning)

_SIZES = {
    **dict.fromkeys(("nkey", "nuserdata"), 0),
    **dict.fromkeys(("memory", "njmax", "nconmax", "nstack"), -1),
    **{f"nuser_{kind}": -1 for kind in ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")},
}  # as in a file without the element `size`


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
    if why_unreadable(path) == MISSING:
        known = ", ".join(names) or "none"
        raise SceneError(f"{path}: no such {kind}; give the path of an MJCF file or one of {known}")
    return path


def parse(path: Path) -> mujoco.MjSpec:
    """The spec of an MJCF file.

    Raises:
        SceneError: it is no file, not named .xml, unreadable, no MJCF, asks for more than `sim.mjcf.limits` allows,
            or holds what is not a number.
    """
    why = why_unreadable(path)
    if why is not None:
        raise SceneError(f"{path}: this {why}; give the path of an MJCF file that may be read")
    if path.suffix.lower() != ".xml":
        raise SceneError(f"{path}: MuJoCo reads MJCF from files that end in .xml; rename it")
    if path.stat().st_size == 0:
        raise SceneError(f"{path}: the file is empty; write an MJCF model with a <worldbody>")
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise SceneError(f"{path}: MuJoCo opens files whose names are UTF-8 text; rename it") from None
    limits.check(path)
    if not path.resolve().is_relative_to(models_folder()):
        found = path.stat()
        _tried(path, found.st_mtime_ns, found.st_size)
    return _read(path)


@lru_cache(maxsize=64)
def _tried(path: Path, *_: int) -> None:
    """Try a file; one that can be read is not tried again while its time and size stay."""
    limits.trial(path, lambda: _pose(path))


def _pose(path: Path) -> None:
    spec = _read(path)
    for key in list(spec.keys):
        spec.delete(key)
    model = compile_spec(spec, path)
    mujoco.mj_kinematics(model, mujoco.MjData(model))


def _read(path: Path) -> mujoco.MjSpec:
    """The spec of a file, without what it says of the sizes of memory: MuJoCo knows them itself."""
    try:
        with _quiet():
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError(f"{path}: not MJCF: {_one_line(error)}; correct the XML there") from None
    for name, value in _SIZES.items():
        setattr(spec, name, value)
    _lend_meshes(spec, path)
    return spec


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep to themselves the warnings by which MuJoCo speaks of deprecated attributes, a line each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def _lend_meshes(spec: mujoco.MjSpec, path: Path) -> None:
    """Let a copy of a built-in robot use its meshes, which have stayed where they were."""
    folder = models_folder() / "robots" / "meshes"
    for mesh in spec.meshes:
        lent = folder / Path(mesh.file).name
        if mesh.file and not (path.parent / spec.meshdir / mesh.file).exists() and lent.is_file():
            mesh.file = str(lent)


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """The compiled model; SceneError names the file that is to blame."""
    try:
        with _quiet():
            return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError(f"{path}: MuJoCo cannot compile it: {_one_line(error)}; correct that element") from None


def _names(folder: str) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in (models_folder() / folder).glob("*.xml")))


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
