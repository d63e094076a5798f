"""Find the first exit within one step of a sampled path (paper, eq. 3 and section III-B).

Between two grid points the path is a Brownian bridge. It crosses a flat wall at distances c0 and c1 with probability
exp(-2 c0 c1 / variance); the time of the first crossing is then drawn exactly. A step without position noise is swept
through the clearance field.
"""

import math

import numpy as np

from pirrht.geometry.arcs import entry_of_piece
from pirrht.geometry.field import border, clearance, interpolate, nearest_label, with_slope
from pirrht.geometry.world import NEVER
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import FAR, HALF, MIN_VARIANCE, ONE, SIDEWAYS, first_crossing, normals, survival, uniform
from pirrht.outcome import Outcome
from pirrht.rollouts.tuning import TUNING

INSIDE, GOAL, COLLISION = map(int, Outcome)  # INSIDE: no exit in this step, out of time after the last one


@kernel
def _border_survival(field, x, y, nx, ny, vx, vy):  # type: ignore[no-untyped-def]
    across = survival(x - field.left, nx - field.left, vx) * survival(field.right - x, field.right - nx, vx)
    return across * survival(y - field.low, ny - field.low, vy) * survival(field.high - y, field.high - ny, vy)


@kernel
def slope_of(field, x, y):  # type: ignore[no-untyped-def]
    """Unit gradient (x, y) of the clearance at (x, y) [m], border included; it points away from the nearest wall."""
    h = 0.5 * field.spacing
    gx = clearance(field, x + h, y) - clearance(field, x - h, y)
    gy = clearance(field, x, y + h) - clearance(field, x, y - h)
    size = math.sqrt(gx * gx + gy * gy)
    return (gx / size, gy / size) if size > 0.0 else (1.0, 0.0)


@inlined
def wall_slope(c, nx, ny, d, mx, my, offset):  # type: ignore[no-untyped-def]
    """Gradient (x, y) [1/m] of log(c / (c + offset)) + log(d / (d + offset)) for two walls as `two_walls` gives them.

    Along it, times BB', surviving paths lean away from walls: psi vanishes there like the distance, c > 0 [m].
    """
    one = offset / (c * (c + offset))
    other = offset / (d * (d + offset))

    return one * nx + other * mx, one * ny + other * my


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
def distances(arena, x, y):  # type: ignore[no-untyped-def]
    """Distances of (x, y) from the obstacles, from the border and from the goal's disc, each negative beyond [m]."""
    field, goal = arena.field, arena.goal
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
def _may_meet(before, after, square):  # type: ignore[no-untyped-def]
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
        exit, share, _ = sweep_exit(arena, x, y, nx, ny)
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
def _enter_goal(arena, step, g0, g1, cov, line, state):  # type: ignore[no-untyped-def]
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


@kernel
def bridge_exit(arena, step, before, after, cov, weighed, state, line=False):  # type: ignore[no-untyped-def]
    """Judge how a noisy step ends (paper, eq. 3, between the steps).

    Args, in order: arena, start and end (x, y, X, Y) of the step [m], `distances` before and after it [m],
        covariance (xx, xy, yy) of the step [m^2], whether a step that ends in free space is weighed by the probability
        that it met no wall, instead of being ended with the opposite one, state of the random sequence, and whether the
        step may keep to a line; then it enters the goal where that line does.
    Returns: next state of the sequence, INSIDE or the Outcome, share of the step until the exit, and the log of that
        probability [nats].
    """
    reach = FAR * (cov[0] + cov[2] if line else max(cov[0], cov[2]))
    after = _cut_short(arena, step, before, after)
    near_wall = _may_meet(before[0], after[0], reach)
    near_border = _may_meet(before[1], after[1], reach)
    wall_time, goal_time, lasting = NEVER, NEVER, 0.0
    if near_wall or near_border:
        near = near_wall, near_border
        state, wall_time, lasting = _meet_walls(arena.field, step, before, after, cov, near, weighed, state)
    if _may_meet(before[2], after[2], reach):
        state, goal_time = _enter_goal(arena, step, before[2], after[2], cov, line, state)
    if goal_time == NEVER and wall_time == NEVER:
        return state, INSIDE, 1.0, lasting
    if goal_time <= wall_time:
        return state, GOAL, goal_time, goal_time * lasting
    return state, COLLISION, wall_time, 0.0


@inlined
def fitting(near, rest, least, scale):  # type: ignore[no-untyped-def]
    """Fit a step [s] to the place: noise carries a path over a third of the way to what ends it, or less.

    Args: distance to wall or goal [m]; rest of the step of the grid, least step [s]; 1 / (9 variance per second)
        [s/m^2].
    """
    wish = max(scale * near * near, least)
    return rest if wish >= rest else min(wish, HALF * rest)


