"""Where compiled kernels lie on disk, and who may have written them.

Loading a kernel runs what is in its file. So nothing is read but from folders and files that belong to this user or to
root, and that nobody else may write to.
"""

from __future__ import annotations

import os
import stat
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from uuid import uuid4

UNUSED = 30 * 86400.0  # a kernel that was not loaded for so long is removed [s]
DAY = 86400.0  # how exactly that is known [s]
KERNELS, LOCKS, NOTES = "kernels", "locks", "notes"
_PACKAGE = Path(__file__).resolve().parent.parent
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))


class Foreign(OSError):
    """Somebody else owns a folder or a file of the cache, or may write to it."""


@cache
def folder() -> Path:
    """Where kernels are kept: NUMBA_CACHE_DIR, else beside the package, else in the user's cache.

    The variable is read from the environment, since a file of the current folder may change what numba takes it for.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named:
        return Path(named) / "pirrht"
    home = _PACKAGE / "__pycache__"
    with suppress(OSError):
        home.mkdir(exist_ok=True)
        if os.access(home, os.W_OK):
            return home / "pirrht"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pirrht"


def own(part: str) -> Path:
    """Make a folder of the cache, if need be.

    Raises:
        Foreign: somebody else may write there.
        OSError: it cannot be made.
    """
    for path in (folder(), folder() / part):
        path.mkdir(mode=0o755, parents=True, exist_ok=True)
        if _is_foreign(path.stat()) or not _is_owned(os.lstat(path)):
            raise Foreign(
                f"compiled kernels in {path} are not used, since another user may write there, so every command "
                "compiles anew; remove it, or set NUMBA_CACHE_DIR to a folder of your own"
            )
    return path


def read(key: str) -> bytes | None:
    """Read the file of a kernel; None where there is none.

    Raises:
        Foreign: somebody else may have written it.
    """
    try:
        path = own(KERNELS) / key
        with os.fdopen(os.open(path, _FLAGS), "rb") as stream:
            found = os.fstat(stream.fileno())
            if _is_foreign(found):
                raise Foreign(f"a compiled kernel is not used, since another user may have written it: {path}")
            content = stream.read()
        if time.time() - found.st_mtime > DAY:
            os.utime(path)
        return content
    except Foreign:
        raise
    except OSError:
        return None


def write(key: str, content: bytes) -> None:
    """Write the file of a kernel so that nobody finds half of it.

    Raises:
        Foreign: somebody else may write there.
        OSError: it cannot be written.
    """
    path = own(KERNELS) / key
    part = path.with_name(f"{path.name}.{uuid4().hex[:16]}.tmp")
    try:
        with open(part, "xb", opener=lambda name, flags: os.open(name, flags, 0o644)) as stream:
            stream.write(content)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@cache
def tidy() -> None:
    """Remove, once per process, what was not loaded for a month."""
    now = time.time()
    for path in [path for part in (KERNELS, LOCKS, NOTES) for path in (folder() / part).glob("*")]:
        with suppress(OSError):
            if now - path.stat().st_mtime > UNUSED:
                path.unlink()


def _is_owned(found: os.stat_result) -> bool:
    """Whether something belongs to this user or to root; where there are no owners it does."""
    return not hasattr(os, "geteuid") or found.st_uid in (0, os.geteuid())


def _is_foreign(found: os.stat_result) -> bool:
    """Whether somebody else may have written something."""
    return hasattr(os, "geteuid") and (not _is_owned(found) or bool(found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)))
