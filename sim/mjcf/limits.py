"""What an MJCF file and the files that it names must be before MuJoCo reads them, and a trial of reading them.

MuJoCo opens whatever a file names and allocates whatever it asks for. Here every file is regular and of bounded size,
pictures and counts are bounded, and every number is one. What slips through meets the limits of a child process, in
which a file is read and compiled first.
"""

from __future__ import annotations

import math
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import iterparse

from pirrht.errors import SceneError
from sim.files import MISSING, read_bounded, why_unreadable

LARGEST_XML, LARGEST_FILE = 32 * 2**20, 128 * 2**20  # bytes
MOST_ELEMENTS = 60_000  # of a file with all that it includes, copies counted one by one: MuJoCo takes 7 s for them
MOST_COPIES = 10_000  # of an element, by all that repeats it: 3 s
MOST_FOLDERS = 32  # in which files are searched
MOST_PIXELS, MOST_POINTS, MOST = 2**26, 2**24, 1_000_000
MEMORY, CPU, WALL = 2 * 2**30, 20, 120  # of the trial: bytes beyond what this process has, and seconds

_COUNTS = {  # element -> attributes whose product is how much it asks for, and the most that it may
    "texture": (("width", "height"), MOST_PIXELS),
    "hfield": (("nrow", "ncol"), MOST_POINTS),
    "replicate": (("count",), MOST_COPIES),
    "composite": (("count",), MOST_COPIES),
    "flexcomp": (("count",), MOST_COPIES),
    "camera": (("resolution",), MOST_PIXELS),
    "numeric": (("size",), MOST),
    "user": (("dim",), MOST),
}
_REPEATS = ("replicate", "composite", "flexcomp")  # make `count` of what they hold
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_WORDS = {  # attributes whose value is a name
    "name", "class", "childclass", "model", "prefix", "mesh", "material", "texture", "hfield", "joint", "joint1",
    "joint2", "body", "body1", "body2", "geom", "geom1", "geom2", "site", "site1", "site2", "target", "tendon",
    "actuator", "objname", "refname", "key", "plugin", "instance", *_FOLDERS,
}  # fmt: skip
_MARKUP = re.compile(
    rb"(?P<aside><!--.*?-->|<\?.*?\?>)|<(?P<tag>[^<>\"'!?](?:[^<>\"']|\"[^\"]*\"|'[^']*')*+)>|<", re.DOTALL
)
_PNG = b"\x89PNG\r\n\x1a\n"


def check(path: Path) -> None:
    """Refuse an MJCF file that MuJoCo should not read, or that names such a file.

    Raises:
        SceneError: a file is no regular one, too large or not well-formed, or an element has what is no number or
            asks for too much; names file, element and attribute.
    """
    waiting, seen, named, number = [path], {path}, list[tuple[Path, Element, str]](), 0
    bases, folders = {path.parent}, {""}
    while waiting:
        file = waiting.pop()
        for element, copies in _elements(file):
            number += copies
            if copies > MOST_COPIES:
                raise SceneError(f"{file}: {element.tag} is there more than {MOST_COPIES} times; write smaller counts")
            if number > MOST_ELEMENTS:
                raise SceneError(f"{path}: it has more than {MOST_ELEMENTS} elements; write fewer, or smaller counts")
            _check_numbers(file, element)
            folders |= {element.get(key, "") for key in _FOLDERS if element.tag == "compiler"}
            if len(folders) > MOST_FOLDERS:
                raise SceneError(f"{file}: it names more than {MOST_FOLDERS} folders; write one compiler element")
            for key in element.attrib:
                if key.startswith("file") and element.tag in ("include", "model"):
                    for found in _regular(file, element, key, {path.parent, file.parent}, {""}):
                        bases.add(found.parent)
                        waiting += [found] if found not in seen else []
                        seen.add(found)
                elif key.startswith("file"):
                    named.append((file, element, key))
    for file, element, key in named:
        for found in _regular(file, element, key, bases, folders):
            _check_size(found, element)


def trial(path: Path, read: Callable[[], object]) -> None:
    """Read a file in a child process of bounded memory and time, where the system has such.

    Raises:
        SceneError: reading it failed, in the child's words, or went beyond the limits.
    """
    if sys.platform != "linux":
        return
    source, sink = os.pipe()
    child = os.fork()
    if child == 0:
        _try(read, sink)
    os.close(sink)
    try:
        with os.fdopen(source, "rb") as stream:
            words = stream.read().decode(errors="replace")
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        os.waitpid(child, 0)
    if words == _READ:
        return
    if not words or "allocate memory" in words or "unknown exception" in words:
        raise SceneError(
            f"{path}: loading it takes MuJoCo more than {MEMORY >> 30} GiB of memory or {CPU} s; make meshes, pictures "
            "and counts smaller"
        )
    raise SceneError(words)


