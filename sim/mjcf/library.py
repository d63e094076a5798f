"""Where scenes and robots are found, how their files become MuJoCo specs, and how files of other people are refused.

MuJoCo opens whatever a file names and allocates whatever it asks for. Here every named file is regular and of bounded
size; then a child process of bounded memory and time reads and compiles the scene before this one does.
"""

import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from html import unescape
from itertools import chain, product
from math import prod
from pathlib import Path
from typing import TypeVar

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import PirrhtError, SceneError, printable
from pirrht.geometry.tuning import TUNING
from sim.files import MISSING, why_unreadable
from sim.text import suggestion

FARTHEST = TUNING.farthest  # of any coordinate or measure [m] and angle [rad]
FINEST = 1e-6  # of any measure of an imported file [m]
LARGEST_TEXT = 32 * 2**20  # bytes; worlds of the BARN data set have one megabyte
LARGEST_FILE = 128 * 2**20  # bytes
MOST_PARTS = 60_000  # bodies, geoms and sites of an MJCF file with all that it includes: MuJoCo takes 7 s for them
MOST_OF = {b"count": 10_000, b"dim": 10**6, b"nrow": 2**24, b"ncol": 2**24, b"width": 2**26, b"height": 2**26}
MOST_PLACES = 100_000  # where named files are searched
MOST_ELEMENTS, MOST_LEVELS, MOST_NESTED = 300_000, 256, 32  # of an SDF world with all that it includes
MOST_TRIANGLES = 1_000_000  # of a COLLADA file, in all its instances
MOST_PIXELS = 25_000_000  # of a map: 250 m square at 0.05 m; a pixel takes 64 bytes on the way
SHOWN = 6  # names or faults in a line
MEMORY, CPU, WALL = 2 * 2**30, 20, 120  # of the trial: bytes beyond what this process has, and seconds

_NAMED = re.compile(
    rb"""\b(file\w*|count|dim|nrow|ncol|width|height|meshdir|texturedir|assetdir)\s*=\s*(?:"([^"]*)"|'([^']*)')"""
)
_PART = re.compile(rb"<!--.*?(?:-->|\Z)|<(body|geom|site)\b", re.DOTALL)  # and comments, which hold none
_READ, _FOREIGN = "read", (ValueError, RuntimeError, mujoco.FatalError)  # what MuJoCo raises
T = TypeVar("T")
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
        what = f"{'file' if path.suffix else kind}{suggestion(which, names)}"
        raise SceneError(f"{path}: no such {what}; give the path of an MJCF file or one of {', '.join(names)}")
    return path


def parse(path: Path) -> mujoco.MjSpec:
    """The spec of an MJCF file that keeps to the limits here."""
    check(path)
    if path.suffix.lower() != ".xml" or any("\ud800" <= c <= "\udfff" for c in str(path)):
        raise SceneError(f"{path}: MuJoCo reads MJCF from files that end in .xml and whose names are text; rename it")
    if not path.resolve().is_relative_to(models_folder()):
        _tried(path, path.stat().st_mtime_ns, path.stat().st_size)
    return _read(path)


@lru_cache(maxsize=64)
def _tried(path: Path, *_: int) -> None:
    """Try a file; one that can be read is not tried again while its time and size stay."""

    def compiled() -> None:
        spec = _read(path)
        delete(spec, spec.keys)
        model = compile_spec(spec, path)
        mujoco.mj_kinematics(model, mujoco.MjData(model))
        check_parts(path, model.nbody + model.ngeom + model.nsite)
        with refused(f"{path}: it has names that are not UTF-8 text; rename them", "", UnicodeError, most=0):
            _ = model.names.decode(), [text.data for text in spec.texts]

    trial(path, compiled)


def _read(path: Path) -> mujoco.MjSpec:
    """The spec of a file, without what it says of the sizes of memory: MuJoCo knows them itself."""
    with refused(f"{path}: not MJCF: ", "; correct the XML there", *_FOREIGN):
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


def delete(spec: mujoco.MjSpec, *groups: Iterable[object]) -> None:
    """Delete elements of a spec."""
    for element in list(chain(*groups)):
        spec.delete(element)


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """The compiled model; SceneError names the file that is to blame."""
    with refused(f"{path}: MuJoCo cannot compile it: ", "; correct that element", *_FOREIGN):
        return spec.compile()


@contextmanager
def refused(
    begin: str, end: str, *errors: type[Exception], most: int | None = None, kind: type[PirrhtError] = SceneError
) -> Iterator[None]:
    """Make errors of some kinds, `most` characters of them, one of this project in one line between two texts."""
    try:
        with warnings.catch_warnings(action="ignore"):  # as MuJoCo's of deprecated attributes
            yield
    except errors as error:
        raise kind(begin + " ".join(str(error).split())[:most] + end) from None


def content_of(path: Path, what: str, remedy: str = "remove what is no obstacle") -> bytes:
    """Read a regular file of bearable size; the SceneError of any other names the path and what to give."""
    if (why := why_unreadable(path)) is not None:
        raise SceneError(f"{path}: cannot be read (it {why}); give {what}")
    with path.open("rb") as stream:
        content = stream.read(LARGEST_TEXT + 1)
    if len(content) > LARGEST_TEXT:
        raise SceneError(f"{path}: larger than {LARGEST_TEXT >> 20} MiB; {remedy}")
    return content


