"""Free space of a round robot on a clearance field of its centre: what a disc in the plane and a ball in space share.

Between two grid points a path with noise on its position is a Brownian bridge. It crosses a flat wall at distances c0
and c1 with probability exp(-2 c0 c1 / variance); the time of the first crossing is then drawn exactly (paper, eq. 3 and
section III-B). A step without position noise is swept through the clearance field.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.geometry.space import BLOCKED, COLLISION, GOAL, INSIDE, NEVER, UNSURE
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import borrowing, inlined, kernel, load_float32, part
from pirrht.jit.streams import FAR, MIN_VARIANCE, ONE, SIDEWAYS, first_crossing, survival, uniform
from pirrht.jit.vectors import combined, dot


class GridKernels(NamedTuple):
    """Kernels of a field of so many numbers; `static` has the addresses `nearest` and `second` of grids, and spacing.

    Places and directions are tuples.
    """

    width: int  # numbers of a place: 2 or 3
    border: Any  # (static, place): distance from the border of the workspace, negative outside [m]
    side: Any  # (static, place, k): distance from side k of the border [m], and the direction away from it
    interpolate: Any  # (static, grid, place): clearance in a grid [m]
    with_slope: Any  # (static, grid, place): clearance and its gradient
    closest: (
        Any  # (static, place): index of the closest point, the place seen from there [m], and the spacing there [m]
    )
    label: Any  # (static, place): solid that is nearest at the closest point
    walls: Any  # as of `SpaceKernels`
    along: Any  # (place, direction, s, aside): place s along a direction, and in the plane to the right of it [m]
    entry: (
        Any  # (place, direction, length, goal, radius): distance along a piece to the goal [m]; infinity: it misses it
    )


class CovarianceKernels(NamedTuple):
    """Kernels of the covariance of a place, its upper triangle by rows."""

    axis: Any  # (cov, k): variance along an axis
    total: Any  # (cov): sum of these
    most: Any  # (cov): greatest of these
    even: Any  # (cov): whether it is that of isotropic noise
    towards: Any  # (cov, g): its quadratic form
    # (cov): direction in which it spreads most, where it spreads in that alone, and whether so.
    line: Any


class RoundKernels(NamedTuple):
    """Kernels of a round robot, and parts that other footprints share."""

    fields: dict[str, Any]  # of `SpaceKernels`, by name
    refused: Any  # (static, place): BLOCKED or UNSURE for a place that is not certified
    # (world, place, moved, g0, g1, cov, line, state), distances to the goal [m]: next state of the random sequence, and
    # the share of a step at which a bridge enters the goal, or NEVER
    enter_goal: Any


@cache
def covariances(width: int) -> CovarianceKernels:
    """Build the kernels of covariances of two or three numbers."""
    if width == 2:

        @inlined
        def line_in_plane(cov):  # type: ignore[no-untyped-def]
            size = cov[0] + cov[2]
            alone = cov[0] * cov[2] - cov[1] * cov[1] <= TUNING.line * size * size
            return (math.sqrt(cov[0] / size), math.copysign(math.sqrt(cov[2] / size), cov[1])), alone

        return CovarianceKernels(
            part(lambda cov, k: cov[0] if k == 0 else cov[2]),
            part(lambda cov: cov[0] + cov[2]),
            part(lambda cov: max(cov[0], cov[2])),
            part(lambda cov: cov[1] == 0.0 and cov[0] == cov[2]),
            part(lambda cov, g: cov[0] * g[0] * g[0] + 2.0 * cov[1] * g[0] * g[1] + cov[2] * g[1] * g[1]),
            line_in_plane,
        )

    @inlined
    def line_in_space(cov):  # type: ignore[no-untyped-def]
        xx, xy, xz, yy, yz, zz = cov
        size = xx + yy + zz
        minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz
        column, most = ((xx, xy, xz), xx) if xx >= yy else ((xy, yy, yz), yy)
        if zz > most:
            column, most = (xz, yz, zz), zz
        per = 1.0 / math.sqrt(most * size)
        return (per * column[0], per * column[1], per * column[2]), minors <= TUNING.line * size * size

    @inlined
    def towards_in_space(cov, g):  # type: ignore[no-untyped-def]
        squares = cov[0] * g[0] * g[0] + cov[3] * g[1] * g[1] + cov[5] * g[2] * g[2]
        return squares + 2.0 * (cov[1] * g[0] * g[1] + cov[2] * g[0] * g[2] + cov[4] * g[1] * g[2])

    @inlined
    def even_in_space(cov):  # type: ignore[no-untyped-def]
        level = cov[1] == 0.0 and cov[2] == 0.0 and cov[4] == 0.0
        return level and cov[0] == cov[3] and cov[3] == cov[5]

    return CovarianceKernels(
        part(lambda cov, k: cov[0] if k == 0 else (cov[3] if k == 1 else cov[5])),
        part(lambda cov: cov[0] + cov[3] + cov[5]),
        part(lambda cov: max(cov[0], cov[3], cov[5])),
        even_in_space,
        towards_in_space,
        line_in_space,
    )


@inlined
def may_meet(before, after, square):  # type: ignore[no-untyped-def]
    """Check whether a bridge between two distances may meet what they are from; beyond `square` [m^2] it cannot."""
    return after <= 0.0 or 2.0 * before * after < square


@inlined
def first_met(state, wall_time, goal_time, log_survival):  # type: ignore[no-untyped-def]
    """Return what `SpaceKernels.bridge` does, by the shares of a step at which it meets a wall and enters the goal."""
    if goal_time == NEVER and wall_time == NEVER:
        return state, INSIDE, 1.0, log_survival
    if goal_time <= wall_time:
        return state, GOAL, goal_time, goal_time * log_survival
    return state, COLLISION, wall_time, 0.0


@cache
def round_kernels(grid: GridKernels) -> RoundKernels:
    """Build the kernels of a round robot on a field."""
    width = grid.width
    border, side, interpolate, with_slope = grid.border, grid.side, grid.interpolate, grid.with_slope
    closest, label, walls, along, entry = grid.closest, grid.label, grid.walls, grid.along, grid.entry
    axis, total, most_of, even, towards, line_of = covariances(width)
    inner = dot(width)
    both = combined(width)
    less = part(lambda a, b: both(1.0, a, -1.0, b))
    over = part(lambda a, by: (a[0] / by, a[1] / by))
    if width == 3:
        over = part(lambda a, by: (a[0] / by, a[1] / by, a[2] / by))
    flat = part(lambda c, n: (c, n[0], n[1])) if width == 2 else part(lambda c, n: (c, n[0], n[1], n[2]))
    off_line = part(lambda d, e, middle: (d[0] * e[1] - d[1] * e[0]) * (d[0] * e[1] - d[1] * e[0]))
    if width == 3:
        off_line = part(lambda d, e, middle: max(inner(d, d) - middle * middle, 0.0))
    moved_along = part(lambda place, k, h: (place[0] + h, place[1]) if k == 0 else (place[0], place[1] + h))
    if width == 3:

        @part
        def moved_along(place, k, h):  # type: ignore[no-untyped-def]
            x, y, z = place
            return (x + h, y, z) if k == 0 else ((x, y + h, z) if k == 1 else (x, y, z + h))

    @inlined
    def clearance(static, pose):  # type: ignore[no-untyped-def]
        """Return a lower bound [m] of the clearance of a place [m], border included."""
        edge = border(static, pose)
        return edge if edge <= 0.0 else min(edge, interpolate(static, static.nearest, pose))

    @inlined
    def known_walls(static, pose, known):  # type: ignore[no-untyped-def]
        """Return the two nearest walls of a place of which `distances` are known."""
        return walls(static, pose)

    @inlined
    def refused(static, pose):  # type: ignore[no-untyped-def]
        """Return BLOCKED or UNSURE for a place that is not certified; the nearest grid point bounds its clearance."""
        if border(static, pose) <= 0.0:
            return BLOCKED
        at, offset, spacing = closest(static, pose)
        most = load_float32(static.nearest, at) + math.sqrt(inner(offset, offset)) + spacing
        return BLOCKED if most < 0.0 else UNSURE

    @inlined
    def spread(static, cov, line):  # type: ignore[no-untyped-def]
        """Return the most variance along an axis [m^2], along a line all of it."""
        return total(cov) if line else most_of(cov)

    @inlined
    def extent(static, change):  # type: ignore[no-untyped-def]
        """Return the length of a displacement [m]."""
        return math.sqrt(inner(change, change))

    @borrowing
    def near(static, pose, within, out):  # type: ignore[no-untyped-def]
        """Write the nearer than `within` [m] of two components and the sides of the border; return how many."""
        count = 0
        for k in range(2 * width if border(static, pose) < within else 0):
            c, n = side(static, pose, k)
            if c < within:
                out[count, 0] = c
                for j in range(width):
                    out[count, j + 1] = n[j]
                count += 1
        for k in range(2):
            c, n = with_slope(static, static.nearest if k == 0 else static.second, pose)
            if c >= within:
                break
            out[count, 0] = c
            for j in range(width):
                out[count, j + 1] = n[j]
            count += 1
        return count

    @inlined
    def border_survival(static, pose, moved, cov):  # type: ignore[no-untyped-def]
        alive = 1.0
        for k in range(2 * width):
            c, _ = side(static, pose, k)
            d, _ = side(static, moved, k)
            alive *= survival(c, d, axis(cov, k // 2))
        return alive

    @inlined
    def rise(static, pose, k):  # type: ignore[no-untyped-def]
        h = 0.5 * static.spacing
        return clearance(static, moved_along(pose, k, h)) - clearance(static, moved_along(pose, k, -h))

    gradient = part(lambda static, pose: (rise(static, pose, 0), rise(static, pose, 1)))
    first_axis: tuple[float, ...] = (1.0, 0.0)
    if width == 3:
        gradient = part(lambda static, pose: (rise(static, pose, 0), rise(static, pose, 1), rise(static, pose, 2)))
        first_axis = (1.0, 0.0, 0.0)

    @kernel
    def slope_of(static, pose):  # type: ignore[no-untyped-def]
        """Unit gradient of the clearance at a place [m], border included; it points away from the nearest wall."""
        g = gradient(static, pose)
        size = math.sqrt(inner(g, g))
        return over(g, size) if size > 0.0 else first_axis

    @kernel
    def towards_wall(static, pose, cov):  # type: ignore[no-untyped-def]
        """Variance of a step towards the nearest wall."""
        return axis(cov, 0) if even(cov) else max(towards(cov, slope_of(static, pose)), MIN_VARIANCE)

    @kernel
    def obstacle_survival(static, pose, moved, c0, c1, variance):  # type: ignore[no-untyped-def]
        """Probability that a bridge misses the obstacles: the two nearest that stand apart are a flat wall each."""
        if c1 <= 0.0:
            return 0.0
        d0 = interpolate(static, static.second, pose)
        d1 = interpolate(static, static.second, moved)

        if label(static, pose) != label(static, moved):
            _, g = with_slope(static, static.nearest, pose)
            _, h = with_slope(static, static.nearest, moved)
            if inner(g, h) < 0.5 * math.sqrt(inner(g, g) * inner(h, h)):
                return survival(c0, d1, variance) * survival(d0, c1, variance)
        return survival(c0, c1, variance) * survival(d0, d1, variance)

    @inlined
    def distances(arena, pose):  # type: ignore[no-untyped-def]
        """Distances of a place from the obstacles, the border and the goal, each negative beyond [m]."""
        edge = border(arena.static, pose)
        away = less(pose, arena.goal)
        to_goal = math.sqrt(inner(away, away)) - arena.radius
        return (interpolate(arena.static, arena.static.nearest, pose) if edge > 0.0 else edge), edge, to_goal

    @inlined
    def rim_along(arena, pose, e):  # type: ignore[no-untyped-def]
        """Distance along e from a place to the goal's rim, negative behind [m]; infinity if the line misses it."""
        d = less(arena.goal, pose)
        middle = inner(d, e)
        square = arena.radius * arena.radius - off_line(d, e, middle)
        return middle - math.copysign(math.sqrt(square), middle) if square > 0.0 else np.inf

    @kernel
    def endpoint_exit(arena, pose):  # type: ignore[no-untyped-def]
        """Apply the paper's rule (III-A, steps 3, 4): INSIDE, or the Outcome at the step's end."""
        if clearance(arena.static, pose) <= 0.0:
            return COLLISION
        away = less(pose, arena.goal)
        return GOAL if inner(away, away) <= arena.radius * arena.radius else INSIDE

    @kernel
    def march(arena, pose, moved, turn, clear, ahead):  # type: ignore[no-untyped-def]
        """March what `clear` [m] around the start and `ahead` [m] around the end leave open; 0: nothing is known."""
        way = less(moved, pose)
        away = less(arena.goal, pose)
        length = math.sqrt(inner(way, way))
        if length == 0.0:
            return endpoint_exit(arena, moved), 1.0, 0.0
        u = over(way, length)
        until, reach = np.inf, length + arena.radius
        if inner(away, away) <= reach * reach:
            until = entry(pose, u, length, arena.goal, arena.radius)
        stop = min(length, until)
        bow = 0.5 * turn / length
        pace = 1.0 / math.sqrt(1.0 + 0.25 * turn * turn)
        s = min(stop, clear * pace)
        while True:
            c = clearance(arena.static, along(pose, u, s, bow * s * (length - s)))
            if c <= 0.0:
                return COLLISION, s / length, 0.0
            if s >= stop:
                break
            if ahead > 0.0 and length - s < (c + ahead) * pace:
                return INSIDE, 1.0, ahead
            s = min(stop, s + max(c, 0.1 * arena.static.spacing) * pace)
        return (GOAL, until / length, 0.0) if until < np.inf else (INSIDE, 1.0, c)

    @inlined
    def sweep(arena, pose, moved, turn=0.0, clear=0.0):  # type: ignore[no-untyped-def]
        """Judge how a step from one place to another without position noise ends, by certified clearances.

        In the plane a step that turns [rad] is an arc next to its chord; into the goal it counts as straight. No wall
        is nearer to its start than `clear` [m]; the clearances at both ends may cover the step.
        Returns: INSIDE or the Outcome, share of the step until the exit, and what is clear at its end, as far as is
            known.
        """
        way = less(moved, pose)
        away = less(arena.goal, pose)
        ahead = 0.0
        arc = math.sqrt(inner(way, way) * (1.0 + 0.25 * turn * turn))
        reach = arc + arena.radius
        if inner(away, away) > reach * reach:
            if arc < clear:
                return INSIDE, 1.0, clear - arc
            ahead = clearance(arena.static, moved)
            if ahead > 0.0 and arc < clear + ahead:
                return INSIDE, 1.0, ahead
        return march(arena, pose, moved, turn, clear, ahead)

    @inlined
    def cut_short(arena, pose, moved, before, after):  # type: ignore[no-untyped-def]
        """Return the distances after a step, negative where its chord meets a wall or the goal."""
        (c0, _, g0), (c1, e1, g1), way = before, after, less(moved, pose)
        square = inner(way, way)
        past_wall = c1 > 0.0 and (c0 + c1) * (c0 + c1) < square
        past_rim = g1 > 0.0 and (g0 + g1) * (g0 + g1) < square

        if past_wall or past_rim:
            exit, share, _ = sweep(arena, pose, moved)
            c1 = c0 * (1.0 - 1.0 / share) if past_wall and exit == COLLISION else c1
            g1 = g0 * (1.0 - 1.0 / share) if past_rim and exit == GOAL else g1
        return c1, e1, g1

    @inlined
    def meet_walls(static, pose, moved, before, after, cov, near, weighed, state):  # type: ignore[no-untyped-def]
        """Draw the next state, the share of a step at which a bridge meets `near` walls or NEVER, and log P(none)."""
        c0, e0, _ = before
        c1, e1, _ = after
        near_wall, near_border = near
        u = 1.0

        variance = towards_wall(static, pose, cov)
        alive = border_survival(static, pose, moved, cov) if near_border else 1.0
        if not weighed:
            state, u = uniform(state)
        # Two walls at least as far as the nearest: no need to look where the second is, if this already tells.
        certain = 1.0 - 2.0 * (1.0 - survival(c0, c1, variance))
        if near_wall and alive > 0.0 and (near_border or u >= certain):
            alive *= obstacle_survival(static, pose, moved, c0, c1, variance)
        if weighed and alive > 0.0:
            return state, NEVER, math.log(alive)
        if u < alive:
            return state, NEVER, 0.0
        state, share = first_crossing(max(min(c0, e0), MIN_VARIANCE), min(c1, e1), math.sqrt(variance), state)
        return state, share, 0.0

    @inlined
    def enter_goal(arena, pose, moved, g0, g1, cov, line, state):  # type: ignore[no-untyped-def]
        """Draw the next state, and the share of a step at which a bridge enters the goal, or NEVER; g0, g1 in [m]."""
        e, alone = line_of(cov)
        if line and alone:
            to_rim = rim_along(arena, pose, e)
            ahead = inner(less(moved, pose), e)
            variance = max(total(cov), MIN_VARIANCE)
            g0 = abs(to_rim)
            g1 = abs(to_rim) - math.copysign(1.0, to_rim) * ahead
        else:
            e = over(less(pose, arena.goal), g0 + arena.radius)
            variance = max(towards(cov, e), MIN_VARIANCE)
        state, u = uniform(state)
        if u < survival(g0, g1, variance):
            return state, NEVER
        return first_crossing(max(g0, MIN_VARIANCE), g1, math.sqrt(variance), state)

    @kernel
    def bridge(arena, pose, moved, before, after, cov, weighed, state, line=False):  # type: ignore[no-untyped-def]
        """Judge how a noisy step ends (paper, eq. 3, between the steps).

        A step that may keep to a line enters the goal where that line does.
        Returns: next state of the sequence, INSIDE or the Outcome, share of the step until the exit, and the log of
            that probability [nats].
        """
        reach = FAR * spread(arena.static, cov, line)
        after = cut_short(arena, pose, moved, before, after)
        near_wall = may_meet(before[0], after[0], reach)
        near_border = may_meet(before[1], after[1], reach)
        wall_time, goal_time, lasting = NEVER, NEVER, 0.0
        if near_wall or near_border:
            near = near_wall, near_border
            state, wall_time, lasting = meet_walls(arena.static, pose, moved, before, after, cov, near, weighed, state)
        if may_meet(before[2], after[2], reach):
            state, goal_time = enter_goal(arena, pose, moved, before[2], after[2], cov, line, state)
        return first_met(state, wall_time, goal_time, lasting)

    @kernel
    def facing(static, pose, known, cov):  # type: ignore[no-untyped-def]
        """Clearance of a place [m] over the share of noise, of a covariance, that a wall faces along its line."""
        size, nearest = total(cov), np.inf
        for k in range(2):
            d, g = with_slope(static, static.nearest if k == 0 else static.second, pose)
            square = inner(g, g)
            share = ONE if square == 0.0 else towards(cov, g) / (square * size)
            nearest = min(nearest, d / math.sqrt(max(share, SIDEWAYS)))
        return nearest

    @kernel
    def towards_exit(arena, pose, outcome):  # type: ignore[no-untyped-def]
        """Return the distance of a place [m] from rim (GOAL) or wall, and the unit vector towards it, in one tuple."""
        if outcome == GOAL:
            n = less(arena.goal, pose)
            size = math.sqrt(inner(n, n))
            return flat(size - arena.radius, over(n, size))
        return flat(max(clearance(arena.static, pose), 0.0), over(slope_of(arena.static, pose), -1.0))

    @inlined
    def rim(arena, pose, cov):  # type: ignore[no-untyped-def]
        """Return the direction of noise along a line, how far along it the goal's rim is [m], and whether it is one."""
        e, alone = line_of(cov)
        return e, rim_along(arena, pose, e), alone

    fields = {
        "clearance": clearance, "place": clearance, "walls": walls, "known_walls": known_walls, "near": near,
        "distances": distances, "facing": facing, "spread": spread, "extent": extent, "sweep": sweep,
        "bridge": bridge, "end": endpoint_exit, "exit": towards_exit, "rim": rim,
    }  # fmt: skip
    return RoundKernels({"position": width, "turns": False, "near_most": 2 * width + 2} | fields, refused, enter_goal)
