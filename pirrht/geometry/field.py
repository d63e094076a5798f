"""The clearance field: FCL sampled once on a grid, so that a million queries cost milliseconds.

The distance to a convex solid is convex with second derivatives of at most 1/distance, so bilinear interpolation
of the distance to the nearest of several solids is too high by at most h^2 / (4 d). That bound is subtracted: the
field never claims more clearance than there is. The border of the workspace is exact and kept out of the grid.

The second wall is the nearest solid in another direction; where another solid takes over, its clearance may jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.addresses import load_float32, load_int32
from pirrht.compiled.float32 import ONE
from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import World

LEVELS = 4  # the coarsest grid has 2^(LEVELS - 1) times the spacing of the finest
BAND = 2.0  # a cell is refined where its clearance is less than this many of its own widths
REACH = 1.0  # the field tells no clearance above this [m]; exits and bridges are decided far below it
SHARP = 4.0  # where walls change that are less than this many robot radii away, the change is refined
NOTHING = 1e6  # clearance where there are no obstacles at all [m]

Mask = NDArray[np.bool_]  # (nx, ny)
Values = tuple[Array, Array, NDArray[np.int64]]  # nearest, second and label at the points of a grid, (nx, ny)


class Grid(NamedTuple):
    """Clearance of the robot's centre on a grid of nx * ny points, as numbers that kernels can take cheaply."""

    x0: float  # position of grid point (0, 0) [m]
    y0: float  # [m]
    spacing: float  # h [m]
    per: float  # 1/h [1/m]
    nx: int
    ny: int
    nearest: int  # address of float32 (nx, ny): clearance to the nearest solid, never too high [m]
    second: int  # address of float32 (nx, ny): clearance to the nearest that stands in another direction [m]
    label: int  # address of int32 (nx, ny): index of the nearest solid
    left: float  # border of the workspace [m]
    low: float  # [m]
    right: float  # [m]
    high: float  # [m]


class Field(Grid):
    """The same together with the arrays that the addresses point to."""

    arrays: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]  # nearest, second, label

    @classmethod
    def of(cls, world: World, spacing: float, nearest: Array, second: Array, label: NDArray[np.int64]) -> Field:
        """Take hold of values (nx, ny), clearances [m] and labels, that start at the workspace's least corner."""
        arrays = (
            np.ascontiguousarray(nearest, dtype=np.float32),
            np.ascontiguousarray(second, dtype=np.float32),
            np.ascontiguousarray(label, dtype=np.int32),
        )
        corner, end = world.lower.astype(float), world.upper.astype(float)
        addresses = (array.ctypes.data for array in arrays)
        field = cls(corner[0], corner[1], spacing, 1.0 / spacing, *nearest.shape, *addresses, *corner, *end)
        field.arrays = arrays
        return field


def set_back(field: Field, distance: float) -> Field:
    """The same field with all walls, the border included, moved back by a distance [m]."""
    nearest, second, label = field.arrays
    arrays = nearest + np.float32(distance), second + np.float32(distance), label
    moved = field._replace(
        nearest=arrays[0].ctypes.data,
        second=arrays[1].ctypes.data,
        left=field.left - distance,
        low=field.low - distance,
        right=field.right + distance,
        high=field.high + distance,
    )
    moved.arrays = arrays
    return moved


