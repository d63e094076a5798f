"""Solve the continuous-time equation among moving obstacles: psi(x, y, t) of a point with isotropic noise.

`-psi_t = -(q/lambda) psi + (b^2/2) Laplace psi`, psi = 1 on the goal's disc and exp(-phi/lambda) at walls, where they
are at t. Steps end at every row of every motion, and often enough in between. After the last row psi is stationary,
as `point` solves for it; from there Gaussian steps go back in time. Repeated motions are stepped through period by
period until psi repeats itself. Between kept frames psi is one more such step, from the place itself to the next frame:
so the control grows as 1/distance at each wall.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import kve

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact import point
from pirrht.exact.bodies import bodies_of, clearance_from, frames_of, poses_at
from pirrht.exact.boundaries import Step, Surroundings, step_of, to_border
from pirrht.exact.gaussian_step import log_psi_before, meet_boundaries, smooth, taps_along
from pirrht.exact.grid import (
    TUNING,
    Domain,
    Frame,
    Progress,
    affordable,
    frame_at,
    ignore_progress,
    in_goal,
    largest_change,
)
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import kernel
from pirrht.problem import Problem

SAME = 1e-6  # times that differ by less are one [s]
BEFORE = 1e-9  # a body arrives at a jump so much before it [s]


class Timetable(NamedTuple):
    """Ends of steps."""

    times: Array  # (F + 1,) from 0 on [s]
    last: float  # when all motion has ended [s]; infinite where motions repeat
    first: float  # when all motions repeat ...
    period: float  # ... every so many seconds; 0 where none does [s]
    again: int  # place in `times` of the time one period before the last one; 0 where none repeats


class Frames(NamedTuple):
    """log psi in time: frames of it, and the stationary solution after the last motion."""

    frame: Frame
    surroundings: Surroundings
    step: Step  # the longest of the solution
    stationary: point.Expansion  # after `last`; unused where motions repeat
    last: float  # when all motion has ended [s]; infinite where motions repeat
    first: float  # when all motions repeat ...
    period: float  # ... every so many seconds; 0 where none does [s]
    ahead: float  # the next frame is at least so much later [s]
    times: Array  # (F + 1,) ends of steps [s]
    begin: Array  # (F, 1 + J, 3) poses at the beginnings of steps [m, m, rad]
    end: Array  # (F, 1 + J, 3) and at their ends
    moments: Array  # (G,) times of the frames [s]
    arriving: Array  # (G, 1 + J, 4) poses of bodies then, as of `frames_of`
    log_psi: NDArray[np.float32]  # (G, nx, ny) [nats]; minus infinity inside of walls and of the goal


def timetable(movers: tuple[Mover, ...], longest: float) -> Timetable:
    """Divide motions into steps of at most `longest` [s]; OptionError if periods have no useful common multiple."""
    motions = [mover.motion for mover in movers]
    repeated = [m for m in motions if m.repeat]
    still = max([0.0, *(-m.offset if m.repeat else m.last for m in motions)])
    lead = _steps(_knots(motions, 0.0, still), longest)
    if not repeated:
        rest = still + longest * np.arange(1, TUNING.last_steps + 1)
        return Timetable(np.concatenate([lead, rest]), last=still, first=0.0, period=0.0, again=0)
    period = _common([float(m.rows[-1, 0]) for m in repeated])
    cycle = _steps(_knots(motions, still, still + period), longest)
    more = cycle[1 : 2 + int(np.searchsorted(cycle, still + TUNING.last_steps * longest))] + period
    times = np.concatenate([lead[:-1], cycle, more])
    return Timetable(times, last=math.inf, first=still, period=period, again=len(lead) - 1 + len(more))


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


def _knots(motions: list[Motion], begin: float, end: float) -> Array:
    """Times from begin to end [s], both included, at which a motion has a row."""
    found = [np.array([begin, end])]
    for m in motions:
        rows, period = m.rows[:, 0] - m.offset, float(m.rows[-1, 0])
        first, last = ((t - rows[0]) / period for t in (begin, end)) if m.repeat else (0.0, 0.0)
        found += [rows + k * period for k in range(max(math.floor(first), 0), math.floor(last) + 1)]
    every = np.unique(np.concatenate(found))
    return every[(every >= begin) & (every <= end)]


def _steps(knots: Array, longest: float) -> Array:
    """Divide time into steps of at most `longest` [s] that end at knots [s], without knots that are too close."""
    kept = [float(knots[0])]
    for t in knots[1:-1]:
        if min(t - kept[-1], knots[-1] - t) >= TUNING.shortest_step * longest:
            kept.append(float(t))
    kept += [float(t) for t in knots[-1:] if t > kept[-1]]
    pieces = [np.linspace(a, b, math.ceil((b - a) / longest - SAME) + 1)[1:] for a, b in itertools.pairwise(kept)]
    return np.concatenate([kept[:1], *pieces])


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or one that keeps v to 0.1 %.

    OptionError if the grid would have too many points or frames, a spacing is too coarse, or there is a step dt.
    """
    if dt is not None:
        raise OptionError("no grid solves a problem in steps among moving obstacles; leave out dt (exit rule bridge)")
    scene = space.scene
    radius, length = scene.robot_radius, 1.0 / point.wavenumber_of(problem)
    mean = math.sqrt(radius * length)
    deviation = min(TUNING.step_radii * radius, TUNING.step_lengths * length, TUNING.step_mean * mean)
    most = deviation / TUNING.moving_points
    if spacing is not None and spacing > most:
        raise OptionError(
            f"a spacing of {spacing:g} m is too coarse among moving obstacles; choose at most {most:.2g} m"
        )
    chosen = affordable(scene, spacing or most, f"steps among moving obstacles are at most {deviation:.2g} m wide")
    _thinning(scene, chosen, timetable(scene.movers, _longest(problem, chosen)))
    return chosen


