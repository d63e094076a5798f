"""Where scenes and robots are found, and how their files become MuJoCo specs."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path

import mujoco

from pirrht.errors import SceneError
from sim.files import MISSING, why_unreadable
from sim.mjcf import limits

mujoco.set_mju_user_warning(lambda text: None)  # without, it leaves a MUJOCO_LOG.TXT in the current folder


def models_folder() -> Path:
    """The folder with `scenes` and `robots`: inside the package when installed, next to it in a checkout."""
    here = Path(__file__).resolve().parents[1]
    return here / "models" if (here / "models").is_dir() else here.parent / "models"


def _names(folder: str) -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in (models_folder() / folder).glob("*.xml")))


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
        close = get_close_matches(str(which), names, 1)
        meant, what = f"did you mean {close[0]}? Else " if close else "", "file" if path.suffix else kind
        raise SceneError(f"{path}: no such {what}; {meant}give the path of an MJCF file or one of {', '.join(names)}")
    return path


def parse(path: Path) -> mujoco.MjSpec:
    """The spec of an MJCF file that keeps to `sim.mjcf.limits`."""
    limits.check(path)
    if path.suffix.lower() != ".xml" or any("\ud800" <= c <= "\udfff" for c in str(path)):
        raise SceneError(f"{path}: MuJoCo reads MJCF from files that end in .xml and whose names are text; rename it")
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
    with _refused(f"{path}: not MJCF: ", "; correct the XML there"):
        spec = mujoco.MjSpec.from_file(str(path))
    spec.nkey = spec.nuserdata = 0
    for name in dir(spec):
        if name in ("memory", "njmax", "nconmax", "nstack") or name.startswith("nuser_"):
            setattr(spec, name, -1)
    lent = models_folder() / "robots" / "meshes"  # for copies of built-in robots, whose meshes have stayed there
    for mesh in spec.meshes:
        there = lent / Path(mesh.file).name
        if mesh.file and not (path.parent / spec.meshdir / mesh.file).exists() and there.is_file():
            mesh.file = str(there)
    return spec


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """The compiled model; SceneError names the file that is to blame."""
    with _refused(f"{path}: MuJoCo cannot compile it: ", "; correct that element"):
        return spec.compile()


@contextmanager
def _refused(begin: str, end: str) -> Iterator[None]:
    """Make an error of MuJoCo a SceneError in one line; its warnings are of deprecated attributes, a line each."""
    try:
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            yield
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError(begin + " ".join(str(error).split()) + end) from None
