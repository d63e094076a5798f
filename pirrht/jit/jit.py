"""Numeric functions as kernels; small ones become part of them and stay plain Python.

Kernels that call one of several functions by address compile once, not once for each of them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic
from numba.np.unsafe.ndarray import to_fixed_tuple

try:
    from pirrht.jit import linking
except ImportError as _change:  # of numba's private interface
    from pirrht.jit import plain as linking  # type: ignore[no-redef]

    logging.getLogger("pirrht").warning("pirrht: kernels are compiled anew by every command: %s", _change)

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
as_tuple = (lambda values, count: tuple(values[:count])) if DISABLED else to_fixed_tuple  # the first of an array


def kernel(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a numeric function: without the interpreter lock, cached on disk, IEEE division."""
    return function if DISABLED else linking.compiled(function, OPTIONS | options)


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
        function.targetoptions.setdefault("_nrt", True)  # else numba takes over that of its first caller
    elif not DISABLED:
        linking.register(function, OPTIONS)
    return function


def address_of(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Compile a function for arguments like these and return its address; uncompiled, the function itself."""
    return function if DISABLED else _by_address(function)(tuple(map(typeof, arguments)))


@cache
def _by_address(function: Callable[..., Any]) -> Callable[[tuple[Any, ...]], int]:
    return linking.addressed(function, OPTIONS)


def caller(result: Any) -> Any:
    """Make the kernel function (address, arguments) that calls by address and returns values like `result`.

    The arguments are a tuple of exactly the types that `address_of` was given.
    """
    if DISABLED:
        return lambda function, arguments: function(*arguments)
    returned = typeof(result)

    @intrinsic  # type: ignore[untyped-decorator]
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            kinds = [context.get_value_type(kind) for kind in arguments]
            function = ir.FunctionType(context.get_value_type(returned), kinds)
            values = [builder.extract_value(given[1], i) for i in range(len(kinds))]
            return builder.call(builder.inttoptr(given[0], function.as_pointer()), values)

        return returned(types.intp, arguments), generate

    return call
