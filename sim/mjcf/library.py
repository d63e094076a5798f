"""Where scenes and robots are found, and how their files become MuJoCo specs."""

from __future__ import annotations

import re
import warnings
from collections import deque
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path

import mujoco

from pirrht.errors import SceneError
from sim.files import MISSING, why_unreadable
from sim.mjcf import limits

# Without a handler MuJoCo leaves a MUJOCO_LOG.TXT in the folder one happens to work in.
_heard: deque[str] = deque(maxlen=8)
mujoco.set_mju_user_warning(_heard.append)

_SIZES = {
    **dict.fromkeys(("nkey", "nuserdata"), 0),
    **dict.fromkeys(("memory", "njmax", "nconmax", "nstack"), -1),
    **{f"nuser_{kind}": -1 for kind in ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")},
}  # as in a file without the element `size`


def models_folder() -> Path:
    """The folder with `scenes` and `robots`: inside the package when installed, next to it in a checkout."""
    here = Path(__file__).resolve().parents[1]
    return here / "models" if (here / "models").is_dir() else here.parent / "models"


def scene_names() -> tuple[str, ...]:
    """Names of the built-in scenes, sorted."""
    return _names("scenes")


def robot_names() -> tuple[str, ...]:
    """Names of the built-in robots, sorted."""
    return _names("robots")


def find(kind: str, which: str | Path) -> Path:
    """The file of a built-in scene or robot, or the path itself; `kind` is "scene" or "robot"."""
    names = _names(kind + "s")
    if isinstance(which, str) and which in names:
        return models_folder() / (kind + "s") / f"{which}.xml"
    path = Path(which)
    if why_unreadable(path) == MISSING:
        known, close = ", ".join(names) or "none", get_close_matches(str(which), names, 1)
        meant, what = f"did you mean {close[0]}? Else " if close else "", "file" if path.suffix else kind
        raise SceneError(f"{path}: no such {what}; {meant}give the path of an MJCF file or one of {known}")
    return path


def parse(path: Path) -> mujoco.MjSpec:
    """The spec of an MJCF file that keeps to `sim.mjcf.limits`."""
    why = why_unreadable(path)
    if why is not None:
        raise SceneError(f"{path}: this {why}; give the path of an MJCF file that may be read")
    if path.suffix.lower() != ".xml" or any("\ud800" <= c <= "\udfff" for c in str(path)):
        raise SceneError(f"{path}: MuJoCo reads MJCF from files that end in .xml and whose names are text; rename it")
    if path.stat().st_size == 0:
        raise SceneError(f"{path}: the file is empty; write an MJCF model with a <worldbody>")
    limits.check(path)
    if not path.resolve().is_relative_to(models_folder()):
        _tried(path, path.stat().st_mtime_ns, path.stat().st_size)
    return _read(path)


@lru_cache(maxsize=64)
def _tried(path: Path, *_: int) -> None:
    """Try a file; one that can be read is not tried again while its time and size stay."""
    limits.trial(path, lambda: _compiled(path))


def _compiled(path: Path) -> None:
    spec = _read(path)
    for key in list(spec.keys):
        spec.delete(key)
    model = compile_spec(spec, path)
    mujoco.mj_kinematics(model, mujoco.MjData(model))
    limits.check_parts(path, model.nbody + model.ngeom + model.nsite)
    try:
        _ = model.names.decode(), [text.data for text in spec.texts]
    except UnicodeError:
        raise SceneError(f"{path}: it has names that are not UTF-8 text; rename them") from None


def _read(path: Path) -> mujoco.MjSpec:
    """The spec of a file, without what it says of the sizes of memory: MuJoCo knows them itself."""
    _heard.clear()
    try:
        with warnings.catch_warnings(action="ignore", category=UserWarning):  # of deprecated attributes, a line each
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError(f"{path}: not MJCF: {' '.join(str(error).split())}; correct the XML there") from None
    if any("NaN" in words for words in _heard):
        tag = re.search(r"<[^<>]*[\"' +-]nan\b[^<>]*>", path.read_text(errors="replace"), re.IGNORECASE)
        where = " ".join(tag[0].split())[:100] if tag else "an element"
        raise SceneError(f"{path}: {where} has nan for a number; write numbers")
    for name, value in _SIZES.items():
        setattr(spec, name, value)
    lent = models_folder() / "robots" / "meshes"  # for copies of built-in robots, whose meshes have stayed there
    for mesh in spec.meshes:
        there = lent / Path(mesh.file).name
        if mesh.file and not (path.parent / spec.meshdir / mesh.file).exists() and there.is_file():
            mesh.file = str(there)
    return spec


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """The compiled model; SceneError names the file that is to blame."""
    try:
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            return spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        words = " ".join(str(error).split())
        raise SceneError(f"{path}: MuJoCo cannot compile it: {words}; correct that element") from None


def _names(folder: str) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in (models_folder() / folder).glob("*.xml")))