@kernel
def facing(field, x, y, cov):  # type: ignore[no-untyped-def]
    """Clearance of (x, y) [m] over the share of noise, of covariance (xx, xy, yy), that a wall faces along its line."""
    size, nearest = cov[0] + cov[2], np.inf
    for k in range(2):
        d, gx, gy = with_slope(field, field.nearest if k == 0 else field.second, x, y)
        square = gx * gx + gy * gy
        towards = cov[0] * gx * gx + 2.0 * cov[1] * gx * gy + cov[2] * gy * gy
        share = ONE if square == 0.0 else towards / (square * size)
        nearest = min(nearest, d / math.sqrt(max(share, SIDEWAYS)))
    return nearest


@kernel
def towards_exit(arena, x, y, outcome):  # type: ignore[no-untyped-def]
    """Return the distance of (x, y) [m] from rim (GOAL) or wall, and the unit vector (x, y) towards it."""
    if outcome == GOAL:
        nx = arena.goal[0] - x
        ny = arena.goal[1] - y
        size = math.sqrt(nx * nx + ny * ny)
        return size - arena.radius, nx / size, ny / size
    gx, gy = slope_of(arena.field, x, y)
    return max(clearance(arena.field, x, y), 0.0), -gx, -gy


@kernel
def at_crossing(exit, radius, end, share, deviation, state):  # type: ignore[no-untyped-def]
    """Displace an isotropic bridge to its first crossing, the distance to wall or rim; along it the bridge is drawn.

    Args, in order: `towards_exit`, radius of a rim or 0 [m], displacement (x, y) at the end of the step [m], share of
        the step until the crossing, standard deviation of the whole step [m], and state of the random sequence.
    Returns: next state of the sequence, displacement in x and y [m].
    """
    (gap, nx, ny), (dx, dy) = exit, end
    state, z, _ = normals(state)
    along = share * (dy * nx - dx * ny) + deviation * math.sqrt(share * (1.0 - share)) * z
    if abs(along) < radius:  # the rim is round
        gap += radius - math.sqrt(radius * radius - along * along)
    return state, gap * nx - along * ny, gap * ny + along * nx


@kernel
def endpoint_exit(arena, nx, ny):  # type: ignore[no-untyped-def]
    """Apply the paper's rule (III-A, steps 3, 4): INSIDE, or the Outcome at the step's end (nx, ny) [m]."""
    if clearance(arena.field, nx, ny) <= 0.0:
        return COLLISION
    return GOAL if (nx - arena.goal[0]) ** 2 + (ny - arena.goal[1]) ** 2 <= arena.radius * arena.radius else INSIDE


@inlined
def turn_of(vx, vy, wx, wy, dx, dy, dt):  # type: ignore[no-untyped-def]
    """Angle [rad] by which a step of dt [s] turns that goes (dx, dy) [m] while its velocity v [m/s] becomes w."""
    square = dx * dx + dy * dy
    if square == 0.0:
        return 0.0
    return max(-TUNING.arc, min(TUNING.arc, dt * ((wy - vy) * dx - (wx - vx) * dy) / square))


@inlined
def sweep_exit(arena, x, y, nx, ny, turn=0.0, clear=0.0):  # type: ignore[no-untyped-def]
    """Judge how a step from (x, y) to (nx, ny) [m] without position noise ends, by certified clearances.

    A step that turns [rad] is an arc next to its chord; into the goal it counts as straight. No wall is nearer to its
    start than `clear` [m]; the clearances at both ends may cover the step.
    Returns: INSIDE or the Outcome, share of the step until the exit, and what is clear at its end, as far as is known.
    """
    arc = math.sqrt(((nx - x) * (nx - x) + (ny - y) * (ny - y)) * (1.0 + 0.25 * turn * turn))
    (gx, gy), reach, ahead = arena.goal, arc + arena.radius, 0.0
    if (gx - x) * (gx - x) + (gy - y) * (gy - y) > reach * reach:
        if arc < clear:
            return INSIDE, 1.0, clear - arc
        ahead = clearance(arena.field, nx, ny)
        if ahead > 0.0 and arc < clear + ahead:
            return INSIDE, 1.0, ahead
    return _march(arena, x, y, nx, ny, turn, clear, ahead)


@kernel
def _march(arena, x, y, nx, ny, turn, clear, ahead):  # type: ignore[no-untyped-def]
    """March what `clear` [m] around the start and `ahead` [m] around the end leave open; 0 where nothing is known."""
    length = math.sqrt((nx - x) ** 2 + (ny - y) ** 2)
    if length == 0.0:
        return endpoint_exit(arena, nx, ny), 1.0, 0.0
    field, (gx, gy) = arena.field, arena.goal
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
        c = clearance(field, x + s * ux + aside * uy, y + s * uy - aside * ux)
        if c <= 0.0:
            return COLLISION, s / length, 0.0
        if s >= stop:
            break
        if ahead > 0.0 and length - s < (c + ahead) * pace:
            return INSIDE, 1.0, ahead
        s = min(stop, s + max(c, 0.1 * field.spacing) * pace)
    return (GOAL, until / length, 0.0) if until < np.inf else (INSIDE, 1.0, c)
