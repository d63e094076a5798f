"""A mass that is pushed: the exact optimum between two states with free duration (Webb and van den Berg 2013).

Among motions from (p0, v0) to (p1, v1) that take T seconds the one of least integral of q + (r/2) |a|^2 has an
acceleration linear in time. With D = p1 - p0 its cost is J(T) = q T + A / T^3 + B / T^2 + C / T, where

    fixed v1  A = 6 r |D|^2      B = -6 r D.(v0 + v1)   C = 2 r (|v0|^2 + v0.v1 + |v1|^2)
    free v1   A = (3/2) r |D|^2  B = -3 r D.v0          C = (3/2) r |v0|^2

A minimum is where q T^4 - C T^2 - 2 B T - 3 A goes from negative to positive. Of two minima either may be the better
one, and the wrong one can cost many times the optimum. A free v1 is written as not a number.

The paths are cubic, p(s) = p0 + v0 s + c0 s^2 / 2 + c1 s^3 / 6: in a time tau they get no farther than |v| tau +
|a|max tau^2 / 2. That bound is what certificates march by.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.geometry.space import BLOCKED, FREE, LEAST_STEP, UNSURE, SpaceKernels
from pirrht.jit.jit import as_tuple, inlined, kernel
from pirrht.problem import Problem
from pirrht.steering.motion import MotionKernels, MotionKind, Surroundings, Trajectory
from pirrht.steering.steering import CompiledSteering
from pirrht.steering.tuning import TUNING
from pirrht.systems.double_integrator import best_duration
from pirrht.systems.dynamics import check_positive
from pirrht.topology.signature import SignatureKernels

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


# A path in kernels is 8 numbers: p0 [m], v0 [m/s], c0 [m/s^2], c1 [m/s^3], x before y.
_numbers = inlined(lambda motions, i: as_tuple(motions.path[i], 8))


@inlined
def place(c, s):  # type: ignore[no-untyped-def]
    """Return the position (x, y) [m] after s [s]."""
    x = c[0] + s * (c[2] + s * (0.5 * c[4] + s * c[6] / 6.0))
    return x, c[1] + s * (c[3] + s * (0.5 * c[5] + s * c[7] / 6.0))


@inlined
def speeds(c, s):  # type: ignore[no-untyped-def]
    """Return the velocity (vx, vy) [m/s] after s [s]."""
    return c[2] + s * (c[4] + 0.5 * s * c[6]), c[3] + s * (c[5] + 0.5 * s * c[7])


@inlined
def stride(c, s, most, free):  # type: ignore[no-untyped-def]
    """Return a time [s] in which the path from s [s] surely gets no farther than `free` [m], by its acceleration."""
    vx, vy = speeds(c, s)
    v = math.sqrt(vx * vx + vy * vy)
    return 2.0 * free / max(v + math.sqrt(v * v + 2.0 * most * free), 1e-300)


@inlined
def _greatest_force(c, duration):  # type: ignore[no-untyped-def]
    """Return the greatest magnitude of the acceleration [m/s^2]: it is linear in time, so that is at an end."""
    return max(math.hypot(c[4], c[5]), math.hypot(c[4] + duration * c[6], c[5] + duration * c[7]))


class Cubics(NamedTuple):
    """k motions of a mass with accelerations c0 + c1 s, one row each."""

    path: Array  # (k, 8): p0 [m], v0 [m/s], c0 [m/s^2], c1 [m/s^3]
    duration: Array  # (k,) [s]
    cost: Array  # (k,) integral of q + (r/2) |a|^2 [cost]
    tails: Array  # (k, 4) first states
    heads: Array  # (k, 4) last states; a free velocity is not a number
    rates: Array  # (k, 2): q [cost/s] and r

    def points(self, spacing: float) -> list[Array]:
        """Each motion as a polyline (l, 2) [m] with points at most `spacing` [m] apart."""
        return [
            np.column_stack(place(c, np.linspace(0.0, T, 2 + int(v * T / spacing))))
            for c, T, v in map(self.curve, range(len(self.cost)))
        ]

    def curve(self, i: int) -> tuple[tuple[float, ...], float, float]:
        """Numbers of motion i, its duration [s], and a speed that it nowhere exceeds [m/s]."""
        c = tuple(self.path[i].tolist())
        T = float(self.duration[i])

        return c, T, math.hypot(c[2], c[3]) + T * float(_greatest_force(c, T))

    def length(self) -> Array:
        """Lengths of the paths (k,) [m], by Gauss-Legendre quadrature."""
        times = 0.5 * self.duration[:, None] * (NODES + 1.0)
        first, linear, square = (self.path[:, k : k + 2, None] for k in (2, 4, 6))
        vx, vy = np.moveaxis(first + times[:, None] * (linear + 0.5 * times[:, None] * square), 1, 0)
        return np.asarray(0.5 * self.duration * (np.hypot(vx, vy) @ WEIGHTS))


@kernel
def _entry(motions, i, around):  # type: ignore[no-untyped-def]
    """March to the disc: by strides that certainly stay out of it."""
    c = _numbers(motions, i)
    duration = motions.duration[i]
    s = 0.0

    most = _greatest_force(c, duration)
    while True:
        x, y = place(c, s)
        gap = math.hypot(x - around.goal[0], y - around.goal[1]) - around.goal_radius
        if gap <= 1e-7:  # [m]: rounding of a march to the rim
            return s
        if s >= duration:
            return np.inf
        s = min(s + stride(c, s, most, gap), duration)


@inlined
def _cut(motions, i, s):  # type: ignore[no-untyped-def]
    """End motion i after s [s]; its cost is the integral of q + (r/2) |c0 + c1 s|^2."""
    c = _numbers(motions, i)
    q = motions.rates[i, 0]
    r = motions.rates[i, 1]

    still = c[4] * c[4] + c[5] * c[5]
    cross = c[4] * c[6] + c[5] * c[7]
    square = still + s * (cross + s * (c[6] * c[6] + c[7] * c[7]) / 3.0)
    motions.duration[i], motions.cost[i] = s, s * (q + 0.5 * r * square)


@inlined
def _between(motions, i, share, out):  # type: ignore[no-untyped-def]
    c = _numbers(motions, i)
    s = share * motions.duration[i]
    out[0], out[1] = place(c, s)
    out[2], out[3] = speeds(c, s)
    return True


def _free(motions: Cubics, i: int, space: FreeSpace) -> bool:
    """Bisect by FCL's clearances, at a speed that the path nowhere exceeds."""
    c, T, v = motions.curve(i)
    v = max(v, 1e-9)
    return space.collision.bisect_free(lambda length: np.array(place(c, length / v)), T * v)


