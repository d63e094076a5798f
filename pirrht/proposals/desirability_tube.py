"""Desirability in a tube around a reference, log psi of one class from cross-section to cross-section, and its ascent.

With constant q, psi solves `Laplace psi = k^2 psi`. What starts at x reaches a straight line that leaves it on one side
with the density `k d / (pi r) K1(k r)`, d the distance to the line and r that to the place on it, about
`sqrt(k / 2 pi r) exp(-k r) cos` far away. So psi on one cross-section of a reference is an integral over the next one,
back from the goal. Walls on both sides take off what would come from their mirror images. In a channel these transfers
settle to its slowest mode at its own decay, and behind a corner psi is diffracted.

A cross-section is a straight line across the reference, square to it, or along the bisector of a corner, to walls or
as far as noise carries paths. Samples follow the slope of log psi at its nodes (`rollouts.tables`); towards a wall at a
distance c it is known by the length b of `1 - exp(-c / b)`. psi at the start bounds the weight of a class in advance.
The loop over the nodes has no branches and single precision: it compiles to vector instructions.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import clearance, two_walls
from pirrht.geometry.world import World
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import HALF, ONE, TWO, ZERO, exponential, logarithm
from pirrht.jit.vectors import copy_row
from pirrht.proposals.proposal import ProposalControl
from pirrht.proposals.tuning import TUNING
from pirrht.proposals.wall_drift import WallDrift
from pirrht.rollouts.tables import KNOWN, PLACE, DesirabilityTubes, ProposalTables, slope_along

WIDTH = 32  # at least the nodes of a cross-section, and the point on the reference after the last of them
# Rows of their numbers: place, the two nearest walls (distance and unit vector away from it), psi there.
# All are in one array: a compiler that does not know how far apart arrays are must assume that vectors overlap.
PLACE_X, PLACE_Y, WALL, WALL_X, WALL_Y, NEXT, NEXT_X, NEXT_Y, LOG_PSI, SLOPE_X, SLOPE_Y, PUSH, PUSH_NEXT, TOP, WHOLE = (
    WIDTH * row for row in range(15)
)
ROWS = 15 * WIDTH


class Single(NamedTuple):
    """Numbers in single precision, in which the loop over nodes runs."""

    negligible: np.float32 = np.float32(-25.0)  # nodes with so little log psi are skipped [nats]
    nothing: np.float32 = np.float32(-1e30)  # log psi before the first node
    tiny: np.float32 = np.float32(1e-6)  # keeps lengths from zero [m]
    least: np.float32 = np.float32(1e-30)  # keeps psi from zero
    grazing: np.float32 = np.float32(0.02)  # cosine of lines that graze a cross-section and are skipped
    four: np.float32 = np.float32(4.0)
    three_quarters: np.float32 = np.float32(0.75)
    three_halves: np.float32 = np.float32(1.5)
    above: np.float32 = np.float32(0.556)  # of the rational fit to K1, by least squares
    below: np.float32 = np.float32(0.655)


SINGLE = Single()
PER_TURN = np.float32(0.5 / math.pi)
ALIKE = HALF  # cosine between the directions of one wall at two places


@inlined
def bend(z):  # type: ignore[no-untyped-def]
    """K1(z)^2 2 z exp(2 z) / pi - 1, the deviation of K1 from its limit for great z, within 2 %."""
    return SINGLE.three_quarters * (z + SINGLE.above) / (z * (z + SINGLE.below))


@inlined
def fall(k, per, bent):  # type: ignore[no-untyped-def]
    """Return the decrease of log(K1(k r) / r) with r [1/m]; per: 1/r, bent: `bend` there."""
    return k + (SINGLE.three_halves + HALF * bent / (ONE + bent)) * per


@inlined
def wall(k, r, per, bent, steep, c, d):  # type: ignore[no-untyped-def]
    """Return the share f of psi left by a flat wall at distances c and d of both ends of a line of length r.

    The wall takes off psi of the mirror image, which is farther away; `steep` is `fall` at r.
    Returns: f, the increase of log f with c [1/m], and its decrease with r [1/m].
    """
    square = SINGLE.four * c * d
    far = math.sqrt(r * r + square)

    other = bend(k * far)
    ratio = r / far
    inverse = ONE / far

    image = exponential(-k * square / (far + r)) * math.sqrt((ONE + other) / (ONE + bent) * ratio) * ratio
    left = max(ONE - image, SINGLE.tiny)
    odds = image / left
    down = fall(k, inverse, other)

    return left, odds * down * TWO * d * inverse, max(odds * (steep - down * ratio), ZERO)


@inlined
def wall_distance(here, dx, dy, first, second):  # type: ignore[no-untyped-def]
    """Return the distance of a place (dx, dy) from here to a wall that is c away here in the direction -(nx, ny).

    It is that of one of the place's own two walls of the same direction; else that to the wall's plane, unless the wall
    is left behind around a corner. Walls are (c, nx, ny).
    """
    (c, nx, ny), (near, mx, my), (far, ox, oy) = here, first, second
    plane = c + dx * nx + dy * ny
    one = nx * mx + ny * my > ALIKE
    other = nx * ox + ny * oy > ALIKE

    return near if one else (far if other else (plane if plane > ZERO else near))


@kernel
def propagate(k, line, J, step, known, f):  # type: ignore[no-untyped-def]
    """Fill the rows of f (ROWS,) from `known`, those of the next cross-section: of J nodes, `step` apart [m].

    line: its point and unit normal.
    """
    px = np.float32(line[0])
    py = np.float32(line[1])
    tx = np.float32(line[2])
    ty = np.float32(line[3])

    f[LOG_PSI:] = ZERO
    f[TOP:WHOLE] = SINGLE.nothing
    for j in range(J):
        ax = known[PLACE_X + j]
        ay = known[PLACE_Y + j]
        level = known[LOG_PSI + j]

        for i in range(WIDTH if level > SINGLE.negligible else 0):
            dx = ax - f[PLACE_X + i]
            dy = ay - f[PLACE_Y + i]
            f[TOP + i] = max(f[TOP + i], level - k * math.sqrt(dx * dx + dy * dy))
    for j in range(J):
        ax = known[PLACE_X + j]
        ay = known[PLACE_Y + j]
        level = known[LOG_PSI + j]

        first = known[WALL + j], known[WALL_X + j], known[WALL_Y + j]
        second = known[NEXT + j], known[NEXT_X + j], known[NEXT_Y + j]
        for i in range(WIDTH):
            dx = ax - f[PLACE_X + i]
            dy = ay - f[PLACE_Y + i]
            r = math.sqrt(dx * dx + dy * dy) + SINGLE.tiny
            per = ONE / r
            along = max(dx * tx + dy * ty, SINGLE.tiny)
            ahead = (px - f[PLACE_X + i]) * tx + (py - f[PLACE_Y + i]) * ty
            bent = bend(k * r)
            steep = fall(k, per, bent)
            density = step * math.sqrt(PER_TURN * k * per * (ONE + bent)) * along * per
            density = density if along > SINGLE.grazing * r else ZERO
            f[WHOLE + i] += density * exponential(min(k * (ahead - r), ZERO))
            c = wall_distance((f[WALL + i], f[WALL_X + i], f[WALL_Y + i]), dx, dy, first, second)
            d = wall_distance((f[NEXT + i], f[NEXT_X + i], f[NEXT_Y + i]), dx, dy, first, second)
            share, push, nearer = wall(k, r, per, bent, steep, f[WALL + i], c)
            other, press, too = wall(k, r, per, bent, steep, f[NEXT + i], d)
            weight = density * exponential(min(level - k * r - f[TOP + i], ZERO)) * share * other
            inward = (steep + nearer + too) * per * weight
            across = weight / along
            f[LOG_PSI + i] += weight
            f[SLOPE_X + i] += inward * dx - across * tx
            f[SLOPE_Y + i] += inward * dy - across * ty
            f[PUSH + i] += weight * push
            f[PUSH_NEXT + i] += weight * press
    for i in range(WIDTH):
        psi = max(f[LOG_PSI + i], SINGLE.least)
        per = ONE / psi
        f[SLOPE_X + i] = per * f[SLOPE_X + i]
        f[SLOPE_Y + i] = per * f[SLOPE_Y + i]
        f[PUSH + i] = per * f[PUSH + i]
        f[PUSH_NEXT + i] = per * f[PUSH_NEXT + i]
        # Between nodes that noise hardly spreads over, a sum can exceed what reaches the whole line, exp(-k ahead).
        f[LOG_PSI + i] = f[TOP + i] + logarithm(psi) - logarithm(max(f[WHOLE + i], ONE))


@kernel
def goal_kernel(k, goal, radius, f):  # type: ignore[no-untyped-def]
    """Fill the rows of f (ROWS,) where the goal is in sight: psi of its disc in the open, and walls up to its rim."""
    k, radius, most = np.float32(k), np.float32(radius), np.float32(0.5 / k)
    for i in range(WIDTH):
        dx = np.float32(goal[0]) - f[PLACE_X + i]
        dy = np.float32(goal[1]) - f[PLACE_Y + i]
        r = max(math.sqrt(dx * dx + dy * dy), radius)
        length = r - radius + most
        bent = bend(k * length)
        to_rim = ONE - radius / r
        steep = fall(k, ONE / length, bent)
        c = f[WALL + i]
        d = f[NEXT + i]
        near = c + to_rim * (dx * f[WALL_X + i] + dy * f[WALL_Y + i])
        far = d + to_rim * (dx * f[NEXT_X + i] + dy * f[NEXT_Y + i])
        one, f[PUSH + i], _ = wall(k, length, ONE / length, bent, steep, c, near if near > ZERO else c)
        two, f[PUSH_NEXT + i], _ = wall(k, length, ONE / length, bent, steep, d, far if far > ZERO else d)
        inward = (k + HALF / r) / r
        f[SLOPE_X + i] = inward * dx
        f[SLOPE_Y + i] = inward * dy
        f[LOG_PSI + i] = HALF * logarithm(radius / r) - k * (r - radius) + logarithm(one) + logarithm(two)


@kernel
def _march(field, x, y, ux, uy, far):  # type: ignore[no-untyped-def]
    """Return the free length from (x, y) along a unit vector, `far` at most [m], and whether a wall ends it."""
    s = max(clearance(field, x, y), TUNING.stride)  # a reference touches walls
    while s < far:
        c = clearance(field, x + s * ux, y + s * uy)
        if c <= TUNING.touching:
            return s, True
        s += max(c, TUNING.stride)
    return far, False


@kernel
def sections_of(field, line, radius, decay):  # type: ignore[no-untyped-def]
    """Place C cross-sections of a reference (k, 2) [m]: the first through its start, the last before the goal.

    Returns: points (C, 2) on the reference [m], unit normals (C, 2) in the direction of travel, and offsets (C, 2) of
        the ends to the left and to the right [m].
    """
    last, whole = line.shape[0] - 2, 0.0
    for i in range(last + 1):
        whole += math.hypot(line[i + 1, 0] - line[i, 0], line[i + 1, 1] - line[i, 1])
    most = 2 + line.shape[0] + int(whole / TUNING.section_least)

    point = np.empty((most, 2))
    ahead = np.empty((most, 2))
    ends = np.empty((most, 2))

    count = 0
    s = 0.0
    since = math.inf
    apart = TUNING.section_apart
    ux, uy = 1.0, 0.0

    for i in range(last + 1):
        x, y = line[i, 0], line[i, 1]
        dx = line[i + 1, 0] - x
        dy = line[i + 1, 1] - y
        leg = math.hypot(dx, dy)
        if leg <= 0.0:
            continue
        vx, vy = dx / leg, dy / leg
        bx, by = (ux + vx, uy + vy) if count > 0 else (vx, vy)
        size = math.hypot(bx, by)
        bx, by = (bx / size, by / size) if size > TUNING.touching else (vx, vy)
        ux, uy = vx, vy
        end = leg - radius if i == last else leg
        t = 0.0
        while t < end or (count == 0):
            if since >= apart or count == 0:
                here = s + t  # noise is that of a bridge
                spread = math.sqrt(max(here * (whole - here) / whole, TUNING.section_shortest) / decay)
                across = TUNING.section_deviations * spread + TUNING.section_extra
                cx, cy = (bx, by) if t == 0.0 else (ux, uy)
                px, py = x + t * ux, y + t * uy
                ends[count, 0], left_wall = _march(field, px, py, -cy, cx, across)
                ends[count, 1], right_wall = _march(field, px, py, cy, -cx, across)

                point[count] = (px, py)
                ahead[count] = (cx, cy)

                free = max(clearance(field, px, py) - across, 0.0)
                stride = min(TUNING.section_stride + TUNING.section_widening * free, TUNING.section_widest)
                apart = TUNING.section_apart
                if left_wall and right_wall:
                    width = ends[count, 0] + ends[count, 1]
                    stride = min(stride, max(TUNING.section_channel * decay * width * width, TUNING.section_least))
                    apart = min(apart, stride)
                count, since = count + 1, 0.0
            else:
                stride = apart - since
            left = end - t
            stride = left if stride >= left else min(stride, max(0.5 * left, apart))
            t = t + stride
            since = since + stride
        s += leg
    return point[:count], ahead[:count], ends[:count]


@dataclass(frozen=True, slots=True, eq=False)
class DesirabilityAscent(ProposalControl):
    """Ascent of the desirability in a tube, G u = BB' grad log psi, less the wall drift."""

    tubes: DesirabilityTubes  # one, with J nodes on each of C cross-sections
    goal: tuple[float, ...]  # centre [m]
    gain: Array  # (m, 2) lambda R^-1 G' [m/s per nat/m]
    push: WallDrift
    promise: float = -math.inf  # predicted log psi of the class, that of the tube at its start [nats]

    @classmethod
    def of(cls, arena: World, line: Array, x: Array, decay: float, push: WallDrift) -> "DesirabilityAscent":
        """Compute the tube of a reference from x (n,) over corners (k, 2) [m], the goal point as the last.

        It is of a world with the goal's disc, where psi decays by k per meter [1/m].
        """
        cut = sections_of(
            arena.static, np.ascontiguousarray(np.vstack([x[None, :2], line]), dtype=float), arena.radius, decay
        )
        C = len(cut[0])
        place = np.zeros((1, C, PLACE), np.float32)
        slope = np.zeros((1, C, TUNING.nodes, KNOWN), np.float32)
        log_psi = float(_transfer(arena, cut, decay, place[0], slope[0]))
        return cls(DesirabilityTubes(np.array([C]), place, slope, decay), arena.goal, push.gain(x), push, log_psi)

    @property
    def shape(self) -> tuple[int, int]:
        """Cross-sections, and nodes of each (C, J)."""
        return int(self.tubes.count[0]), TUNING.nodes

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at x (n,), s [s] after the plan, which matters where obstacles move."""
        slope = np.zeros(2)
        slope_along(self.tubes, 0, self.goal, x[0], x[1], self.push.walls(x, s), slope)
        return np.asarray(self.gain @ slope) - self.push(x, s)

    def pack(self, leads: ProposalTables, h: int) -> None:
        """Write the tube to the first C cross-sections of the row in `ProposalTables.ways`, and their number."""
        count = leads.ways.count[h] = self.shape[0]
        leads.ways.place[h, :count] = self.tubes.place[0]
        leads.ways.slope[h, :count] = self.tubes.slope[0]


@inlined
def _reach(c, push):  # type: ignore[no-untyped-def]
    """Return the reach of a wall at a distance c whose push is known, the inverse of `push_of` [m]."""
    if push * c < TUNING.drift_least:
        return 0.0
    rest = 1.0 / min(push * c, TUNING.drift_most) - 1.0
    s = min(2.0 * rest, 2.0 + 1.5 * math.sqrt(rest))
    for _ in range(TUNING.newton):
        s -= (s * (0.5 + s * (1.0 / 6.0 + s / 24.0)) - rest) / (0.5 + s * (1.0 / 3.0 + s / 8.0))
    return c / s


@kernel
def _to_sides(f, j, tx, ty, out):  # type: ignore[no-untyped-def]
    """Write the reach of the walls to the left and to the right of the direction (tx, ty) at node j to out (2,) [m]."""
    near = _reach(f[WALL + j], f[PUSH + j])
    far = _reach(f[NEXT + j], f[PUSH_NEXT + j])
    across = f[WALL_X + j] * ty - f[WALL_Y + j] * tx
    other = f[NEXT_X + j] * ty - f[NEXT_Y + j] * tx
    out[0], out[1] = (near, 0.0) if across > 0.0 else (0.0, near)
    if (across > 0.0) != (other > 0.0):
        out[1 if across > 0.0 else 0] = far
    elif abs(across) < TUNING.either_side:
        out[:2] = near


@kernel
def _lay(field, cut, c, J, step, f):  # type: ignore[no-untyped-def]
    """Write the J nodes of cross-section c to rows f, and the point on the reference after the last."""
    point, ahead, ends = cut
    px, py = point[c, 0], point[c, 1]
    tx, ty = ahead[c, 0], ahead[c, 1]

    for j in range(WIDTH):
        left = (j + 0.5) * step - ends[c, 1] if j < J else 0.0
        x, y = px - left * ty, py + left * tx
        f[PLACE_X + j], f[PLACE_Y + j] = x, y
        near, f[WALL_X + j], f[WALL_Y + j], far, f[NEXT_X + j], f[NEXT_Y + j] = two_walls(field, x, y)
        f[WALL + j] = max(near, TUNING.closest)
        f[NEXT + j] = max(far, TUNING.closest)


@kernel
def _transfer(arena, cut, k, place, slope):  # type: ignore[no-untyped-def]
    """Fill `place` and `slope` of a tube from `sections_of`, from the goal back; return log psi at the start."""
    point, ahead, ends = cut
    C = slope.shape[0]
    J = slope.shape[1]
    f = np.zeros(ROWS, np.float32)
    known = np.zeros(ROWS, np.float32)
    base, wide = 0.0, 0.0  # log psi that the rows are relative to; spacing of the nodes on the next cross-section
    for c in range(C - 1, -1, -1):
        tx, ty = ahead[c, 0], ahead[c, 1]
        step = max((ends[c, 0] + ends[c, 1]) / J, 1e-6)
        _lay(arena.static, cut, c, J, step, f)
        if c == C - 1:
            goal_kernel(k, arena.goal, arena.radius, f)
        else:
            line = (point[c + 1, 0], point[c + 1, 1], ahead[c + 1, 0], ahead[c + 1, 1])
            propagate(np.float32(k), line, J, np.float32(wide), known, f)
        wide = step
        for j in range(J):
            slope[c, j, :2] = (f[SLOPE_X + j], f[SLOPE_Y + j])
            _to_sides(f, j, tx, ty, slope[c, j, 2:])
        place[c, :2], place[c, 2], place[c, 3] = point[c], tx, ty
        place[c, 4:] = (0.5 * step - ends[c, 1], 1.0 / step)

        if c > 0:
            top = f[LOG_PSI]
            for j in range(1, J):
                top = max(top, f[LOG_PSI + j])
            for j in range(J):
                f[LOG_PSI + j] -= top
            base += top
            copy_row(f, known)
    return base + f[LOG_PSI + J]
