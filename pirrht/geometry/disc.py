"""Free space of a disc in the plane: the first member of `SpaceKernels`, on the clearance field of its centre.

Between two grid points a path with noise on its position is a Brownian bridge. It crosses a flat wall at distances c0
and c1 with probability exp(-2 c0 c1 / variance); the time of the first crossing is then drawn exactly (paper, eq. 3 and
section III-B). A step without position noise is swept through the clearance field.
"""

import math

import numpy as np

from pirrht.geometry.arcs import entry_of_piece
from pirrht.geometry.certify import certificates
from pirrht.geometry.field import Field, border, closest, interpolate, nearest_label, two_walls, with_slope
from pirrht.geometry.field import clearance as clearance_at
from pirrht.geometry.space import BLOCKED, COLLISION, GOAL, INSIDE, NEVER, UNSURE, SpaceKernels
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import borrowing, inlined, kernel, load_float32
from pirrht.jit.streams import FAR, MIN_VARIANCE, ONE, SIDEWAYS, first_crossing, survival, uniform

NEAR_MOST = 6  # static walls at one place: two components and four sides of the border


class Disc(Field):
    """The clearance field of a disc's centre, as a `Space`."""

    @classmethod
    def over(cls, field: Field) -> "Disc":
        """Take the field of a disc's centre."""
        return cls.holding(*field.contents.values())

    @property
    def kernels(self) -> SpaceKernels:
        """Return the kernels that read it."""
        return DISC


@inlined
def clearance(static, pose):  # type: ignore[no-untyped-def]
    """Return a lower bound [m] of the clearance of a place (x, y) [m], border included."""
    return clearance_at(static, pose[0], pose[1])


@inlined
def walls(static, pose):  # type: ignore[no-untyped-def]
    """Return the two nearest walls of a place (`field.two_walls`), each with its direction as a tuple."""
    c, nx, ny, d, mx, my = two_walls(static, pose[0], pose[1])
    return c, (nx, ny), d, (mx, my)


@inlined
def known_walls(static, pose, known):  # type: ignore[no-untyped-def]
    """Return the two nearest walls of a place of which `distances` are known."""
    return walls(static, pose)


@inlined
def refused(static, pose):  # type: ignore[no-untyped-def]
    """Return BLOCKED or UNSURE for a place that is not certified; the nearest grid point bounds its clearance."""
    x, y = pose
    if border(static, x, y) <= 0.0:
        return BLOCKED
    at, dx, dy, width = closest(static, x, y)
    return BLOCKED if load_float32(static.nearest, at) + math.sqrt(dx**2 + dy**2) + width < 0.0 else UNSURE


@inlined
def spread(static, cov, line):  # type: ignore[no-untyped-def]
    """Return the most variance along an axis [m^2], along a line all of it."""
    return cov[0] + cov[2] if line else max(cov[0], cov[2])


@inlined
def extent(static, change):  # type: ignore[no-untyped-def]
    """Return the length of a displacement [m]."""
    return math.sqrt(change[0] * change[0] + change[1] * change[1])


@borrowing
def near(static, pose, within, out):  # type: ignore[no-untyped-def]
    """Write the nearer than `within` [m] of two components and the sides of the border; return how many."""
    x, y = pose
    count = 0
    for side in range(4 if border(static, x, y) < within else 0):
        c = (x - static.left, static.right - x, y - static.low, static.high - y)[side]
        if c < within:
            out[count, 0], out[count, 1] = c, (1.0, -1.0, 0.0, 0.0)[side]
            out[count, 2] = (0.0, 0.0, 1.0, -1.0)[side]
            count += 1
    for k in range(2):
        c, nx, ny = with_slope(static, static.nearest if k == 0 else static.second, x, y)
        if c >= within:
            break
        out[count, 0], out[count, 1], out[count, 2] = c, nx, ny
        count += 1
    return count


@kernel
def _border_survival(field, x, y, nx, ny, vx, vy):  # type: ignore[no-untyped-def]
    across = survival(x - field.left, nx - field.left, vx) * survival(field.right - x, field.right - nx, vx)
    return across * survival(y - field.low, ny - field.low, vy) * survival(field.high - y, field.high - ny, vy)


@kernel
def slope_of(field, x, y):  # type: ignore[no-untyped-def]
    """Unit gradient (x, y) of the clearance at (x, y) [m], border included; it points away from the nearest wall."""
    h = 0.5 * field.spacing
    gx = clearance_at(field, x + h, y) - clearance_at(field, x - h, y)
    gy = clearance_at(field, x, y + h) - clearance_at(field, x, y - h)
    size = math.sqrt(gx * gx + gy * gy)
    return (gx / size, gy / size) if size > 0.0 else (1.0, 0.0)


