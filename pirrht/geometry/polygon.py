"""Free space of a convex footprint that turns with the heading: a member of `SpaceKernels`, by discs that cover it.

The clearance at a pose (x, y, heading) is the least of that of all discs of a cover, never too high. Groups of them lie
in larger discs, and all of them in a circle around the reference point: far from walls the clearance of those does.
Walls are flat in (x, y, heading), with a part for the heading that is the lever of the disc they are next to.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.arcs import entry_of_piece
from pirrht.geometry.blocks import build_field
from pirrht.geometry.certify import certificates
from pirrht.geometry.collision import Collision
from pirrht.geometry.disc import enter_goal
from pirrht.geometry.disc import rim as planar_rim
from pirrht.geometry.field import Field, border, closest, interpolate, with_slope
from pirrht.geometry.footprint import Footprint, cover, depths
from pirrht.geometry.round import first_met, may_meet
from pirrht.geometry.scene import Workspace
from pirrht.geometry.space import BLOCKED, COLLISION, FREE, GOAL, INSIDE, NEVER, UNSURE, SpaceKernels
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import borrowing, inlined, kernel, load_float32, load_float64
from pirrht.jit.records import Held
from pirrht.jit.streams import FAR, MIN_VARIANCE, ONE, SIDEWAYS, ZERO, first_crossing, survival, uniform

# Numbers of a row: place x, y of a disc in the robot's frame, radius, and how far it reaches from there [m]; of a group
# its first row, and the one past its last.
ROW = 6
NOWHERE = np.float32(1e6)  # clearance of a wall that is not there [m]


class PolygonNumbers(NamedTuple):
    """A footprint among static obstacles, as numbers that kernels take cheaply.

    Radii are those beyond that of the least disc, whose clearance the field holds.
    """

    field: Field  # its border is that of the workspace, its grid reaches further
    rows: int  # address of float64 (size, ROW): groups, then their discs, those that reach farthest first
    groups: int  # number of groups
    around: float  # radius of the circle around all discs [m]
    within: float  # radius of the footprint's inscribed disc [m]
    reach: float  # of the footprint: a turn moves its points by at most so much per radian [m/rad]
    exact: float  # up to this clearance discs count, above it the circle around them does [m]
    near: float  # up to this clearance of a group its discs count [m]
    excess: float  # by which a disc reaches beyond the footprint at most [m]
    spacing: float  # of the field [m]


class Polygon(Held, PolygonNumbers):
    """`PolygonNumbers` together with the array that their address points to."""

    @classmethod
    def of(
        cls, world: Workspace, footprint: Footprint, members: Sequence[int], excess: float = TUNING.excess
    ) -> Polygon:
        """Cover a footprint with at most `excess` [m], and sample the clearance of the least disc.

        `members` are the indices of the obstacles that count. SceneError: the workspace is too large for the field.
        """
        discs = cover(footprint, TUNING.cover_share * excess)
        least = float(discs[:, 2].min())
        table, groups = grouped(footprint, discs, TUNING.group_excess * excess)
        most = float(table[groups:, 3].max()) + least
        wide = Workspace(world.lower - most, world.upper + most, world.obstacles, world.waivers)
        collision = Collision(wide, Footprint.disc(least, height=footprint.height))
        cells = max(TUNING.cells_per_disc, least / (TUNING.grain * excess))
        sure = footprint.inscribed - least + TUNING.sure * excess
        whole = build_field(collision, members, cells=cells, fine=sure)
        left, low = world.lower.tolist()
        right, high = world.upper.tolist()
        field = whole._replace(left=left, low=low, right=right, high=high)

        radii = most - least, footprint.inscribed - least
        reach = footprint.reach, TUNING.exact_reach * footprint.reach
        return cls.holding(
            field, table, groups, *radii, *reach, TUNING.tight * excess, TUNING.cover_share * excess, field.spacing
        )

    def inscribed(self) -> Field:
        """Return clearances of the footprint's inscribed disc."""
        less = np.float32(self.within)
        held = self.field.held
        return self.field._replace(nearest=held["nearest"] - less, second=held["second"] - less)

    def set_back(self, distance: float) -> Polygon:
        """Return the space with all walls, the border included, moved back by a distance [m]."""
        return self._replace(field=self.field.set_back(distance))

    @property
    def kernels(self) -> SpaceKernels:
        """Return the kernels that read it."""
        return POLYGON