def _trajectory(steering: Any, path: Cubics) -> Trajectory:
    """Take mean accelerations of short pieces of time."""
    counts = np.maximum(1, np.ceil(path.duration / TUNING.control_piece)).astype(int)
    rows = np.repeat(path.path, counts, axis=0)
    durations = np.repeat(path.duration / counts, counts)
    middles = (np.concatenate([np.arange(count) for count in counts]) + 0.5) * durations
    return Trajectory(
        controls=rows[:, 4:6] + middles[:, None] * rows[:, 6:8], durations=durations, path=path,
        cost=float(path.cost.sum()), length=float(path.length().sum()),
    )  # fmt: skip


_most = inlined(lambda motions: 3)  # a cubic path crosses a straight cut no more often


@cache
def _certify_for(space: SpaceKernels) -> Any:
    """Build the kernel that certifies motions, by kernels of a footprint."""
    clearance, certify_place = space.place, space.certify_place

    @kernel
    def certify(motions, i, around, patient):  # type: ignore[no-untyped-def]
        """Cover a path by certified clearances at any heading."""
        c = _numbers(motions, i)
        duration = motions.duration[i]
        s = 0.0
        verdict = FREE

        most = _greatest_force(c, duration)
        while True:
            at = place(c, s)
            free = clearance(around.static, at)
            if free < LEAST_STEP:
                if certify_place(around.static, at) == BLOCKED:
                    return BLOCKED
                if not patient:
                    return UNSURE
                verdict, free = UNSURE, 0.5 * around.static.spacing
            if s >= duration:
                return verdict
            s = min(s + stride(c, s, most, free), duration)

    return certify


