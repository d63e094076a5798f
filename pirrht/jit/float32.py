"""Numbers in single precision for loops over many lanes, and their bits.

A vector holds twice as many of them, and they are divided and rooted four times as fast. In a kernel a literal is
double and makes all that meets it double, so constants that such loops share are named here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pirrht.jit.jit import DISABLED, inlined

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

    return cast


as_bits = _cast(types.float32, types.uint32, True)
as_number = _cast(types.uint32, types.float32, False)

LOWEST, PER_LN_2 = np.float32(-87.0), np.float32(1.0 / math.log(2.0))
LN_2_HIGH, LN_2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)  # their sum is log 2 beyond single precision
E2, E3, E4, E5, E6 = (np.float32(1.0 / math.factorial(k)) for k in range(2, 7))
PLACES, BIAS = np.uint32(23), np.int32(127)


@inlined
def exponential(x):  # type: ignore[no-untyped-def]
    """exp(x) of a float32 x <= 0, float32, within 3e-7 of itself; exp(-87) stands for all below it."""
    x = max(x, LOWEST)
    n = np.int32(x * PER_LN_2 - HALF)  # towards zero: the nearest whole number
    r = (x - np.float32(n) * LN_2_HIGH) - np.float32(n) * LN_2_LOW
    series = ONE + r * (ONE + r * (E2 + r * (E3 + r * (E4 + r * (E5 + r * E6)))))
    return series * as_number(np.uint32(np.uint32(n + BIAS) << PLACES))