def grouped(footprint: Footprint, discs: Array, excess: float) -> tuple[Array, int]:
    """Return rows of groups and of discs (k, 3), with radii beyond the least one [m], (g + k, ROW), and g.

    Groups are circles around some discs; two are joined as long as the circle around both reaches no more than `excess`
    [m] beyond the footprint, those first for which that is least.
    """
    circles, held = discs, [[k] for k in range(len(discs))]
    while len(circles) > 1:
        a, b = np.triu_indices(len(circles), 1)
        both = _around(circles[a], circles[b])
        beyond = both[:, 2] + depths(footprint.hull, both[:, :2]) - footprint.rounding
        if beyond.min() > excess:
            break
        one = int(a[np.argmin(beyond)])
        other = int(b[np.argmin(beyond)])
        held[one] += held.pop(other)
        circles = np.delete(circles, other, axis=0)
        circles[one] = both[np.argmin(beyond)]
    order = _by_reach(circles)
    members = [np.array(held[j])[_by_reach(discs[held[j]])] for j in order]
    rows = np.vstack((circles[order], discs[np.concatenate(members)]))
    table = np.zeros((len(rows), ROW))
    table[:, :2] = rows[:, :2]
    table[:, 2] = rows[:, 2] - discs[:, 2].min()
    table[:, 3] = np.hypot(rows[:, 0], rows[:, 1]) + table[:, 2]
    table[: len(order), 4:] = len(order) + np.cumsum([0, *map(len, members)])[np.arange(len(order))[:, None] + (0, 1)]
    return table, len(order)


def _around(one: Array, other: Array) -> Array:
    """Return the least circles around two discs each, (k, 3) and (k, 3)."""
    span = other[:, :2] - one[:, :2]
    apart = np.hypot(*span.T)
    radius = 0.5 * (apart + one[:, 2] + other[:, 2])
    share = (radius - one[:, 2]) / np.maximum(apart, 1e-12)
    both = np.column_stack((one[:, :2] + share[:, None] * span, radius))
    both = np.where((one[:, 2] >= apart + other[:, 2])[:, None], one, both)
    return np.where((other[:, 2] >= apart + one[:, 2])[:, None], other, both)


def _by_reach(discs: Array) -> IntArray:
    """Return the order of discs (k, 3) in which those that reach farthest come first."""
    return np.argsort(-np.hypot(discs[:, 0], discs[:, 1]) - discs[:, 2], kind="stable")


@inlined
def _disc(static, k, x, y, c, s):  # type: ignore[no-untyped-def]
    """Return where disc k is at a pose of heading (c, s), its place relative to (x, y), and its radius [m]."""
    a = load_float64(static.rows, ROW * k)
    b = load_float64(static.rows, ROW * k + 1)
    dx = c * a - s * b
    dy = s * a + c * b

    return x + dx, y + dy, dx, dy, load_float64(static.rows, ROW * k + 2)


@inlined
def _reach(static, k):  # type: ignore[no-untyped-def]
    """Return how far disc k reaches from the reference point [m]."""
    return load_float64(static.rows, ROW * k + 3)


@inlined
def _members(static, j):  # type: ignore[no-untyped-def]
    """Return the rows of the discs of group j."""
    return range(np.int64(load_float64(static.rows, ROW * j + 4)), np.int64(load_float64(static.rows, ROW * j + 5)))


@inlined
def _clearance_of(static, k, x, y, c, s):  # type: ignore[no-untyped-def]
    """Return the clearance of disc k at a pose [m]."""
    px, py, _, _, radius = _disc(static, k, x, y, c, s)
    return interpolate(static.field, static.field.nearest, px, py) - radius


@kernel
def nearest_disc(static, x, y, th, far, within):  # type: ignore[no-untyped-def]
    """Return the least clearance of discs from obstacles, if less than `within` [m], and its row; else this, -1.

    `far` is the clearance of the least disc at (x, y); another place is not nearer to walls by more than its distance.
    """
    c = math.cos(th)
    s = math.sin(th)
    best, at = within, -1
    for j in range(static.groups):
        if far - _reach(static, j) >= best:
            break
        value = _clearance_of(static, j, x, y, c, s)
        if value >= best:
            continue
        if value >= static.near:
            best, at = value, j
            continue
        for k in _members(static, j):
            if far - _reach(static, k) >= best:
                break
            value = _clearance_of(static, k, x, y, c, s)
            if value < best:
                best, at = value, k
    return best, at