_READ = "read"


def _try(read: Callable[[], object], sink: int) -> None:
    """Be the child: read under limits, write how it went, and end."""
    import resource

    words = ""
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        signal.alarm(WALL)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        _lower(resource.RLIMIT_AS, used + MEMORY)
        _lower(resource.RLIMIT_CPU, CPU)
        _lower(resource.RLIMIT_CORE, 0)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        read()
        words = _READ
    except MemoryError:
        pass
    except Exception as error:
        words = str(error)
    finally:
        os.write(sink, words[:4000].encode(errors="replace"))
        os._exit(0)


def _lower(limit: int, value: int) -> None:
    import resource

    hard = resource.getrlimit(limit)[1]
    resource.setrlimit(limit, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))


def _elements(file: Path) -> Iterator[tuple[Element, int]]:
    """All elements of a file, and how many of each there will be."""
    content = read_bounded(file, LARGEST_XML, "the path of an MJCF file", "write large meshes to files of their own")
    repeats = [1]
    try:
        for event, element in iterparse(BytesIO(_text(content)), events=("start", "end"), forbid_dtd=True):
            if event == "start":
                yield element, repeats[-1]
            if element.tag in _REPEATS:
                repeats.append(repeats[-1] * _asked(element, ("count",))) if event == "start" else repeats.pop()
    except (ParseError, DefusedXmlException, ValueError) as error:
        reason = " ".join(str(error).split())
        raise SceneError(f"{file}: not MJCF: {reason}; correct the XML there") from None


def _text(content: bytes) -> bytes:
    """The markup of a file as MuJoCo reads it: in UTF-8 whatever it declares, and without comments."""

    def kept(found: re.Match[bytes]) -> bytes:
        if found["aside"] is not None:
            return b"\n" * found[0].count(b"\n")
        if found["tag"] is None:
            line = content.count(b"\n", 0, found.start()) + 1
            raise ValueError(f"markup that is no element, or does not end: line {line}")
        return found[0]

    markup = _MARKUP.sub(kept, content.removeprefix(b"\xef\xbb\xbf"))
    try:
        markup.decode()
    except UnicodeDecodeError:
        raise ValueError("names that are not UTF-8 text") from None
    return markup


def _check_numbers(file: Path, element: Element) -> None:
    called = f"{file}: {element.tag}" + (f' "{element.get("name")}"' if element.get("name") else "")
    for key, value in element.items():
        if key not in _WORDS and not key.startswith("file") and element.tag != "text" and _has_nan(value):
            raise SceneError(f'{called} has {key}="{_short(value)}"; write numbers there')
    keys, most = _COUNTS.get(element.tag, ((), MOST))
    if _asked(element, keys) > most:
        given = " ".join(f'{key}="{_short(element.attrib[key])}"' for key in keys if key in element.attrib)
        raise SceneError(f"{called} has {given}; write {most} at most" + (", multiplied" if " " in given else ""))


def _asked(element: Element, keys: tuple[str, ...]) -> int:
    """The product of what attributes ask for; 1 for what is no number, of which MuJoCo has words of its own."""
    product = 1
    for word in " ".join(element.get(key, "") for key in keys).split():
        try:
            value = float(word)
        except ValueError:
            continue
        product *= max(1, int(value)) if math.isfinite(value) else sys.maxsize
    return product


def _has_nan(value: str) -> bool:
    return any(word.lower().lstrip("+-").startswith("nan") for word in value.replace(",", " ").split())


def _short(value: str) -> str:
    return value if len(value) <= 40 else f"{value[:37]}..."


def _regular(file: Path, element: Element, key: str, bases: set[Path], folders: set[str]) -> Iterator[Path]:
    """The files that an attribute may mean; those that do not exist are left to MuJoCo."""
    name = element.get(key, "")
    for found in {base / folder / part for base in bases for folder in folders for part in (name, Path(name).name)}:
        why = why_unreadable(found)
        if why is None:
            yield found
        elif why != MISSING and name and not found.is_dir():
            raise SceneError(f'{file}: {element.tag} names {key}="{_short(name)}", which {why}; name a regular file')


def _check_size(file: Path, element: Element) -> None:
    with file.open("rb") as stream:
        head, size = stream.read(24), os.fstat(stream.fileno()).st_size
    if size > LARGEST_FILE:
        raise SceneError(f"{file}: larger than {LARGEST_FILE >> 20} MiB, too large for a {element.tag}")
    if head.startswith(_PNG):
        width, height = (int.from_bytes(head[i : i + 4]) for i in (16, 20))
        most = MOST_POINTS if element.tag == "hfield" else MOST_PIXELS
        if width * height > most:
            raise SceneError(f"{file}: {width} x {height} pixels are too many for a {element.tag}; {most} are allowed")
