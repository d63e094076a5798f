"""How numeric functions become compiled kernels, and how small ones become part of them and stay plain Python.

Numba's disk cache forgets a function when its own file changes, but not when a function that it inlines does. The
kernels of this package therefore live in a folder named after a digest of all of its sources.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba import njit
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., Any])

_inlined: set[str] = set()
_HERE = Path(__file__).resolve().parent


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a numeric function: without the interpreter lock, cached on disk, IEEE division."""
    return _compiled(function)


def inlined(function: Callable[..., Any]) -> Any:
    """The same for a small function of numbers, which is always inlined: a call would cost more than it does."""
    return _compiled(function, forceinline=True)


def jitable(function: F) -> F:
    """Mark a module-level function as inlinable in kernels; it stays an ordinary Python function.

    Kernels close over such functions by reference, so their compiled code can be cached on disk.
    """
    _inlined.add(_name(function))
    marked: F = register_jitable(function)
    return marked


@cache  # kernels are built once per function
def as_jitable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make any numeric Python function callable from a kernel (without the disk cache if it is foreign)."""
    if isinstance(function, Dispatcher) or _name(function) in _inlined:
        return function
    compiled: Callable[..., Any] = njit(function)
    return compiled


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(_FOLDER)  # read when a function is decorated, and only then
    try:
        compiled = njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    finally:
        numba.config.CACHE_DIR = before
    return compiled


def _cache_folder() -> Path:
    """A folder that belongs to exactly these sources; those of earlier ones beside it are removed."""
    digest = hashlib.sha256()
    for path in sorted(_HERE.glob("*.py")):
        digest.update(path.read_bytes())
    name = f"pirrht-kernels-{digest.hexdigest()[:16]}"
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR) / name
    home = _HERE / "__pycache__"
    try:
        home.mkdir(exist_ok=True)
        writable = os.access(home, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pirrht"
    if not (home / name).exists():
        for old in home.glob("pirrht-kernels-*"):
            shutil.rmtree(old, ignore_errors=True)
    return home / name


def _name(function: Callable[..., Any]) -> str:
    return f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', repr(function))}"


_FOLDER = _cache_folder()
