"""Sums of short rows inside kernels, a whole row at once.

Numba's loops over a few numbers take them one by one, since what they write might be what they read, and a vector that
is read after its numbers were written singly waits for all of them. Rows of a law are as long as a step has modes, and
one instruction takes one.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pirrht.jit.addresses import load_float64, store_float64
from pirrht.jit.jit import DISABLED


@cache
def mixed(width: int) -> Any:
    """The function (out, x, a, y, b), of addresses and numbers, that writes a x + b y of rows of so many numbers."""

    def plain(out: int, x: int, a: float, y: int, b: float) -> None:
        for j in range(width):
            store_float64(out, j, a * load_float64(x, j) + b * load_float64(y, j))

    @intrinsic  # type: ignore[untyped-decorator]
    def mix(typing_context: Any, out: Any, x: Any, a: Any, y: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            out, x, a, y, b = given
            one = builder.fmul(_row(builder, width, x), _all(builder, width, a))
            other = builder.fmul(_row(builder, width, y), _all(builder, width, b))
            _write(builder, width, out, builder.fadd(one, other))
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, types.float64, types.intp, types.float64), generate

    return plain if DISABLED else mix


@cache
def summed(count: int, width: int) -> Any:
    """The function (out, first, rows, factors), of addresses, that adds `count` rows times their factors to the first.

    Rows have `width` numbers; those that are added lie one after the other.
    """

    def plain(out: int, first: int, rows: int, factors: int) -> None:
        _added(out, [load_float64(first, j) for j in range(width)], rows, factors, count)

    @intrinsic  # type: ignore[untyped-decorator]
    def add(typing_context: Any, out: Any, first: Any, rows: Any, factors: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            out, first, rows, factors = given
            total = _row(builder, width, first)
            for one in _weighed(builder, count, width, rows, factors):
                total = builder.fadd(total, one)
            _write(builder, width, out, total)
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, types.intp, types.intp), generate

    return plain if DISABLED else add


@cache
def product(count: int, width: int) -> Any:
    """The same without a first row: (out, rows, factors)."""

    def plain(out: int, rows: int, factors: int) -> None:
        _added(out, [0.0] * width, rows, factors, count)

    @intrinsic  # type: ignore[untyped-decorator]
    def multiply(typing_context: Any, out: Any, rows: Any, factors: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            out, rows, factors = given
            total, *others = _weighed(builder, count, width, rows, factors)
            for one in others:
                total = builder.fadd(total, one)
            _write(builder, width, out, total)
            return context.get_dummy_value()

        return types.none(types.intp, types.intp, types.intp), generate

    return plain if DISABLED else multiply


@cache
def bounded(width: int) -> Any:
    """The function (x, bound), of an address and a number, that keeps so many numbers within plus and minus it."""

    def plain(x: int, bound: float) -> None:
        for j in range(width):
            store_float64(x, j, max(-bound, min(bound, load_float64(x, j))))

    @intrinsic  # type: ignore[untyped-decorator]
    def bind(typing_context: Any, x: Any, bound: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            x, bound = given
            most, least = _all(builder, width, bound), _all(builder, width, builder.fneg(bound))
            row = _row(builder, width, x)
            row = builder.select(builder.fcmp_ordered("<", row, most), row, most)
            row = builder.select(builder.fcmp_ordered(">", row, least), row, least)
            _write(builder, width, x, row)
            return context.get_dummy_value()

        return types.none(types.intp, types.float64), generate

    return plain if DISABLED else bind


def _added(out: int, totals: list[float], rows: int, factors: int, count: int) -> None:
    """Write totals and rows times their factors: what is not compiled does."""
    width = len(totals)
    for k in range(count):
        for j in range(width):
            totals[j] += load_float64(rows, k * width + j) * load_float64(factors, k)
    for j in range(width):
        store_float64(out, j, totals[j])


def _weighed(builder: ir.IRBuilder, count: int, width: int, rows: Any, factors: Any) -> list[Any]:
    """Rows times their factors."""
    numbers = [_all(builder, width, builder.load(_at(builder, factors, k))) for k in range(count)]
    return [builder.fmul(_row(builder, width, rows, k * width), number) for k, number in enumerate(numbers)]


def _at(builder: ir.IRBuilder, address: Any, index: int) -> Any:
    pointer = builder.inttoptr(address, ir.DoubleType().as_pointer())
    return builder.gep(pointer, [ir.Constant(ir.IntType(64), index)])


def _row(builder: ir.IRBuilder, width: int, address: Any, index: int = 0) -> Any:
    """The row that begins there."""
    row = ir.VectorType(ir.DoubleType(), width)
    return builder.load(builder.bitcast(_at(builder, address, index), row.as_pointer()), align=8)


def _write(builder: ir.IRBuilder, width: int, address: Any, numbers: Any) -> None:
    row = ir.VectorType(ir.DoubleType(), width)
    builder.store(numbers, builder.bitcast(_at(builder, address, 0), row.as_pointer()), align=8)


def _all(builder: ir.IRBuilder, width: int, number: Any) -> Any:
    """A row of the same number."""
    row, places = ir.VectorType(ir.DoubleType(), width), ir.VectorType(ir.IntType(32), width)
    first = builder.insert_element(ir.Constant(row, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, ir.Constant(row, ir.Undefined), ir.Constant(places, None))
