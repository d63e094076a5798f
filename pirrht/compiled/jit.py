"""How numeric functions become compiled kernels, and how small ones become part of them and stay plain Python.

Numba's disk cache forgets a function when its own file changes, but not when a function that it inlines does. The
kernels of this package therefore live in a folder named after a digest of all of its sources.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba import njit, types
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable

from pirrht.compiled import symbols  # noqa: F401  (from here on this process counts what it compiles on its own)
from pirrht.compiled.alone import one_at_a_time
from pirrht.compiled.disk import KernelCache, may_be_written
from pirrht.compiled.identity import OURS, identity, name_of, named

F = TypeVar("F", bound=Callable[..., Any])

DISABLED = bool(numba.config.DISABLE_JIT)  # NUMBA_DISABLE_JIT=1: kernels are plain Python, for debuggers and coverage

if DISABLED:
    np.seterr(over="ignore", divide="ignore", invalid="ignore")  # as compiled: keys wrap, division is IEEE's

NOTES, LOCKS = "known", "locks"  # folders beside the kernels
_inlined: set[str] = set()
_HERE = Path(__file__).resolve().parent.parent  # the package


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a numeric function: without the interpreter lock, cached on disk, IEEE division."""
    return _compiled(function)


def inlined(function: Callable[..., Any]) -> Any:
    """The same for a small function of numbers, which is always inlined: a call would cost more than it does."""
    return _compiled(function, forceinline=True)


def part(function: Callable[..., Any]) -> Any:
    """A part of a long kernel: inlined, and it does not count who holds the arrays that it is given.

    Counting is atomic: a step of a path that is split into parts would take five times as long. It makes no arrays, and
    returns none (TypeError), since its caller would let go of what it never held.
    """
    return borrowing(function, forceinline=True)


def borrowing(function: Callable[..., Any], **options: Any) -> Any:
    """The same for a kernel that is called: for one path, that counts the arrays of all its records twice."""
    compiled: Any = _compiled(function, counting=False, **options)
    if not DISABLED:
        compiled.compile = _returning_no_array(compiled, compiled.compile)
    return compiled


def jitable(function: F) -> F:
    """Mark a module-level function as inlinable in kernels; it stays an ordinary Python function.

    Kernels close over such functions by reference, so their compiled code can be cached on disk.
    """
    _inlined.add(name_of(function))
    marked: F = register_jitable(function)
    return marked


@cache  # kernels are built once per function
def as_jitable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make any numeric Python function callable from a kernel, which is kept on disk if the function has a name."""
    ours = name_of(function) in _inlined and name_of(function).startswith(OURS)
    if DISABLED or ours:  # others numba would look up by their names alone
        return function
    if isinstance(function, Dispatcher):
        function.targetoptions.setdefault("_nrt", True)
        return function
    compiled: Callable[..., Any] = njit(_nrt=True)(function)
    _name(compiled, identity(function))
    return compiled


def cached(module: str) -> bool:
    """Whether kernels of a module of this package lie compiled on disk."""
    return any(_FOLDER.rglob(f"{module}.*.nbi"))


def kept() -> bool:
    """Whether what is compiled can be kept on disk for the next process."""
    return not DISABLED and may_be_written(_FOLDER)


def noted(name: str) -> bool:
    """Whether somebody has noted, beside what lies compiled on disk, that a name's kernels are there."""
    return (_FOLDER / NOTES / name).exists()


def note(name: str) -> None:
    """Note beside what lies compiled on disk that a name's kernels are there; nothing where it cannot be written."""
    with suppress(OSError):
        (_FOLDER / NOTES).mkdir(parents=True, exist_ok=True)
        (_FOLDER / NOTES / name).touch()


def _compiled(function: F, *, counting: bool = True, **options: Any) -> F:
    """Compile it; what says nothing of `_nrt` would take over that of whoever asks for it first."""
    if DISABLED:
        return function
    compiled = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, _nrt=counting, **options)(function)
    compiled.get_call_template = _widened(compiled.get_call_template)
    known = identity(function)
    if _name(compiled, known) and os.path.exists(function.__code__.co_filename):
        compiled._cache = KernelCache(function, _FOLDER)
        compiled.compile = one_at_a_time(compiled.compile, _FOLDER / LOCKS / f"{function.__name__}-{known}")
    kernel: F = compiled
    return kernel


def _returning_no_array(compiled: Any, work: Callable[..., Any]) -> Callable[..., Any]:
    """The same work, which refuses what it compiled if that hands on an array."""

    def checked(signature: Any) -> Any:
        made = work(signature)
        if any(_holds_array(overload.signature.return_type) for overload in compiled.overloads.values()):
            raise TypeError(f"{compiled.py_func.__name__} is part of a kernel and returns an array; write into one")
        return made

    return checked


def _holds_array(kind: types.Type) -> bool:
    """Whether values of a type hold arrays."""
    return isinstance(kind, types.Array) or any(_holds_array(one) for one in getattr(kind, "types", ()))


def _name(compiled: Any, identity: str | None) -> bool:
    """Give a dispatcher the name of its function; whether there is one.

    Numba names it by chance, and looks up what closes over one by that name: on disk it would never be found.
    """
    if identity is not None:
        compiled._set_uuid(identity)
        named.add(compiled)
    return identity is not None


def _widened(template: Callable[..., Any]) -> Callable[..., Any]:
    """Called from another kernel with a literal or a short whole number, a kernel is the one of any such number.

    Otherwise it is compiled once for 0, once for 2 and once for an index out of an array of 32 bits.
    """

    def of(kind: Any) -> Any:
        kind = types.unliteral(kind)
        return types.int64 if kind in (types.int8, types.int16, types.int32) else kind

    return lambda args, kws: template(tuple(map(of, args)), {name: of(kind) for name, kind in kws.items()})


def digest_of(package: Path) -> str:
    """A short name of all sources of a package, those of its sub-packages included, and of where they lie."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _cache_folder() -> Path:
    """A folder that belongs to exactly these sources; those of earlier ones beside it are removed."""
    name = f"pirrht-kernels-{digest_of(_HERE)}"
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


_FOLDER = _cache_folder()
