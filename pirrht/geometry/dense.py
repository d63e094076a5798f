"""Sample the clearance field of a small world: FCL's distances on one grid, coarser far from obstacles.

A level's points are queried where the coarser level's cells are near a wall or walls change; elsewhere its values are
carried over, less what interpolation may be too high by.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import LEVELS, REACH, Field
from pirrht.geometry.tuning import TUNING

Mask = NDArray[np.bool_]  # (nx, ny)
Values = tuple[Array, Array, NDArray[np.int64]]  # nearest, second and label at the points of a grid, (nx, ny)


def dense_shape(span: Array, h: float) -> tuple[int, int]:
    """Return the points of the grid that covers a workspace's span (2,) [m] with a spacing h [m]."""
    nx, ny = (np.ceil(span / (h * 2 ** (LEVELS - 1))).astype(int) * 2 ** (LEVELS - 1) + 1).tolist()
    return nx, ny


def build_dense(collision: Collision, members: Sequence[int], h: float) -> Field:
    """Sample clearances [m] from the solids that count on a grid of spacing h [m]."""
    world, r, least_r = collision.world, collision.footprint.radius, collision.least_radius
    span = world.upper - world.lower
    coarse = h * 2 ** (LEVELS - 1)
    shape = np.ceil(span / coarse).astype(int) + 1
    level = _Level(collision, members, h)
    every = np.ones(tuple(shape), dtype=bool)
    nearest, second, label = level.at(coarse, every, ~every, None)
    width = coarse
    for _ in range(LEVELS - 1):
        least, most = _least(nearest), -_least(-nearest)
        margin = width**2 / (4.0 * np.maximum(least + least_r - np.sqrt(2.0) * width, 0.5 * least_r))
        shallow, near = most > -1.5 * width, TUNING.sharp * r
        corners = world.lower + width * np.moveaxis(np.indices(least.shape), 0, -1)
        refine = _within(shallow & (least < TUNING.band * width) | collision.near_waivers(corners, 2.0 * width))
        change = _within(_change(shallow & (least < near), second, label, width, near))
        width /= 2.0
        near_guess, second_guess = _upsample(nearest) - _fill(margin), _upsample(second)
        label_guess = np.repeat(np.repeat(label, 2, axis=0), 2, axis=1)[: near_guess.shape[0], : near_guess.shape[1]]
        guess = (near_guess, second_guess, label_guess.copy())
        guess[0][::2, ::2] = nearest
        nearest, second, label = level.at(width, refine, change, guess)
    final = width**2 / (4.0 * np.maximum(nearest + least_r, least_r) - 4.0 * np.sqrt(2.0) * width)
    return Field.of(world, float(width), nearest - final, second - final, label)


class _Level:
    """The grid points of one level, for which FCL is queried where masks select them."""

    def __init__(self, collision: Collision, members: Sequence[int], cell: float) -> None:
        self.collision, self.members, self.cell = collision, members, cell

    def at(self, width: float, refine: Mask, change: Mask, guess: Values | None) -> Values:
        """Return values at points to refine, second wall and label where these change, and elsewhere the guess."""
        if guess is None:
            shape, far = refine.shape, REACH if self.members else TUNING.nothing
            cutoff, guess = REACH, (np.full(shape, far), np.full(shape, far), np.full(shape, -1, dtype=np.int64))
        else:
            cutoff = min(REACH, 2.0 * (TUNING.band + 1.5) * width)  # no nearest solid of a refined cell is farther
        if self.members:
            near = max(cutoff, min(REACH, TUNING.sharp * self.collision.footprint.radius + 3.0 * width))
            self.query(width, refine & ~change, refine, cutoff, guess)
            self.query(width, change, refine, near, guess)
        return guess

    def query(self, width: float, mask: Mask, refine: Mask, cutoff: float, values: Values) -> None:
        """Put walls that are found within a cutoff [m] into the values, in place."""
        (nearest, second, label), at, r = values, np.nonzero(mask), self.collision.footprint.radius
        points = self.collision.world.lower + np.column_stack(at) * width
        one, two, which, _ = self.collision.nearest_walls(points, self.members, cutoff + r, self.cell)
        nearest[at] = np.where(refine[at], one - r, nearest[at])  # a guess is what it has to be: never too high
        label[at] = which
        second[at] = np.where(two < cutoff + r, two - r, np.maximum(second[at], cutoff))


def _least(values: Array) -> Array:
    """Return the least corner of each cell."""
    least: Array = np.minimum(
        np.minimum(values[:-1, :-1], values[1:, :-1]), np.minimum(values[:-1, 1:], values[1:, 1:])
    )
    return least


def _change(cells: Mask, second: Array, label: NDArray[np.int64], width: float, near: float) -> Mask:
    """Return in which of these cells another solid takes over as one of two near walls."""
    i, j = np.nonzero(cells)
    corners = (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)
    values, labels = np.array([second[at] for at in corners]), np.array([label[at] for at in corners])
    changes = np.zeros_like(cells)
    changes[i, j] = (np.ptp(values, axis=0) > 1.5 * width) & (values.min(axis=0) < near)
    changes[i, j] |= np.ptp(labels, axis=0) > 0
    return changes


def _within(cell: Mask) -> Mask:
    """Return points of the next finer grid that lie in cells, less those of this one."""
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