@inlined
def _from_obstacles(static, pose, within):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance from obstacles at a pose inside the border, of less than `within` [m]."""
    x, y, th = pose
    far = interpolate(static.field, static.field.nearest, x, y)
    if far - static.around >= min(within, static.exact):
        return min(within, far - static.around)
    return nearest_disc(static, x, y, th, far, within)[0]


@inlined
def clearance(static, pose):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance at a pose [m]; the border bounds the reference point."""
    edge = border(static.field, pose[0], pose[1])
    return edge if edge <= 0.0 else _from_obstacles(static, pose, edge)


@inlined
def place(static, at):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance at a place (x, y), whatever the heading [m]."""
    edge = border(static.field, at[0], at[1])
    if edge <= 0.0:
        return edge
    return min(edge, interpolate(static.field, static.field.nearest, at[0], at[1]) - static.around)


@kernel
def clearances(static, poses, out):  # type: ignore[no-untyped-def]
    """Write the clearance at poses (k, 3) to out (k,) [m]."""
    for k in range(len(poses)):
        out[k] = clearance(static, (poses[k, 0], poses[k, 1], poses[k, 2]))


@inlined
def apart(static, one, other):  # type: ignore[no-untyped-def]
    """Tell whether two directions are those of two walls: 60 degrees apart, turns counted by the reach."""
    per = 1.0 / (static.reach * static.reach)
    along = one[0] * other[0] + one[1] * other[1] + per * one[2] * other[2]
    square = one[0] * one[0] + one[1] * one[1] + per * one[2] * one[2]
    square *= other[0] * other[0] + other[1] * other[1] + per * other[2] * other[2]

    return along <= 0.0 or along * along < TUNING.apart_cosine**2 * square


@inlined
def _with(static, walls, c, direction):  # type: ignore[no-untyped-def]
    """Return the nearest two of two walls and another; the second is apart from the first."""
    first, one, second, other = walls
    if c < first:
        return (c, direction, first, one) if apart(static, direction, one) else (c, direction, second, other)
    if c < second and apart(static, one, direction):
        return first, one, c, direction
    return walls


@inlined
def _wall_of(static, grid, place):  # type: ignore[no-untyped-def]
    """Return the clearance of a disc at a `place` (`_disc`) from a wall in a grid of the field [m], and its direction.

    Where another wall takes over, it is steeper than a distance can be, and counts as far away.
    """
    px, py, dx, dy, radius = place
    d, gx, gy = with_slope(static.field, grid, px, py)
    square = gx * gx + gy * gy
    per = 1.0 / math.sqrt(square + 1e-12)
    nx = per * gx
    ny = per * gy
    away = np.float32(d - radius) if square <= 2.0 else NOWHERE
    return away, (np.float32(nx), np.float32(ny), np.float32(ny * dx - nx * dy))


@inlined
def _sides(static, x, y, within):  # type: ignore[no-untyped-def]
    """Return the sides of the border nearer to (x, y) than `within` [m] as the two nearest walls."""
    field, least = static.field, np.float32(within)
    left = np.float32(x - field.left)
    right = np.float32(field.right - x)
    low = np.float32(y - field.low)
    high = np.float32(field.high - y)
    found = (least, (ZERO, ZERO, ZERO), least, (ZERO, ZERO, ZERO))
    found = _with(static, found, min(left, right), (ONE if left < right else -ONE, ZERO, ZERO))
    return _with(static, found, min(low, high), (ZERO, ONE if low < high else -ONE, ZERO))


@kernel
def _second_wall(static, seen, nearest, one, within):  # type: ignore[no-untyped-def]
    """Return the nearest wall that is apart from the direction `one` of that of the `nearest` disc, and its direction.

    Groups whose wall is not apart are passed over.

    `seen` are the pose as (x, y, cosine, sine) and the clearance of the least disc there [m].
    """
    (x, y, c, s), far = seen
    field = static.field
    away, direction = _wall_of(static, field.second, nearest)
    if away >= within or not apart(static, one, direction):
        away = np.float32(within)
        direction = (ZERO, ZERO, ZERO)
    for j in range(static.groups):
        if far - _reach(static, j) >= away:
            break
        gap, towards = _wall_of(static, field.nearest, _disc(static, j, x, y, c, s))
        if gap >= away or not apart(static, one, towards):
            continue
        if gap >= static.near:
            away, direction = gap, towards
            continue
        for k in _members(static, j):
            if far - _reach(static, k) >= away:
                break
            gap, towards = _wall_of(static, field.nearest, _disc(static, k, x, y, c, s))
            if gap < away and apart(static, one, towards):
                away, direction = gap, towards
    return away, direction


@kernel
def walls_within(static, pose, within):  # type: ignore[no-untyped-def]
    """Return the two nearest walls at a pose, border included, each as clearance [m] and direction.

    The second is another wall, or the first as another corner of the footprint meets it, farther by less than the
    footprint's reach. Those farther than `within` [m] count as so far away, in no direction.
    """
    x, y, th = pose
    field = static.field
    found = _sides(static, x, y, within)
    far = interpolate(field, field.nearest, x, y)
    if far - static.around >= found[2]:
        return found
    if far - static.around >= static.exact:  # so far away the footprint counts as the circle around it
        circle = x, y, 0.0, 0.0, static.around
        for grid in (field.nearest, field.second):
            away, direction = _wall_of(static, grid, circle)
            found = _with(static, found, away, direction)
        return found
    clear, at = nearest_disc(static, x, y, th, far, np.float64(found[2]))
    if at < 0:
        return found
    c = math.cos(th)
    s = math.sin(th)
    nearest = _disc(static, at, x, y, c, s)
    _, one = _wall_of(static, field.nearest, nearest)
    away, direction = _second_wall(static, ((x, y, c, s), far), nearest, one, min(found[2], clear + static.reach))
    found = _with(static, found, np.float32(clear), one)
    return _with(static, found, away, direction) if away < min(found[2], NOWHERE) else found


@inlined
def walls(static, pose):  # type: ignore[no-untyped-def]
    """Return the two nearest walls at a pose, border included (`walls_within`)."""
    return walls_within(static, pose, NOWHERE)


@inlined
def known_walls(static, pose, known):  # type: ignore[no-untyped-def]
    """Return the two nearest walls of a pose of which `distances` are known."""
    return known[3]


@borrowing
def near(static, pose, within, out):  # type: ignore[no-untyped-def]
    """Write those of the two nearest walls that are nearer than `within` [m]; return how many."""
    c, one, d, other = walls_within(static, pose, within)
    count = 0
    for k in range(2):
        away, direction = (c, one) if k == 0 else (d, other)
        if away < np.float32(within):
            out[count, 0] = away
            for j in range(3):
                out[count, 1 + j] = direction[j]
            count += 1
    return count


@inlined
def refused(static, pose):  # type: ignore[no-untyped-def]
    """Return BLOCKED for a pose at which a disc inside the footprint meets an obstacle for sure, else UNSURE."""
    if border(static.field, pose[0], pose[1]) <= 0.0:
        return BLOCKED
    return _refused(static, pose[0], pose[1], pose[2])


@kernel
def _refused(static, x, y, th):  # type: ignore[no-untyped-def]
    far = interpolate(static.field, static.field.nearest, x, y)
    _, at = nearest_disc(static, x, y, th, far, np.inf)
    px, py, _, _, radius = _disc(static, at, x, y, math.cos(th), math.sin(th))
    return BLOCKED if _farthest(static, px, py) < radius - static.excess else UNSURE


@inlined
def _farthest(static, x, y):  # type: ignore[no-untyped-def]
    """Return an upper bound of the clearance of the least disc at (x, y), by the nearest grid point [m]."""
    at, dx, dy, width = closest(static.field, x, y)
    return load_float32(static.field.nearest, at) + math.sqrt(dx * dx + dy * dy) + width


@kernel
def certify_place(static, at):  # type: ignore[no-untyped-def]
    """Return FREE for a place (x, y) that is free at any heading, BLOCKED for one at none, or UNSURE."""
    if place(static, at) > 0.0:
        return FREE
    blocked = border(static.field, at[0], at[1]) <= 0.0 or _farthest(static, at[0], at[1]) < static.within
    return BLOCKED if blocked else UNSURE


@inlined
def extent(static, change):  # type: ignore[no-untyped-def]
    """Return how far a change of pose moves any point of the footprint at most [m]."""
    return math.sqrt(change[0] * change[0] + change[1] * change[1]) + static.reach * abs(change[2])


@inlined
def spread(static, cov, line):  # type: ignore[no-untyped-def]
    """Return the most variance of a clearance [m^2]."""
    aside = math.sqrt(cov[0] + cov[3] if line else max(cov[0], cov[3]) + abs(cov[1]))
    return (aside + static.reach * math.sqrt(cov[5])) ** 2


@inlined
def variance_along(direction, cov):  # type: ignore[no-untyped-def]
    """Return g S g' [m^2] of a direction g and the covariance S of a pose."""
    gx, gy, gt = direction
    planar = cov[0] * gx * gx + 2.0 * cov[1] * gx * gy + cov[3] * gy * gy
    return max(planar + 2.0 * gt * (gx * cov[2] + gy * cov[4]) + gt * gt * cov[5], MIN_VARIANCE)


