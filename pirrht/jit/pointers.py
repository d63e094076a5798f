"""Calls by address: a kernel that calls one of several functions compiles once, not once for each of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from llvmlite import ir
from numba import typeof, types
from numba.extending import intrinsic
from numba.np.unsafe.ndarray import to_fixed_tuple

from pirrht.jit.jit import DISABLED, OPTIONS
from pirrht.jit.linking import Entry

as_tuple = (lambda values, count: tuple(values[:count])) if DISABLED else to_fixed_tuple  # the first of an array


def address_of(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Compile a function for arguments like these and return its address; uncompiled, the function itself."""
    return function if DISABLED else _entry(function).address(tuple(map(typeof, arguments)))


@cache
def _entry(function: Callable[..., Any]) -> Entry:
    return Entry(function, OPTIONS, by_address=True)


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