@kernel
def _towards_wall(field, x, y, cov):  # type: ignore[no-untyped-def]
    """Variance of a step towards the nearest wall."""
    if cov[1] == 0.0 and cov[0] == cov[2]:
        return cov[0]
    gx, gy = slope_of(field, x, y)
    return max(cov[0] * gx * gx + 2.0 * cov[1] * gx * gy + cov[2] * gy * gy, MIN_VARIANCE)


@kernel
def _obstacle_survival(field, x, y, nx, ny, c0, c1, variance):  # type: ignore[no-untyped-def]
    """Probability that a bridge misses the obstacles: the two nearest that stand apart are a flat wall each."""
    if c1 <= 0.0:
        return 0.0
    d0 = interpolate(field, field.second, x, y)
    d1 = interpolate(field, field.second, nx, ny)

    if nearest_label(field, x, y) != nearest_label(field, nx, ny):
        _, gx, gy = with_slope(field, field.nearest, x, y)
        _, hx, hy = with_slope(field, field.nearest, nx, ny)
        if gx * hx + gy * hy < 0.5 * math.sqrt((gx * gx + gy * gy) * (hx * hx + hy * hy)):
            return survival(c0, d1, variance) * survival(d0, c1, variance)
    return survival(c0, c1, variance) * survival(d0, d1, variance)


@inlined
def distances(arena, pose):  # type: ignore[no-untyped-def]
    """Distances of a place from the obstacles, from the border and from the goal's disc, each negative beyond [m]."""
    (x, y), field, goal = pose, arena.static, arena.goal
    edge = border(field, x, y)
    to_goal = math.sqrt((x - goal[0]) ** 2 + (y - goal[1]) ** 2) - arena.radius
    return (interpolate(field, field.nearest, x, y) if edge > 0.0 else edge), edge, to_goal


@inlined
def line_of(cov):  # type: ignore[no-untyped-def]
    """Direction (x, y) in which a covariance (xx, xy, yy) spreads most, where it spreads in that alone; whether so."""
    size = cov[0] + cov[2]
    alone = cov[0] * cov[2] - cov[1] * cov[1] <= TUNING.line * size * size
    return math.sqrt(cov[0] / size), math.copysign(math.sqrt(cov[2] / size), cov[1]), alone


@inlined
def rim_along(arena, x, y, ex, ey):  # type: ignore[no-untyped-def]
    """Distance along (ex, ey) from (x, y) to the goal's rim, negative behind [m]; infinity if the line misses it."""
    dx = arena.goal[0] - x
    dy = arena.goal[1] - y
    middle = dx * ex + dy * ey
    off = dx * ey - dy * ex
    square = arena.radius * arena.radius - off * off
    return middle - math.copysign(math.sqrt(square), middle) if square > 0.0 else np.inf


@inlined
def may_meet(before, after, square):  # type: ignore[no-untyped-def]
    """Check whether a bridge between two distances may meet what they are from; beyond `square` [m^2] it cannot."""
    return after <= 0.0 or 2.0 * before * after < square


@inlined
def _cut_short(arena, step, before, after):  # type: ignore[no-untyped-def]
    """Return the distances after a step, negative where its chord meets a wall or the goal's disc."""
    (x, y, nx, ny), (c0, _, g0), (c1, e1, g1) = step, before, after
    square = (nx - x) * (nx - x) + (ny - y) * (ny - y)
    past_wall = c1 > 0.0 and (c0 + c1) * (c0 + c1) < square
    past_rim = g1 > 0.0 and (g0 + g1) * (g0 + g1) < square

    if past_wall or past_rim:
        exit, share, _ = sweep(arena, (x, y), (nx, ny))
        c1 = c0 * (1.0 - 1.0 / share) if past_wall and exit == COLLISION else c1
        g1 = g0 * (1.0 - 1.0 / share) if past_rim and exit == GOAL else g1
    return c1, e1, g1


