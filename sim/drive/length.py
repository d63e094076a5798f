"""How long a driven path is, whatever its noise.

The path of dx = u dt + b dw is infinitely long: the finer it is looked at, the longer it gets. It is therefore measured
by chords over a time tau of driving, and from the square of each chord (over t seconds) goes what noise alone adds to
it across its direction, b^2 t. Noise and control at its natural pace sqrt(2 q / R) carry equally far in lambda / (2 q)
seconds; tau is CHORD times lambda / q. So tau does not depend on physics step or control period, tau -> 0 and the
length becomes that of the path as b -> 0, and where noise does not act on the position (cars) nothing is smoothed.
Noise along the way alone (a rover's) adds nothing to a chord on average: only its own to and fro is smoothed away.
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np

from pirrht.arrays import Array
from pirrht.problem import Problem

CHORD = 2.5  # times lambda / q: 0.05 s at the point's b = 0.1, 0.45 s at 0.3


class Length:
    """The length of a path that goes on, from its start at x (n,).

    Args:
        problem: tells noise and the time of a chord.
    """

    def __init__(self, problem: Problem, x: Array) -> None:
        self._spread, self._smooth = spread(problem, x), not problem.dynamics.noisy_position
        self._time = CHORD * problem.temperature / problem.least_rate
        self._first = self._last = self._begun = (float(x[0]), float(x[1]))  # of the path, so far, of the chord
        self._steps, self._step = 0, 0.0  # of the chord, and their length [s]
        self._chords = 0.0  # of those that are over [m]
        self.noisy = 0.0  # of the path with all its noise [m]

    def add(self, states: Array, step: float, noisy: float) -> None:
        """Go on through states (k, n), `step` seconds apart, over a path of `noisy` metres."""
        self.noisy += noisy
        if not len(states):
            return
        self._last, self._step = (float(states[-1, 0]), float(states[-1, 1])), step
        each, first = max(1, round(self._time / step)), self._steps
        for end in range(each - first, len(states) + 1, each):
            place = (float(states[end - 1, 0]), float(states[end - 1, 1]))
            self._chords += self._chord(place, each)
            self._begun = place
        self._steps = (first + len(states)) % each

    @property
    def total(self) -> float:
        """Of the path without its noise [m]; at least the distance between its ends, at most the noisy length."""
        if self._smooth:
            return self.noisy
        total = self._chords + self._chord(self._last, self._steps)
        return min(self.noisy, max(total, _distance(self._first, self._last)))

    def _chord(self, end: tuple[float, float], steps: int) -> float:
        square = _distance(self._begun, end) ** 2 - self._spread * steps * self._step
        return sqrt(max(0.0, square))


def spread(problem: Problem, x: Array) -> float:
    """Variance per second that noise adds to each coordinate of the position at x (n,) [m^2/s].

    In input form that in the direction in which it adds least, since robots drive in the other.
    """
    dynamics = problem.dynamics
    if not dynamics.noisy_position:
        return 0.0
    if dynamics.input_form:
        B = np.asarray(dynamics.B_c(x))[list(dynamics.position)]
        return max(0.0, float(np.linalg.eigvalsh(B @ B.T)[0]))
    first = dynamics.n - dynamics.m
    rows = np.asarray(dynamics.B_c(x))[[i - first for i in dynamics.position if i >= first]]
    return float(np.sum(rows**2)) / 2.0


def _distance(a: tuple[float, float], b: tuple[float, float]) -> float:
    return hypot(b[0] - a[0], b[1] - a[1])
