"""Numbers in single precision for loops over many lanes, and their bits.

A vector holds twice as many of them, and they are divided and rooted four times as fast. In a kernel a literal is
double and makes all that meets it double, so constants that such loops share are named here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pirrht.compiled.jit import DISABLED

ZERO, HALF, ONE, TWO = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0))
INFINITE = np.float32(np.inf)


def _cast(source: Any, target: Any, whole: bool) -> Any:
    if DISABLED:
        return lambda value: np.float32(value).view(np.uint32) if whole else np.uint32(value).view(np.float32)

    @intrinsic  # type: ignore[untyped-decorator]
    def cast(typing_context: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], ir.IntType(32) if whole else ir.FloatType())

        return target(source), generate

    cast._set_uuid(f"pirrht.float32.cast {target}")  # as in `addresses`
    return cast


as_bits = _cast(types.float32, types.uint32, True)
as_number = _cast(types.uint32, types.float32, False)
