"""Compute the clearance of a convex footprint at a place and heading, from the field of distances of points.

Discs cover the footprint (`footprint.cover`), and its clearance is the least of theirs, never too high. Circles around
groups of discs bound them from below, in a tree: most places far from walls need one look at the field, those near walls
a few. A row of the tree is a circle; rows below it follow, up to the row that it says is next.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import BLOCKED, FREE, UNSURE, point_along
from pirrht.geometry.blocks import build_field
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import Field, border, closest, interpolate, with_slope
from pirrht.geometry.footprint import Footprint, cover
from pirrht.geometry.scene import Workspace
from pirrht.geometry.tuning import TUNING
from pirrht.geometry.world import NEVER
from pirrht.jit.jit import inlined, kernel, load_float32, load_float64
from pirrht.jit.streams import MIN_VARIANCE, SIDEWAYS, survival

APART_COSINE = TUNING.apart_cosine
LEAST_STEP = TUNING.least_step
FIELDS = 4  # numbers of a row: place x, y in the robot's frame [m], radius beyond the field's [m], the next row


class PolygonNumbers(NamedTuple):
    """A footprint among static obstacles, as numbers that kernels can take cheaply."""

    field: Field  # clearance of a disc as small as the least of the cover; its border is the workspace's
    rows: int  # address of float64 (size, FIELDS)
    size: int
    beyond: float  # radius of the circle around all, beyond the field's [m]
    reach: float  # of the footprint: a turn moves its points by at most so much per radian [m/rad]
    exact: float  # a clearance of less than this is the least of all discs' [m], a greater one that of the circle
    excess: float  # by which a disc reaches beyond the footprint at most [m]
    within: float  # inscribed radius of the footprint, beyond the field's [m]
    spacing: float  # of the field [m]


class Polygon(PolygonNumbers):
    """`PolygonNumbers` together with the array that their address points to."""

    table: Array  # (size, FIELDS)
    discs: Array  # (k, 3) of the cover: x, y, radius [m]

    @classmethod
    def of(
        cls, world: Workspace, footprint: Footprint, members: list[int], excess: float = TUNING.excess
    ) -> Polygon:
        """Cover a footprint by discs that reach `excess` [m] beyond it at most, and sample the field of the least.

        `members` are the indices of the obstacles that count. SceneError: the workspace is too large for such a field.
        """
        discs = cover(footprint, TUNING.cover_share * excess)
        least = float(discs[:, 2].min())
        out = float(np.hypot(discs[:, 0], discs[:, 1]).max())
        wide = Workspace(world.lower - out, world.upper + out, world.obstacles, world.waivers)
        collision = Collision(wide, Footprint.disc(least, height=footprint.height))
        whole = build_field(collision, members, cells=TUNING.cells_per_disc, band=TUNING.cover_band)
        border = dict(zip(("left", "low", "right", "high"), (*world.lower, *world.upper), strict=True))
        field = whole._replace(**border)
        field.arrays, field.blocks = whole.arrays, whole.blocks
        table = tree_of(discs, least)
        numbers = table.ctypes.data, len(table), table[0, 2], footprint.reach
        sizes = TUNING.exact_reach * footprint.reach, TUNING.cover_share * excess, footprint.inscribed - least
        made = cls(field, *numbers, *sizes, field.spacing)
        made.table, made.discs = table, discs
        return made


def tree_of(discs: Array, least: float) -> Array:
    """Arrange discs (k, 3) in a tree of circles, (rows, FIELDS); radii are those beyond the least one [m]."""
    rows: list[list[float]] = []

    def add(some: Array, centre: Array) -> None:
        if len(some) == 1:
            rows.append([some[0, 0], some[0, 1], some[0, 2] - least, len(rows) + 1])
            return
        around = (np.hypot(*(some[:, :2] - centre).T) + some[:, 2]).max()
        row = [*centre, around * (1.0 + 1e-12) - least, 0.0]
        rows.append(row)
        axis = int(np.argmax(np.ptp(some[:, :2], axis=0)))
        order = np.argsort(some[:, axis], kind="stable")
        halves = [some[order[: len(some) // 2]], some[order[len(some) // 2 :]]]
        for half in sorted(halves, key=lambda half: -half[:, 2].max()):
            add(half, 0.5 * (half[:, :2].min(axis=0) + half[:, :2].max(axis=0)))
        row[3] = len(rows)

    add(discs, np.zeros(2))
    return np.array(rows, dtype=float)


@inlined
def _row(polygon, k, x, y, c, s):  # type: ignore[no-untyped-def]
    """Return the place (x, y) of a row at a pose [m], its radius beyond the field's [m], and the next row."""
    a = load_float64(polygon.rows, FIELDS * k)
    b = load_float64(polygon.rows, FIELDS * k + 1)
    following = int(load_float64(polygon.rows, FIELDS * k + 3))

    return x + c * a - s * b, y + s * a + c * b, load_float64(polygon.rows, FIELDS * k + 2), following


