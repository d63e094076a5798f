"""Reading and writing array elements by address inside kernels.

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

_PLAIN: dict[str, Any] = {  # what Python reads where kernels are not compiled; whole numbers widen as they do there
    "float": (ctypes.c_float, np.float32),
    "double": (ctypes.c_double, np.float64),
    "i8": (ctypes.c_int8, np.int64),
    "i16": (ctypes.c_int16, np.int64),
    "i32": (ctypes.c_int32, np.int64),
    "i64": (ctypes.c_int64, np.int64),
}


def _type(name: str) -> ir.Type:
    # Made anew for every use: llvmlite's types note down what they are asked, and a kernel whose closure holds one that
    # has changed is not found on disk.
    known = {"float": ir.FloatType, "double": ir.DoubleType}
    return known[name]() if name in known else ir.IntType(int(name[1:]))


def _loader(element: Any, machine: str) -> Any:
    if DISABLED:
        kind, number = _PLAIN[machine]
        return lambda address, index: number(kind.from_address(int(address) + ctypes.sizeof(kind) * int(index)).value)

    @intrinsic  # type: ignore[untyped-decorator]
    def load(typing_context: Any, address: Any, index: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = builder.inttoptr(arguments[0], _type(machine).as_pointer())
            return builder.load(builder.gep(pointer, [arguments[1]]))

        return element(types.intp, types.intp), generate

    return load


load_int8 = _loader(types.int8, "i8")
load_int16 = _loader(types.int16, "i16")
load_float32 = _loader(types.float32, "float")
load_int32 = _loader(types.int32, "i32")
load_float64 = _loader(types.float64, "double")
load_int64 = _loader(types.int64, "i64")


def _storer(element: Any, machine: str) -> Any:
    if DISABLED:
        kind, _ = _PLAIN[machine]

        def put(address: int, index: int, value: Any) -> None:
            place = kind.from_address(int(address) + ctypes.sizeof(kind) * int(index))
            place.value = float(value) if machine in ("float", "double") else int(value)

        return put

    @intrinsic  # type: ignore[untyped-decorator]
    def store(typing_context: Any, address: Any, index: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = builder.inttoptr(arguments[0], _type(machine).as_pointer())
            builder.store(arguments[2], builder.gep(pointer, [arguments[1]]))
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, element), generate

    return store


store_int8 = _storer(types.int8, "i8")
store_int16 = _storer(types.int16, "i16")
store_int32 = _storer(types.int32, "i32")
store_int64 = _storer(types.int64, "i64")
store_float64 = _storer(types.float64, "double")
