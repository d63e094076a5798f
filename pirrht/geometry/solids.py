"""Make walls on the ground from plain numbers: boxes, discs, polygons and grids of occupied cells."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pirrht.arrays import Array, BoolArray
from pirrht.errors import SceneError
from pirrht.formatting import short
from pirrht.geometry.checks import numbers, rows_of
from pirrht.geometry.obstacle import Kind, Obstacle, about_vertical
from pirrht.geometry.tuning import TUNING


def boxes(rows: ArrayLike, height: float) -> tuple[Obstacle, ...]:
    """Make boxes of a height [m] from rows (k, 4 or 5): least x, y, greatest x, y [m], a yaw about the middle [rad]."""
    given = table(rows, (4, 5), "boxes", "x0, y0, x1, y1 [m] and perhaps a yaw [rad]")
    half = 0.5 * (given[:, 2:4] - given[:, :2])
    middle = 0.5 * (given[:, :2] + given[:, 2:4])
    for i in np.flatnonzero(np.any(half < TUNING.smallest, axis=1)):
        raise SceneError(f"box {i + 1} is {given[i].tolist()}; x0 must be less than x1, and y0 than y1")
    return tuple(
        _upright(f"box {i}", Kind.BOX, np.append(h, 0.5 * height), xy, float(yaw))
        for i, (h, xy, yaw) in enumerate(zip(half, middle, given[:, 4], strict=True), start=1)
    )


def discs(rows: ArrayLike, height: float) -> tuple[Obstacle, ...]:
    """Make upright cylinders of a height [m] from rows (k, 3): x, y, radius [m]."""
    given = table(rows, (3,), "discs", "x, y, radius [m]")
    for i in np.flatnonzero(given[:, 2] < TUNING.smallest):
        raise SceneError(f"disc {i + 1} is {given[i].tolist()}; its radius must be positive")
    return tuple(
        _upright(f"disc {i}", Kind.CYLINDER, np.array([radius, 0.5 * height, 0.0]), np.array([x, y]))
        for i, (x, y, radius) in enumerate(given, start=1)
    )


def prisms(polygons: Sequence[ArrayLike], height: float) -> tuple[Obstacle, ...]:
    """Make upright prisms of a height [m] over polygons (l, 2) [m]; triangles where one is not convex."""
    solids = []
    for i, polygon in enumerate(rows_of(polygons, "polygons", "polygons, each of corners x, y [m]"), start=1):
        parts = _convex_parts(f"polygon {i}", table(polygon, (2,), f"polygon {i}", "corners x, y [m]"))
        names = [f"polygon {i}"] if len(parts) == 1 else [f"polygon {i}.{k}" for k in range(1, len(parts) + 1)]
        solids += [_prism(name, part, height) for name, part in zip(names, parts, strict=True)]
    return tuple(solids)


def cells(occupied: BoolArray, resolution: float, origin: Array, height: float) -> tuple[Obstacle, ...]:
    """Make boxes of a height [m] that cover just the occupied cells of a side [m], row 0 first from an origin [m]."""
    from pirrht.geometry.rectangles import cover  # slow to import, and few scenes are grids

    return boxes(resolution * cover(occupied).reshape(-1, 4)[:, [2, 0, 3, 1]] + np.tile(origin, 2), height)


def voxels(occupied: BoolArray, size: float, origin: Array) -> tuple[Obstacle, ...]:
    """Make boxes in space that cover just the occupied voxels of a side [m], the first of all at an origin [m]."""
    from pirrht.geometry.rectangles import blocks

    corners = (size * blocks(occupied) + np.tile(origin, 2)).reshape(-1, 2, 3)
    return tuple(
        Obstacle(
            name=f"block {i}", kind=Kind.BOX, size=0.5 * (high - low), position=0.5 * (low + high), rotation=np.eye(3)
        )
        for i, (low, high) in enumerate(corners, start=1)
    )


def occupancy(occupied: ArrayLike, axes: Sequence[str]) -> BoolArray:
    """Return a grid of booleans along some axes; SceneError: it is none, or has too many cells."""
    try:
        grid = np.asarray(occupied)
    except ValueError:  # rows of several lengths
        grid = np.array(None)
    if grid.ndim != len(axes) or grid.size == 0 or grid.dtype != np.bool_ or np.ma.is_masked(occupied):
        masked = " with masked cells" if np.ma.is_masked(occupied) else ""
        raise SceneError(
            f"the grid is of {grid.dtype} and shape {grid.shape}{masked}; it must hold booleans ({', '.join(axes)}), "
            "such as `grid > 50` makes them"
        )
    if grid.size > TUNING.grid_cells:
        coarser = [str(int(np.ceil((grid.size / TUNING.grid_cells) ** (1.0 / grid.ndim))))] * grid.ndim
        raise SceneError(
            f"the grid has {' x '.join(map(str, grid.shape))} cells, and at most {TUNING.grid_cells:,} are taken; "
            f"cut out a part, or join {' x '.join(coarser)} cells to one that is occupied if one of them is"
        )
    return grid


def table(rows: Any, widths: tuple[int, ...], what: str, columns: str) -> Array:
    """Return rows of finite numbers (k, widest), filled up with 0; SceneError names a row of anything else."""
    out = np.zeros((len(rows_of(rows, what, f"rows: {columns}")), widths[-1]))
    for i, row in enumerate(rows):
        given = numbers(row, (None,), f"{what}: row {i + 1}", columns)
        if len(given) not in widths:
            raise SceneError(f"{what}: row {i + 1} is {short(row)}; it must be {columns}")
        out[i, : len(given)] = given
    return out


def _upright(name: str, kind: Kind, size: Array, xy: Array, yaw: float = 0.0) -> Obstacle:
    """Make a solid of MuJoCo's sizes (3,), the second or last of which is half its height, that stands at a place."""
    return Obstacle(
        name=name, kind=kind, size=size, rotation=about_vertical(yaw),
        position=np.append(xy, size[1] if kind is Kind.CYLINDER else size[2]),
    )  # fmt: skip