@kernel
def nearest_disc(polygon, x, y, th, within):  # type: ignore[no-untyped-def]
    """Return the least clearance of all discs from obstacles, if less than `within` [m], and its row; else this, -1."""
    c, s = math.cos(th), math.sin(th)
    best, at, k = within, -1, 0
    while k < polygon.size:
        px, py, radius, following = _row(polygon, k, x, y, c, s)
        value = interpolate(polygon.field, polygon.field.nearest, px, py) - radius
        if value >= best:
            k = following
            continue
        if following == k + 1:
            best, at = value, k
        k += 1
    return best, at


@inlined
def place(polygon, at):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance at a position (x, y), whatever the heading [m]."""
    edge = border(polygon.field, at[0], at[1])
    if edge <= 0.0:
        return edge
    return min(edge, interpolate(polygon.field, polygon.field.nearest, at[0], at[1]) - polygon.beyond)


@inlined
def clearance(polygon, pose):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance at a pose [m]; the border bounds the reference point."""
    x, y, th = pose
    edge = border(polygon.field, x, y)
    if edge <= 0.0:
        return edge
    far = interpolate(polygon.field, polygon.field.nearest, x, y) - polygon.beyond
    if far >= min(edge, polygon.exact):
        return min(edge, far)
    return nearest_disc(polygon, x, y, th, edge)[0]


@kernel
def clearances(polygon, poses, out):  # type: ignore[no-untyped-def]
    """Write the clearance at poses (k, 3) to out (k,) [m]."""
    for k in range(len(poses)):
        out[k] = clearance(polygon, (poses[k, 0], poses[k, 1], poses[k, 2]))


@inlined
def _lever(polygon, k, c, s, nx, ny):  # type: ignore[no-untyped-def]
    """Return by how much the clearance of a row's disc grows per turn [m/rad] where it grows along (nx, ny)."""
    a = load_float64(polygon.rows, FIELDS * k)
    b = load_float64(polygon.rows, FIELDS * k + 1)

    return nx * (-s * a - c * b) + ny * (c * a - s * b)


@inlined
def _apart(g, h, reach):  # type: ignore[no-untyped-def]
    """Tell whether two gradients (x, y, heading) are more than 60 degrees apart, turns counted by the reach."""
    along = g[0] * h[0] + g[1] * h[1] + g[2] * h[2] / (reach * reach)
    one = g[0] * g[0] + g[1] * g[1] + g[2] * g[2] / (reach * reach)
    other = h[0] * h[0] + h[1] * h[1] + h[2] * h[2] / (reach * reach)

    return along <= 0.0 or along * along < APART_COSINE * APART_COSINE * one * other


@inlined
def _of_disc(polygon, grid, k, px, py, radius, c, s):  # type: ignore[no-untyped-def]
    """Return the clearance of a row's disc in a grid of the field [m] and its gradient (x, y, heading)."""
    d, nx, ny = with_slope(polygon.field, grid, px, py)
    size = math.sqrt(nx * nx + ny * ny + 1e-12)
    nx, ny = nx / size, ny / size

    return d - radius, (nx, ny, _lever(polygon, k, c, s, nx, ny))


@inlined
def _with_wall(walls, value, slope, reach):  # type: ignore[no-untyped-def]
    """Return the two nearest of two walls and another one, which counts as second if it is apart from the first."""
    first, one, second, other = walls
    if value < first:
        return (value, slope, first, one) if _apart(slope, one, reach) else (value, slope, second, other)
    if value < second and _apart(slope, one, reach):
        return first, one, value, slope
    return walls


