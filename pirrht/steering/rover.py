"""Steer a rover: arcs and straight pieces of least cost, whose radius and speed the cost itself chooses.

A turn costs sqrt(2 q (r_v radius^2 + r_w)) per radian, least on the spot; wider ones save the more on the way the
farther it is: sqrt(r_w / r_v) is the scale. Of Dubins' words with one of a few radii the cheapest is taken, at the
smallest of which the rover all but turns on the spot. For r_w / r_v = 0.25 m^2 that is within 0.3 % of the best of
twelve radii between random headings 2 m apart or more, and within 2 % at 0.6 m.

Curves are driven ahead. Between random headings reversing would pay in half of all pairs, saving 7 % 8 m apart and 31 %
at 0.3 m, but passages have headings of their own: facing along them it saves nothing, facing away pi sqrt(2 q r_w)
once. So only a run's first proposals consider paths driven backwards as a whole (`backwards`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.arcs import TWO_PI, Curves
from pirrht.jit.jit import kernel
from pirrht.jit.vectors import copy_row
from pirrht.problem import Problem
from pirrht.steering.along_arcs import PricedArcs, price_of, priced, priced_arcs
from pirrht.steering.dubins import EPS, PoseSteering, _ends, _opposite_turns, _same_turns
from pirrht.steering.motion import Motion
from pirrht.steering.steering import Compiled, insert, rows
from pirrht.steering.trajectory import Trajectory
from pirrht.systems.dynamics import check_positive
from pirrht.systems.rover import Rover

RADII = (0.1, 0.3, 0.7, 1.4)  # times sqrt(r_w / r_v)


@kernel
def _cheapest(tail, head, numbers, limit, curvature, length):  # type: ignore[no-untyped-def]
    """Cost of the cheapest word between states (3,); infinity if it is not below `limit`.

    Numbers are 2 q r_v, 2 q r_w and the radii; curvature (3,) [1/m] and length (3,) [m] are written unless empty.
    """
    best, straight = limit, math.sqrt(numbers[0])
    write = curvature.shape[0] > 0
    for k in range(2, len(numbers)):
        radius = numbers[k]
        ends, sa, ca, sb, cb = _ends(tail, head, radius)
        arc, line = radius * price_of(numbers[0], numbers[1], 1.0 / radius), radius * straight
        for s in (1.0, -1.0):
            for opposite in (False, True):
                most = best / line  # no word is cheaper than as many meters straight ahead
                if opposite:
                    total, t, p, q = _opposite_turns(s, ends, sb + sa, cb + ca, most)
                    arcs = False
                else:
                    total, arcs, t, p, q = _same_turns(s, ends, sb - sa, cb - ca, most)
                cost = (t + q) * arc + p * (arc if arcs else line)
                if total < np.inf and cost < best:
                    best = cost
                    if write:
                        length[0], length[1], length[2] = t * radius, p * radius, q * radius
                        curvature[0], curvature[2] = s / radius, (-s if opposite else s) / radius
                        curvature[1] = -s / radius if arcs else 0.0
    return best if best < limit else np.inf


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Three pieces each; the numbers are 2 q r_v, 2 q r_w and the radii."""
    k = tails.shape[0]
    start, curvature, length, cost = np.empty((k, 3)), np.zeros((k, 3)), np.zeros((k, 3)), np.empty(k)
    price = np.empty((k, 3))
    for i in range(k):
        copy_row(tails[i], start[i])
        cost[i] = _cheapest(tails[i], heads[i], numbers, np.inf, curvature[i], length[i])
        for p in range(3):
            price[i, p] = price_of(numbers[0], numbers[1], curvature[i, p])
    return PricedArcs(start, curvature, length, price, cost, heads)


