"""Rows of numbers inside kernels: copies, small linear systems, and sums of short rows in vector instructions.

Numba assigns slices with a message for shapes that differ, which takes a seventh of the time that kernels compile. Its
loops over a few numbers take them one by one, since an array that is written might overlap one that is read. A vector
instruction takes a whole row of a control law, which is as long as a step has modes.
"""

from __future__ import annotations

import ctypes
from functools import cache, partial, reduce
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from pirrht.jit.jit import DISABLED, jitable, kernel


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
    m, width = A.shape[0], Y.shape[1]
    work = A.copy()
    copy_rows(Y, X)
    for i in range(m):
        pivot = i
        for r in range(i + 1, m):
            if abs(work[r, i]) > abs(work[pivot, i]):
                pivot = r
        for c in range(m):
            work[i, c], work[pivot, c] = work[pivot, c], work[i, c]
        for k in range(width):
            X[i, k], X[pivot, k] = X[pivot, k], X[i, k]
        for r in range(m):
            if r != i:
                factor = work[r, i] / work[i, i]
                for c in range(i, m):
                    work[r, c] -= factor * work[i, c]
                for k in range(width):
                    X[r, k] -= factor * X[i, k]
    for i in range(m):
        for k in range(width):
            X[i, k] /= work[i, i]


@cache
def axpy(width: int) -> Any:
    """Return the function (out, x, a, y, b), of addresses and numbers, that writes a x + b y of rows of that width."""
    return _by_rows("axpy", width)


@cache
def affine(count: int, width: int) -> Any:
    """Return the function (out, first, rows, factors), of addresses, that writes first + sum_k factors_k rows_k.

    There are `count` rows of `width` numbers, one after the other.
    """
    return _by_rows("affine", count, width)


@cache
def matvec(count: int, width: int) -> Any:
    """Return the function (out, rows, factors), of addresses, that writes sum_k factors_k rows_k.

    There are `count` rows of `width` numbers, one after the other.
    """
    return _by_rows("matvec", count, width)


@cache
def clip(width: int) -> Any:
    """Return the function (x, bound), of an address and a number, that clips a row to plus and minus it."""
    return _by_rows("clip", width)


