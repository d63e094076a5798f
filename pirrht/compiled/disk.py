"""Compiled kernels on disk: what is damaged there, or cannot be written, costs time and one line.

Numba unpickles whatever it finds, numbers its files, and so hands out another kernel's code where two processes wrote
at once. Here a file of machine code is named after its content, and the index after which it is looked up begins with
a digest of itself: neither is unpickled unless it is what was written.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator
from numba.core.serialize import dumps

from pirrht.compiled.unbroken import unbroken

LENGTH = hashlib.sha256().digest_size
_log = logging.getLogger("pirrht")
_told: set[str] = set()  # what this process has said


class KernelCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function, in a folder."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._name, self._py_func = repr(function), function
        self._impl = _implementation(folder)(function)
        locator = self._impl.locator
        self._cache_path = locator.get_cache_path()
        self._cache_file = Files(
            Path(self._cache_path), self._impl.filename_base, [numba.__version__, locator.get_source_stamp()]
        )
        self.enable()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function of a signature, None if it is not there or damaged."""
        try:
            with unbroken("loading"):
                return super().load_overload(sig, target_context)
        except Exception:  # whatever rebuilding meets
            _damaged(Path(self._cache_path))
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function; where that is not possible it is compiled anew by every process."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _tell(
                f"compiled kernels cannot be kept in {Path(self._cache_path).parent} ({error.strerror}), so every "
                "command compiles anew; set NUMBA_CACHE_DIR to a folder that may be written"
            )


class Files:
    """An index and the files of machine code of one function: keys -> content.

    Args:
        stamp: belongs to the function's source; under another one nothing is found.
    """

    def __init__(self, folder: Path, base: str, stamp: Any) -> None:
        self._folder, self._base, self._stamp = folder, base, stamp
        self._index = folder / f"{base}.nbi"

    def load(self, key: Any) -> Any:
        """What was saved under a key, None if there is nothing that is whole."""
        name = self._names().get(key)
        content = None if name is None else _read(self._folder / name)
        if name is None or content is None:
            return None
        if self._name(content) != name:
            _damaged(self._folder / name)
            return None
        return pickle.loads(content)

    def save(self, key: Any, data: Any) -> None:
        """Keep something under a key; the index names a file only once it is whole."""
        content = dumps(data)
        name = self._name(content)
        _replace(self._folder / name, content)
        index = dumps((self._stamp, self._names() | {key: name}))
        _replace(self._index, hashlib.sha256(index).digest() + index)

    def flush(self) -> None:
        """Forget everything."""
        index = dumps((self._stamp, {}))
        _replace(self._index, hashlib.sha256(index).digest() + index)

    def _names(self) -> dict[Any, str]:
        content = _read(self._index)
        if content is None:
            return {}
        if hashlib.sha256(content[LENGTH:]).digest() != content[:LENGTH]:
            _damaged(self._index)
            return {}
        stamp, names = pickle.loads(content[LENGTH:])
        return dict(names) if stamp == self._stamp else {}

    def _name(self, content: bytes) -> str:
        return f"{self._base}.{hashlib.sha256(content).hexdigest()[:32]}.nbc"


def may_be_written(folder: Path) -> bool:
    """Whether compiled kernels can be kept in a folder, which need not exist yet."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


@cache
def _implementation(folder: Path) -> Any:
    class Locator(UserProvidedCacheLocator):  # type: ignore[misc]
        """In a folder per room, whether it may be written or not."""

        def __init__(self, function: Any, file: str) -> None:
            self._py_file, self._lineno = file, function.__code__.co_firstlineno
            self._cache_path = str(folder / self.get_suitable_cache_subpath(file))

        @classmethod
        def from_function(cls, function: Any, file: str) -> Any:
            return cls(function, file) if os.path.exists(file) else None

    class Implementation(CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = (Locator,)

    return Implementation


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _replace(path: Path, content: bytes) -> None:
    part = path.with_name(f"{path.name}.{uuid4().hex[:16]}.tmp")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _damaged(path: Path) -> None:
    _tell(f"a compiled kernel on disk is damaged, {path}; it is compiled anew")


def _tell(line: str) -> None:
    """Once per process and kind; without a handler of the caller's own it goes to standard error as it is."""
    kind = line.split(",")[0].split("(")[0]
    if kind not in _told:
        _told.add(kind)
        _log.warning("pirrht: %s", line)