@inlined
def facing(static, pose, known, cov):  # type: ignore[no-untyped-def]
    """Return the clearance at a pose over the share of noise, of a covariance, that a wall faces [m]."""
    c, one, d, other = known[3]
    most = max(spread(static, cov, True), MIN_VARIANCE)
    near_one = c / math.sqrt(max(variance_along(one, cov) / most, SIDEWAYS))
    return min(near_one, d / math.sqrt(max(variance_along(other, cov) / most, SIDEWAYS)))


@inlined
def goal_gap(world, pose):  # type: ignore[no-untyped-def]
    """Return the distance of the reference point from the goal's rim, negative inside [m]."""
    return math.sqrt((pose[0] - world.goal[0]) ** 2 + (pose[1] - world.goal[1]) ** 2) - world.radius


@inlined
def distances(world, pose):  # type: ignore[no-untyped-def]
    """Return the clearance, that from the border, the distance to the goal's rim [m], and the two nearest walls."""
    found = walls(world.static, pose)
    return np.float64(found[0]), border(world.static.field, pose[0], pose[1]), goal_gap(world, pose), found


@kernel
def end(world, pose):  # type: ignore[no-untyped-def]
    """Return INSIDE, GOAL or COLLISION at the end of a step, by the pose alone."""
    if clearance(world.static, pose) <= 0.0:
        return COLLISION
    return GOAL if goal_gap(world, pose) <= 0.0 else INSIDE


