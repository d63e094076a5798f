"""Solve the continuous-time equation among moving obstacles: psi(x, y, t) of a point with isotropic noise.

`-psi_t = -(q/lambda) psi + (b^2/2) Laplace psi`, psi = 1 on the goal's disc and exp(-phi/lambda) at walls, where they
are at t. Steps end at every row of every motion, and often enough in between. After the last row psi is `planar`'s;
from there `march` goes back in time. Repeated motions are marched period by period until psi repeats itself.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.errors import OptionError
from pirrht.exact import moving_look, point
from pirrht.exact.bridges import Room, Step, at_goal
from pirrht.exact.grid import Domain, Progress, affordable, frame_at, ignore_progress, in_goal
from pirrht.exact.march import march, taps_along
from pirrht.exact.moving_look import BEYOND, March, in_wall
from pirrht.freespace import FreeSpace
from pirrht.geometry.motion import Motion, Mover
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import kernel
from pirrht.moving.bodies import bodies_of, clearance_from, frames_of, poses_at
from pirrht.problem import Problem

SHORT = 0.5  # no step is shorter than this share of the longest
MARGIN = 5  # steps of the longest kind beyond the end, for frames that come next
LONGEST = 200.0  # common period of motions that start over at most [s]
CLOSE = 1e-6  # periods that differ by less are one [s]
BEFORE = 1e-9  # a body arrives at a jump so much before it [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timetable:
    """Ends of steps."""

    times: Array  # (F + 1,) from 0 on [s]
    last: float  # when all stands still for good [s]; infinite where motions start over
    first: float  # when all that moves starts over ...
    period: float  # ... every so many seconds; 0 where nothing does [s]
    again: int  # place in `times` of the time one period before the last one; 0 where nothing starts over

    @property
    def before(self) -> Array:
        """Times just before a repeated body jumps [s]."""
        return self.times - BEFORE if self.period > 0.0 else self.times

    @property
    def after(self) -> Array:
        """Times just after a repeated body jumps [s]."""
        return self.times + BEFORE if self.period > 0.0 else self.times


def timetable(movers: tuple[Mover, ...], longest: float) -> Timetable:
    """Divide motions into steps of at most `longest` [s]; OptionError if periods have no useful common multiple."""
    motions = [mover.motion for mover in movers]
    repeated = [m for m in motions if m.repeat]
    still = max([0.0, *(-m.offset if m.repeat else m.last for m in motions)])
    lead = _steps(_knots(motions, 0.0, still), longest)
    margin = MARGIN * longest
    if not repeated:
        rest = still + longest * np.arange(1, MARGIN + 1)
        return Timetable(times=np.concatenate([lead, rest]), last=still, first=0.0, period=0.0, again=0)
    period = _common([float(m.rows[-1, 0]) for m in repeated])
    cycle = _steps(_knots(motions, still, still + period), longest)
    more = cycle[1 : 2 + int(np.searchsorted(cycle, still + margin))] + period
    times = np.concatenate([lead[:-1], cycle, more])
    return Timetable(times=times, last=math.inf, first=still, period=period, again=len(lead) - 1 + len(more))


def _common(periods: list[float]) -> float:
    """Find the least common multiple of periods [s]; OptionError if it is too long."""
    longest = max(periods)
    for n in range(1, math.floor(LONGEST / longest) + 1):
        if all(abs(n * longest / p - round(n * longest / p)) * p < CLOSE for p in periods):
            return n * longest
    raise OptionError(
        f"motions start over every {', '.join(f'{p:g}' for p in periods)} s, which has no common multiple up to "
        f"{LONGEST:g} s; choose periods that have one"
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
    """Divide time into steps of at most `longest` [s] that end at knots [s], without knots closer than SHORT."""
    kept = [float(knots[0])]
    for t in knots[1:-1]:
        if min(t - kept[-1], knots[-1] - t) >= SHORT * longest:
            kept.append(float(t))
    out = [np.array(kept[:1])]
    for a, b in itertools.pairwise([*kept, *([float(knots[-1])] if knots[-1] > kept[-1] else [])]):
        out.append(np.linspace(a, b, math.ceil((b - a) / longest - CLOSE) + 1)[1:])
    return np.concatenate(out)


WIDEST = 0.28  # deviation of a step at most, as a share of the robot's radius ...
FASTEST = 1.1  # ... as one of the decay length 1/k, so that psi changes by e or so in a step ...
BETWEEN = 0.33  # ... and as one of the geometric mean of both
PER_STEP = 1.25  # points per deviation of a step
NEXT = 0.5  # the next frame is at least this share of a step later
MEMORY = 300_000_000  # bytes of frames
THINNED = 8  # steps from one frame that is kept to the next at most
SETTLED = 1e-3  # largest change of log psi from one period to the next [nats]
PERIODS = 60

look = moving_look.look


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or one that keeps v to 0.1 %.

    OptionError if the grid would have too many points or frames, a spacing is too coarse, or there is a step dt.
    """
    if dt is not None:
        raise OptionError("no grid solves a problem in steps among moving bodies; leave out dt (--exit bridge)")
    scene = space.scene
    radius, length = scene.robot_radius, 1.0 / point.wavenumber_of(problem)
    deviation = min(WIDEST * radius, FASTEST * length, BETWEEN * math.sqrt(radius * length))
    most = deviation / PER_STEP
    if spacing is not None and spacing > most:
        raise OptionError(f"a spacing of {spacing:g} m is too coarse among moving bodies; choose at most {most:.2g} m")
    chosen = affordable(scene, spacing or most, f"a step of {deviation:.2g} m is what the march can take")
    _thinning(scene, chosen, timetable(scene.movers, _longest(problem, chosen)))
    return chosen


