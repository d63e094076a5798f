"""Scales of noise and cost at a state, and what the nearest walls add to the control there.

In free space psi falls like exp(-k r), k^2 = 2 q / (lambda b^2), at the speed that balances q against u'Ru/2. Near a
wall it falls like the share of paths that noise does not carry into it: their mean leans away from it, the push.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arena import Arena
from pirrht.geometry.field import Field, clearance
from pirrht.problem import Problem
from pirrht.rollouts.first_exit import survivors_slope

ANTICIPATION = 0.25  # walls push as far as noise carries a path in this time [s]; much longer makes weights uneven
AVERAGED = 0.02  # near walls and goal the control now is averaged over leading steps of this length together [s]
SHARE = 0.25  # of the time in which noise carries a path to the nearest of them
SHARPER = 0.2  # of a rollout step's noise: nearer than half of that a wall pushes the robot no harder


def best_speed(problem: Problem, x: Array) -> float:
    """Speed that balances q against u'Ru/2 at x (n,) [m/s]."""
    R = problem.control_cost(x)
    return float(np.sqrt(2.0 * problem.least_rate / (np.trace(R) / len(R))))


def noise_rate(problem: Problem, x: Array) -> float:
    """Variance per second of an actuated state at x (n,), their mean [m^2/s]; of a car [rad^2/s]."""
    B = problem.dynamics.B_c(x)
    return float(np.trace(B @ B.T)) / len(B)


def decay(problem: Problem, x: Array) -> float:
    """k of psi = exp(-k r) in free space [1/m], by the noise at x (n,); only gates, of points that noise moves, ask."""
    return float(np.sqrt(2.0 * problem.least_rate / (problem.temperature * noise_rate(problem, x))))


def reach(problem: Problem, x: Array) -> float:
    """How far noise, as at x (n,), carries a path in the time over which walls are anticipated [m]."""
    return float(np.sqrt(2.0 * noise_rate(problem, x) * ANTICIPATION))


def window(problem: Problem, arena: Arena, x: Array, times: Array, longest: float) -> int:
    """Leading steps of a grid (T+1,) [s] over which the control now is averaged, at least one, at most `longest` [s].

    Besides the guide, which is followed exactly, the optimal control changes near walls and goal: about as fast as
    noise carries a path there.
    """
    to_goal = float(np.hypot(*(x[:2] - np.array(arena.goal)))) - arena.radius
    near = min(float(clearance(arena.field, x[0], x[1])), to_goal)
    span = min(max(SHARE * near**2 / noise_rate(problem, x), AVERAGED), longest)
    return max(1, int(np.searchsorted(times, span + 1e-9, side="right")) - 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Push:
    """The part of the control that the nearest walls account for, as a function of the state.

    It changes fast with the position, so it is taken at the state itself; the rest of the control, which samples tell,
    changes slowly and is averaged over the leading steps.
    """

    problem: Problem
    field: Field
    reach: float  # as `Leads.reach` [m]; 0: none
    step: float  # of the rollouts, their first [s]

    def __call__(self, x: Array) -> Array:
        """Control (m,) at x (n,)."""
        d = self.problem.dynamics
        if self.reach <= 0.0 or float(clearance(self.field, x[0], x[1])) >= 3.0 * self.reach:
            return np.zeros(d.m)
        B = d.B_c(x)
        # A robot that reacts between plans may come closer than a rollout's step would let it.
        widest = SHARPER * float(np.sqrt((B @ B.T).diagonal().max() * self.step))
        slope = np.array(survivors_slope(self.field, self.reach, widest, x[0], x[1])[:2])
        return np.asarray(np.linalg.solve(d.G_c(x), B @ B.T @ slope))