@inlined
def sweep(world, pose, moved, turn=0.0, clear=0.0):  # type: ignore[no-untyped-def]
    """Judge how a step from one pose to another without position noise ends, by certified clearances.

    The place runs along an arc next to its chord, which turns [rad], and enters the goal along the chord; the heading
    changes evenly. No wall is nearer to the start than `clear` [m].
    Returns: INSIDE or the Outcome, share of the step until the exit, and what is clear at its end, as far as is known.
    """
    dx = moved[0] - pose[0]
    dy = moved[1] - pose[1]
    arc = math.sqrt((dx * dx + dy * dy) * (1.0 + 0.25 * turn * turn))
    whole = arc + world.static.reach * abs(moved[2] - pose[2])
    reach = arc + world.radius
    ahead = 0.0
    if (world.goal[0] - pose[0]) ** 2 + (world.goal[1] - pose[1]) ** 2 > reach * reach:
        if whole < clear:
            return INSIDE, 1.0, clear - whole
        ahead = clearance(world.static, moved)
        if ahead > 0.0 and whole < clear + ahead:
            return INSIDE, 1.0, ahead
    return _march(world, pose, moved, whole, turn, clear, ahead)


@kernel
def _march(world, pose, moved, whole, turn, clear, ahead):  # type: ignore[no-untyped-def]
    """March what `clear` [m] around the start and `ahead` [m] around the end leave open; 0 where nothing is known."""
    x, y, th = pose
    dx = moved[0] - x
    dy = moved[1] - y
    length = math.sqrt(dx * dx + dy * dy)
    until = 0.0 if goal_gap(world, pose) <= 0.0 else NEVER
    if until == NEVER and length > 0.0:
        entry = entry_of_piece(x, y, math.atan2(dy, dx), 0.0, length, world.goal[0], world.goal[1], world.radius)
        until = min(entry / length, NEVER)
    stop = min(1.0, until)
    share = min(stop, clear / max(whole, 1e-300))
    reached = share
    while True:
        aside = 0.5 * turn * share * (1.0 - share)
        here = (x + share * dx + aside * dy, y + share * dy - aside * dx, th + share * (moved[2] - th))
        c = clearance(world.static, here)
        if share > reached and share - c / max(whole, 1e-300) > reached:  # not all between is clear
            share = reached
            continue
        if c <= 0.0:
            return COLLISION, share, 0.0
        if share >= stop:
            break
        if ahead > 0.0 and (1.0 - share) * whole < c + ahead:
            return INSIDE, 1.0, ahead
        least = 0.5 * world.static.excess
        reached = min(stop, share + max(c, least) / max(whole, 1e-300))
        share = min(stop, share + max(TUNING.stride * c, least) / max(whole, 1e-300))
    return (GOAL, until, 0.0) if until < NEVER else (INSIDE, 1.0, c)


