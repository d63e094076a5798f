"""How small numeric functions become part of compiled kernels and stay usable from plain Python."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., Any])

_inlined: set[str] = set()

kernel = njit(
    cache=True, nogil=True, error_model="numpy"
)  # how every compiled function of this package is built
inlined = njit(
    cache=True, nogil=True, error_model="numpy", forceinline=True
)  # small ones: a call would cost more


def jitable(function: F) -> F:
    """Mark a module-level function as inlinable in kernels; it stays an ordinary Python function.

    Kernels close over such functions by reference, so their compiled code can be cached on disk.
    """
    _inlined.add(_name(function))
    marked: F = register_jitable(function)
    return marked


def as_jitable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make any numeric Python function callable from a kernel (without the disk cache if it is foreign)."""
    if isinstance(function, Dispatcher) or _name(function) in _inlined:
        return function
    compiled: Callable[..., Any] = njit(function)
    return compiled


def source_token(*functions: Callable[..., Any]) -> str:
    """A digest of the functions' modules, so that cached kernels are rebuilt when what they inline changes."""
    digest = hashlib.sha256()
    for function in functions:
        plain = getattr(function, "py_func", function)
        try:
            module = inspect.getmodule(plain)
            text = inspect.getsource(module) if module is not None else ""
        except (OSError, TypeError):
            text = repr(getattr(plain, "__code__", plain))
        digest.update(text.encode())
    return digest.hexdigest()[:16]


def _name(function: Callable[..., Any]) -> str:
    return f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', repr(function))}"
