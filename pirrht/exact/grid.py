"""Define domain, frame and interpolation of the grids, and the numbers that tune them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.geometry.space import clearances_of
from pirrht.jit.jit import inlined, kernel
from pirrht.problem import Problem


class GridTuning(NamedTuple):
    """Tuning of all grids: accuracy against time and memory. Errors named here were measured on closed forms."""

    # Every grid
    most_points: int = 1_000_000  # grid points in the plane: solved for in about half a minute
    fcl_band: float = 0.03  # FCL replaces the clearance field where that has less [m]; the field interpolates
    # Stationary point (`point`)
    point_lengths: float = 1.0  # default spacing in decay lengths 1/k of psi: v to 0.5 %, u to 2 %
    point_radii: float = 0.2  # and at most this share of the robot's radius, so that gaps are resolved
    hug: float = 0.1  # points closer to a wall than this share of the spacing get arms from further off
    speaks: float = 2.5  # a place has the expansion of a free grid point at most so many cells away
    # A point in space (`ball`)
    ball_points: int = 5_000_000  # grid points in space: two minutes
    ball_lengths: float = 0.5  # default spacing in decay lengths 1/k of psi
    ball_arm: float = 1e-3  # share of the spacing below which an arm is as long as that
    ball_halvings: int = 24  # of an arm, to find the wall that ends it
    ball_settled: float = 1e-6  # change of log psi in a sweep at which iteration ends [nats]
    ball_sweeps: int = 1000  # sweeps of the iteration at most
    # Gaussian steps (`boundaries`, `discrete_point`, `moving_point`)
    tile: int = 16  # points in a row that share one exponent, and along the side of a tile of boundaries: cache
    cutoff: float = 6.0  # a step ends so many deviations beyond the mean that the optimal law gives it
    directions: int = 6  # walls in different directions that one place has
    curvature_arm: float = 0.2  # arm of second differences of a clearance, as a share of the robot's radius
    kernel_sum: float = 1e-6  # shortfalls of a sum below this are rounding
    difference: float = 1e-3  # arm of differences for the gradient, as a share of a step's deviation
    underflow: float = 1e-250  # sums below this are taken again with an exponent of their own
    # A point with a step (`discrete_point`)
    discrete_points: float = 3.0  # default points per deviation of a step: the sum is exact to 1e-38
    cell_parts: int = 8  # a cell that a boundary cuts is integrated over so many parts each way
    discrete_settled: float = 1e-7  # change of log psi in a step at which iteration ends [nats]
    discrete_steps: int = 20_000  # steps of the iteration at most
    # A point among moving obstacles (`moving_point`)
    step_radii: float = 0.28  # deviation of a step at most, as a share of the robot's radius,
    step_lengths: float = 1.1  # of the decay length 1/k of psi,
    step_mean: float = 0.33  # and of their geometric mean: v to 0.1 % with all three
    moving_points: float = 1.25  # points per deviation of a step: the sum is exact to 4e-14
    shortest_step: float = 0.5  # steps end at rows of motions unless they are shorter than this share of the longest
    last_steps: int = 5  # steps after the last motion, so that each time before has a next frame
    next_frame: float = 0.5  # psi is evaluated from a frame at least this share of a step later
    frame_bytes: float = 3e8  # memory of frames, which are thinned to fit
    thinned: int = 8  # steps between frames at most: longer steps would cost accuracy
    common_period: float = 200.0  # least common multiple of repeated motions at most [s]
    moving_settled: float = 1e-3  # change of log psi from period to period at which iteration ends [nats]
    moving_periods: int = 60  # periods of the iteration at most
    # A car (`car`)
    ray: float = 2.0  # length of a ray in spacings: longer rays interpolate less often and resolve walls less
    sideways_points: float = 2.0  # points across the deviation of a car after a second, at least
    car_radii: float = 1.0 / 6.0  # default spacing as a share of the robot's radius, at most
    headings: int = 120  # headings at least
    car_points: int = 8_000_000  # grid points of positions and headings: about two minutes
    car_cutoff: float = 6.5  # smoothing ends so many deviations beyond
    fastest_turn: float = 4.0  # what this turn rate reaches in a step [rad/s]
    ray_checks: int = 4  # poses along a ray of a footprint with a heading that exact distances judge
    turn_halvings: int = 6  # of the angle between two headings in which a turn meets a wall
    worst_path: float = 10.0  # v is cut off at the cost of driving so many times around half the workspace
    car_settled: float = 1e-4  # change of v in a sweep at which iteration ends [cost]
    car_sweeps: int = 500  # sweeps of the iteration at most
    # Paths under the optimal law (`optimal`)
    path_step: float = 0.01  # step of drawn paths at most [s], and
    moving_path_step: float = 0.005  # among moving obstacles, where gaps close while a law is held [s]
    wall_steps: float = 0.15  # and its deviation as a share of the clearance, since the law grows as 1/clearance
    shortest_path_step: float = 1e-7  # but no step is shorter [s]
    candidates: int = 64  # normal ends that a step of the discrete problem is resampled from
    path_steps: int = 100_000  # steps of a path at most
    drawn: float = 0.5  # a recording draws the control now over this time [s]


TUNING = GridTuning()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Domain:
    """The workspace, the disc or ball on which psi is one, and the clearance from walls, in d dimensions."""

    lower: Array  # (d,) corner of the workspace [m]
    upper: Array  # (d,) the opposite one [m]
    goal: Goal
    clearance: Callable[[Array], Array]  # of centres (k, d), (k,) [m]; at most 0 where the robot may not be

    @classmethod
    def of(cls, space: FreeSpace) -> "Domain":
        """Take the domain of a scene; its clearance is the field's with the border, near obstacles FCL's [m]."""
        of_field = clearances_of(space.field.kernels)

        def at(points: Array) -> Array:
            out = np.empty(len(points))
            of_field(space.field, np.ascontiguousarray(points), out)
            close = np.flatnonzero(out < TUNING.fcl_band)
            out[close] = space.collision.clearance(points[close])
            return out

        scene = space.scene
        return cls(lower=scene.lower.astype(float), upper=scene.upper.astype(float), goal=scene.goal, clearance=at)


class Equation(NamedTuple):
    """Numbers of psi's equation for a point."""

    b: float  # noise [m/sqrt(s)]
    rate: float  # q/lambda [nats/s]
    wall: float  # phi/lambda [nats]; may be infinite
    wavenumber: float  # k of `Laplace psi = k^2 psi` where nothing moves [1/m]

    @classmethod
    def of(cls, problem: Problem) -> "Equation":
        """Take the numbers of a point with constant noise and constant q."""
        assert not callable(problem.q)
        b = float(problem.dynamics.B_c(np.zeros(problem.dynamics.n))[0, 0])
        rate = problem.q / problem.temperature

        return cls(b, rate, problem.phi / problem.temperature, math.sqrt(2.0 * rate) / b)