@kernel
def _nearest(states, x, numbers, forward, chosen, cost):  # type: ignore[no-untyped-def]
    """Fill `chosen` with the states of least cost, cheapest first; of equal ones the earlier comes first.

    No path is cheaper than straight there while turning evenly: sqrt(2 q (r_v gap^2 + r_w turn^2)).
    """
    count, here, none = chosen.shape[0], (x[0], x[1], x[2]), np.empty(0)
    found = 0
    for i in range(states.shape[0]):
        limit = cost[count - 1] if found == count else np.inf
        dx, dy, turn = states[i, 0] - x[0], states[i, 1] - x[1], states[i, 2] - x[2]
        turn -= TWO_PI * math.floor(turn / TWO_PI + 0.5)
        least = numbers[0] * (dx * dx + dy * dy) + numbers[1] * turn * turn
        if least > limit * limit * (1.0 + EPS):
            continue
        there = (states[i, 0], states[i, 1], states[i, 2])
        tail, head = (here, there) if forward else (there, here)
        d = _cheapest(tail, head, numbers, np.inf, none, none)
        found = insert(chosen, cost, found, d, i)


@kernel
def _costs(tails, heads, numbers, out):  # type: ignore[no-untyped-def]
    none = np.empty(0)
    for i in range(out.shape[0]):
        out[i] = _cheapest(tails[i], heads[i], numbers, np.inf, none, none)


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverSteering(PoseSteering):
    """A rover's cheapest arcs and straight pieces for the integral of q + (r_v v^2 + r_w w^2) / 2.

    Args:
        q: cost rate [cost/s].
        r_v: weight of the speed v [cost s/m^2].
        r_w: weight of the turn rate w [cost s/rad^2].

    Raises:
        OptionError: one of them is not a positive number.
    """

    q: float = 1.0
    r_v: float = 2.0
    r_w: float = 0.5

    def __post_init__(self) -> None:
        check_positive(self, "q", "r_v", "r_w")

    @classmethod
    def of(cls, problem: Problem) -> RoverSteering:
        """Take that of a problem of a `Rover` with q constant and R diagonal; OptionError for another."""
        if not isinstance(problem.dynamics, Rover):
            raise OptionError(f"a rover's arcs steer a Rover, not {type(problem.dynamics).__name__}; bring a Steering")
        R = problem.control_cost(np.zeros(3))
        if np.any(np.diag(R.diagonal()) != R):
            raise OptionError("a rover's arcs are priced for a diagonal R alone; bring a Steering")
        return cls(q=problem.least_rate, r_v=float(R[0, 0]), r_w=float(R[1, 1]))

    @property
    def motion(self) -> Motion:  # type: ignore[override]
        """Arcs at the speed that the cost asks for."""
        return priced_arcs(self.q, *self._numbers[:2])

    @property
    def compiled(self) -> Compiled:
        """The words as kernels; their numbers are 2 q r_v, 2 q r_w and the radii [m]."""
        return Compiled(_nearest, _connect, self._numbers)

    def priced(self, path: Curves) -> Curves:
        """Price curves (k, P) for the rover."""
        return priced(path, *self._numbers[:2])

    @property
    def radii(self) -> tuple[float, ...]:
        """Radii of the words' arcs [m]."""
        return self._numbers[2:]

    @property
    def _numbers(self) -> tuple[float, ...]:
        scale = math.sqrt(self.r_w / self.r_v)
        return (2.0 * self.q * self.r_v, 2.0 * self.q * self.r_w, *(share * scale for share in RADII))

    def backwards(self, x: Array) -> Array:
        """Face a pose (3,) the other way."""
        return np.asarray(x + np.array([0.0, 0.0, math.pi]))

    def reversing(self, trajectory: Trajectory) -> Trajectory:
        """Drive a trajectory at the opposite speeds, with its turn rates and cost."""
        return replace(trajectory, controls=trajectory.controls * np.array([-1.0, 1.0]))

    def distance(self, tails: Array, heads: Array) -> Array:
        """Least cost from tails to heads, (..., 3) x 2 -> (...,) [cost]. Not symmetric."""
        tails, heads = np.broadcast_arrays(tails, heads)
        out = np.empty(tails.shape[:-1])
        _costs(rows(tails, 3), rows(heads, 3), self._numbers, out.reshape(-1))
        return out

    def connect(self, tails: Array, heads: Array) -> Curves:
        """The cheapest curves from tails (k, 3) to heads (k, 3), (k, 3) pieces."""
        tails, heads = rows(np.atleast_2d(tails), 3), rows(np.atleast_2d(heads), 3)
        found = _connect(tails, heads, self._numbers)
        return Curves(
            start=found.start, curvature=found.curvature, length=found.length, cost=found.cost, tails=tails, heads=heads
        )
