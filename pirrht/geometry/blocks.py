"""Sample the clearance field of a world: on one grid in a small world, in square blocks of points in a large one.

Every point is sampled, so the field errs by what bilinear interpolation can be too high by, which is subtracted. The
distance to a convex solid is convex with second derivatives of at most 1/distance: a cell of width h errs by at most
h^2 / (4 d), and by nothing next to a flat face, where its gradient is the same at all corners.

Blocks are fine where walls are near or change, else coarse; all of one level have the same number of points and spacing
2^level h. A table names for every place the finest block that covers it. Where no solid is within cutoff all places
share one constant block.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, BoolArray
from pirrht.errors import SceneError
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import LEVEL_BITS, LEVELS, REACH, Arrays, Field
from pirrht.geometry.tuning import TUNING
from pirrht.geometry.walls import Found

TOP = LEVELS - 1

Origins = NDArray[np.int64]  # (k, 2) first cells of blocks, in the finest spacing


def build_field(
    collision: Collision, members: Sequence[int], *, cells: float = TUNING.cells_per_radius, fine: float = 0.0
) -> Field:
    """Sample clearances [m] from the solids that count; SceneError: the workspace is too large.

    Args: spacings in the robot's radius; clearance up to which cells next to curved walls and corners are finest [m].
    """
    world, radius = collision.world, collision.least_radius
    span = world.upper - world.lower
    farthest = float(np.abs([world.lower, world.upper]).max())
    h = radius / cells
    if farthest > TUNING.single_cells * h:
        raise SceneError(
            f"{_too_large(span, radius)}: {farthest:g} m from the origin positions are too coarse for it; up to "
            f"{_rounded(TUNING.single_cells * h, math.floor)} m works, or a radius of "
            f"{_rounded(farthest * cells / TUNING.single_cells, math.ceil)} m or more"
        )
    counts = np.ceil(span / h - 1e-9).astype(int) + 1
    if float(np.prod(counts.astype(float))) > TUNING.dense_points:
        return build_blocks(collision, members, h, fine)
    arrays, _ = _sampled(collision, members, h, world.lower + h * lattice(*counts)[None], None)
    nearest, second, label = arrays
    return Field.of(world, h, (nearest[0], second[0], label[0]))


def build_blocks(collision: Collision, members: Sequence[int], h: float, fine: float = 0.0) -> Field:
    """Sample clearances [m] from the solids that count in blocks, the finest of spacing h [m]; SceneError: too many."""
    span = collision.world.upper - collision.world.lower
    for cells in (8, 16, 32):  # wider ones make the table smaller and waste more points
        tops = np.ceil(span / (h * cells * 2**TOP) - 1e-9)
        entries = float(np.prod(tops * 2.0**TOP))
        if entries <= TUNING.table_places:
            break
    _require(entries, TUNING.table_places, collision, members)
    table = np.full((tops * 2**TOP).astype(int), TOP, dtype=np.int32)  # block 0, which is constant
    steps = np.arange(2**TOP)
    places = lattice(cells + 1, cells + 1)
    far = REACH if len(members) else TUNING.nothing
    shape = (1, cells + 1, cells + 1)
    parts: list[Arrays] = [
        (np.full(shape, far, np.float32), np.full(shape, far, np.float32), np.full(shape, -1, np.int32))
    ]
    origins, size = _near_blocks(collision, members, h * cells * 2**TOP, tops) * (cells << TOP), 1
    _require(len(origins) * cells**2, TUNING.coarse_cells, collision, members)
    for level in range(TOP, -1, -1):
        _require((size + len(origins)) * (cells + 1) ** 2, TUNING.block_points, collision, members)
        children = [origins[:0]]
        for some in np.array_split(origins, range(TUNING.blocks_at_once, len(origins), TUNING.blocks_at_once)):
            points = collision.world.lower + (some[:, None, None] + (places << level)) * h
            arrays, coarse = _sampled(collision, members, h * 2**level, points, fine if level else None)
            i, j = (some // cells).T
            at = steps[: 1 << level]
            table[i[:, None, None] + at[:, None], j[:, None, None] + at] = (
                (size + np.arange(len(some))) << LEVEL_BITS | level
            )[:, None, None]
            parts.append(arrays)
            size += len(some)
            b, i, j = np.nonzero(coarse.reshape(-1, 2, cells // 2, 2, cells // 2).any(axis=(2, 4)))
            children.append(some[b] + np.column_stack((i, j)) * (cells << level >> 1))
        origins = np.concatenate(children)
        origins = origins[np.all(origins * h < span, axis=1)]
    nearest, second, label = (np.concatenate(values) for values in zip(*parts, strict=True))
    return Field.of(collision.world, h, (nearest, second, label), table)


def _sampled(
    collision: Collision, members: Sequence[int], width: float, points: Array, fine: float | None
) -> tuple[Arrays, BoolArray]:
    """Sample blocks of points (k, nx, ny, 2) [m] so far apart [m]. `fine` as of `build_field`; None: none is finer.

    Returns: clearances that are never too high and labels; cells (k, nx - 1, ny - 1) too wide for the walls in them.
    """
    shape, r, least_r = points.shape[:3], collision.footprint.radius, collision.least_radius
    sharp = TUNING.sharp * r
    walls = collision.nearest_walls(
        points.reshape(-1, 2), members, (REACH if len(members) else TUNING.nothing) + r, width
    )
    near = (walls.first - r).reshape(shape)
    far = (walls.second - r).reshape(shape)
    label = walls.which.astype(np.int32).reshape(shape)
    away = np.maximum(near, 0.0) + least_r - math.sqrt(2.0) * width  # at least, of places in the cell that are free
    margin = width**2 / (4.0 * np.maximum(away, 0.5 * least_r))
    coarse = np.zeros((shape[0], shape[1] - 1, shape[2] - 1), dtype=np.bool_)
    if fine is not None:
        least, most = _extremes(near)
        low, high = _extremes(far)
        one, other = _extremes(label)

        flat = _flat(walls, shape, one == other, most + r, width)
        changes = (least < sharp) & ((one != other) | (high - low > 1.5 * width) & (low < sharp))
        coarse = (most > max(-1.5 * width, -r)) & ((least < max(TUNING.band * width, fine)) & ~flat | changes)
        around = np.pad(coarse | flat, ((0, 0), (1, 1), (1, 1)), constant_values=True)  # cells around each point
        margin[around[:, 1:, 1:] & around[:, 1:, :-1] & around[:, :-1, 1:] & around[:, :-1, :-1]] = 0.0
    return ((near - margin).astype(np.float32), (far - margin).astype(np.float32), label), coarse


def _flat(walls: Found, shape: tuple[int, ...], alone: BoolArray, most: Array, width: float) -> BoolArray:
    """Return in which cells the distance is linear: one solid is nearest, and its gradient the same at all corners.

    `walls` are of points (k,) in blocks (blocks, nx, ny); `alone` (blocks, nx - 1, ny - 1) tells where the same solid
    is nearest at all corners, at `most` so far away [m]; `width` is that of a cell [m].
    """
    farther = _extremes(walls.other.reshape(shape))[0] > most + 1.5 * width
    slopes = (walls.away / np.maximum(walls.first, 1e-300)[:, None]).reshape(*shape, 2)
    for slope in (slopes[..., 0], slopes[..., 1]):
        low, high = _extremes(slope)
        alone = alone & (high - low < 1e-7)
    return alone & farther & (_extremes(walls.first.reshape(shape))[0] > 0.0)


def _extremes(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the least and the greatest of the values (k, nx, ny) at the corners of each cell."""
    low, high = (extreme(values[:, :-1], values[:, 1:]) for extreme in (np.minimum, np.maximum))
    return np.minimum(low[..., :-1], low[..., 1:]), np.maximum(high[..., :-1], high[..., 1:])


