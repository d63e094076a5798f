"""Files: output is refused before any work is done and replaced once it is complete; input has an end."""

import json
import math
import os
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from secrets import token_hex
from typing import Any, BinaryIO

import numpy as np

from pirrht.errors import OptionError, printable

SHOWN = 40  # characters of a file's name that its draft bears: two such names and an ending fit any file system


class Draft:
    """A file next to another one, whose place it takes when it is complete. All raise OSError.

    Args:
        follow: whether a link keeps its place and the file that it leads to is replaced.
    """

    def __init__(self, path: Path, *, follow: bool = True) -> None:
        self.target = Path(os.path.realpath(path)) if follow else Path(os.path.realpath(path.parent), path.name)
        self.file = self.target.with_name(f".{self.target.name[:SHOWN]}.{token_hex(4)}.part")
        self.handle = os.open(self.file, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)  # open for writing

    def publish(self) -> None:
        """Take the target's place, with its permissions or, if there is none, those of any new file."""
        if self.target.exists() and not self.target.is_symlink():
            shutil.copymode(self.target, self.file)
        os.replace(self.file, self.target)

    def discard(self) -> None:
        """Remove it, unless it has been published."""
        with suppress(OSError):
            os.unlink(self.file)


@contextmanager
def replaced(path: Path, option: str, *, follow: bool = True) -> Iterator[BinaryIO]:
    """Yield a stream whose content becomes that of a file; after a failure the old file stays.

    What is no regular file, such as /dev/null or a pipe, and what standard output goes to is written to at the end.
    OptionError: it cannot be written; names the option.

    Args:
        follow: whether a link may lead elsewhere. It must not where the name is ours and the folder somebody else's:
            then the file takes the place of whatever has its name.
    """
    try:
        if follow and takes_as_it_comes(path):
            yield (content := BytesIO())
            output = _output(path)
            with open(path if output is None else os.dup(output), "wb") as target:
                target.write(content.getvalue())
            return
        draft = Draft(path, follow=follow)
        try:
            with os.fdopen(draft.handle, "wb") as stream:
                yield stream
            draft.publish()
        finally:
            draft.discard()
    except OSError as error:
        raise refused(option, path, error) from None


def takes_as_it_comes(path: Path) -> bool:
    """Return whether nothing can take a path's place: a device, a pipe, or the file behind this process' output."""
    odd = os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path))
    return odd or _output(path) is not None


def _output(path: Path) -> int | None:
    """Return the descriptor of standard output or error if it is the file: opening it again would empty it."""
    for known in (1, 2):
        with suppress(OSError, ValueError):
            if os.path.samestat(os.stat(path), os.fstat(known)):
                return known
    return None


def path_text(path: Path) -> str:
    """Return a path as text in one line that any terminal takes."""
    return printable(str(path))


MISSING = "does not exist"
_KINDS = {stat.S_IFDIR: "is a folder", stat.S_IFIFO: "is a pipe", stat.S_IFSOCK: "is a socket"}


def why_unreadable(path: Path) -> str | None:
    """Return the reason that a path is no file with an end, as the end of a sentence; None if it is one."""
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return MISSING
    except (OSError, ValueError) as error:  # ValueError: a null character
        return f"cannot be opened ({getattr(error, 'strerror', None) or error})"
    if not stat.S_ISREG(mode):
        return _KINDS.get(stat.S_IFMT(mode), "is a device")
    return None if os.access(path, os.R_OK) else "may not be read"


def check_writable(path: Path, option: str, *, follow: bool = True) -> None:
    """Refuse an output path before any work is done, by OptionError: a folder, a disk, one that cannot be made.

    Args:
        follow: as of `replaced`.
    """
    try:
        str(path).encode()
        mode = os.stat(path, follow_symlinks=follow).st_mode
    except (FileNotFoundError, NotADirectoryError):
        mode = 0
    except (OSError, ValueError) as error:
        raise refused(option, path, error) from None
    folder = Path(os.path.realpath(path)).parent if follow else path.parent
    places = [folder, *([path] if mode and not stat.S_ISLNK(mode) else [])]
    if follow and takes_as_it_comes(path):
        places = [path]
    for wrong, what in (
        (stat.S_ISDIR(mode), " is a folder; give the path of a file"),
        (stat.S_ISBLK(mode), " is a disk; give the path of a file"),
        (not folder.is_dir(), f": the folder {path_text(folder)} does not exist; create it first"),
        (not all(os.access(place, os.W_OK) for place in places),
         " may not be written; choose another place or fix the permissions"),
    ):  # fmt: skip
        if wrong:
            raise OptionError(f"{option} {path_text(path)}{what}")


def refused(option: str, path: Path, error: OSError | ValueError) -> OptionError:
    """Make the error where the system refuses a path that an option names, or what is done with it."""
    text = path_text(path)
    short = text if len(text) <= 80 else f"{text[:40]}...{text[-30:]}"
    why = "the name is not UTF-8" if isinstance(error, UnicodeError) else getattr(error, "strerror", None) or error
    return OptionError(f"{option} {short}: {why}; choose another place")


def write_json(path: Path, value: Any) -> None:
    """Write JSON so that the old file stays until the new one is complete."""
    text = json.dumps(plain(value), indent=2, allow_nan=False) + "\n"
    sys.stdout.flush()  # lines come first where both go to one place
    with replaced(path, "--json") as stream:
        stream.write(text.encode())


def plain(value: Any) -> Any:
    """A value that JSON can hold: arrays as lists, infinities and NaN as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
