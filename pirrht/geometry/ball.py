"""Free space of a ball in space, on the clearance field of its centre: distances sampled on one grid of points.

As in the plane, trilinear interpolation of the distance to the nearest of several convex solids is too high by at most
h^2 / (4 d), since second derivatives add up to at most 2 / d. That bound is subtracted, but not next to one flat face,
where the distance is linear. The border is exact.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.errors import SceneError
from pirrht.geometry.blocks import lattice
from pirrht.geometry.collision import Collision
from pirrht.geometry.obstacle import Kind
from pirrht.geometry.pieces import entry_of_ball
from pirrht.geometry.round import GridKernels, round_kernels
from pirrht.geometry.space import BLOCKED, FREE, LEAST_STEP, UNSURE, SpaceKernels
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, kernel, load_float32, load_int32
from pirrht.jit.records import Held
from pirrht.jit.streams import ONE, ZERO
from pirrht.jit.vectors import combined, dot

_dot = dot(3)
_both = combined(3)


class Lattice(NamedTuple):
    """Clearance of a ball's centre on a grid of nx * ny * nz points, as numbers that kernels can take cheaply."""

    lower: tuple[float, float, float]  # least corner of the workspace, which is the first point [m]
    upper: tuple[float, float, float]  # its greatest corner [m]
    spacing: float  # h [m]
    per: float  # 1/h [1/m]
    nx: int
    ny: int
    nz: int
    nearest: int  # address of float32 per point: clearance to the nearest solid, never too high [m]
    second: int  # address of float32 per point: clearance to the nearest that stands in another direction [m]
    label: int  # address of int32 per point: index of the nearest solid


