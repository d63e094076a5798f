"""The continuous-time equation among moving bodies: psi(x, y, t) of a point with isotropic noise.

`-psi_t = -(q/lambda) psi + (b^2/2) Laplace psi`, psi = 1 on the goal's disc and exp(-phi/lambda) at walls, which are
where they are at t. After the last row of the motions all stands still and psi is `planar`'s; from there `march` goes
back in time. Where motions start over, periods are marched until psi repeats itself.

Between grid points and frames psi is one more such step, from x itself to the frame that comes next: it has the same
walls, so that the control grows as 1/distance at each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.compiled.jit import kernel
from pirrht.errors import OptionError
from pirrht.exact import planar
from pirrht.exact.bodies import bodies_of, clearance_from, frames_of, poses_at
from pirrht.exact.bridges import WALLS, Room, Step, log_sum, missed, outside, walls_around
from pirrht.exact.domain import Domain, Frame, affordable, frame_at, in_goal
from pirrht.exact.march import march, taps_along
from pirrht.exact.payoffs import at_goal, log_paid
from pirrht.exact.timetable import Timetable, timetable
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.problem import Problem

WIDEST = 0.28  # deviation of a step at most, as a share of the robot's radius ...
FASTEST = 1.1  # ... as one of the decay length 1/k, so that psi changes by e or so in a step ...
BETWEEN = 0.33  # ... and as one of the geometric mean of both
PER_STEP = 1.25  # default points per deviation of a step
COARSEST = 1.2  # deviations that points may be apart
BEYOND = 6.0  # a step is cut off so many deviations beyond the one that the law asks for
NEXT = 0.5  # the next frame is at least this share of a step later
MEMORY = 300_000_000  # bytes of frames
THINNED = 8  # steps from one frame that is kept to the next at most
SETTLED = 1e-3  # largest change of log psi from one period to the next [nats]
PERIODS = 60


class March(NamedTuple):
    """log psi in time: frames of it, and the solution once all stands still."""

    frame: Frame
    room: Room
    step: Step  # the longest of the march
    rest: planar.Expansion  # after `last`; of a motion that starts over unused
    last: float  # when all stands still for good [s]; infinite where motions start over
    first: float  # when what starts over begins to repeat itself [s] ...
    period: float  # ... every so many seconds; 0 where nothing does
    ahead: float  # the next frame is at least so much later [s]
    times: Array  # (F + 1,) ends of steps [s]
    begin: Array  # (F, 1 + J, 3) poses at the beginnings of steps [m, m, rad]
    end: Array  # (F, 1 + J, 3) and at their ends
    kept: IntArray  # (G,) places in `times` of the frames
    arriving: Array  # (G, 1 + J, 4) poses of the bodies then, as `frames_of` has them
    log_psi: NDArray[np.float32]  # (G, nx, ny) [nats]; minus infinity inside of walls and of the goal


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """The spacing [m] asked for, or one that keeps v to 0.1 %.

    Raises:
        OptionError: the grid would have too many points or frames, a spacing is too coarse, or there is a step dt.
    """
    if dt is not None:
        raise OptionError("no grid solves a problem in steps among moving bodies; leave out dt (--exit bridge)")
    deviation = _deviation(problem, space.scene)
    if spacing is not None and spacing > COARSEST * deviation:
        raise OptionError(
            f"a spacing of {spacing:g} m is too coarse for steps of {deviation:.2g} m; choose at most "
            f"{COARSEST * deviation:.2g} m"
        )
    chosen = deviation / PER_STEP if spacing is None else spacing
    chosen = affordable(space.scene, chosen, f"noise carries a step {deviation:.2g} m")
    table = timetable(space.scene.movers, _longest(problem, space.scene))
    _thinning(space.scene, chosen, table)
    return chosen


def grid_of(problem: Problem, space: FreeSpace, spacing: float, dt: float | None) -> March:
    """The solution (G, nx, ny) [nats] in continuous time on a grid of this spacing [m]; dt is none.

    Raises:
        OptionError: as `spacing_for`, or a repeated motion does not settle.
    """
    scene = space.scene
    table = timetable(scene.movers, _longest(problem, scene))
    solver = _Solver(problem, scene, spacing, table)
    return solver.solution()


def _deviation(problem: Problem, scene: Scene) -> float:
    """Standard deviation of the longest step along each axis [m]."""
    radius, length = scene.robot_radius, 1.0 / planar.wavenumber_of(problem)
    return min(WIDEST * radius, FASTEST * length, BETWEEN * math.sqrt(radius * length))


def _longest(problem: Problem, scene: Scene) -> float:
    """Longest step of the march [s]."""
    b = float(problem.dynamics.B_c(np.zeros(2))[0, 0])
    return (_deviation(problem, scene) / b) ** 2


def _thinning(scene: Scene, spacing: float, table: Timetable) -> int:
    """Every which step is kept as a frame.

    Raises:
        OptionError: too many would be.
    """
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

    def __init__(self, problem: Problem, scene: Scene, spacing: float, table: Timetable) -> None:
        assert not callable(problem.q)
        self.problem, self.scene, self.table, self.spacing = problem, scene, table, spacing
        self.b = float(problem.dynamics.B_c(np.zeros(2))[0, 0])
        self.rate, self.wall = problem.q / problem.temperature, problem.phi / problem.temperature
        self.longest = _longest(problem, scene)
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
        now = self._at_rest(rest)
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

    def _rest(self) -> planar.Expansion:
        """The solution with all bodies as they stand at the end of the table."""
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
        k = planar.wavenumber_of(self.problem)
        spacing = min(planar.FINEST / k, planar.COARSEST * scene.robot_radius)
        return planar.solve(domain, wavenumber=k, wall=self.wall, spacing=spacing)

    def _at_rest(self, rest: planar.Expansion) -> Array:
        """log psi of the stationary solution on the grid of the march."""
        out = np.empty(self.shape)
        _sample(rest, self.room, frames_of(self.end[-1]), out)
        return out

    def _settled(self, now: Array) -> Array:
        """log psi at the end of the table such that it is the same a period before.

        Raises:
            OptionError: it does not settle.
        """
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
            yield k, now

    def taps(self, step: Step) -> tuple[Array, Array, Array]:
        """Weights of a step along x and y, and what it is paid at the goal: none depends on where bodies are."""
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
def in_wall(room, pose, x, y):  # type: ignore[no-untyped-def]
    """Whether (x, y) [m] is in a solid, posed (1 + J, 4), or not inside the border."""
    for k in range(room.bodies.owner.shape[0]):
        if clearance_from(room.bodies, k, pose, x, y) <= 0.0:
            return True
    return outside(room, x, y)


@kernel
def _sample(rest, room, pose, out):  # type: ignore[no-untyped-def]
    """log psi of a stationary solution on the grid of `room`, (nx, ny) [nats]; minus infinity in walls and goal."""
    x, slope = np.empty(2), np.empty(2)
    frame = room.frame
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x[0], x[1] = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
            blocked = in_goal(frame, x) or in_wall(room, pose, x[0], x[1])
            out[i, j] = -math.inf if blocked else planar.look(rest, x, slope)


@kernel
def look(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,) [m, m, s]; its gradient [1/m] goes to slope (2,). -phi/lambda in walls."""
    slope[0], slope[1] = 0.0, 0.0
    if in_goal(grid.frame, x):
        return 0.0
    t = max(x[2], 0.0)
    if t < grid.last and grid.period > 0.0 and t >= grid.first + grid.period:
        t = grid.first + (t - grid.first) % grid.period
    pose = np.empty((grid.begin.shape[1], 4))
    poses_of(grid, t, pose)
    if t >= grid.last:
        if in_wall(grid.room, pose, x[0], x[1]):
            return -grid.step.wall
        return planar.look(grid.rest, x, slope)
    g, high = 0, grid.kept.shape[0] - 1
    while g < high:
        middle = (g + high) // 2
        if grid.times[grid.kept[middle]] >= t + grid.ahead:
            high = middle
        else:
            g = middle + 1
    b, rate = grid.step.b, grid.step.rate
    dt = grid.times[grid.kept[g]] - t
    deviation = b * math.sqrt(dt)
    reach = (BEYOND + math.sqrt(2.0 * rate * dt)) * deviation
    step = Step(dt, deviation, b, rate, grid.step.wall, reach)
    return _from(grid, grid.log_psi[g], pose, grid.arriving[g], step, x[0], x[1], slope)