def _longest(problem: Problem, spacing: float) -> float:
    """Longest step [s] on a grid of a spacing [m]."""
    return (TUNING.moving_points * spacing / float(problem.dynamics.B_c(np.zeros(2))[0, 0])) ** 2


def _thinning(scene: Scene, spacing: float, table: Timetable) -> int:
    """Count steps from one kept frame to the next; OptionError if there would be too many frames."""
    points = float(np.prod(np.ceil((scene.upper - scene.lower) / spacing) + 1))
    steps = len(table.times)
    thinning = max(1, math.ceil(4.0 * points * steps / TUNING.frame_bytes))
    if thinning > TUNING.thinned:
        raise OptionError(
            f"motions of {table.times[-1]:.3g} s in {steps:,} steps on {points:,.0f} points are too much to solve for; "
            "choose more noise, a smaller workspace or shorter motions"
        )
    return thinning


def grid_of(
    problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress = ignore_progress
) -> Frames:
    """Solve in continuous time on a grid of this spacing [m], (G, nx, ny) [nats]; dt is none.

    Calls `progress` with the share of the steps that is done, anew for every period. OptionError as of `spacing_for`,
    or if a repeated motion does not settle.
    """
    scene, longest = space.scene, _longest(problem, spacing)
    assert not callable(problem.q)
    b, rate = float(problem.dynamics.B_c(np.zeros(2))[0, 0]), problem.q / problem.temperature
    step = step_of(longest, b, rate, problem.phi / problem.temperature)
    table = timetable(scene.movers, longest)
    thinning = _thinning(scene, spacing, table)
    ahead = TUNING.next_frame * longest * thinning
    cutoff = step_of(longest * thinning + ahead, b, rate, step.wall).cutoff
    surroundings = _surroundings(scene, spacing, point.wavenumber_of(problem), cutoff)
    shape = tuple(int(n) for n in np.ceil((scene.upper - scene.lower) / spacing - 1e-9).astype(int) + 1)
    jump = BEFORE if table.period > 0.0 else 0.0  # so that repeated bodies are on the right side of it
    begin, end = (poses_at(scene.movers, t) for t in (table.times[:-1] + jump, table.times[1:] - jump))
    stationary, now = _stationary(problem, scene, surroundings, frames_of(end[-1])), np.empty(shape)
    _sample(stationary, surroundings, frames_of(end[-1]), now)
    march = _March(table, surroundings, step, frames_of(begin), frames_of(end), progress, {})
    if table.period > 0.0:
        now = march.settled(now)
    last = len(table.times) - 1
    kept = np.unique(np.concatenate([np.arange(last, -1, -thinning), [0]]))
    frames = np.empty((len(kept), *shape), dtype=np.float32)
    frames[-1] = now
    for k, earlier in march.back(now, 0):
        if k in kept:
            frames[np.searchsorted(kept, k)] = earlier
    arriving = frames_of(np.concatenate([begin[:1], end])[kept])
    return Frames(
        surroundings.frame, surroundings, step, stationary, table.last, table.first, table.period, ahead, table.times,
        begin, end, table.times[kept], arriving, frames,
    )  # fmt: skip


