"""Interpolate the clearance field: distances sampled once on a grid, so that a million queries cost milliseconds.

The distance to a convex solid is convex with second derivatives of at most 1/distance, so bilinear interpolation of the
distance to the nearest of several solids is too high by at most h^2 / (4 d). That bound is subtracted: the field never
claims more clearance than there is. The border of the workspace is exact and kept out of the grid. The second wall is
the nearest solid in another direction; where another solid takes over, its clearance may jump.
"""

import math
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pirrht.geometry.scene import Workspace
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, kernel, load_float32, load_int32
from pirrht.jit.records import Held
from pirrht.jit.streams import ONE, ZERO

LEVELS = 4  # the coarsest grid has 2^(LEVELS - 1) times the spacing of the finest
REACH = TUNING.cutoff
LEVEL_BITS = 2  # of a table's entry: the lowest bits are a block's level, the others its number

Arrays = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]  # nearest, second, label


class Grid(NamedTuple):
    """Clearance of the robot's centre on a grid of nx * ny points, as numbers that kernels can take cheaply.

    Where the points lie in blocks, one of level l has spacing 2^l h, and so many points in each of its columns.
    """

    x0: float  # position of grid point (0, 0) [m]
    y0: float  # [m]
    spacing: float  # h [m]
    per: float  # 1/h [1/m]
    nx: int
    ny: int
    stride: int  # points from one column to the next: ny, or those of a block's column
    table: int  # address of int32 (rows, columns): number and level of the block that holds a place; 0: no table
    columns: int  # of the table
    shift: int  # a place of the table is 2^shift cells wide
    nearest: int  # address of float32 per point: clearance to the nearest solid, never too high [m]
    second: int  # address of float32 per point: clearance to the nearest that stands in another direction [m]
    label: int  # address of int32 per point: index of the nearest solid
    left: float  # border of the workspace [m]
    low: float  # [m]
    right: float  # [m]
    high: float  # [m]


class Field(Held, Grid):
    """A `Grid` together with the arrays that its addresses point to."""

    @classmethod
    def of(cls, world: Workspace, spacing: float, arrays: Arrays, table: NDArray[np.int32] | None = None) -> Self:
        """Take hold of values of points in columns (nx, ny) or in blocks (k, stride, stride).

        The first point lies at the world's least corner, the finest are `spacing` apart [m]. `arrays` are clearances
        from the nearest solid and from the second wall [m], and labels; `table` has numbers and levels of the blocks.
        """
        nx, stride = arrays[0].shape[-2:]
        shape: tuple[Any, ...] = (nx, stride, stride, 0, 0, 0)
        if table is not None:
            cells = stride - 1
            shape = (*(cells * n + 1 for n in table.shape), stride, table, table.shape[1], cells.bit_length() - 1)
        corner = world.lower.astype(float)
        return cls.holding(*corner, spacing, 1.0 / spacing, *shape, *arrays, *corner, *world.upper.astype(float))

    def set_back(self, distance: float) -> Self:
        """Return the field with all walls, the border included, moved back by a distance [m]."""
        return self._replace(
            nearest=self.held["nearest"] + np.float32(distance),
            second=self.held["second"] + np.float32(distance),
            left=self.left - distance,
            low=self.low - distance,
            right=self.right + distance,
            high=self.high + distance,
        )


@inlined
def border(field, x, y):  # type: ignore[no-untyped-def]
    """Return the distance of (x, y) [m] to the border of the workspace, negative outside [m]."""
    return min(min(x - field.left, field.right - x), min(y - field.low, field.high - y))


@inlined
def finest_cell(field, x, y):  # type: ignore[no-untyped-def]
    """Return (x, y) [m] in spacings from the grid's first point, and the cell (i, j) of the finest grid."""
    fx = (x - field.x0) * field.per
    fy = (y - field.y0) * field.per
    i = min(max(np.int32(fx), np.int32(0)), np.int32(field.nx - 2))
    j = min(max(np.int32(fy), np.int32(0)), np.int32(field.ny - 2))
    return fx, fy, i, j


@inlined
def cell_of(field, x, y):  # type: ignore[no-untyped-def]
    """Return the cell of (x, y) [m]: index of its first point, place in it, 0 to 1 each, and 1/width [1/m]."""
    fx, fy, i, j = finest_cell(field, x, y)
    if field.table == 0:
        return i * np.int32(field.ny) + j, fx - np.float32(i), fy - np.float32(j), field.per
    return cell_in_block(field, fx, fy, i, j)


@inlined
def cell_in_block(field, fx, fy, i, j):  # type: ignore[no-untyped-def]
    """Return what `cell_of` does in a field of blocks, from what `finest_cell` returns."""
    entry = load_int32(field.table, (i >> field.shift) * field.columns + (j >> field.shift))
    level = entry & ((1 << LEVEL_BITS) - 1)
    span = field.shift + level

    bi = (i >> span) << span
    bj = (j >> span) << span
    ci = (i - bi) >> level
    cj = (j - bj) >> level

    share = ONE / np.float32(1 << level)
    at = ((entry >> LEVEL_BITS) * field.stride + ci) * field.stride + cj
    u = (fx - np.float32(bi)) * share - np.float32(ci)
    v = (fy - np.float32(bj)) * share - np.float32(cj)

    return at, u, v, field.per * share