class Ball(Held, Lattice):
    """A `Lattice` together with its arrays, as a `Space`."""

    @classmethod
    def of(cls, collision: Collision, members: Sequence[int]) -> Self:
        """Sample clearances [m] from the solids that count; SceneError: the workspace is too large."""
        world, radius = collision.world, collision.footprint.radius
        span = world.upper - world.lower
        volume = float(np.prod(span))
        coarsest = radius / TUNING.least_cells
        meshes = sum(world.obstacles[i].kind is Kind.MESH for i in members)
        points = TUNING.dense_points / (1.0 + meshes / TUNING.meshes)
        h = min(max(radius / TUNING.cells_per_radius, (volume / points) ** (1.0 / 3.0)), coarsest)
        if volume > TUNING.block_points * h**3:
            least = TUNING.least_cells * (volume / TUNING.block_points) ** (1.0 / 3.0)
            raise SceneError(
                f"the workspace of {' m x '.join(f'{side:g}' for side in span)} m is too large for a ball of radius "
                f"{radius:g} m; up to {TUNING.block_points * h**3:.3g} m^3 work, or a radius of {least:.3g} m or more"
            )
        counts = np.ceil(span / h - 1e-9).astype(int) + 1
        nearest, second = np.empty((2, *counts), dtype=np.float32)
        label = np.empty(counts, dtype=np.int32)
        farthest = (TUNING.cutoff if len(members) else TUNING.nothing) + radius
        away = np.empty((3, *counts), dtype=np.float32)  # from the nearest solid, unit vectors
        other = np.empty(counts, dtype=np.float32)
        slab = max(1, TUNING.slab_points // int(counts[1] * counts[2]))
        for first in range(0, int(counts[0]), slab):
            part = slice(first, first + slab)
            places = lattice(*label[part].shape) + np.array([first, 0, 0])
            walls = collision.nearest_walls((world.lower + h * places).reshape(-1, 3), members, farthest)
            values = (walls.first, walls.second, walls.which, walls.other)
            for out, value in zip((nearest, second, label, other), values, strict=True):
                out[part] = value.reshape(out[part].shape)
            directions = (walls.away / np.maximum(walls.first, 1e-300)[:, None]).T
            away[:, part] = directions.reshape(away[:, part].shape)
        curved = ~_flat(label, away, other - nearest > 2.0 * h)
        at_least = np.maximum(nearest, radius) - math.sqrt(3.0) * h  # of places in the cells around
        excess = h**2 / (4.0 * np.maximum(at_least, 0.5 * radius))
        nearest -= radius + np.where(curved, excess, 0.0)
        second -= radius + excess
        return cls.holding(
            tuple(world.lower.tolist()), tuple(world.upper.tolist()), h, 1.0 / h, *counts.tolist(),
            nearest, second, label,
        )  # fmt: skip

    @property
    def kernels(self) -> SpaceKernels:
        """Return the kernels that read it."""
        return BALL


def _flat(label: IntArray, away: Array, alone: BoolArray) -> BoolArray:
    """Check of points of a grid (nx, ny, nz) that the distance is linear in all cells around.

    One solid is nearest at all their corners and in the same direction `away` (3, nx, ny, nz), and no other is as near.
    """
    out = minimum_filter(alone, 3) & (maximum_filter(label, 3) == minimum_filter(label, 3))
    for axis in away:
        out &= maximum_filter(axis, 3) - minimum_filter(axis, 3) < TUNING.flat
    return np.asarray(out)


@inlined
def _border(static, place):  # type: ignore[no-untyped-def]
    x, y, z = place
    (left, near, low), (right, far, high) = static.lower, static.upper
    return min(min(min(x - left, right - x), min(y - near, far - y)), min(z - low, high - z))


@inlined
def _side(static, place, k):  # type: ignore[no-untyped-def]
    axis = k // 2
    sign = 1.0 if k % 2 == 0 else -1.0
    end = static.lower[axis] if k % 2 == 0 else static.upper[axis]
    n = (sign if axis == 0 else 0.0, sign if axis == 1 else 0.0, sign if axis == 2 else 0.0)
    return sign * (place[axis] - end), n


@inlined
def _cell(static, place):  # type: ignore[no-untyped-def]
    """Return the index of the first point of a place's cell, and the place in it, 0 to 1 each."""
    fx = (place[0] - static.lower[0]) * static.per
    fy = (place[1] - static.lower[1]) * static.per
    fz = (place[2] - static.lower[2]) * static.per
    i = min(max(np.int32(fx), np.int32(0)), np.int32(static.nx - 2))
    j = min(max(np.int32(fy), np.int32(0)), np.int32(static.ny - 2))
    k = min(max(np.int32(fz), np.int32(0)), np.int32(static.nz - 2))
    return (i * static.ny + j) * static.nz + k, fx - i, fy - j, fz - k


@inlined
def _pair(grid, at, w):  # type: ignore[no-untyped-def]
    """Return the value between two points along z, and its rise."""
    low = load_float32(grid, at)
    rise = load_float32(grid, at + 1) - low
    return low + w * rise, rise


@inlined
def _with_slope(static, grid, place):  # type: ignore[no-untyped-def]
    """Return the trilinear value [m] at a place in the workspace and its gradient [m/m]."""
    at, u, v, w = _cell(static, place)
    a, p = _pair(grid, at, w)
    b, q = _pair(grid, at + static.nz, w)
    beyond = at + static.ny * static.nz
    c, r = _pair(grid, beyond, w)
    d, s = _pair(grid, beyond + static.nz, w)

    near = a + v * (b - a)
    far = c + v * (d - c)
    across = (1.0 - u) * (b - a) + u * (d - c)
    up = (1.0 - u) * (p + v * (q - p)) + u * (r + v * (s - r))
    return near + u * (far - near), ((far - near) * static.per, across * static.per, up * static.per)


@inlined
def _interpolate(static, grid, place):  # type: ignore[no-untyped-def]
    return _with_slope(static, grid, place)[0]


@inlined
def _closest(static, place):  # type: ignore[no-untyped-def]
    at, u, v, w = _cell(static, place)
    i = 1 if u >= 0.5 else 0
    j = 1 if v >= 0.5 else 0
    k = 1 if w >= 0.5 else 0
    h = static.spacing
    return at + (i * static.ny + j) * static.nz + k, (h * (u - i), h * (v - j), h * (w - k)), h


@inlined
def _label(static, place):  # type: ignore[no-untyped-def]
    return load_int32(static.label, _closest(static, place)[0])


@inlined
def _wall(static, grid, place):  # type: ignore[no-untyped-def]
    """Return a wall's clearance [m] and the unit vector away from it, in single precision."""
    c, g = _with_slope(static, grid, place)
    square = _dot(g, g)
    per = 1.0 / math.sqrt(square + 1e-12)
    c = c if square < 2.0 else 1e6  # steeper than a distance can be: another wall takes over here
    return np.float32(c), (np.float32(per * g[0]), np.float32(per * g[1]), np.float32(per * g[2]))


@inlined
def walls(static, pose):  # type: ignore[no-untyped-def]
    """Return the two nearest walls of a place, border included: distance [m] and direction away from it, each."""
    c, n = _wall(static, static.nearest, pose)
    d, m = _wall(static, static.second, pose)
    for axis in range(3):
        low = pose[axis] - static.lower[axis]
        high = static.upper[axis] - pose[axis]
        e = np.float32(min(low, high))
        sign = ONE if low < high else -ONE
        towards = (sign if axis == 0 else ZERO, sign if axis == 1 else ZERO, sign if axis == 2 else ZERO)
        if e < c:
            d, m = c, n
            c, n = e, towards
        elif e < d:
            d, m = e, towards
    return c, n, d, m


@inlined
def _along(place, u, s, aside):  # type: ignore[no-untyped-def]
    return _both(1.0, place, s, u)


ROUND = round_kernels(
    GridKernels(
        width=3, border=_border, side=_side, interpolate=_interpolate, with_slope=_with_slope, closest=_closest,
        label=_label, walls=walls, along=_along, entry=entry_of_ball,
    )
)  # fmt: skip
_clearance, _refused = ROUND.fields["clearance"], ROUND.refused


@kernel
def certify(static, pose):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a place."""
    return FREE if _clearance(static, pose) > 0.0 else _refused(static, pose)


@kernel
def certify_piece(static, tail, head, patient=True):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a straight piece, by a march from clearance to clearance along it."""
    way = _both(1.0, head, -1.0, tail)
    length = math.sqrt(_dot(way, way))
    per = 1.0 / length if length > 0.0 else 0.0
    s, verdict = 0.0, FREE
    while True:
        place = _both(1.0, tail, per * s, way)
        c = _clearance(static, place)
        if c < LEAST_STEP:
            if _refused(static, place) == BLOCKED:
                return BLOCKED
            if not patient:
                return UNSURE
            verdict, c = UNSURE, 0.5 * static.spacing
        if s >= length:
            return verdict
        s = min(s + c, length)


BALL = SpaceKernels(
    isotropic=False, certify=certify, certify_place=certify, certify_piece=certify_piece, certify_curve=None,
    **ROUND.fields,
)  # fmt: skip