@cache
def _pairs_of(space: SpaceKernels, classes: SignatureKernels) -> Any:
    """Build the kernel that counts the turns of motions, by kernels of a footprint and of a signature."""
    clearance, crossings = space.place, classes.crossings

    @kernel
    def pairs(motions, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
        """Append pairs of a polyline with the path in free discs about its corners, and so with the path's turns."""
        c = _numbers(motions, i)
        duration = motions.duration[i]
        most, s = _greatest_force(c, duration), 0.0
        ax, ay = place(c, 0.0)
        while s < duration:
            s = min(s + stride(c, s, most, max(clearance(around.static, (ax, ay)), TUNING.shortest_side)), duration)
            bx, by = place(c, s)
            if s >= duration and not to_goal:  # the state itself: its side of a cut must not depend on rounding
                bx = motions.heads[i, 0]
                by = motions.heads[i, 1]
            count = crossings(around.classes, (ax, ay, 0.0), (bx, by, 0.0), False, marker, turn, count)
            ax, ay = bx, by
        return count

    return pairs


def _kernels(around: Surroundings) -> MotionKernels:
    pairs = _pairs_of(around.static.kernels, around.classes.kernels)
    return MotionKernels(_entry, _cut, _certify_for(around.static.kernels), pairs, _most, _between)


CUBICS = MotionKind(_kernels, _free, _trajectory)


@kernel
def optimum(tail, head, q, r):  # type: ignore[no-untyped-def]
    """Duration [s] and cost of the optimum between states (4,), as tuples; infinite from a free velocity."""
    if math.isnan(tail[2]):
        return np.inf, np.inf

    dx = head[0] - tail[0]
    dy = head[1] - tail[1]
    ux, uy = tail[2], tail[3]

    square = dx * dx + dy * dy
    before = ux * ux + uy * uy

    if math.isnan(head[2]):
        if square == 0.0:
            return 0.0, 0.0
        return best_duration(q, 1.5 * r * square, -3.0 * r * (dx * ux + dy * uy), 1.5 * r * before)
    wx, wy = head[2], head[3]
    if square == 0.0 and ux == wx and uy == wy:
        return 0.0, 0.0
    along = dx * (ux + wx) + dy * (uy + wy)
    mixed = before + ux * wx + uy * wy + wx * wx + wy * wy
    return best_duration(q, 6.0 * r * square, -6.0 * r * along, 2.0 * r * mixed)


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    """Cost of the optimum; a change of velocity alone costs sqrt(2 q r) |dv| at least."""
    q, r = numbers
    dv = math.hypot(head[2] - tail[2], head[3] - tail[3])
    return np.inf if math.sqrt(2.0 * q * r) * dv > limit else optimum(tail, head, q, r)[1]


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by one motion; the numbers are q and r."""
    k, (q, r) = tails.shape[0], numbers

    found = Cubics(np.empty((k, 8)), np.empty(k), np.empty(k), tails, heads, np.empty((k, 2)))
    path = found.path
    for i in range(k):
        T, found.cost[i] = optimum(as_tuple(tails[i], 4), as_tuple(heads[i], 4), q, r)
        found.duration[i] = T
        found.rates[i] = (q, r)
        per = 1.0 / T if T > 0.0 else 0.0
        for d in range(2):
            mean = (heads[i, d] - tails[i, d]) * per
            before = tails[i, 2 + d]
            after = heads[i, 2 + d]

            after = 0.5 * (3.0 * mean - before) if math.isnan(after) else after  # the best end of a free velocity
            path[i, d], path[i, 2 + d] = tails[i, d], before
            path[i, 4 + d] = (6.0 * mean - 4.0 * before - 2.0 * after) * per
            path[i, 6 + d] = 6.0 * (before + after - 2.0 * mean) * per * per
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class MassSteering(CompiledSteering):
    """The double integrator's optimum for the integral of q + (r/2) |a|^2 (Webb and van den Berg 2013).

    The root is the goal point with a free velocity, not a number. OptionError: one of the numbers is not positive.
    """

    q: float = 1.0  # cost rate [cost/s]
    r: float = 2.0  # weight of the acceleration [cost s^3/m^2]
    top: float = 2.0  # speeds up to this are drawn [m/s]

    n = 4
    motion = CUBICS
    cost = _cost
    optimum = _connect

    def __post_init__(self) -> None:
        check_positive(self, "q", "r", "top")

    @classmethod
    def of(cls, problem: Problem) -> "MassSteering":
        """Take the optimum of a mass that controls accelerate, q constant, R a multiple of I; else OptionError."""
        d = problem.dynamics
        if d.control_kind != "acceleration":
            raise OptionError(f"cubic motions steer a DoubleIntegrator, not {type(d).__name__}; bring a Steering")
        R = problem.control_cost(np.zeros(4))
        if not np.allclose(R, R[0, 0] * np.eye(2)):
            raise OptionError("cubic motions are optimal only for R a multiple of the identity; bring a Steering")
        r = float(R[0, 0])
        across = float(np.hypot(*(problem.scene.upper - problem.scene.lower)))
        return cls(q=problem.least_rate, r=r, top=1.5 * across / (4.5 * r * across**2 / problem.least_rate) ** 0.25)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return q [cost/s] and r [cost s^3/m^2]."""
        return self.q, self.r

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A state (4,): uniform in the workspace, in direction and in speed up to `top`."""
        x, y = rng.uniform(scene.lower, scene.upper)
        angle = rng.uniform(-np.pi, np.pi)
        speed = self.top * rng.random()

        return np.array([x, y, speed * np.cos(angle), speed * np.sin(angle)])

    def at_rest(self, x: Array) -> Array:
        """Return that place (4,) with no velocity."""
        return np.array([x[0], x[1], 0.0, 0.0])

    def states_along(self, path: Array, scene: Scene) -> Array:
        """Every point (k, 3) driven through both ways, slower and faster, (4 k, 4)."""
        turned = np.column_stack([np.cos(path[:, 2]), np.sin(path[:, 2])])
        speeds = [sign * share * self.top for share in TUNING.passage_speeds for sign in (1.0, -1.0)]
        return np.stack([np.hstack([path[:, :2], speed * turned]) for speed in speeds], axis=1).reshape(-1, 4)

    def roots(self, goal: Array) -> Array:
        """The goal point (2,) [m] at any velocity, (1, 4)."""
        return np.array([[*goal, np.nan, np.nan]])