@kernel
def two_walls(polygon, pose):  # type: ignore[no-untyped-def]
    """Return the two nearest walls at a pose, border included: clearance [m] and its gradient (x, y, heading), each.

    The second is the nearest whose gradient points elsewhere: another wall, or the same one met by another corner.
    """
    x, y, th = pose
    c, s = math.cos(th), math.sin(th)
    field = polygon.field
    left, right = x - field.left, field.right - x
    low, high = y - field.low, field.high - y

    aside = (1.0 if left < right else -1.0, 0.0, 0.0)
    ahead = (0.0, 1.0 if low < high else -1.0, 0.0)
    walls = (min(left, right), aside, np.inf, (0.0, 0.0, 0.0))
    walls = _with_wall(walls, min(low, high), ahead, polygon.reach)

    _, at = nearest_disc(polygon, x, y, th, np.inf)
    px, py, radius, _ = _row(polygon, at, x, y, c, s)
    value, slope = _of_disc(polygon, field.nearest, at, px, py, radius, c, s)
    walls = _with_wall(walls, value, slope, polygon.reach)
    k = 0
    while k < polygon.size:
        px, py, radius, following = _row(polygon, k, x, y, c, s)
        if interpolate(field, field.nearest, px, py) - radius >= walls[2]:
            k = following
            continue
        k += 1
        if following == k:
            value, slope = _of_disc(polygon, field.nearest, k - 1, px, py, radius, c, s)
            walls = _with_wall(walls, value, slope, polygon.reach)
            value, slope = _of_disc(polygon, field.second, k - 1, px, py, radius, c, s)
            walls = _with_wall(walls, value, slope, polygon.reach)
    return walls


@kernel
def surely_blocked(polygon, pose):  # type: ignore[no-untyped-def]
    """Tell whether the footprint itself meets an obstacle at a pose for sure, or its reference point the border."""
    x, y, th = pose
    if border(polygon.field, x, y) <= 0.0:
        return True
    c, s = math.cos(th), math.sin(th)
    _, at = nearest_disc(polygon, x, y, th, np.inf)
    px, py, radius, _ = _row(polygon, at, x, y, c, s)
    point, dx, dy, width = closest(polygon.field, px, py)

    away = load_float32(polygon.field.nearest, point) + math.sqrt(dx * dx + dy * dy) + width
    return away - radius + polygon.excess < 0.0


@kernel
def certify(polygon, pose):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for one pose."""
    if clearance(polygon, pose) > 0.0:
        return FREE
    return BLOCKED if surely_blocked(polygon, pose) else UNSURE


@kernel
def certify_place(polygon, at):  # type: ignore[no-untyped-def]
    """Return FREE for a position (x, y) that is free at any heading, BLOCKED for one at none, or UNSURE."""
    if place(polygon, at) > 0.0:
        return FREE
    if border(polygon.field, at[0], at[1]) <= 0.0:
        return BLOCKED
    point, dx, dy, width = closest(polygon.field, at[0], at[1])
    away = load_float32(polygon.field.nearest, point) + math.sqrt(dx * dx + dy * dy) + width
    return BLOCKED if away < polygon.within else UNSURE


@kernel
def certify_arc(polygon, pose, curvature, length, patient=True):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for an arc [1/m, m] from a pose, with the footprint's heading along it.

    A point of the footprint moves at most 1 + reach |curvature| for each meter of the arc.
    """
    x, y, th = pose
    ux, uy = math.cos(th), math.sin(th)
    speed = 1.0 + polygon.reach * abs(curvature)
    s, verdict = 0.0, FREE
    while True:
        px, py = point_along(x, y, th, ux, uy, curvature, s)
        here = px, py, th + curvature * s
        free = clearance(polygon, here)
        if free < LEAST_STEP:
            if surely_blocked(polygon, here):
                return BLOCKED
            if not patient:
                return UNSURE
            verdict, free = UNSURE, 0.5 * polygon.spacing
        if s >= length:
            return verdict
        s = min(s + free / speed, length)