def _surroundings(scene: Scene, spacing: float, wavenumber: float, cutoff: float) -> Surroundings:
    """Boundaries of a scene for steps of a cutoff [m] on a grid of a spacing [m], k in [1/m]."""
    (left, low), (right, high) = scene.lower.tolist(), scene.upper.tolist()
    frame = frame_at(scene.lower.astype(float), spacing, scene.goal)
    pitch = min(frame.radius, 1.0 / wavenumber) / 64.0  # cubic interpolation errs by 1e-8
    e, rim = pitch * np.arange(4.0 + 3.0 * cutoff / pitch), wavenumber * frame.radius
    around_goal = kve(0, rim + wavenumber * e) / kve(0, rim) * np.exp(-wavenumber * e)
    return Surroundings(
        frame, float(left), float(low), float(right), float(high), bodies_of(scene, cutoff), around_goal, pitch
    )


def _stationary(problem: Problem, scene: Scene, surroundings: Surroundings, pose: Array) -> point.Expansion:
    """Solve with all bodies where they are at the end, pose (1 + J, 4)."""

    def clearance(points: Array) -> Array:
        out = np.empty(len(points))
        _clearances(surroundings, pose, np.ascontiguousarray(points), out)
        return out

    lower, upper = scene.lower.astype(float), scene.upper.astype(float)
    return point.solve(
        Domain(lower=lower, upper=upper, goal=scene.goal, clearance=clearance),
        wavenumber=point.wavenumber_of(problem),
        wall=problem.phi / problem.temperature,
        spacing=point.default_spacing(problem, scene),
    )


class _March(NamedTuple):
    """Gaussian steps back in time through a timetable."""

    table: Timetable
    surroundings: Surroundings
    longest: Step
    begin: Array  # (F, 1 + J, 4)
    end: Array  # (F, 1 + J, 4)
    progress: Progress
    taps: dict[float, tuple[Array, Array]]  # weights along x and y by the length of a step [ns]

    def settled(self, now: Array) -> Array:
        """Find log psi at the table's end that is equal a period before; OptionError if it does not settle."""
        for _ in range(TUNING.moving_periods):
            before = now
            *_, (_, now) = self.back(before, self.table.again)
            if largest_change(now, before) < TUNING.moving_settled:
                return now
        raise OptionError(
            f"psi has not settled after {TUNING.moving_periods} periods of {self.table.period:g} s of the repeated "
            "motions; choose a longer period or a greater q"
        )

    def back(self, now: Array, first: int) -> Iterator[tuple[int, Array]]:
        """(k, log psi at time k) from the one before the last back to `first`."""
        times, into, known, s = self.table.times, np.ones(now.shape), np.zeros(now.shape), self.surroundings
        last = len(times) - 1
        for k in range(last - 1, first - 1, -1):
            step = step_of(float(times[k + 1] - times[k]), self.longest.b, self.longest.rate, self.longest.wall)
            if (key := round(1e9 * step.dt)) not in self.taps:
                self.taps[key] = (
                    taps_along(now.shape[0], s.frame.x0, s.frame.spacing, s.left, s.right, step),
                    taps_along(now.shape[1], s.frame.y0, s.frame.spacing, s.low, s.high, step),
                )
            out = np.empty(now.shape)
            smooth(now, into, known, *self.taps[key], step.rate * step.dt, out)
            meet_boundaries(s, step, self.begin[k], self.end[k], now, out)
            now = out
            self.progress((last - k) / (last - first))
            yield k, now