@inlined
def _meet_walls(field, step, before, after, cov, near, weighed, state):  # type: ignore[no-untyped-def]
    """Draw the next state, the share of a step at which a bridge meets `near` walls or NEVER, and log P(none)."""
    x, y, nx, ny = step
    c0, e0, _ = before
    c1, e1, _ = after
    near_wall, near_border = near
    u = 1.0

    variance = _towards_wall(field, x, y, cov)
    alive = _border_survival(field, x, y, nx, ny, cov[0], cov[2]) if near_border else 1.0
    if not weighed:
        state, u = uniform(state)
    # Two walls at least as far as the nearest: no need to look where the second is, if this already tells.
    certain = 1.0 - 2.0 * (1.0 - survival(c0, c1, variance))
    if near_wall and alive > 0.0 and (near_border or u >= certain):
        alive *= _obstacle_survival(field, x, y, nx, ny, c0, c1, variance)
    if weighed and alive > 0.0:
        return state, NEVER, math.log(alive)
    if u < alive:
        return state, NEVER, 0.0
    state, share = first_crossing(max(min(c0, e0), MIN_VARIANCE), min(c1, e1), math.sqrt(variance), state)
    return state, share, 0.0


@inlined
def enter_goal(arena, step, g0, g1, cov, line, state):  # type: ignore[no-untyped-def]
    """Draw the next state, and the share of a step at which a bridge enters the goal, or NEVER; g0, g1 in [m]."""
    x, y, nx, ny = step
    ex, ey, alone = line_of(cov)
    if line and alone:
        to_rim = rim_along(arena, x, y, ex, ey)
        moved = (nx - x) * ex + (ny - y) * ey
        variance = max(cov[0] + cov[2], MIN_VARIANCE)
        g0 = abs(to_rim)
        g1 = abs(to_rim) - math.copysign(1.0, to_rim) * moved
    else:
        ex = (x - arena.goal[0]) / (g0 + arena.radius)
        ey = (y - arena.goal[1]) / (g0 + arena.radius)
        variance = max(cov[0] * ex * ex + 2.0 * cov[1] * ex * ey + cov[2] * ey * ey, MIN_VARIANCE)
    state, u = uniform(state)
    if u < survival(g0, g1, variance):
        return state, NEVER
    return first_crossing(max(g0, MIN_VARIANCE), g1, math.sqrt(variance), state)


@inlined
def first_met(state, wall_time, goal_time, log_survival):  # type: ignore[no-untyped-def]
    """Return what `SpaceKernels.bridge` does, by the shares of a step at which it meets a wall and enters the goal."""
    if goal_time == NEVER and wall_time == NEVER:
        return state, INSIDE, 1.0, log_survival
    if goal_time <= wall_time:
        return state, GOAL, goal_time, goal_time * log_survival
    return state, COLLISION, wall_time, 0.0


@kernel
def bridge(arena, pose, moved, before, after, cov, weighed, state, line=False):  # type: ignore[no-untyped-def]
    """Judge how a noisy step ends (paper, eq. 3, between the steps).

    A step that may keep to a line enters the goal where that line does.
    Returns: next state of the sequence, INSIDE or the Outcome, share of the step until the exit, and the log of that
        probability [nats].
    """
    step = (pose[0], pose[1], moved[0], moved[1])
    reach = FAR * (cov[0] + cov[2] if line else max(cov[0], cov[2]))
    after = _cut_short(arena, step, before, after)
    near_wall = may_meet(before[0], after[0], reach)
    near_border = may_meet(before[1], after[1], reach)
    wall_time, goal_time, lasting = NEVER, NEVER, 0.0
    if near_wall or near_border:
        near = near_wall, near_border
        state, wall_time, lasting = _meet_walls(arena.static, step, before, after, cov, near, weighed, state)
    if may_meet(before[2], after[2], reach):
        state, goal_time = enter_goal(arena, step, before[2], after[2], cov, line, state)
    return first_met(state, wall_time, goal_time, lasting)


@kernel
def facing(static, pose, known, cov):  # type: ignore[no-untyped-def]
    """Clearance of a place [m] over the share of noise, of a covariance, that a wall faces along its line."""
    (x, y), size, nearest = pose, cov[0] + cov[2], np.inf
    for k in range(2):
        d, gx, gy = with_slope(static, static.nearest if k == 0 else static.second, x, y)
        square = gx * gx + gy * gy
        towards = cov[0] * gx * gx + 2.0 * cov[1] * gx * gy + cov[2] * gy * gy
        share = ONE if square == 0.0 else towards / (square * size)
        nearest = min(nearest, d / math.sqrt(max(share, SIDEWAYS)))
    return nearest


