"""Array elements by address inside kernels.

Numba counts references whenever an array is taken out of a tuple, atomically and far more often than its optimiser can
undo in a long function: 460 counts in the rollout loop made it five times slower. A kernel therefore takes arrays,
which keeps them alive, and hands addresses to the functions that it calls in its loops.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pirrht.jit.jit import DISABLED

_C: dict[str, Any] = {
    "f32": ctypes.c_float, "f64": ctypes.c_double,
    "i8": ctypes.c_int8, "i16": ctypes.c_int16, "i32": ctypes.c_int32, "i64": ctypes.c_int64,
}  # fmt: skip


def _pointer(builder: Any, name: str, address: Any, index: Any) -> Any:
    # The type is made anew for every use: llvmlite's types note down how they are used, and a kernel whose closure
    # holds one that has changed is not found on disk.
    kind = {"f32": ir.FloatType, "f64": ir.DoubleType}.get(name) or (lambda: ir.IntType(int(name[1:])))
    return builder.gep(builder.inttoptr(address, kind().as_pointer()), [index])


def _element(name: str, address: int, index: int) -> Any:
    """Return the element that uncompiled code reads or writes."""
    return _C[name].from_address(int(address) + ctypes.sizeof(_C[name]) * int(index))


def _loader(element: Any, name: str) -> Any:
    if DISABLED:
        number: Any = {"f32": np.float32, "f64": np.float64}.get(name, np.int64)  # whole numbers widen, as in kernels
        return lambda address, index: number(_element(name, address, index).value)

    @intrinsic  # type: ignore[untyped-decorator]
    def load(typing_context: Any, address: Any, index: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.load(_pointer(builder, name, *arguments))

        return element(types.intp, types.intp), generate

    return load


def _storer(element: Any, name: str) -> Any:
    if DISABLED:

        def put(address: int, index: int, value: Any) -> None:
            _element(name, address, index).value = float(value) if name[0] == "f" else int(value)

        return put

    @intrinsic  # type: ignore[untyped-decorator]
    def store(typing_context: Any, address: Any, index: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            builder.store(arguments[2], _pointer(builder, name, *arguments[:2]))
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, element), generate

    return store


load_int8, store_int8 = _loader(types.int8, "i8"), _storer(types.int8, "i8")
load_int16, store_int16 = _loader(types.int16, "i16"), _storer(types.int16, "i16")
load_int32, store_int32 = _loader(types.int32, "i32"), _storer(types.int32, "i32")
load_int64, store_int64 = _loader(types.int64, "i64"), _storer(types.int64, "i64")
load_float64, store_float64 = _loader(types.float64, "f64"), _storer(types.float64, "f64")
load_float32 = _loader(types.float32, "f32")