def lattice(*counts: int) -> NDArray[np.int64]:
    """Return the points of whole numbers from 0 on, (nx, ny, 2) or (nx, ny, nz, 3)."""
    return np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1)


def _near_blocks(collision: Collision, members: Sequence[int], width: float, counts: Array) -> Origins:
    """Return which of the coarsest blocks, of a width [m], may have a solid within the cutoff, (k, 2)."""
    near = np.zeros(counts.astype(int), dtype=np.bool_)
    far = REACH + collision.footprint.radius
    low, high = (side[list(members)] - collision.world.lower for side in collision.extents())
    first = np.clip(np.floor((low - far) / width), 0, near.shape).astype(int)
    last = np.clip(np.floor((high + far) / width) + 1, 0, near.shape).astype(int)
    for (i, j), (i_end, j_end) in zip(first.tolist(), last.tolist(), strict=True):
        near[i:i_end, j:j_end] = True
    return np.argwhere(near)


def _require(count: float, limit: int, collision: Collision, members: Sequence[int]) -> None:
    """Refuse a workspace whose field would hold more than a limit of something."""
    if count <= limit:
        return
    span, radius = collision.world.upper - collision.world.lower, collision.least_radius
    share = math.sqrt(limit / count)
    x, y = (_rounded(share * side, math.floor) for side in span.tolist())
    raise SceneError(
        f"{_too_large(span, radius)} among these {len(members)} obstacles; up to about {x} m x {y} m works, or "
        f"a radius of about {_rounded(radius / share, math.ceil)} m or more"
    )


def _too_large(span: Array, radius: float) -> str:
    return f"the workspace of {span[0]:g} m x {span[1]:g} m is too large for a robot of radius {radius:g} m"


def _rounded(length: float, rounding: Callable[[float], float]) -> str:
    """Write a length [m] in three digits."""
    unit = 10.0 ** (math.floor(math.log10(length)) - 2)
    return f"{rounding(length / unit) * unit:g}"