@kernel
def towards_exit(arena, pose, outcome):  # type: ignore[no-untyped-def]
    """Return the distance of a place [m] from rim (GOAL) or wall, and the unit vector (x, y) towards it."""
    x, y = pose
    if outcome == GOAL:
        nx = arena.goal[0] - x
        ny = arena.goal[1] - y
        size = math.sqrt(nx * nx + ny * ny)
        return size - arena.radius, nx / size, ny / size
    gx, gy = slope_of(arena.static, x, y)
    return max(clearance(arena.static, pose), 0.0), -gx, -gy


@kernel
def endpoint_exit(arena, pose):  # type: ignore[no-untyped-def]
    """Apply the paper's rule (III-A, steps 3, 4): INSIDE, or the Outcome at the step's end."""
    if clearance(arena.static, pose) <= 0.0:
        return COLLISION
    square = (pose[0] - arena.goal[0]) ** 2 + (pose[1] - arena.goal[1]) ** 2
    return GOAL if square <= arena.radius * arena.radius else INSIDE


@inlined
def sweep(arena, pose, moved, turn=0.0, clear=0.0):  # type: ignore[no-untyped-def]
    """Judge how a step from one place to another without position noise ends, by certified clearances.

    A step that turns [rad] is an arc next to its chord; into the goal it counts as straight. No wall is nearer to its
    start than `clear` [m]; the clearances at both ends may cover the step.
    Returns: INSIDE or the Outcome, share of the step until the exit, and what is clear at its end, as far as is known.
    """
    (x, y), (nx, ny) = pose, moved
    arc = math.sqrt(((nx - x) * (nx - x) + (ny - y) * (ny - y)) * (1.0 + 0.25 * turn * turn))
    (gx, gy), reach, ahead = arena.goal, arc + arena.radius, 0.0
    if (gx - x) * (gx - x) + (gy - y) * (gy - y) > reach * reach:
        if arc < clear:
            return INSIDE, 1.0, clear - arc
        ahead = clearance_at(arena.static, nx, ny)
        if ahead > 0.0 and arc < clear + ahead:
            return INSIDE, 1.0, ahead
    return _march(arena, x, y, nx, ny, turn, clear, ahead)


@kernel
def _march(arena, x, y, nx, ny, turn, clear, ahead):  # type: ignore[no-untyped-def]
    """March what `clear` [m] around the start and `ahead` [m] around the end leave open; 0 where nothing is known."""
    length = math.sqrt((nx - x) ** 2 + (ny - y) ** 2)
    if length == 0.0:
        return endpoint_exit(arena, (nx, ny)), 1.0, 0.0
    field, (gx, gy) = arena.static, arena.goal
    ux = (nx - x) / length
    uy = (ny - y) / length
    until, reach = np.inf, length + arena.radius
    if (gx - x) * (gx - x) + (gy - y) * (gy - y) <= reach * reach:
        until = entry_of_piece(x, y, math.atan2(uy, ux), 0.0, length, gx, gy, arena.radius)
    stop = min(length, until)
    bow = 0.5 * turn / length
    pace = 1.0 / math.sqrt(1.0 + 0.25 * turn * turn)
    s = min(stop, clear * pace)
    while True:
        aside = bow * s * (length - s)
        c = clearance_at(field, x + s * ux + aside * uy, y + s * uy - aside * ux)
        if c <= 0.0:
            return COLLISION, s / length, 0.0
        if s >= stop:
            break
        if ahead > 0.0 and length - s < (c + ahead) * pace:
            return INSIDE, 1.0, ahead
        s = min(stop, s + max(c, 0.1 * field.spacing) * pace)
    return (GOAL, until / length, 0.0) if until < np.inf else (INSIDE, 1.0, c)


@inlined
def rim(arena, pose, cov):  # type: ignore[no-untyped-def]
    """Return the direction of noise along a line, how far along it the goal's rim is [m], and whether it is one."""
    ex, ey, alone = line_of(cov)
    return (ex, ey), rim_along(arena, pose[0], pose[1], ex, ey), alone


certify, certify_piece, certify_curve, _ = certificates(clearance, refused, False)

DISC = SpaceKernels(
    position=2, turns=False, isotropic=True, near_most=NEAR_MOST, clearance=clearance, place=clearance, walls=walls,
    known_walls=known_walls, near=near, distances=distances, facing=facing, spread=spread, extent=extent, sweep=sweep,
    bridge=bridge, end=endpoint_exit, exit=towards_exit, rim=rim, certify=certify, certify_place=certify,
    certify_piece=certify_piece, certify_curve=certify_curve,
)  # fmt: skip