def check(path: Path) -> None:
    """Refuse an MJCF file that is too large, copies too much, or names what is no regular file of bounded size.

    Names are searched wherever MuJoCo might; what does not exist is left to it.
    """
    waiting = [path]
    seen = {path}
    names = dict[str, Path]()

    bases = {path.parent}
    folders = {""}

    while waiting:
        file = waiting.pop()
        bases.add(file.parent)
        content = content_of(file, "the path of an MJCF file", "write large meshes to files of their own")
        check_parts(file, sum(map(bool, _PART.findall(content))))
        for key, *value in _NAMED.findall(content):
            text = unescape(b"".join(value).decode(errors="surrogateescape"))
            if key in MOST_OF:
                if prod(max(1.0, float(word)) for word in text.split() if word.isdecimal()) > MOST_OF[key]:
                    raise SceneError(
                        f'{file}: {key.decode()}="{printable(text[:40])}" is too much; write {MOST_OF[key]} at most'
                    )
            elif key.startswith(b"file"):
                names.setdefault(text, file)
            else:
                folders.add(text)
        if len(names) * len(bases) * len(folders) > MOST_PLACES:
            raise SceneError(f"{file}: it names too many files and folders; write fewer")
        if not waiting:
            places = product(names, bases, folders)
            maybe = ((base / folder / part, name) for name, base, folder in places for part in {name, Path(name).name})
            found = {one.parent.resolve() / one.name for one, name in maybe if _check_named(one, name, names[name])}
            waiting = [one for one in found - seen if one.stat().st_size <= LARGEST_TEXT]
            seen |= found


def _check_named(found: Path, name: str, by: Path) -> bool:
    """Whether there is such a file; what is there and would never end, or is too large, is refused."""
    why = why_unreadable(found)
    if why not in (None, MISSING) and name and not os.path.isdir(found):
        raise SceneError(f'{by}: it names the file "{printable(name[:40])}", which {why}; name a regular file')
    if why is None and found.stat().st_size > LARGEST_FILE:
        raise SceneError(f"{found}: larger than {LARGEST_FILE >> 20} MiB; make it smaller")
    return why is None


def check_parts(path: Path, number: int) -> None:
    """Refuse a file of too many bodies, geoms and sites."""
    if number > MOST_PARTS:
        raise SceneError(f"{path}: it has more than {MOST_PARTS} bodies, geoms and sites; write fewer")


def trial(path: Path, read: Callable[[], object]) -> None:
    """Read a file in a child process of bounded memory and time, on Linux; a failure there is a SceneError here."""
    if sys.platform != "linux":
        return
    source, sink = os.pipe()
    child = os.fork()
    if child == 0:
        words = ""
        try:
            _bound()
            read()
            words = _READ
        except Exception as error:
            words = "" if isinstance(error, MemoryError) else str(error)
        finally:
            os.write(sink, words[:4000].encode(errors="replace"))
            os._exit(0)
    os.close(sink)
    try:
        with os.fdopen(source, "rb") as stream:
            words = stream.read().decode(errors="replace")
    finally:
        os.kill(child, signal.SIGKILL)  # it has ended, unless this process is interrupted
        os.waitpid(child, 0)
    if not words or "allocate memory" in words or "unknown exception" in words:
        raise SceneError(
            f"{path}: loading it takes MuJoCo more than {MEMORY >> 30} GiB of memory or {CPU} s; make meshes, pictures "
            "and counts smaller"
        )
    if words != _READ:
        raise SceneError(words)


def _bound() -> None:
    """Bound memory and time of this process, which says nothing from now on."""
    import resource

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
    signal.alarm(WALL)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    for limit, most in ((resource.RLIMIT_AS, used + MEMORY), (resource.RLIMIT_CPU, CPU), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(limit)[1]
        resource.setrlimit(limit, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)


@contextmanager
def prefixed(words: str) -> Iterator[None]:
    """Put words in front of the message of a SceneError."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{words}{str(error).removeprefix(words)}") from None


class Faults(list[str]):
    """Collects what is wrong with a file, to be refused at once."""

    def of(self, read: Callable[..., T], *arguments: object) -> T | None:
        """Return what `read` returns for arguments; None, and its words are kept, if it raises a SceneError."""
        try:
            return read(*arguments)
        except SceneError as error:
            self.append(str(error))
            return None

    def refuse(self) -> None:
        """Raise a SceneError if anything was wrong."""
        if self:
            more = f"; and {len(self) - SHOWN} more" if len(self) > SHOWN else ""
            raise SceneError("; also, ".join(self[:SHOWN]) + more)


def listed(names: Sequence[str], most: int = SHOWN) -> str:
    """Join names by commas, each in one line, not all of many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(" ".join(name.split()) for name in names[:most]) + more


def refuse_far(label: str, *numbers: Array) -> None:
    """Refuse places and sizes [m] that are no numbers, or larger than any scene's."""
    values = np.concatenate([np.asarray(one, dtype=float).ravel() for one in numbers])
    wrong = values[~(np.abs(values) <= FARTHEST)]
    if len(wrong):
        raise SceneError(f"{label} has a place or size of {wrong[0]:g} m; write at most {FARTHEST:g} m")
