"""Files: replaced only once their new content is complete, and read only where they have an end."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from pirrht.errors import OptionError


@contextmanager
def replaced(path: Path, option: str) -> Iterator[BinaryIO]:
    """A stream whose content becomes that of a file; an old file stays until then, and if anything goes wrong.

    Raises:
        OptionError: it cannot be written; names the option.
    """
    part = None
    try:
        handle, part = tempfile.mkstemp(prefix=path.name, suffix=".part", dir=path.resolve().parent)
        with os.fdopen(handle, "wb") as stream:
            yield stream
        os.chmod(part, 0o666 & ~_umask())
        os.replace(part, path)
        part = None
    except OSError as error:
        raise OptionError(f"{option} {path}: {error.strerror or error}; choose another place") from None
    finally:
        if part is not None:
            with suppress(OSError):
                os.unlink(part)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


MISSING = "does not exist"
_KINDS = {stat.S_IFDIR: "is a folder", stat.S_IFIFO: "is a pipe", stat.S_IFSOCK: "is a socket"}


def why_unreadable(path: Path) -> str | None:
    """Why a path is no file that can be read to its end, as the end of a sentence; None if it is one.

    Pipes and devices are none: opening them may wait for ever, and reading them need not end.
    """
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return MISSING
    except (OSError, ValueError) as error:  # ValueError: a null character
        return f"cannot be opened ({getattr(error, 'strerror', None) or error})"
    if not stat.S_ISREG(mode):
        return _KINDS.get(stat.S_IFMT(mode), "is a device")
    return None if os.access(path, os.R_OK) else "may not be read"