class Frame(NamedTuple):
    """Frame of a grid's points, and the goal's disc."""

    x0: float  # position of point (0, 0) [m]
    y0: float  # [m]
    spacing: float  # h [m]
    goal_x: float  # centre of the goal's disc [m]
    goal_y: float  # [m]
    radius: float  # of the disc [m]


def frame_at(corner: Array, spacing: float, goal: Goal) -> Frame:
    """Place a grid whose point (0, 0) is at a corner (2,) [m], spacing in [m]."""
    x0, y0 = corner.tolist()
    goal_x, goal_y = goal.center.tolist()

    return Frame(x0, y0, spacing, float(goal_x), float(goal_y), float(goal.radius))


def largest_change(now: Array, before: Array) -> float:
    """Largest change of log psi (nx, ny) [nats]; infinite where one is minus infinity and the other is not."""
    finite = np.isfinite(now)
    if not np.array_equal(finite, np.isfinite(before)):
        return math.inf
    return float(np.max(np.abs(now[finite] - before[finite]), initial=0.0))


@inlined
def to_rim(frame, x, y):  # type: ignore[no-untyped-def]
    """Distance of (x, y) from the goal's disc [m], negative in it."""
    return math.sqrt((x - frame.goal_x) ** 2 + (y - frame.goal_y) ** 2) - frame.radius