@inlined
def bilinear(a, b, c, d, u, v):  # type: ignore[no-untyped-def]
    """Return the value at (u, v), 0 to 1 each, in a cell; corners a, b are in the first column, c, d in the second."""
    low = a * (ONE - v) + b * v
    high = c * (ONE - v) + d * v

    return low * (ONE - u) + high * u


@inlined
def bilinear_slope(a, b, c, d, u, v, per):  # type: ignore[no-untyped-def]
    """Return the bilinear value and its gradient (d/dx, d/dy) [value/m], with `per` cells per meter [1/m]."""
    low = a * (ONE - v) + b * v
    high = c * (ONE - v) + d * v

    return low * (ONE - u) + high * u, (high - low) * per, ((b - a) * (ONE - u) + (d - c) * u) * per


@inlined
def _corners(field, grid, x, y):  # type: ignore[no-untyped-def]
    at, u, v, per = cell_of(field, x, y)
    a = load_float32(grid, at)
    b = load_float32(grid, at + 1)

    return a, b, load_float32(grid, at + field.stride), load_float32(grid, at + field.stride + 1), u, v, per


@inlined
def interpolate(field, grid, x, y):  # type: ignore[no-untyped-def]
    """Return the bilinear value [m] at (x, y) [m] in the workspace of the grid at an address of the field."""
    a, b, c, d, u, v, _ = _corners(field, grid, x, y)
    return bilinear(a, b, c, d, u, v)


@inlined
def with_slope(field, grid, x, y):  # type: ignore[no-untyped-def]
    """Return the bilinear value [m] at (x, y) [m] and its gradient (d/dx, d/dy) [m/m]."""
    a, b, c, d, u, v, per = _corners(field, grid, x, y)
    return bilinear_slope(a, b, c, d, u, v, per)


@inlined
def closest(field, x, y):  # type: ignore[no-untyped-def]
    """Return the index of the point closest to (x, y) [m], (x, y) as seen from it [m], and the spacing there [m]."""
    at, u, v, per = cell_of(field, x, y)
    i = 1 if u >= 0.5 else 0
    j = 1 if v >= 0.5 else 0

    return at + i * field.stride + j, (u - i) / per, (v - j) / per, 1.0 / per


@kernel
def nearest_label(field, x, y):  # type: ignore[no-untyped-def]
    """Return the solid that is nearest at the grid's point closest to (x, y) [m]; -1 where none is near."""
    return load_int32(field.label, closest(field, x, y)[0])


@inlined
def clearance(field, x, y):  # type: ignore[no-untyped-def]
    """Return a lower bound [m] of the clearance at (x, y) [m], border included."""
    edge = border(field, x, y)
    return edge if edge <= 0.0 else min(edge, interpolate(field, field.nearest, x, y))


@inlined
def two_walls(field, x, y):  # type: ignore[no-untyped-def]
    """Return the two nearest walls at (x, y) [m], border included: distance [m] and unit vector away from it, each."""

    return walls_of(field, x, y, with_slope(field, field.nearest, x, y), with_slope(field, field.second, x, y))


@inlined
def _with_edge(e, ex, ey, c, nx, ny, d, mx, my):  # type: ignore[no-untyped-def]
    """Return the two nearest of three walls, the last two of which are in order."""
    first = e < c
    later = e < d

    d = c if first else (e if later else d)
    mx = nx if first else (ex if later else mx)
    my = ny if first else (ey if later else my)

    return e if first else c, ex if first else nx, ey if first else ny, d, mx, my


@inlined
def walls_of(field, x, y, nearest, second):  # type: ignore[no-untyped-def]
    """Return the two nearest walls from clearances (c, gx, gy) [m] of two obstacles, in single precision."""
    c = np.float32(nearest[0])
    nx = np.float32(nearest[1])
    ny = np.float32(nearest[2])

    d = np.float32(second[0])
    mx = np.float32(second[1])
    my = np.float32(second[2])
    d = d if mx * mx + my * my < np.float32(2.0) else np.float32(1e6)  # steeper than a distance can be: another wall

    tiny = np.float32(1e-12)  # for places on a wall
    one = ONE / math.sqrt(nx * nx + ny * ny + tiny)
    other = ONE / math.sqrt(mx * mx + my * my + tiny)
    nx, ny = one * nx, one * ny
    mx, my = other * mx, other * my

    left = np.float32(x - field.left)
    right = np.float32(field.right - x)
    low = np.float32(y - field.low)
    high = np.float32(field.high - y)

    across = min(left, right)
    along = min(low, high)
    side = ONE if left < right else -ONE
    level = ONE if low < high else -ONE

    c, nx, ny, d, mx, my = _with_edge(across, side, ZERO, c, nx, ny, d, mx, my)
    return _with_edge(along, ZERO, level, c, nx, ny, d, mx, my)
