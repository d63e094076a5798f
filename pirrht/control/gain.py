"""Linear feedback between plans, u(x) = u + K (x - x_ref), with K from the samples of the plan itself.

Thijssen and Kappen (Phys. Rev. E 91, 032104, 2015) regress the control that samples carry on the state, each sample
at its weight. At the state of the plan that can be done exactly. For x' = x + Z, where Z ~ N(0, s Sigma) is what noise
moves the actuated states by in a time s, log psi(x) = log E_P[psi(x + Z)] - q s / lambda has the second derivative

    Hess log psi = (s Sigma)^-1 (Cov_w[Z] - s Sigma) (s Sigma)^-1,      Sigma = B B' = lambda G R^-1 G',

the score identity of second order, so that u* = lambda R^-1 G' grad log psi has the slope

    K = du*/dx = (C R / (lambda s) - 1) G^-1 / s,      C = Cov_w[G^-1 Z]: the covariance of the control carried.

Classes that want different things spread it beyond that of the noise: K turns the control towards the class whose side
the robot strays to. What the samples' own feedback contributes to Z is known without noise: its slope is added, and
left out of C. K is shrunk towards it where few samples tell more. Nothing is to be found about states that noise does
not move: a car has the slope of its guides in position, and that of its samples in heading only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.feedback import Lead, wrapped
from pirrht.estimation.estimate import Estimate, Rollouts, deviation, joined, mean_control, normalised
from pirrht.problem import Problem
from pirrht.rollouts.backend import Guides

NUDGE = 5e-3  # over which the slope of a guide is taken [m or rad]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearLaw:
    """The control near the plan's state."""

    state: Array  # (n,) x_ref of the plan ...
    velocity: Array  # (n,) ... and how it moves without control
    control: Array  # (m,) u there, without what the nearest wall adds
    gain: Array  # (m, n) K
    push: Callable[[Array], Array]  # what the nearest wall adds at a state, (m,)

    def __call__(self, x: Array, s: float) -> Array:
        """Control (m,) at state x (n,), s [s] after the plan was made."""
        off = wrapped(x - self.state - s * self.velocity, len(x))
        control: Array = self.control + self.push(x) + self.gain @ off
        return control


def linear_law(estimate: Estimate, leads: Sequence[Lead | None]) -> LinearLaw:
    """The law that the samples of a plan make; `leads` are what those around each reference were led by."""
    source, guides, x = estimate.source, estimate.rollouts.guides, estimate.rollouts.x0
    d = source.problem.dynamics
    gain = np.zeros((d.m, d.n))
    for weight, lead in zip(estimate.proposal_weights, leads, strict=False):
        if lead is not None:
            gain += weight * slope(lead, x)
    found, error = curvature(source.problem, estimate.parts)
    followed = gain + slope(lambda y, s: source.push(y, guides), x)
    rest = found - unfollowed(guides) * followed[:, d.n - d.m :]
    size = float(np.sum(rest**2))
    # James and Stein: as much as chance makes of nothing is taken off.
    gain[:, d.n - d.m :] += rest * (max(0.0, 1.0 - float(np.sum(error**2)) / size) if size > 0.0 else 0.0)
    return LinearLaw(
        state=x,
        velocity=np.concatenate([d.f(x)[: d.n - d.m], np.zeros(d.m)]),
        control=estimate.control - source.push(x, guides),
        gain=bounded(gain, d.G_c(x), 1.0 / float(guides.times[1])),
        push=lambda x: source.push(x, guides),
    )


def curvature(problem: Problem, parts: Sequence[Rollouts]) -> tuple[Array, Array]:
    """Slope of u* in the actuated states beyond what samples followed, and the standard error of each entry, (m, m)."""
    x, (paths, log_weight, first) = parts[0].x0, joined(parts)
    weight, _ = normalised(log_weight)
    now, span = paths.now, paths.span
    s = float(np.einsum("s,s->", weight, span))
    R = problem.control_cost(x)
    noise: Array = problem.temperature * np.asarray(np.linalg.inv(R), dtype=float)
    terms = weight[:, None, None] * _spread(now - span[:, None] * mean_control(weight, paths), span, noise)
    if not any(part.guides.led.any() for part in parts):  # there, the noise of samples is not that of the robot
        terms -= _expected(weight, now, span, first, noise)
    scale, G = R / problem.temperature, problem.dynamics.G_c(x)
    slopes: Array = terms @ scale @ np.linalg.inv(G) / s**2
    errors = deviation(slopes.reshape(len(slopes), -1), first, parts[0].guides.mirrored)
    return slopes.sum(axis=0), np.reshape(errors, slopes.shape[1:])


def unfollowed(guides: Guides) -> float:
    """Share of the slope of guides that samples do not follow, as they hold the control over each step.

    A displacement at the end of one of the steps dt_i of the window adds its slope to those that follow only, to
    s^2 - sum dt_i^2 of s^2 in all: the rest is found in what noise carries.
    """
    steps = np.diff(guides.times[: guides.window + 1])
    return float(np.sum(steps**2) / np.sum(steps) ** 2)


def bounded(gain: Array, G: Array, rate: float) -> Array:
    """A gain (m, n) of which the robot's actuated states move no faster than `rate` [1/s].

    A plan that is made every first step of the rollouts, or more often, can then not overshoot, let alone a physics
    step, and where the exact law runs away from a state it does so no faster than samples on such steps can tell.
    """
    fastest = float(np.linalg.norm(G @ gain[:, -len(G) :], 2))
    return gain * min(1.0, rate / fastest) if fastest > 0.0 else gain


def _spread(off: Array, span: Array, noise: Array) -> Array:
    """Squares (S, m, m) of what samples carried, less those that noise makes on average."""
    return off[:, :, None] * off[:, None, :] - span[:, None, None] * noise


def _expected(weight: Array, now: Array, span: Array, first: NDArray[np.int64], noise: Array) -> Array:
    """Terms that add up to zero on average, and, where weights are even, to the error of the others.

    Around each reference the squares of all the noise drawn are what they should be; a sample that deviates from that
    does so with its weight as well.
    """
    out = np.zeros((len(now), *noise.shape))
    for a, b in zip(first[:-1], first[1:], strict=True):
        if b - a > 1:
            bare = now[a:b] - span[a:b, None] * now[a:b].sum(axis=0) / span[a:b].sum()
            out[a:b] = weight[a:b].sum() / (b - a) * _spread(bare, span[a:b], noise)
    return out


def slope(lead: Lead, x: Array) -> Array:
    """Slope (m, n) of a guide's control in the state."""
    steps = NUDGE * np.eye(len(x))
    return np.column_stack([(lead(x + step, 0.0) - lead(x - step, 0.0)) / (2.0 * NUDGE) for step in steps])
