"""Describe deterministic paths with the controls that drive them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import kernel
from pirrht.problem import Problem

SPACING = 0.05  # distance of points on drawn arcs [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A deterministic path with the controls that drive it, piecewise constant in time."""

    controls: Array  # (l, m) control of each piece
    durations: Array  # (l,) [s]
    path: Any  # consecutive motions (`Motions`): along arcs, `Curves`
    cost: float  # steering cost [cost]
    length: float  # [m]
    slack: float | None = None  # where controls are not known but only the path: time to get under way at most [s]

    def __repr__(self) -> str:
        seconds = float(self.durations.sum())
        return f"Trajectory({self.length:.3g} m, {seconds:.3g} s, cost {self.cost:.4g})"

    @cached_property
    def points(self) -> Array:
        """The path as a polyline (k, 2), for pictures [m]; points on arcs are SPACING apart."""
        lines = self.path.points(SPACING)
        return np.vstack([lines[0], *(line[1:] for line in lines[1:])])

    def faster(self, times: float) -> Trajectory:
        """Drive the path so many times as fast, for a system that controls move."""
        return replace(self, controls=times * self.controls, durations=self.durations / times)

    def tape(self, times: Array) -> Array:
        """Mean control of each step of a grid (T+1,) [s], (T, m); zero after the end (the paper's footnote)."""
        out = np.zeros((len(times) - 1, self.controls.shape[1]))
        _resample(np.ascontiguousarray(self.controls), self.durations, times, out)  # compiled for one layout
        return out


def running_cost(problem: Problem, x: Array, trajectory: Trajectory) -> float:
    """Integral of q + u'Ru/2 along a trajectory from x (n,) [cost]; a callable q with its mean over the points.

    Where the controls are not known it is the steering's cost, and the most that getting under way may cost.
    """
    if trajectory.slack is not None:
        return trajectory.cost + 2.0 * problem.least_rate * trajectory.slack
    R = problem.control_cost(x)
    effort = 0.5 * np.einsum("lm,mk,lk->l", trajectory.controls, R, trajectory.controls)
    rate = problem.rate(x)
    if callable(problem.q):
        tail = x[2:]
        rate = float(np.mean([problem.rate(np.concatenate([p, tail])) for p in trajectory.points]))
    return float(np.sum((rate + effort) * trajectory.durations))


@kernel
def _resample(controls, durations, times, out):  # type: ignore[no-untyped-def]
    steps, m = out.shape
    now, i = 0.0, 0
    for p in range(durations.shape[0]):
        end = now + durations[p]
        while i < steps:
            overlap = min(end, times[i + 1]) - max(now, times[i])
            if overlap > 0.0:
                for j in range(m):
                    out[i, j] += controls[p, j] * overlap / (times[i + 1] - times[i])
            if times[i + 1] > end:
                break
            i += 1
        now = end
