"""Reading and writing array elements by address inside kernels.

Numba counts references whenever an array is taken out of a tuple, atomically and far more often than its optimiser can
undo in a long function: 460 counts in the rollout loop made it five times slower. A kernel therefore takes arrays,
which keeps them alive, and hands addresses to the functions that it calls in its loops.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _loader(element: Any, machine: ir.Type) -> Any:
    @intrinsic  # type: ignore[untyped-decorator]
    def load(typing_context: Any, address: Any, index: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = builder.inttoptr(arguments[0], machine.as_pointer())
            return builder.load(builder.gep(pointer, [arguments[1]]))

        return element(types.intp, types.intp), generate

    load._set_uuid(f"pirrht.memory.load {element}")  # not by chance: kernels that use it are looked up by it (`jit`)
    return load


load_int8 = _loader(types.int8, ir.IntType(8))
load_int16 = _loader(types.int16, ir.IntType(16))
load_float32 = _loader(types.float32, ir.FloatType())
load_int32 = _loader(types.int32, ir.IntType(32))
load_float64 = _loader(types.float64, ir.DoubleType())
load_int64 = _loader(types.int64, ir.IntType(64))


def _storer(element: Any, machine: ir.Type) -> Any:
    @intrinsic  # type: ignore[untyped-decorator]
    def store(typing_context: Any, address: Any, index: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = builder.inttoptr(arguments[0], machine.as_pointer())
            builder.store(arguments[2], builder.gep(pointer, [arguments[1]]))
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, element), generate

    store._set_uuid(f"pirrht.memory.store {element}")
    return store


store_int8 = _storer(types.int8, ir.IntType(8))
store_int16 = _storer(types.int16, ir.IntType(16))
store_int32 = _storer(types.int32, ir.IntType(32))
store_int64 = _storer(types.int64, ir.IntType(64))
store_float64 = _storer(types.float64, ir.DoubleType())
