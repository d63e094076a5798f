"""Solve the continuous-time equation among moving obstacles: psi(x, y, t) of a point with isotropic noise.

`-psi_t = -(q/lambda) psi + (b^2/2) Laplace psi`, psi = 1 on the goal's disc and exp(-phi/lambda) at walls, where they
are at t. Steps end at every row of every motion, and often enough in between. After the last row psi is stationary,
as `point` solves for it; from there Gaussian steps go back in time. Repeated motions are stepped through period by
period until psi repeats itself. Between kept frames psi is one more such step, from the place itself to the next frame:
so the control grows as 1/distance at each wall.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact import boundaries, point
from pirrht.exact.boundaries import JUMP, MovingDomain, clearance_at, poses_at
from pirrht.exact.discrete_point import Step, smooth, step_of, taps_along
from pirrht.exact.grid import TUNING, Domain, Equation, Progress, affordable, frame_at, in_goal, largest_change
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Motion
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import kernel
from pirrht.problem import Problem

SAME = 1e-6  # times that differ by less are one [s]


class Frames(NamedTuple):
    """log psi in time."""

    domain: MovingDomain
    step: Step  # the longest of the solution
    first: float  # when all motions repeat ...
    period: float  # ... every so many seconds; 0 where they end [s]
    ahead: float  # the next frame is at least so much later [s]
    moments: Array  # (G,) times of the frames [s]
    log_psi: NDArray[np.float32]  # (G, nx, ny) [nats]; minus infinity inside of walls and of the goal


def _timetable(motions: Sequence[Motion], longest: float) -> tuple[Array, float, float]:
    """Divide motions into steps of at most `longest` [s]; OptionError if periods have no useful common multiple.

    Returns ends of steps (F + 1,) from 0 on, when all motions repeat, and their period, 0 where they end [s].
    """
    periods = [float(m.rows[-1, 0]) for m in motions if m.repeat]
    still = max([0.0, *(-m.offset if m.repeat else m.last for m in motions)])
    period = _common(periods) if periods else 0.0
    lead = _steps(motions, 0.0, still, longest)
    cycle = _steps(motions, still, still + period, longest)

    if periods:
        more = cycle[1 : 2 + int(np.searchsorted(cycle, still + TUNING.last_steps * longest))] + period
    else:
        more = still + longest * np.arange(1.0, TUNING.last_steps + 1.0)
    return np.concatenate([lead, cycle[1:], more]), still, period


def _common(periods: list[float]) -> float:
    """Find the least common multiple of periods [s]; OptionError if it is too long."""
    longest = max(periods)
    for n in range(1, math.floor(TUNING.common_period / longest) + 1):
        if all(abs(n * longest / p - round(n * longest / p)) * p < SAME for p in periods):
            return n * longest
    raise OptionError(
        f"motions start over every {', '.join(f'{p:g}' for p in periods)} s, which has no common multiple up to "
        f"{TUNING.common_period:g} s; choose periods that have one"
    )


def _steps(motions: Sequence[Motion], begin: float, end: float, longest: float) -> Array:
    """Divide a time into steps of at most `longest` [s] that end at rows of motions, but for those too close."""
    rows = [np.array([begin, end])]
    for m in motions:
        again = math.ceil((end + m.offset) / m.rows[-1, 0]) if m.repeat else 1
        rows += [m.rows[:, 0] - m.offset + k * m.rows[-1, 0] for k in range(again)]
    kept = [begin]
    for t in np.unique(np.concatenate(rows)):
        if min(t - kept[-1], end - t) >= TUNING.shortest_step * longest:
            kept.append(float(t))
    kept += [end] if end > begin else []
    pieces = [np.linspace(a, b, math.ceil((b - a) / longest - SAME) + 1)[1:] for a, b in itertools.pairwise(kept)]
    return np.concatenate([kept[:1], *pieces])


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or one that keeps v to 0.1 %; OptionError if no such grid will do."""
    if dt is not None:
        raise OptionError("no grid solves a problem in steps among moving obstacles; leave out dt (exit rule bridge)")
    length = 1.0 / Equation.of(problem).wavenumber
    mean = math.sqrt(space.scene.robot_radius * length)
    deviation = min(TUNING.step_radii * space.scene.robot_radius, TUNING.step_lengths * length, TUNING.step_mean * mean)
    most = deviation / TUNING.moving_points
    if spacing is not None and spacing > most:
        raise OptionError(
            f"a spacing of {spacing:g} m is too coarse among moving obstacles; choose at most {most:.2g} m"
        )
    reason = f"steps among moving obstacles are at most {deviation:.2g} m wide"
    chosen = affordable(space.scene, spacing or most, reason)
    _plan(problem, space.scene, chosen)
    return chosen


def _plan(problem: Problem, scene: Scene, spacing: float) -> tuple[tuple[Array, float, float], float, int]:
    """Return `_timetable`, its longest step [s], and the steps from one kept frame to the next; refuses too many."""
    longest = (TUNING.moving_points * spacing / Equation.of(problem).b) ** 2
    table = _timetable([mover.motion for mover in scene.movers], longest)
    points = float(np.prod(np.ceil((scene.upper - scene.lower) / spacing) + 1))
    thinning = max(1, math.ceil(4.0 * points * len(table[0]) / TUNING.frame_bytes))
    if thinning > TUNING.thinned:
        raise OptionError(
            f"motions of {table[0][-1]:.3g} s in {len(table[0]):,} steps on {points:,.0f} points are too much to "
            "solve for; choose more noise, a smaller workspace or shorter motions"
        )
    return table, longest, thinning