@inlined
def place_at(frame, i, j):  # type: ignore[no-untyped-def]
    """Position (x, y) of a grid point, or of a place between some [m]."""
    return frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing


@inlined
def in_goal(frame, x):  # type: ignore[no-untyped-def]
    """Tell whether the position of x (n,) [m] is in the goal's disc."""
    return (x[0] - frame.goal_x) ** 2 + (x[1] - frame.goal_y) ** 2 <= frame.radius * frame.radius


def affordable(scene: Scene, spacing: float, reason: str, remedy: str = "") -> float:
    """Return a spacing [m]; OptionError with reason and remedy if the workspace has too many points at it."""
    size = (scene.upper - scene.lower) / spacing
    most = TUNING.most_points if len(size) == 2 else TUNING.ball_points
    if np.prod(size) > most:
        needed = " x ".join(f"{count:.0f}" for count in size)
        raise OptionError(
            f"{reason}, so the grid needs {needed} points and can have {most:,}; choose more noise{remedy} or a "
            "smaller workspace"
        )
    return spacing


Progress = Callable[[float], None]  # takes the share that is done, from 0 to 1


def ignore_progress(share: float) -> None:
    """Ignore progress."""


class Settling:
    """Reports rounds until changes are small: how far they have fallen towards the least change, on a log scale."""

    def __init__(self, progress: Progress, least: float) -> None:
        self._progress, self._least = progress, least
        self._first = self._share = 0.0  # greatest change and share so far

    def note(self, change: float) -> None:
        """Take note of the change by a round; infinite: nothing is known yet."""
        if self._least < change < math.inf:
            self._first = max(self._first, change)
            self._share = max(self._share, math.log(self._first / change) / math.log(self._first / self._least))
        self._progress(self._share)


@inlined
def cubic(t):  # type: ignore[no-untyped-def]
    """Values at t [spacings] of cubic polynomials, each 1 at one of -1, 0, 1 and 2 and 0 at the others."""
    a = t * (t - 1.0)
    b = (t + 1.0) * (t - 2.0)

    return a * (2.0 - t) / 6.0, b * (t - 1.0) / 2.0, -b * t / 2.0, a * (t + 1.0) / 6.0


@inlined
def slopes(t):  # type: ignore[no-untyped-def]
    """Derivatives of the polynomials of `cubic` at t [1/spacing]."""
    s = 3.0 * t * t
    return (6.0 * t - s - 2.0) / 6.0, (s - 4.0 * t - 1.0) / 2.0, (2.0 + 2.0 * t - s) / 2.0, (s - 1.0) / 6.0


@kernel
def interpolate(values, frame, x, slope):  # type: ignore[no-untyped-def]
    """Interpolate `values` (nx, ny, nt), of headings 2 pi k / nt, at x by cubics; the gradient goes to slope (n,)."""
    nx, ny, nt = values.shape
    fx = (x[0] - frame.x0) / frame.spacing
    fy = (x[1] - frame.y0) / frame.spacing
    ft = x[2] * nt / (2.0 * math.pi) if nt > 1 else 0.0

    i = min(max(int(fx), 0), nx - 2)
    j = min(max(int(fy), 0), ny - 2)
    k = math.floor(ft)

    px = cubic(fx - i)
    py = cubic(fy - j)
    pt = cubic(ft - k)

    dx = slopes(fx - i)
    dy = slopes(fy - j)
    dt = slopes(ft - k)

    total = 0.0
    along_x = 0.0
    along_y = 0.0
    along_t = 0.0

    for a in range(4):
        s = min(max(i + a - 1, 0), nx - 1)
        for b in range(4):
            value, turning, t = 0.0, 0.0, min(max(j + b - 1, 0), ny - 1)
            for c in range(4):
                entry = values[s, t, (k + c - 1) % nt]
                value += pt[c] * entry
                turning += dt[c] * entry
            total += px[a] * py[b] * value
            along_x += dx[a] * py[b] * value
            along_y += px[a] * dy[b] * value
            along_t += px[a] * py[b] * turning
    slope[:2] = (along_x / frame.spacing, along_y / frame.spacing)

    if nt > 1:
        slope[2] = along_t * nt / (2.0 * math.pi)
    return total
