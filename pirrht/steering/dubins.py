"""Connect poses by Dubins curves: the shortest paths of a car that drives forwards and turns no tighter than a radius.

Six words suffice: two arcs with a straight piece between, LSL, RSR, LSR, RSL, and three arcs, LRL, RLR (Dubins, 1957).
The centres of the outer circles fix the straight piece or the middle circle.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.arcs import TWO_PI, Curves
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.vectors import copy_row
from pirrht.problem import Problem
from pirrht.steering.steering import CompiledSteering, Steering
from pirrht.steering.tuning import TUNING
from pirrht.systems.dynamics import check_positive

EPS = 1e-10  # rounding, in radians or turning radii: an arc this close to a whole circle is none


@inlined
def _turn(angle):  # type: ignore[no-untyped-def]
    """Wrap an angle to [0, 2 pi), 0 where rounding left a whole turn."""
    angle -= TWO_PI * math.floor(angle / TWO_PI)
    return 0.0 if angle > TWO_PI - EPS else angle


@kernel
def _same_turns(s, gap, a, b, across, ahead, limit):  # type: ignore[no-untyped-def]
    """Words whose first and last arc turn to one side s, 1 left or -1 right: (length, whether CCC, t, p, q).

    All in turning radii: the gap (2) leads from state to state, a and b are their headings, across = sin b - sin a and
    ahead = cos b - cos a; t, p, q are the pieces. Words certainly longer than `limit` may be left out.
    """
    vx = gap[0] - s * across
    vy = gap[1] + s * ahead
    d = math.sqrt(vx * vx + vy * vy)
    if d > limit and (d >= 4.0 or limit < np.pi):
        return np.inf, False, 0.0, 0.0, 0.0
    phi = math.atan2(vy, vx) if d > EPS else a
    first = s * (phi - a)
    last = s * (b - phi)
    t = _turn(first)
    q = _turn(last)
    length = t + d + q
    if d >= 4.0:
        return length, False, t, d, q
    # The centres of three circles in a row make an isosceles triangle; the middle arc is the long one.
    corner = math.acos(0.25 * d)
    p = np.pi + 2.0 * corner
    t3 = _turn(first + corner + 0.5 * np.pi)
    q3 = _turn(last + corner + 0.5 * np.pi)

    if t3 + p + q3 < length:
        return t3 + p + q3, True, t3, p, q3
    return length, False, t, d, q


@kernel
def _opposite_turns(s, gap, a, b, across, ahead, limit):  # type: ignore[no-untyped-def]
    """Word that begins turning to side s, goes straight and ends turning to the other: (length, t, p, q).

    Arguments as of `_same_turns`, but across = sin b + sin a and ahead = cos b + cos a.
    """
    vx = gap[0] + s * across
    vy = gap[1] - s * ahead
    square = vx * vx + vy * vy - 4.0
    if square < -EPS or square > limit * limit:
        return np.inf, 0.0, 0.0, 0.0
    p = math.sqrt(max(0.0, square))
    psi = math.atan2(vy, vx) + s * math.atan2(2.0, p)
    t = _turn(s * (psi - a))
    q = _turn(s * (psi - b))

    return t + p + q, t, p, q


@kernel
def shortest(tail, head, radius, limit):  # type: ignore[no-untyped-def]
    """Find the shortest curve between two states (3,), below `limit` [m]: length, curvatures (3) [1/m], pieces (3)."""
    gap = ((head[0] - tail[0]) / radius, (head[1] - tail[1]) / radius)
    a = tail[2]
    b = head[2]

    sa = math.sin(a)
    ca = math.cos(a)
    sb = math.sin(b)
    cb = math.cos(b)

    most = limit / radius

    best = most
    bends = (0.0, 0.0, 0.0)
    pieces = (0.0, 0.0, 0.0)

    for s in (1.0, -1.0):
        total, arcs, t, p, q = _same_turns(s, gap, a, b, sb - sa, cb - ca, best)
        if total < best:
            best = total
            bends = (s, -s if arcs else 0.0, s)
            pieces = (t, p, q)
        total, t, p, q = _opposite_turns(s, gap, a, b, sb + sa, cb + ca, best)
        if total < best:
            best = total
            bends = (s, 0.0, -s)
            pieces = (t, p, q)
    return best * radius if best < most else np.inf, bends, pieces


@inlined
def sideways(x, move, step, numbers, out):  # type: ignore[no-untyped-def]
    """Write a pose (3,) after a step to the side [turning radii], in heading [rad], or both, to out (3,)."""
    move += move >= 4
    side = (move // 3 - 1) * step * numbers[0]
    turn = (move % 3 - 1) * step

    out[0] = x[0] - side * math.sin(x[2])
    out[1] = x[1] + side * math.cos(x[2])
    out[2] = x[2] + turn


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    """Cost of the shortest curve; infinity if it is not below `limit`. The chord is a lower bound."""
    gap = math.sqrt((head[0] - tail[0]) ** 2 + (head[1] - tail[1]) ** 2)
    most = limit / numbers[1]
    return np.inf if gap - 4.0 * EPS * numbers[0] > most else numbers[1] * shortest(tail, head, numbers[0], most)[0]


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by three pieces; the numbers are the turning radius and the cost per meter."""
    k = tails.shape[0]
    radius = numbers[0]

    start = np.empty((k, 3))
    curvature = np.empty((k, 3))
    length = np.empty((k, 3))
    cost = np.empty(k)

    for i in range(k):
        copy_row(tails[i], start[i])
        _, bends, pieces = shortest(tails[i], heads[i], radius, np.inf)
        for p in range(3):
            curvature[i, p] = bends[p] / radius
            length[i, p] = pieces[p] * radius
        cost[i] = numbers[1] * (length[i, 0] + length[i, 1] + length[i, 2])
    return Curves(start, curvature, length, cost, tails, heads)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dubins(CompiledSteering):
    """The unicycle's time optimum, q = 1, R = 0, |u| <= 1, of bounded curvature; OptionError unless V, rho > 0."""

    V: float = 1.0  # speed [m/s]
    rho: float = 1.0  # dtheta/dt = u / rho, so the turning radius [m] is V rho
    tightness: float = 1.0  # by which curves turn tighter: |u| reaches so much

    n = 3
    heading = 2
    symmetric = False
    cost = _cost
    optimum = _connect
    shift = sideways
    moves = 8

    def __post_init__(self) -> None:
        check_positive(self, "V", "rho", "tightness")

    @classmethod
    def of(cls, problem: Problem) -> "Dubins":
        """Take the curves of a car at constant speed (the paper's second example); OptionError for another dynamics."""
        car: Any = problem.dynamics
        if car.control_kind != "turn rate":
            raise OptionError(f"Dubins curves steer a Unicycle, not {type(car).__name__}; bring a Steering")
        return cls(V=car.V, rho=car.rho)

    radius = property(lambda self: self.V * self.rho / self.tightness, doc="Least turning radius [m].")
    speed = property(lambda self: self.V, doc="The constant V [m/s].")
    cost_per_meter = property(lambda self: 1.0 / self.V, doc="Time per meter: cost is time [s/m].")

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the turning radius [m] and the cost per meter [cost/m]."""
        return self.radius, self.cost_per_meter

    def controls(self, heading: Array, curvature: Array) -> Array:
        """u = curvature V rho, (l, 1), at most `tightness`, for heading (l,) [rad] and curvature (l,) [1/m]."""
        return np.asarray(np.clip(curvature * self.V * self.rho, -self.tightness, self.tightness)[:, None])

    @property
    def alternatives(self) -> tuple[Steering, ...]:
        """Curves that turn tighter, as the system can at a price: often the only ones that can turn one way."""
        tighter = TUNING.tightness if self.tightness == 1.0 else ()
        return tuple(replace(self, tightness=one) for one in tighter)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A state (3,), uniform in the workspace [m] and in heading [rad]."""
        return np.append(rng.uniform(scene.lower, scene.upper), rng.uniform(-np.pi, np.pi))

    def states_along(self, path: Array, scene: Scene) -> Array:
        """Every pose (k, 3) and its reverse, (2 k, 3), headings in [-pi, pi)."""
        states = np.repeat(path, 2, axis=0)
        states[1::2, 2] += np.pi
        states[:, 2] -= TWO_PI * np.floor((states[:, 2] + np.pi) / TWO_PI)
        return states

    def roots(self, goal: Array) -> Array:
        """Spread headings evenly at the goal point (2,) [m], (k, 3)."""
        headings = np.linspace(-np.pi, np.pi, TUNING.root_headings, endpoint=False)
        return np.column_stack([np.broadcast_to(goal, (len(headings), 2)), headings])