def grid_of(
    problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress = ignore_progress
) -> March:
    """Solve in continuous time on a grid of this spacing [m], (G, nx, ny) [nats]; dt is none.

    Calls `progress` with the share of the march that is done, anew for every period. OptionError as of `spacing_for`,
    or if a repeated motion does not settle.
    """
    scene = space.scene
    table = timetable(scene.movers, _longest(problem, spacing))
    solver = _Solver(problem, scene, spacing, table, progress)
    return solver.solution()


def _noise(problem: Problem) -> float:
    """b [m/sqrt(s)]."""
    return float(problem.dynamics.B_c(np.zeros(2))[0, 0])


def _longest(problem: Problem, spacing: float) -> float:
    """Longest step of the march [s] on a grid of a spacing [m]."""
    return (PER_STEP * spacing / _noise(problem)) ** 2


def _thinning(scene: Scene, spacing: float, table: Timetable) -> int:
    """Count steps from one kept frame to the next; OptionError if there would be too many frames."""
    points = float(np.prod(np.ceil((scene.upper - scene.lower) / spacing) + 1))
    steps = len(table.times)
    thinning = max(1, math.ceil(4.0 * points * steps / MEMORY))
    if thinning > THINNED:
        raise OptionError(
            f"motions of {table.times[-1]:.3g} s in {steps:,} steps on {points:,.0f} points are too much to solve for; "
            "choose more --noise, a smaller workspace or shorter motions"
        )
    return thinning