def grid_of(problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress) -> Frames:
    """Solve in continuous time on a grid of this spacing [m]; dt is none.

    `progress` takes the share of steps done, anew for every period. OptionError too if a repeated motion does not
    settle.
    """
    scene, equation = space.scene, Equation.of(problem)
    (times, first, period), longest, thinning = _plan(problem, scene, spacing)
    ahead = TUNING.next_frame * longest * thinning
    frame = frame_at(scene.lower.astype(float), spacing, scene.goal)
    cutoff = step_of(longest * thinning + ahead, equation).cutoff
    domain = boundaries.moving_domain(scene, frame, cutoff, equation.wavenumber)
    step = step_of(longest, equation)
    now = _stationary(problem, space, domain, float(times[-1]) - JUMP)
    if period > 0.0:
        again = int(np.argmin(np.abs(times - (times[-1] - period))))
        for _ in range(TUNING.moving_periods):
            before = now
            *_, (_, now) = _back(domain, step, times, before, again, progress)
            if largest_change(now, before) < TUNING.moving_settled:
                break
        else:
            raise OptionError(
                f"psi has not settled after {TUNING.moving_periods} periods of {period:g} s of the repeated "
                "motions; choose a longer period or a greater q"
            )
    kept = np.unique(np.concatenate([np.arange(len(times) - 1, -1, -thinning), [0]]))
    frames = np.empty((len(kept), *now.shape), dtype=np.float32)
    frames[-1] = now
    for k, earlier in _back(domain, step, times, now, 0, progress):
        if k in kept:
            frames[np.searchsorted(kept, k)] = earlier
    return Frames(domain, step, first, period, ahead, times[kept], frames)


def _stationary(problem: Problem, space: FreeSpace, domain: MovingDomain, time: float) -> Array:
    """Solve with all bodies where they are at a time [s] for good: log psi (nx, ny) [nats]."""

    def clearance(points: Array) -> Array:
        out = np.empty(len(points))
        _clearances(domain, time, np.ascontiguousarray(points), out)
        return out

    still = replace(Domain.of(space), clearance=clearance)
    equation = Equation.of(problem)

    spacing = point.default_spacing(problem, space.scene)
    stationary = point.solve(still, wavenumber=equation.wavenumber, wall=equation.wall, spacing=spacing)
    out = np.empty(np.ceil((still.upper - still.lower) / domain.frame.spacing - 1e-9).astype(int) + 1)
    _sample(stationary, domain, time, out)
    return out


def _back(
    domain: MovingDomain, longest: Step, times: Array, now: Array, first: int, progress: Progress
) -> Iterator[tuple[int, Array]]:
    """(k, log psi at time k) from the one before the last back to `first`."""
    frame, (left, low, right, high) = domain.frame, domain.border
    last = len(times) - 1
    ones = np.ones(now.shape)
    taps: dict[int, tuple[Array, Array]] = {}  # by the length of a step [ns]
    for k in range(last - 1, first - 1, -1):
        step = step_of(float(times[k + 1] - times[k]), longest)
        if (key := round(1e9 * step.dt)) not in taps:
            taps[key] = (
                taps_along(now.shape[0], frame.x0, frame.spacing, left, right, step),
                taps_along(now.shape[1], frame.y0, frame.spacing, low, high, step),
            )
        earlier = smooth(now, ones, *taps[key], step.rate * step.dt)
        boundaries.meet_boundaries(domain, step, float(times[k]), now, earlier)
        now = earlier
        progress((last - k) / (last - first))
        yield k, now


@kernel
def _clearances(domain, t, points, out):  # type: ignore[no-untyped-def]
    """Fill `out` (k,) [m] with the clearances of points (k, 2) [m] at t [s]."""
    pose = poses_at(domain.solids, t)
    for i in range(len(points)):
        out[i] = clearance_at(domain, pose, points[i, 0], points[i, 1])


@kernel
def _sample(stationary, domain, t, out):  # type: ignore[no-untyped-def]
    """Sample a stationary solution on a grid (nx, ny) [nats]; minus infinity in goal and walls at t [s]."""
    x = np.empty(2)
    slope = np.empty(2)
    frame = domain.frame
    pose = poses_at(domain.solids, t)

    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x[0] = frame.x0 + i * frame.spacing
            x[1] = frame.y0 + j * frame.spacing
            blocked = in_goal(frame, x) or clearance_at(domain, pose, x[0], x[1]) <= 0.0
            out[i, j] = -math.inf if blocked else point.evaluate(stationary, x, slope)


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,) [m, m, s]; its gradient [1/m] goes to slope (2,). -phi/lambda in walls."""
    slope[0], slope[1] = 0.0, 0.0
    if in_goal(grid.domain.frame, x):
        return 0.0
    t = max(x[2], 0.0)
    if t >= grid.first + grid.period:
        t = grid.first + ((t - grid.first) % grid.period if grid.period > 0.0 else 0.0)
    g = 0
    while g < len(grid.moments) - 1 and grid.moments[g] < t + grid.ahead:
        g += 1
    step = step_of(grid.moments[g] - t, grid.step)
    return boundaries.log_psi_before(grid.domain, step, t, grid.log_psi[g], x, slope)