def _prism(name: str, corners: Array, height: float) -> Obstacle:
    """Make a mesh of a convex polygon (l, 2), counter-clockwise, with a floor and a ceiling."""
    count = len(corners)
    middle = corners.mean(axis=0)
    z = np.repeat([-0.5 * height, 0.5 * height], count)
    fan = np.array([[0, k, k + 1] for k in range(1, count - 1)])
    here = np.arange(count)
    there = np.roll(np.arange(count), -1)
    sides = [np.column_stack([here, there, there + count]), np.column_stack([here, there + count, here + count])]
    return Obstacle(
        name=name, kind=Kind.MESH, size=np.zeros(3), position=np.array([*middle, 0.5 * height]), rotation=np.eye(3),
        vertices=np.column_stack([np.tile(corners - middle, (2, 1)), z]),
        faces=np.vstack([fan[:, ::-1], fan + count, *sides]).astype(np.int64),
    )  # fmt: skip


def _convex_parts(name: str, corners: Array) -> list[Array]:
    """Return a simple polygon (l, 2), or triangles if it is not convex; SceneError: no inside, or crosses itself."""
    corners = corners[np.any(corners != np.roll(corners, 1, axis=0), axis=1)]
    if _crosses_itself(corners):
        raise SceneError(f"{name} crosses itself; list its corners in their order around it")
    area = 0.5 * float(np.sum(_cross(corners, np.roll(corners, -1, axis=0))))
    if abs(area) < TUNING.smallest**2:
        raise SceneError(f"{name} has no inside; give it three corners or more that are not in line")
    left = list(corners if area > 0 else corners[::-1])
    if all(_turn(left, k) >= 0 for k in range(len(left))):
        return [np.array(left)]
    parts = []
    while len(left) > 3:
        k = next(k for k in range(len(left)) if _is_ear(left, k))
        parts.append(np.array([left[k - 1], left[k], left[(k + 1) % len(left)]]))
        del left[k]
    parts.append(np.array(left))
    return [part for part in parts if _turn(list(part), 1) > 0]


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _turn(corners: Sequence[Array], k: int) -> float:
    """Return by how much a polygon turns at its corner k, positive to the left."""
    before = corners[k - 1]
    here = corners[k]
    return float(_cross(here - before, corners[(k + 1) % len(corners)] - here))


def _is_ear(corners: Sequence[Array], k: int) -> bool:
    """Return whether the triangle at corner k of a simple polygon can be cut off."""
    a = corners[k - 1]
    b = corners[k]
    c = corners[(k + 1) % len(corners)]

    if _turn(corners, k) <= 0:
        return _turn(corners, k) == 0
    p = np.array([q for q in corners if not any(np.array_equal(q, own) for own in (a, b, c))]).reshape(-1, 2)
    inside = (_cross(b - a, p - a) >= 0) & (_cross(c - b, p - b) >= 0) & (_cross(a - c, p - c) >= 0)
    return not inside.any()


def _crosses_itself(corners: Array) -> bool:
    """Return whether two sides of a polygon that are no neighbours meet."""
    a, b = corners, np.roll(corners, -1, axis=0)
    ends = [np.sign(_cross((b - a)[:, None], end[None] - a[:, None])) for end in (a, b)]
    apart = ends[0] * ends[1]  # (l, l) -1 where the ends of one side lie apart, seen from another
    low = np.minimum(a, b)
    high = np.maximum(a, b)
    near = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=-1)
    meet = (apart <= 0) & (apart.T <= 0) & near
    gap = np.abs(np.subtract.outer(np.arange(len(a)), np.arange(len(a))))
    return bool(np.any(meet & (gap > 1) & (gap < len(a) - 1)))
