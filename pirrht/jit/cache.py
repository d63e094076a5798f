"""Compiled kernels on disk, each under the name of all that it computes (`names`).

Loading a kernel runs code of its file. So nothing is read but from folders and files that belong to this user or to
root and that nobody else may write to, and nothing is unpickled unless it has the digest with which its file begins.
One process compiles a kernel; others that need it wait, and then find it.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numba
from numba.core.serialize import dumps

try:
    import fcntl
except ImportError:  # a system without such locks: everyone compiles
    fcntl = None  # type: ignore[assignment]

UNUSED = 30 * 86400.0  # a kernel that was not loaded for so long is removed [s]
DAY = 86400.0  # precision of the time at which a kernel was loaded last [s]
KERNELS, LOCKS, NOTES = "kernels", "locks", "notes"  # folders
_LENGTH = hashlib.sha256().digest_size
_PACKAGE = Path(__file__).resolve().parent.parent
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
_log = logging.getLogger("pirrht")
_warned: set[str] = set()  # kinds of lines that this process has written


class Foreign(OSError):
    """Somebody else owns a folder or a file of the cache, or may write to it."""


def load(
    key: str | None, made: Callable[[Any], Any], during: Callable[[str], AbstractContextManager[Any]] = nullcontext
) -> Any:
    """Return `made` of the content that is kept under a name, in a context; None if there is none that is whole."""
    try:
        content = None if key is None else _read(key)
    except Foreign as error:
        _warn_once(str(error))
        return None
    if content is None:
        return None
    try:
        if not content.startswith(_digest(content[_LENGTH:])):
            raise ValueError
        with during("loading"):
            return made(pickle.loads(content[_LENGTH:]))
    except Exception:  # whatever rebuilding meets
        path = folder() / KERNELS / str(key)
        _warn_once(f"a compiled kernel on disk is damaged, {path}; it is compiled again")
        return None


def save(key: str | None, content: Callable[[], Any]) -> None:
    """Keep something under a name; where that is not possible every process compiles it."""
    if key is None:
        return
    data = dumps(content())
    try:
        _write(key, _digest(data) + data)
        _tidy()
    except Foreign as error:
        _warn_once(str(error))
    except OSError as error:
        _warn_once(
            f"compiled kernels cannot be kept in {folder()} ({error.strerror}), so every command compiles anew; set "
            "NUMBA_CACHE_DIR to a folder that may be written"
        )


@contextmanager
def locked(key: str | None) -> Iterator[None]:
    """Hold the lock of a name until done or gone; where there is none, go on without.

    Kernels call each other in no circle, so that no two processes wait for each other.
    """
    stream = None
    if key is not None and fcntl is not None:
        with suppress(OSError):
            stream = (_own(LOCKS) / key).open("ab")
    if stream is None:
        yield
        return
    with stream:
        with suppress(OSError):
            os.utime(stream.name)
            fcntl.flock(stream, fcntl.LOCK_EX)
        yield


def kept() -> bool:
    """Return whether compiled code can be kept on disk for the next process."""
    if numba.config.DISABLE_JIT:
        return False
    try:
        tempfile.TemporaryFile(dir=_own(KERNELS)).close()
    except OSError:
        return False
    return True


def noted(name: str) -> bool:
    """Return whether a process has noted that all kernels of a name are there."""
    return (folder() / NOTES / name).exists()


def note(name: str) -> None:
    """Note that all kernels of a name are there; nothing where it cannot be written."""
    with suppress(OSError):
        (_own(NOTES) / name).touch()


@cache
def folder() -> Path:
    """Return the folder of kernels: NUMBA_CACHE_DIR, else next to the package, else in the user's cache.

    The variable is read from the environment, since a file of the current folder may change numba's own.
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


def _own(part: str) -> Path:
    """Make a folder of the cache, if need be; Foreign where somebody else may write there."""
    for path in (folder(), folder() / part):
        path.mkdir(mode=0o755, parents=True, exist_ok=True)
        if _is_foreign(path.stat()) or not _is_owned(os.lstat(path)):
            raise Foreign(
                f"compiled kernels in {path} are not used, since another user may write there, so every command "
                "compiles anew; remove it, or set NUMBA_CACHE_DIR to a folder of your own"
            )
    return path


def _read(key: str) -> bytes | None:
    """Return the file of a kernel, None where there is none; Foreign where somebody else may have written it."""
    try:
        path = _own(KERNELS) / key
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


def _write(key: str, content: bytes) -> None:
    """Write the file of a kernel so that nobody finds half of it."""
    path = _own(KERNELS) / key
    part = path.with_name(f"{path.name}.{uuid4().hex[:16]}.tmp")
    try:
        with open(part, "xb", opener=lambda name, flags: os.open(name, flags, 0o644)) as stream:
            stream.write(content)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@cache
def _tidy() -> None:
    """Remove, once per process, files that were not loaded for a month."""
    now = time.time()
    for path in [path for part in (KERNELS, LOCKS, NOTES) for path in (folder() / part).glob("*")]:
        with suppress(OSError):
            if now - path.stat().st_mtime > UNUSED:
                path.unlink()


def _is_owned(found: os.stat_result) -> bool:
    """Return whether something belongs to this user or to root; where there are no owners it does."""
    return not hasattr(os, "geteuid") or found.st_uid in (0, os.geteuid())


def _is_foreign(found: os.stat_result) -> bool:
    """Return whether somebody else may have written something."""
    return hasattr(os, "geteuid") and (not _is_owned(found) or bool(found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)))


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()


def _warn_once(line: str) -> None:
    """Once per process and kind; without a handler of the caller's own it goes to standard error as it is."""
    kind = line.split(",")[0].split("(")[0]
    if kind not in _warned:
        _warned.add(kind)
        _log.warning("pirrht: %s", line)
