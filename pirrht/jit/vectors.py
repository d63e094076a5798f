"""Rows of numbers inside kernels: copies, sums, and small linear systems.

Numba assigns slices with a message for shapes that differ, which takes a seventh of the time that kernels compile.
"""

import ctypes
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from pirrht.jit.jit import DISABLED, jitable, kernel, load_float64, part, store_float64


@jitable
def copy_row(source: NDArray[Any], out: NDArray[Any]) -> None:
    """Write source (n,) to out (n,)."""
    for i in range(out.shape[0]):
        out[i] = source[i]


@jitable
def copy_rows(source: NDArray[Any], out: NDArray[Any]) -> None:
    """Write source (k, n) to out (k, n)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]


@kernel
def solve(A, Y, X):  # type: ignore[no-untyped-def]
    """Solve A X = Y for small A (m, m) by elimination with row pivots; Y, X (m, k)."""
    m = A.shape[0]
    width = A.shape[0] + Y.shape[1]
    work = np.empty((m, width))  # both next to each other
    copy_rows(A, work[:, :m])
    copy_rows(Y, work[:, m:])
    for i in range(m):
        pivot = i
        for r in range(i + 1, m):
            if abs(work[r, i]) > abs(work[pivot, i]):
                pivot = r
        for c in range(width):
            work[i, c], work[pivot, c] = work[pivot, c], work[i, c]
        for r in range(m):
            factor = work[r, i] / work[i, i] if r != i else 0.0
            for c in range(i, width):
                work[r, c] -= factor * work[i, c]
    for i in range(m):
        for k in range(m, width):
            X[i, k - m] = work[i, k] / work[i, i]


@cache
def dot(width: int) -> Any:
    """Return the function (a, b) that multiplies two tuples of two or three numbers."""
    if width == 2:
        return part(lambda a, b: a[0] * b[0] + a[1] * b[1])
    return part(lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@cache
def combined(width: int) -> Any:
    """Return the function (s, a, t, b) that makes s a + t b of tuples of two or three numbers."""
    if width == 2:
        return part(lambda s, a, t, b: (s * a[0] + t * b[0], s * a[1] + t * b[1]))
    return part(lambda s, a, t, b: (s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]))


@cache
def axpy(width: int) -> Any:
    """Return the function (out, x, a, y, b), of addresses and numbers, that writes a x + b y of rows of that width."""

    @part
    def combine(out, x, a, y, b):  # type: ignore[no-untyped-def]
        for j in range(width):
            store_float64(out, j, a * load_float64(x, j) + b * load_float64(y, j))

    return combine


@cache
def matvec(count: int, width: int) -> Any:
    """Return the function (out, rows, factors), of addresses, that writes sum_k factors_k rows_k of `count` rows.

    `out` is not `factors`.
    """

    @part
    def multiply(out, rows, factors):  # type: ignore[no-untyped-def]
        for j in range(width):
            total = 0.0
            for k in range(count):
                total += load_float64(factors, k) * load_float64(rows, k * width + j)
            store_float64(out, j, total)

    return multiply


def _blended() -> Any:
    """Make the function of `blended`, in vector instructions; uncompiled, it reads views of memory."""
    if DISABLED:

        def plain(first: int, second: int, one: Any, other: Any, along: Any) -> tuple[Any, ...]:
            (a, b), (c, d) = (np.ctypeslib.as_array((ctypes.c_float * 8).from_address(int(at))).reshape(2, 4)
                               for at in (first, second))  # fmt: skip
            low = a * (1 - one) + b * one
            high = c * (1 - other) + d * other

            return tuple(low + along * (high - low))

        return plain

    @intrinsic  # type: ignore[untyped-decorator]
    def blend(typing_context: Any, *_: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kind = ir.VectorType(ir.FloatType(), 4)
            places = [ir.Constant(ir.IntType(32), k) for k in range(4)]

            def rows(address: Any) -> tuple[Any, Any]:
                start = builder.inttoptr(address, kind.as_pointer())
                return builder.load(start, align=4), builder.load(builder.gep(start, places[1:2]), align=4)

            def fill(number: Any) -> Any:
                one = builder.insert_element(ir.Constant(kind, ir.Undefined), number, places[0])
                return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), 4), None))

            def between(low: Any, high: Any, share: Any) -> Any:
                rest = builder.fsub(ir.Constant(ir.FloatType(), 1.0), share)
                return builder.fadd(builder.fmul(low, fill(rest)), builder.fmul(high, fill(share)))

            first, second, one, other, along = cgutils.unpack_tuple(builder, values[0])
            low = between(*rows(first), one)
            high = between(*rows(second), other)
            row = builder.fadd(low, builder.fmul(fill(along), builder.fsub(high, low)))
            return context.make_tuple(
                builder, signature.return_type, [builder.extract_element(row, place) for place in places]
            )

        return types.UniTuple(types.float32, 4)(
            types.StarArgTuple((types.intp, types.intp, *3 * [types.float32]))
        ), generate

    return blend


# (first, second, one, other, along): four float32 between rows of four. At two addresses lie two rows each; between
# these a share each is taken, and a share `along` between the results.
blended = _blended()