def build_field(collision: Collision, members: Sequence[int]) -> Field:
    """Sample FCL's clearances [m] from the solids that count, coarser far from obstacles."""
    world, r = collision.world, collision.footprint.radius
    span = world.upper - world.lower
    h = float(max(r / 8.0, span.max() / 4000.0))
    coarse = h * 2 ** (LEVELS - 1)
    shape = np.ceil(span / coarse).astype(int) + 1
    level = _Level(collision, members)
    every = np.ones(tuple(shape), dtype=bool)
    nearest, second, label = level.at(coarse, every, ~every, None)
    width = coarse
    for _ in range(LEVELS - 1):
        least, most = _least(nearest), -_least(-nearest)
        margin = width**2 / (4.0 * np.maximum(least + r - np.sqrt(2.0) * width, 0.5 * r))
        shallow, near = most > -1.5 * width, SHARP * r
        refine = _within(shallow & (least < BAND * width))
        change = _within(_change(shallow & (least < near), second, label, width, near))
        width /= 2.0
        near_guess, second_guess = _upsample(nearest) - _fill(margin), _upsample(second)
        label_guess = np.repeat(np.repeat(label, 2, axis=0), 2, axis=1)[: near_guess.shape[0], : near_guess.shape[1]]
        guess = (near_guess, second_guess, label_guess.copy())
        guess[0][::2, ::2] = nearest
        nearest, second, label = level.at(width, refine, change, guess)
    final = width**2 / (4.0 * np.maximum(nearest + r, r) - 4.0 * np.sqrt(2.0) * width)
    return Field.of(world, float(width), nearest - final, second - final, label)


class _Level:
    """Asks FCL for the grid points of one level that masks select."""

    def __init__(self, collision: Collision, members: Sequence[int]) -> None:
        self.collision, self.members = collision, members

    def at(self, width: float, refine: Mask, change: Mask, guess: Values | None) -> Values:
        """Values at the points to refine, and the second wall and the label where these change; elsewhere the guess."""
        if guess is None:
            shape, far = refine.shape, REACH if self.members else NOTHING
            reach, guess = REACH, (np.full(shape, far), np.full(shape, far), np.full(shape, -1, dtype=np.int64))
        else:
            reach = min(REACH, 2.0 * (BAND + 1.5) * width)  # no nearest solid of a refined cell is farther
        if self.members:
            near = max(reach, min(REACH, SHARP * self.collision.footprint.radius + 3.0 * width))
            self.ask(width, refine & ~change, refine, reach, guess)
            self.ask(width, change, refine, near, guess)
        return guess

    def ask(self, width: float, mask: Mask, refine: Mask, reach: float, values: Values) -> None:
        """Put what is found within reach [m] into the values, in place."""
        (nearest, second, label), at, r = values, np.nonzero(mask), self.collision.footprint.radius
        points = self.collision.world.lower + np.column_stack(at) * width
        one, two, which, _ = self.collision.nearest_walls(points, self.members, reach + r)
        nearest[at] = np.where(refine[at], one - r, nearest[at])  # a guess is what it has to be: never too high
        label[at] = which
        second[at] = np.where(two < reach + r, two - r, np.maximum(second[at], reach))


def _least(values: Array) -> Array:
    """Least corner of each cell."""
    least: Array = np.minimum(
        np.minimum(values[:-1, :-1], values[1:, :-1]), np.minimum(values[:-1, 1:], values[1:, 1:])
    )
    return least


def _change(cells: Mask, second: Array, label: NDArray[np.int64], width: float, near: float) -> Mask:
    """In which of these cells another solid takes over as one of two near walls."""
    i, j = np.nonzero(cells)
    corners = (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)
    values, labels = np.array([second[at] for at in corners]), np.array([label[at] for at in corners])
    changes = np.zeros_like(cells)
    changes[i, j] = (np.ptp(values, axis=0) > 1.5 * width) & (values.min(axis=0) < near)
    changes[i, j] |= np.ptp(labels, axis=0) > 0
    return changes


def _within(cell: Mask) -> Mask:
    """Points of the next finer grid that lie in cells, less those of this one."""
    fine = np.zeros(tuple(2 * s + 1 for s in cell.shape), dtype=bool)
    block = np.repeat(np.repeat(cell, 2, axis=0), 2, axis=1)
    for i in (0, 1):
        for j in (0, 1):
            fine[i : i + block.shape[0], j : j + block.shape[1]] |= block
    fine[::2, ::2] = False
    return fine


def _upsample(values: Array) -> Array:
    fine = np.empty(tuple(2 * s - 1 for s in values.shape))
    fine[::2, ::2] = values
    fine[1::2, ::2] = 0.5 * (values[:-1] + values[1:])
    fine[::2, 1::2] = 0.5 * (values[:, :-1] + values[:, 1:])
    fine[1::2, 1::2] = 0.25 * (values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:])
    return fine