def _blended() -> Any:
    """Make the function of `blended`; uncompiled, it reads views of memory."""
    if DISABLED:

        def plain(first: int, second: int, one: Any, other: Any, along: Any) -> tuple[Any, ...]:
            (a, b), (c, d) = (np.ctypeslib.as_array((ctypes.c_float * 8).from_address(int(at))).reshape(2, 4)
                              for at in (first, second))  # fmt: skip
            low, high = a * (1 - one) + b * one, c * (1 - other) + d * other
            return tuple(low + along * (high - low))

        return plain

    @intrinsic  # type: ignore[untyped-decorator]
    def blend(typing_context: Any, *kinds: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            to = _Vectors(builder, 4, ir.FloatType())

            def between(low: Any, high: Any, share: Any) -> Any:
                rest = builder.fsub(ir.Constant(ir.FloatType(), 1.0), share)
                return builder.fadd(builder.fmul(low, to.fill(rest)), builder.fmul(high, to.fill(share)))

            first, second, one, other, along = cgutils.unpack_tuple(builder, values[0])
            low = between(to.load(first), to.load(first, 4), one)
            high = between(to.load(second), to.load(second, 4), other)
            row = builder.fadd(low, builder.fmul(to.fill(along), builder.fsub(high, low)))
            numbers = [builder.extract_element(row, ir.Constant(ir.IntType(32), k)) for k in range(4)]
            return context.make_tuple(builder, signature.return_type, numbers)

        return types.UniTuple(types.float32, 4)(types.StarArgTuple((_A, _A, *3 * [types.float32]))), generate

    return blend


def _by_rows(name: str, *shape: int) -> Any:
    """Make the intrinsic of a name; uncompiled, the function on views of memory.

    Its closure holds a name, not a function, so that kernels which call it are found on disk (`cache`).
    """
    if DISABLED:
        return partial(_SUMS[name][1], *shape)

    @intrinsic  # type: ignore[untyped-decorator]
    def by_rows(typing_context: Any, *given: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            _SUMS[name][2](_Vectors(builder, shape[-1]), *shape, *cgutils.unpack_tuple(builder, values[0]))
            return context.get_dummy_value()

        return types.none(types.StarArgTuple(_SUMS[name][0])), generate

    return by_rows


class _Vectors:
    """Write LLVM IR on rows of one width."""

    def __init__(self, builder: ir.IRBuilder, width: int, number: Any = None) -> None:
        self.number = number or ir.DoubleType()
        self.builder, self.width, self.kind = builder, width, ir.VectorType(self.number, width)

    def load(self, address: Any, index: int = 0) -> Any:
        """Load the row that begins at an index."""
        return self.builder.load(self.builder.bitcast(self._at(address, index), self.kind.as_pointer()), align=4)

    def store(self, address: Any, row: Any) -> None:
        """Store a row."""
        self.builder.store(row, self.builder.bitcast(self._at(address, 0), self.kind.as_pointer()), align=8)

    def fill(self, number: Any) -> Any:
        """Return a row of one number."""
        places, empty = ir.VectorType(ir.IntType(32), self.width), ir.Constant(self.kind, ir.Undefined)
        first = self.builder.insert_element(empty, number, ir.Constant(ir.IntType(32), 0))
        return self.builder.shuffle_vector(first, empty, ir.Constant(places, None))

    def products(self, count: int, rows: Any, factors: Any) -> list[Any]:
        """Return rows times their factors, all of which are loaded first: the output may overlap them."""
        numbers = [self.fill(self.builder.load(self._at(factors, k))) for k in range(count)]
        return [self.builder.fmul(self.load(rows, k * self.width), number) for k, number in enumerate(numbers)]

    def _at(self, address: Any, index: int) -> Any:
        pointer = self.builder.inttoptr(address, self.number.as_pointer())
        return self.builder.gep(pointer, [ir.Constant(ir.IntType(64), index)])


def _write_axpy(to: _Vectors, width: int, out: Any, x: Any, a: Any, y: Any, b: Any) -> None:
    to.store(out, to.builder.fadd(to.builder.fmul(to.load(x), to.fill(a)), to.builder.fmul(to.load(y), to.fill(b))))


def _write_sum(to: _Vectors, count: int, width: int, out: Any, *given: Any) -> None:
    to.store(out, reduce(to.builder.fadd, [*map(to.load, given[:-2]), *to.products(count, *given[-2:])]))


def _write_clip(to: _Vectors, width: int, x: Any, bound: Any) -> None:
    row, upper, lower = to.load(x), to.fill(bound), to.fill(to.builder.fneg(bound))
    row = to.builder.select(to.builder.fcmp_ordered("<", row, upper), row, upper)
    to.store(x, to.builder.select(to.builder.fcmp_ordered(">", row, lower), row, lower))


def _view(address: int, *shape: int) -> NDArray[np.float64]:
    """Return memory at an address as an array."""
    row = (ctypes.c_double * int(np.prod(shape))).from_address(int(address))
    return np.ctypeslib.as_array(row).reshape(shape)


def _plain_axpy(width: int, out: int, x: int, a: float, y: int, b: float) -> None:
    _view(out, width)[:] = a * _view(x, width) + b * _view(y, width)


def _plain_sum(count: int, width: int, out: int, *given: int) -> None:
    products = _view(given[-2], count, width) * _view(given[-1], count)[:, None]
    _view(out, width)[:] = reduce(np.add, [*(_view(first, width) for first in given[:-2]), *products])


def _plain_clip(width: int, x: int, bound: float) -> None:
    np.clip(_view(x, width), -bound, bound, out=_view(x, width))


_A, _F = types.intp, types.float64
_SUMS: dict[str, tuple[tuple[Any, ...], Any, Any]] = {  # types of arguments, plain function, writer of LLVM IR
    "axpy": ((_A, _A, _F, _A, _F), _plain_axpy, _write_axpy),
    "affine": ((_A, _A, _A, _A), _plain_sum, _write_sum),
    "matvec": ((_A, _A, _A), _plain_sum, _write_sum),
    "clip": ((_A, _F), _plain_clip, _write_clip),
}
# (first, second, one, other, along): four float32 between rows of four. At two addresses lie two rows each; between
# these a share each is taken, and a share `along` between the results.
blended = _blended()
