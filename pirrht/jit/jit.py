"""How numeric functions become kernels, and how small ones become part of them and stay plain Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

from pirrht.jit import linking

F = TypeVar("F", bound=Callable[..., Any])

DISABLED = bool(numba.config.DISABLE_JIT)  # NUMBA_DISABLE_JIT=1: kernels are plain Python, for debuggers and coverage

if DISABLED:
    np.seterr(over="ignore", divide="ignore", invalid="ignore")  # as compiled: keys wrap, division is IEEE's

# All are set: numba takes over those that are not from whatever calls a function first.
OPTIONS = {
    "nopython": True, "nogil": True, "error_model": "numpy", "fastmath": False, "forceinline": False, "_nrt": True,
    "no_cfunc_wrapper": True,
}  # fmt: skip
linking.keep_functions_of_numba(OPTIONS)


def kernel(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a numeric function: without the interpreter lock, cached on disk, IEEE division."""
    return function if DISABLED else linking.Entry(function, OPTIONS | options)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a small function of numbers, which is always inlined: a call would cost more than it does."""
    return kernel(function, forceinline=True)


def borrowing(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that does not count who holds the arrays that it is given.

    Counting is atomic: for one path, a kernel that is called would count the arrays of all its records twice. It makes
    no arrays, and returns none (TypeError), since its caller would let go of what it never held.
    """
    return kernel(function, _nrt=False, **options)


def part(function: Callable[..., Any]) -> Any:
    """Compile a part of a long kernel: inlined, and `borrowing`.

    A step of a path that is split into parts would otherwise take five times as long.
    """
    return borrowing(function, forceinline=True)


def jitable(function: F) -> F:
    """Mark a module-level function as one that kernels may call; it stays an ordinary Python function."""
    as_jitable(function)
    return function


@cache  # kernels are built once per function
def as_jitable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make any numeric Python function one that kernels may call; it stays an ordinary Python function."""
    if isinstance(function, Dispatcher):
        function.targetoptions.setdefault("_nrt", True)  # else it takes over that of whoever asks for it first
    elif not DISABLED:
        linking.register(function, OPTIONS)
    return function