def _fill(margin: Array) -> Array:
    """Spread a bound per cell to the points of the next finer grid (the largest of the cells around)."""
    fine = np.zeros(tuple(2 * s + 1 for s in margin.shape))
    block = np.repeat(np.repeat(margin, 2, axis=0), 2, axis=1)
    for i in (0, 1):
        for j in (0, 1):
            view = fine[i : i + block.shape[0], j : j + block.shape[1]]
            np.maximum(view, block, out=view)
    return fine


@inlined
def border(field, x, y):  # type: ignore[no-untyped-def]
    """Distance of (x, y) [m] to the border of the workspace, negative outside [m]."""
    return min(min(x - field.left, field.right - x), min(y - field.low, field.high - y))


@inlined
def cell_of(field, x, y):  # type: ignore[no-untyped-def]
    """Index i ny + j of the cell's first grid point, and where (x, y) [m] lies in the cell, each from 0 to 1."""
    fx, fy = (x - field.x0) * field.per, (y - field.y0) * field.per
    i = min(max(np.int32(fx), np.int32(0)), np.int32(field.nx - 2))
    j = min(max(np.int32(fy), np.int32(0)), np.int32(field.ny - 2))
    return i * np.int32(field.ny) + j, fx - np.float32(i), fy - np.float32(j)


@inlined
def bilinear(a, b, c, d, u, v):  # type: ignore[no-untyped-def]
    """Value at (u, v) in a cell, each from 0 to 1; corner values a, b in the first column and c, d in the second."""
    low, high = a * (ONE - v) + b * v, c * (ONE - v) + d * v
    return low * (ONE - u) + high * u


@inlined
def bilinear_slope(a, b, c, d, u, v, per):  # type: ignore[no-untyped-def]
    """The same and its gradient (d/dx, d/dy) [value/m], with `per` cells per meter [1/m]."""
    low, high = a * (ONE - v) + b * v, c * (ONE - v) + d * v
    return low * (ONE - u) + high * u, (high - low) * per, ((b - a) * (ONE - u) + (d - c) * u) * per


@inlined
def _corners(field, grid, x, y):  # type: ignore[no-untyped-def]
    at, u, v = cell_of(field, x, y)
    a, b = load_float32(grid, at), load_float32(grid, at + 1)
    return a, b, load_float32(grid, at + field.ny), load_float32(grid, at + field.ny + 1), u, v


@inlined
def interpolate(field, grid, x, y):  # type: ignore[no-untyped-def]
    """Bilinear value [m] at (x, y) [m] in the workspace of the grid at an address, field.nearest or field.second."""
    a, b, c, d, u, v = _corners(field, grid, x, y)
    return bilinear(a, b, c, d, u, v)


@inlined
def with_slope(field, grid, x, y):  # type: ignore[no-untyped-def]
    """The same and its gradient (d/dx, d/dy) [m/m]."""
    a, b, c, d, u, v = _corners(field, grid, x, y)
    return bilinear_slope(a, b, c, d, u, v, field.per)


@inlined
def closest(field, x, y):  # type: ignore[no-untyped-def]
    """Indices (i, j) of the grid point closest to (x, y) [m]."""
    i = min(max(int((x - field.x0) / field.spacing + 0.5), 0), field.nx - 1)
    j = min(max(int((y - field.y0) / field.spacing + 0.5), 0), field.ny - 1)
    return i, j


@kernel
def nearest_label(field, x, y):  # type: ignore[no-untyped-def]
    """Solid that is nearest at the grid point closest to (x, y) [m]; -1 where none is near."""
    i, j = closest(field, x, y)
    return load_int32(field.label, i * field.ny + j)


@inlined
def clearance(field, x, y):  # type: ignore[no-untyped-def]
    """A lower bound [m] of the clearance at (x, y) [m], border included."""
    edge = border(field, x, y)
    if edge <= 0.0:
        return edge
    return min(edge, interpolate(field, field.nearest, x, y))