@kernel
def poses_of(grid, t, pose):  # type: ignore[no-untyped-def]
    """Fill `pose` (1 + J, 4), as `frames_of` has it, with that of all bodies at t [s]."""
    if grid.period > 0.0 and t >= grid.first + grid.period:
        t = grid.first + (t - grid.first) % grid.period
    f = min(max(np.searchsorted(grid.times, t, side="right") - 1, 0), grid.begin.shape[0] - 1)
    share = min(max((t - grid.times[f]) / (grid.times[f + 1] - grid.times[f]), 0.0), 1.0)
    for j in range(pose.shape[0]):
        yaw = (1.0 - share) * grid.begin[f, j, 2] + share * grid.end[f, j, 2]
        pose[j, 0] = (1.0 - share) * grid.begin[f, j, 0] + share * grid.end[f, j, 0]
        pose[j, 1] = (1.0 - share) * grid.begin[f, j, 1] + share * grid.end[f, j, 1]
        pose[j, 2], pose[j, 3] = math.cos(yaw), math.sin(yaw)


@kernel
def _from(grid, later, begin, end, step, x, y, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] one step before a frame; its gradient goes to slope (2,) [1/m].

    Args:
        grid: of `March`.
        later: the frame, (nx, ny) [nats].
        begin, end: poses of all bodies, 2 x (1 + J, 4), as `frames_of` has them.
        step: of `Step`.
        x, y: position [m].
        slope: filled, (2,) [1/m].
    """
    room, frame, bodies = grid.room, grid.frame, grid.room.bodies
    near, count = np.empty(bodies.owner.shape[0], dtype=np.int64), 0
    for k in range(near.shape[0]):
        d = clearance_from(bodies, k, begin, x, y)
        if min(d, clearance_from(bodies, k, end, x, y)) < step.reach:
            near[count] = k
            count += 1
    wall, which = np.empty(count, dtype=np.int64), np.empty(WALLS, dtype=np.int64)
    clear, away = np.empty(WALLS), np.empty((WALLS, 4))
    n = walls_around(bodies, near[:count], begin, x, y, step.reach, wall, which, clear, away)
    if n < 0 or outside(room, x, y):
        return -step.wall
    h = frame.spacing
    i0, j0 = max(math.ceil((x - step.reach - frame.x0) / h), 0), max(math.ceil((y - step.reach - frame.y0) / h), 0)
    i1 = min(math.floor((x + step.reach - frame.x0) / h) + 1, later.shape[0])
    j1 = min(math.floor((y + step.reach - frame.y0) / h) + 1, later.shape[1])
    along_x, slope_x = np.empty(max(i1 - i0, 0)), np.empty(max(i1 - i0, 0))
    along_y, slope_y = np.empty(max(j1 - j0, 0)), np.empty(max(j1 - j0, 0))
    _axis(along_x, slope_x, frame.x0 + i0 * h, h, x, room.left, room.right, step)
    _axis(along_y, slope_y, frame.y0 + j0 * h, h, y, room.low, room.high, step)
    to_rim = math.sqrt((x - frame.goal_x) ** 2 + (y - frame.goal_y) ** 2) - frame.radius
    out_x, out_y = (x - frame.goal_x) / (to_rim + frame.radius), (y - frame.goal_y) / (to_rim + frame.radius)
    base = -math.inf
    for i in range(i0, i1):
        for j in range(j0, j1):
            base = max(base, later[i, j])
    square = step.deviation * step.deviation
    total, gx, gy = 0.0, 0.0, 0.0
    for i in range(i0, i1):
        for j in range(j0, j1):
            if later[i, j] == -math.inf:
                continue
            weight = math.exp(later[i, j] - base)
            px, py = frame.x0 + i * h, frame.y0 + j * h
            lx, ly = slope_x[i - i0], slope_y[j - j0]
            if to_rim < step.reach:
                d = math.sqrt((px - frame.goal_x) ** 2 + (py - frame.goal_y) ** 2) - frame.radius
                share = missed(to_rim, d, step)
                weight *= share
                steep = _steep(to_rim, d, square)
                lx, ly = lx + steep * out_x, ly + steep * out_y
            for g in range(n):
                d = math.inf
                for k in range(count):
                    if wall[k] == g:
                        d = min(d, clearance_from(bodies, near[k], end, px, py))
                weight *= missed(clear[g], d, step)
                steep = _steep(clear[g], d, square)
                lx, ly = lx + steep * away[g, 2], ly + steep * away[g, 3]
            weight *= along_x[i - i0] * along_y[j - j0]
            total += weight
            gx += weight * lx
            gy += weight * ly
    loss = step.rate * step.dt
    value = base - loss + math.log(total) if total > 0.0 else -math.inf
    if total > 0.0:
        slope[0], slope[1] = gx / total, gy / total
    edge = min(min(x - room.left, room.right - x), min(y - room.low, room.high - y))
    if to_rim < step.reach or (step.wall < math.inf and (n > 0 or edge < step.reach)):
        here = log_paid(room, near[:count], begin, end, step, x, y, -1.0)
        whole = log_sum(value, here)
        if whole > -math.inf:
            e, rest = min(1e-3 * step.deviation, 0.5 * to_rim), math.exp(value - whole)
            right = math.exp(log_paid(room, near[:count], begin, end, step, x + e, y, -1.0) - whole)
            left = math.exp(log_paid(room, near[:count], begin, end, step, x - e, y, -1.0) - whole)
            above = math.exp(log_paid(room, near[:count], begin, end, step, x, y + e, -1.0) - whole)
            below = math.exp(log_paid(room, near[:count], begin, end, step, x, y - e, -1.0) - whole)
            slope[0] = rest * slope[0] + (right - left) / (2.0 * e)
            slope[1] = rest * slope[1] + (above - below) / (2.0 * e)
        value = whole
    return value


@kernel
def _steep(d, e, square):  # type: ignore[no-untyped-def]
    """Derivative by d of the logarithm of `missed` [1/m]."""
    if d <= 0.0 or e <= 0.0:
        return 0.0
    z = 2.0 * d * e / square
    return 2.0 * e / square / math.expm1(z) if z < 40.0 else 0.0


@kernel
def _axis(weight, steep, first, h, x, low, high, step):  # type: ignore[no-untyped-def]
    """What x takes from points along an axis, as `taps_along`, and the derivative of its logarithm [1/m]."""
    square = step.deviation * step.deviation
    scale = h / (step.deviation * math.sqrt(2.0 * math.pi))
    for a in range(len(weight)):
        y = first + a * h
        weight[a] = scale * math.exp(-0.5 * (y - x) ** 2 / square)
        weight[a] *= missed(x - low, y - low, step) * missed(high - x, high - y, step)
        steep[a] = (y - x) / square + _steep(x - low, y - low, square) - _steep(high - x, high - y, square)