@inlined
def _meet_walls(static, before, after, c0, c1, cov, weighed, state):  # type: ignore[no-untyped-def]
    """Draw the next state, the share of a step at which a bridge meets a wall or NEVER, and log P(none).

    Its distances before and after it have walls; it is `c0` [m] from the nearest and ends at `c1` [m].
    """
    near0, one, d0, other = before[3]
    near1, same, d1, _ = after[3]
    variance = variance_along(one, cov)
    second = variance_along(other, cov)

    if not may_meet(c0, c1, FAR * max(variance, second)):
        return state, NEVER, 0.0
    alive = 0.0
    if c1 > 0.0:
        if apart(static, one, same):  # another wall is nearest now
            near1, d1 = d1, near1
        alive = survival(near0, near1, variance) * survival(d0, d1, second)
    if weighed and alive > 0.0:
        return state, NEVER, math.log(alive)
    u = 1.0
    if not weighed:
        state, u = uniform(state)
    if u < alive:
        return state, NEVER, 0.0
    state, share = first_crossing(max(c0, MIN_VARIANCE), c1, math.sqrt(variance), state)
    return state, share, 0.0


@kernel
def bridge(world, pose, moved, before, after, cov, weighed, state, line=False):  # type: ignore[no-untyped-def]
    """Judge how a noisy step ends: walls are flat in (x, y, heading), and meet the noise of the disc next to them.

    Returns: next state of the sequence, INSIDE or the Outcome, share of the step until the exit, and the log of the
        probability that it met no wall [nats].
    """
    c0 = before[0]
    g0 = before[2]
    c1 = after[0]
    g1 = after[2]
    change = (moved[0] - pose[0], moved[1] - pose[1], moved[2] - pose[2])
    chord = math.sqrt(change[0] * change[0] + change[1] * change[1])
    past_wall = c1 > 0.0 and c0 + c1 < extent(world.static, change)
    past_rim = g1 > 0.0 and g0 + g1 < chord
    if past_wall or past_rim:
        exit, share, _ = sweep(world, pose, moved, 0.0, max(c0, 0.0))
        share = max(share, 1e-9)
        c1 = c0 * (1.0 - 1.0 / share) if past_wall and exit == COLLISION else c1
        g1 = g0 * (1.0 - 1.0 / share) if past_rim and exit == GOAL else g1
    wall_time, goal_time, lasting = NEVER, NEVER, 0.0
    if may_meet(c0, c1, FAR * spread(world.static, cov, line)):
        state, wall_time, lasting = _meet_walls(world.static, before, after, c0, c1, cov, weighed, state)
    planar = (cov[0], cov[1], cov[3])
    if may_meet(g0, g1, FAR * (cov[0] + cov[3])):
        here, there = (pose[0], pose[1]), (moved[0], moved[1])
        state, goal_time = enter_goal(world, here, there, g0, g1, planar, line, state)
    return first_met(state, wall_time, goal_time, lasting)


@inlined
def rim(world, pose, cov):  # type: ignore[no-untyped-def]
    """Return the direction of noise along a line, how far along it the goal's rim is [m], and whether it is one."""
    return planar_rim(world, (pose[0], pose[1]), (cov[0], cov[1], cov[3]))


certify, certify_piece, certify_curve, certify_turn = certificates(clearance, refused, True)

POLYGON = SpaceKernels(
    position=2, turns=True, isotropic=False, near_most=2, clearance=clearance, place=place, walls=walls,
    known_walls=known_walls, near=near,
    distances=distances, facing=facing, spread=spread, extent=extent, sweep=sweep, bridge=bridge, end=end, exit=None,
    rim=rim, certify=certify, certify_place=certify_place, certify_piece=certify_piece, certify_curve=certify_curve,
    certify_turn=certify_turn,
)  # fmt: skip