class _Solver:
    """The march for one problem."""

    def __init__(
        self, problem: Problem, scene: Scene, spacing: float, table: Timetable, progress: Progress = ignore_progress
    ) -> None:
        assert not callable(problem.q)
        self.problem, self.scene, self.table, self.spacing, self.progress = problem, scene, table, spacing, progress
        self.b = _noise(problem)
        self.rate, self.wall = problem.q / problem.temperature, problem.phi / problem.temperature
        self.longest = _longest(problem, spacing)
        self.thinning = _thinning(scene, spacing, table)
        widest = self.step(self.longest * (1.0 + NEXT) * self.thinning)
        bodies = bodies_of(scene, widest.reach)
        (left, low), (right, high) = scene.lower.tolist(), scene.upper.tolist()
        frame = frame_at(scene.lower.astype(float), spacing, scene.goal)
        self.room = Room(frame, float(left), float(low), float(right), float(high), bodies)
        self.shape = tuple(int(n) for n in np.ceil((scene.upper - scene.lower) / spacing - 1e-9).astype(int) + 1)
        self.begin, self.end = (poses_at(scene.movers, t) for t in (table.after[:-1], table.before[1:]))
        self._taps: dict[float, tuple[Array, Array, Array]] = {}

    def step(self, dt: float) -> Step:
        """A step of dt [s]."""
        deviation = self.b * math.sqrt(dt)
        reach = (BEYOND + math.sqrt(2.0 * self.rate * dt)) * deviation
        return Step(dt, deviation, self.b, self.rate, self.wall, reach)

    def solution(self) -> March:
        """Frames of log psi at the times of the table."""
        table, rest = self.table, self._rest()
        last = len(table.times) - 1
        kept = np.unique(np.concatenate([np.arange(last, -1, -self.thinning), [0]]))
        frames = np.empty((len(kept), *self.shape), dtype=np.float32)
        now = np.empty(self.shape)
        _sample(rest, self.room, frames_of(self.end[-1]), now)
        if table.period > 0.0:
            now = self._settled(now)
        self._keep(frames, kept, last, now)
        for k, earlier in self._back(now, last, 0):
            self._keep(frames, kept, k, earlier)
        step = self.step(self.longest)
        arriving = frames_of(np.concatenate([self.begin[:1], self.end])[kept])
        return March(
            frame=self.room.frame, room=self.room, step=step, rest=rest, last=table.last, first=table.first,
            period=table.period, ahead=NEXT * self.longest * self.thinning, times=table.times, begin=self.begin,
            end=self.end, kept=kept, arriving=arriving, log_psi=frames,
        )  # fmt: skip

    def _keep(self, frames: NDArray[np.float32], kept: IntArray, k: int, now: Array) -> None:
        at = np.searchsorted(kept, k)
        if at < len(kept) and kept[at] == k:
            frames[at] = now

    def _rest(self) -> point.Expansion:
        """Solve with all bodies as they stand at the end of the table."""
        end = float(self.table.times[-1])
        still = tuple(solid for mover in self.scene.movers for solid in mover.at(end))
        scene = replace(self.scene, obstacles=(*self.scene.obstacles, *still), movers=())
        bodies = bodies_of(scene, scene.robot_radius)
        pose = frames_of(np.zeros((1, 3)))

        def clearance(points: Array) -> Array:
            out: Array = np.minimum(points - scene.lower, scene.upper - points).min(axis=1)
            _clearances(bodies, pose, np.ascontiguousarray(points), out)
            return out

        domain = Domain(
            lower=scene.lower.astype(float), upper=scene.upper.astype(float), goal=scene.goal, clearance=clearance
        )
        k = point.wavenumber_of(self.problem)
        spacing = min(point.FINEST / k, point.COARSEST * scene.robot_radius)
        return point.solve(domain, wavenumber=k, wall=self.wall, spacing=spacing)

    def _settled(self, now: Array) -> Array:
        """Find log psi at the table's end that is equal a period before; OptionError if it does not settle."""
        table, last = self.table, len(self.table.times) - 1
        for _ in range(PERIODS):
            before = now
            *_, (_, now) = self._back(before, last, table.again)
            both = np.isfinite(now) & np.isfinite(before)
            same = bool(np.all(np.isfinite(now) == np.isfinite(before)))
            if same and float(np.max(np.abs(now[both] - before[both]), initial=0.0)) < SETTLED:
                return now
        raise OptionError(
            f"psi has not settled after {PERIODS} periods of {table.period:g} s of the repeated motions; "
            "choose a longer period or a greater --q"
        )

    def _back(self, now: Array, last: int, first: int) -> Iterator[tuple[int, Array]]:
        """(k, log psi at time k) from the one before `last` back to `first`."""
        for k in range(last - 1, first - 1, -1):
            dt = float(self.table.times[k + 1] - self.table.times[k])
            step, out = self.step(dt), np.empty(self.shape)
            begin, end = frames_of(self.begin[k]), frames_of(self.end[k])
            march(now, out, self.room, begin, end, *self.taps(step), step)
            now = out
            self.progress((last - k) / (last - first))
            yield k, now

    def taps(self, step: Step) -> tuple[Array, Array, Array]:
        """Weights of a step along x and y, and its payment at the goal: none depends on where bodies are."""
        key = round(step.dt / self.longest, 9)
        if key not in self._taps:
            room, frame = self.room, self.room.frame
            alone = np.empty(self.shape)
            at_goal(frame, step, alone)
            self._taps[key] = (
                taps_along(self.shape[0], frame.x0, frame.spacing, room.left, room.right, step),
                taps_along(self.shape[1], frame.y0, frame.spacing, room.low, room.high, step),
                alone,
            )
        return self._taps[key]


@kernel
def _clearances(bodies, pose, points, out):  # type: ignore[no-untyped-def]
    """Lower `out` (k,) [m] to the clearances of points (k, 2) [m] from all solids."""
    for i in range(len(points)):
        for k in range(bodies.owner.shape[0]):
            out[i] = min(out[i], clearance_from(bodies, k, pose, points[i, 0], points[i, 1]))


@kernel
def _sample(rest, room, pose, out):  # type: ignore[no-untyped-def]
    """Sample a stationary solution on the grid of `room`, (nx, ny) [nats]; minus infinity in walls and goal."""
    x, slope = np.empty(2), np.empty(2)
    frame = room.frame
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x[0], x[1] = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
            blocked = in_goal(frame, x) or in_wall(room, pose, x[0], x[1])
            out[i, j] = -math.inf if blocked else point.look(rest, x, slope)