@kernel
def clearance_at(surroundings, pose, x, y):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from all solids, posed (1 + J, 4), and from the border [m]."""
    out = to_border(surroundings, x, y)
    for k in range(surroundings.bodies.owner.shape[0]):
        out = min(out, clearance_from(surroundings.bodies, k, pose, x, y))
    return out


@kernel
def _clearances(surroundings, pose, points, out):  # type: ignore[no-untyped-def]
    """Fill `out` (k,) [m] with the clearances of points (k, 2) [m]."""
    for i in range(len(points)):
        out[i] = clearance_at(surroundings, pose, points[i, 0], points[i, 1])


@kernel
def _sample(stationary, surroundings, pose, out):  # type: ignore[no-untyped-def]
    """Sample a stationary solution on a grid (nx, ny) [nats]; minus infinity in walls and goal."""
    x, slope, frame = np.empty(2), np.empty(2), surroundings.frame
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x[0], x[1] = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
            blocked = in_goal(frame, x) or clearance_at(surroundings, pose, x[0], x[1]) <= 0.0
            out[i, j] = -math.inf if blocked else point.evaluate(stationary, x, slope)


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,) [m, m, s]; its gradient [1/m] goes to slope (2,). -phi/lambda in walls."""
    slope[0], slope[1] = 0.0, 0.0
    if in_goal(grid.frame, x):
        return 0.0
    t, pose = _in_period(grid, max(x[2], 0.0)), np.empty((grid.begin.shape[1], 4))
    poses_of(grid, t, pose)
    if t >= grid.last:
        if clearance_at(grid.surroundings, pose, x[0], x[1]) <= 0.0:
            return -grid.step.wall
        return point.evaluate(grid.stationary, x, slope)
    g = min(_count_before(grid.moments, t + grid.ahead), len(grid.moments) - 1)
    step = step_of(grid.moments[g] - t, grid.step.b, grid.step.rate, grid.step.wall)
    return log_psi_before(grid.surroundings, step, pose, grid.arriving[g], grid.log_psi[g], x, slope)


@kernel
def _count_before(times, t):  # type: ignore[no-untyped-def]
    """Count increasing times [s] before t."""
    low, high = 0, len(times)
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if times[middle] < t else (low, middle)
    return low


@kernel
def _in_period(grid, t):  # type: ignore[no-untyped-def]
    """Return the equivalent of a time t [s] in the first period of repeated motions."""
    if grid.period > 0.0 and t >= grid.first + grid.period:
        return grid.first + (t - grid.first) % grid.period
    return t


@kernel
def poses_of(grid, t, pose):  # type: ignore[no-untyped-def]
    """Fill `pose` (1 + J, 4), as of `frames_of`, with poses of all bodies at t [s]."""
    t = _in_period(grid, t)
    f = min(max(_count_before(grid.times, t) - 1, 0), grid.begin.shape[0] - 1)
    share = min(max((t - grid.times[f]) / (grid.times[f + 1] - grid.times[f]), 0.0), 1.0)
    for j in range(pose.shape[0]):
        yaw = (1.0 - share) * grid.begin[f, j, 2] + share * grid.end[f, j, 2]
        pose[j, 0] = (1.0 - share) * grid.begin[f, j, 0] + share * grid.end[f, j, 0]
        pose[j, 1] = (1.0 - share) * grid.begin[f, j, 1] + share * grid.end[f, j, 1]
        pose[j, 2], pose[j, 3] = math.cos(yaw), math.sin(yaw)
