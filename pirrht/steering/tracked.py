"""Make references of systems without steering of their own: lines in the plane, which proposals make feasible.

The tree is that of a point which moves straight at a pace; its vertices are positions, whatever else a state has. Costs
are the point's, so classes are ordered by length. Proposals alone find the system's own optimum: they track a reference
first, from the system's state, and then save where the true cost allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.problem import Problem
from pirrht.steering.motion import Trajectory
from pirrht.steering.straight_line import Lines
from pirrht.steering.tuning import TUNING


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked(Lines):
    """Straight lines at one pace between positions, for systems that move otherwise.

    Args:
        pace: speed [m/s].
        cost_per_meter: of it [cost/m].
        slack: time that getting under way, or turning about, may take [s].
        m: controls of the system.
    """

    pace: float
    cost_per_meter: float
    slack: float
    m: int

    drives = False

    @classmethod
    def of(cls, problem: Problem, pace: float | None = None) -> Tracked:
        """Take lines for any problem.

        Args:
            pace: speed [m/s]; without one, that at which the problem's cost per meter is least.

        Raises:
            OptionError: the pace is not positive, or the cost tells none.
        """
        pace = pace_of(problem) if pace is None else pace
        if not (np.isfinite(pace) and pace > 0):
            raise OptionError(f"the pace of references is {pace:g}; it must be a positive number [m/s]")
        d = problem.dynamics
        x = moving(problem, pace)
        rate = max(problem.rate(d.state_of(problem.scene.start) if x is None else x), problem.least_rate)
        rate = 2.0 * rate if _actuated(problem) else rate  # at the best speed control costs as much as time does
        return cls(pace=pace, cost_per_meter=rate / pace, slack=_delay(problem, pace), m=d.m)

    def vertex_of(self, x: Array) -> Array:
        """The position (..., 2) [m] of a state (..., n)."""
        return np.ascontiguousarray(x[..., :2])

    def trajectory(self, path: Any) -> Trajectory:
        """Return the times along a path, without controls that would drive it."""
        found = self.motion.trajectory(self, path)
        still = np.zeros((len(found.durations), self.m))
        return replace(found, controls=still, slack=self.slack)


def pace_of(problem: Problem) -> float:
    """Speed at which a meter costs least [m/s].

    If positions are actuated q and u'Ru/2 balance there; else it is the system's only speed, or where q has its least
    value per meter if it tells speeds apart.

    Raises:
        OptionError: the cost tells none.
    """
    d = problem.dynamics
    moved = _actuated(problem)
    if moved:  # in the direction in which positions yield least, of those in which they do
        return math.sqrt(2.0 * problem.least_rate * moved[0])
    lower, upper = d.box(problem.scene)
    fractions = (np.arange(1, d.n + 1) * 0.7548776662 + np.arange(TUNING.probed_states)[:, None] * 0.5698402910) % 1.0
    speeds = [math.hypot(*d.f(lower + fraction * (upper - lower))[:2]) for fraction in fractions]
    if max(speeds) > 0 and np.ptp(speeds) < 1e-6 * max(speeds):
        return speeds[0]
    if callable(problem.q) and moving(problem, 1.0) is not None:
        probed = np.geomspace(*TUNING.probed_speeds)
        costs = np.array([problem.rate(moving(problem, v)) for v in probed]) / probed  # type: ignore[arg-type]
        best = int(np.argmin(costs))
        if 0 < best < len(probed) - 1:
            return float(probed[best])
    raise OptionError(
        f"the cost of {type(d).__name__} does not tell how fast its references should be; declare a pace [m/s], as in "
        "System(..., pace=1.0)"
    )


def moving(problem: Problem, speed: float) -> Array | None:
    """Start state at a speed [m/s], (n,); None if the states have none."""
    d = problem.dynamics
    x = d.state_of(problem.scene.start)
    for name in ("speed", "vx"):
        if name in d.states:
            x[d.states.index(name)] = speed
            return x
    return None


def _delay(problem: Problem, pace: float) -> float:
    """Time to turn about or to get up to the pace under a control that costs what time does [s]."""
    d = problem.dynamics
    strength = np.sqrt(2.0 * problem.least_rate * np.diag(_yield(problem, d.state_of(problem.scene.start))))
    change = np.array([math.pi if i in d.angles else pace for i in range(d.n)])
    turned = [change[i] / strength[i] for i in range(2, d.n) if strength[i] > 0]
    return float(max(turned, default=0.0))


def _actuated(problem: Problem) -> list[float]:
    """Mobilities of the position under a control of a given cost, by direction, least first; empty without any."""
    here = problem.dynamics.state_of(problem.scene.start)
    moved = np.linalg.eigvalsh(_yield(problem, here)[:2, :2])
    return [float(part) for part in moved if part > max(0.0, 1e-9 * float(moved[-1]))]


def _yield(problem: Problem, x: Array) -> Array:
    """G R^-1 G' at x (n,), (n, n): what states yield to a control of a given cost."""
    d = problem.dynamics
    G = np.zeros((d.n, d.m))
    block = d.G_c(x)
    G[d.n - len(block) :] = block
    return np.asarray(G @ np.linalg.solve(problem.control_cost(x), G.T))