@kernel
def certify_turn(polygon, pose, turn, patient=True):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a turn [rad] on the spot from a pose, all headings between included."""
    x, y, th = pose
    angle, verdict = 0.0, FREE
    while True:
        here = x, y, th + math.copysign(angle, turn)
        free = clearance(polygon, here)
        if free < LEAST_STEP:
            if surely_blocked(polygon, here):
                return BLOCKED
            if not patient:
                return UNSURE
            verdict, free = UNSURE, 0.5 * polygon.spacing
        if angle >= abs(turn):
            return verdict
        angle = min(angle + free / polygon.reach, abs(turn))


@kernel
def certify_piece(polygon, tail, head, patient=True):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a straight piece between two positions (x, y) [m], headed along it."""
    dx, dy = head[0] - tail[0], head[1] - tail[1]
    length = math.sqrt(dx * dx + dy * dy)
    return certify_arc(polygon, (tail[0], tail[1], math.atan2(dy, dx)), 0.0, length, patient)


@kernel
def certify_curve(polygon, start, curvature, length, patient=True):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a curve (3,), (P,) [1/m], (P,) [m], with the heading along it."""
    x, y = start[0], start[1]
    th, verdict = start[2], FREE
    for p in range(length.shape[0]):
        piece = certify_arc(polygon, (x, y, th), curvature[p], length[p], patient)
        if piece == BLOCKED or (piece == UNSURE and not patient):
            return piece
        verdict = min(verdict, piece)
        x, y = point_along(x, y, th, math.cos(th), math.sin(th), curvature[p], length[p])
        th += curvature[p] * length[p]
    return verdict


@kernel
def first_contact(polygon, pose, moved, bend, clear):  # type: ignore[no-untyped-def]
    """Return the share of a step from one pose to another at which a wall is met, or NEVER, and the clearance then.

    The heading turns evenly; the place runs along an arc next to its chord that turns by `bend` [rad]. No wall is
    nearer to the start than `clear` [m].
    """
    x, y, th = pose
    dx, dy, turn = moved[0] - x, moved[1] - y, moved[2] - th
    speed = math.sqrt((dx * dx + dy * dy) * (1.0 + 0.25 * bend * bend)) + polygon.reach * abs(turn)
    if speed < clear:
        return NEVER, clear - speed
    share, bow = max(clear, 0.0) / max(speed, 1e-300), 0.5 * bend
    while True:
        aside = bow * share * (1.0 - share)
        free = clearance(polygon, (x + share * dx + aside * dy, y + share * dy - aside * dx, th + share * turn))
        if free <= 0.0:
            return share, 0.0
        if share >= 1.0:
            return NEVER, free
        share = min(1.0, share + max(free, 0.1 * polygon.spacing) / max(speed, 1e-300))


@inlined
def variance_along(slope, cov):  # type: ignore[no-untyped-def]
    """Return g S g' of a gradient (x, y, heading) and a covariance S as (xx, xy, xt, yy, yt, tt)."""
    gx, gy, gt = slope
    xx, xy, xt, yy, yt, tt = cov
    return max(
        gx * gx * xx + 2.0 * gx * gy * xy + gy * gy * yy + 2.0 * gt * (gx * xt + gy * yt) + gt * gt * tt, MIN_VARIANCE
    )


@kernel
def log_survival(polygon, before, after, cov):  # type: ignore[no-untyped-def]
    """Return the log of the probability that a noisy step between two poses meets no wall [nats].

    The two nearest walls are flat in (x, y, heading), and each counts with the noise towards it.

    Args: `before` and `after` (x, y, heading); `cov` as of `variance_along`.
    """
    c0, one, d0, other = two_walls(polygon, before)
    c1, same, d1, _ = two_walls(polygon, after)
    if min(c0, c1) <= 0.0:
        return -np.inf
    first, second = variance_along(one, cov), variance_along(other, cov)
    if _apart(one, same, polygon.reach):  # another wall is nearest now
        c1, d1 = d1, c1
    alive = survival(c0, c1, first) * survival(d0, d1, second)
    return math.log(alive) if alive > 0.0 else -np.inf


@kernel
def facing(polygon, pose, cov):  # type: ignore[no-untyped-def]
    """Return the clearance at a pose over the share of noise, of a covariance as of `variance_along`, towards it [m].

    The share is that of the deviation with which a point of the footprint moves at most.
    """
    c, one, d, other = two_walls(polygon, pose)
    most = cov[0] + cov[3] + polygon.reach * polygon.reach * cov[5]
    near = c / math.sqrt(max(variance_along(one, cov) / most, SIDEWAYS))
    return min(near, d / math.sqrt(max(variance_along(other, cov) / most, SIDEWAYS)))
