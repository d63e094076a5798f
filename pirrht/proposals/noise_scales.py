"""Effect of a system's noise on its states, and the states its drift depends on, probed at some states of the scene."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.problem import Problem
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.tuning import ProposalTuning
from pirrht.rollouts.cpu import kind_of
from pirrht.rollouts.tables import Setup


class Noise(NamedTuple):
    """Effect of noise alone on a state, and the states that matter to drift and q."""

    strength: float  # b of a position's variance b^2 t^3 / 3, where it acts on the velocity; for a car b V [m/s^1.5]
    position: float  # b of a position's variance b^2 t, where it acts on the position [m/sqrt(s)]
    metric: Array  # (n,) weights of squared differences between states, inverse to their noise, the first's being 1
    curved: bool  # whether steps have second derivatives
    active: int  # bit k tells whether drift or q depends on the k-th state


def noise_of(problem: Problem, setup: Setup, width: int, tuning: ProposalTuning) -> Noise:
    """Measure the noise of a problem by the derivatives of its steps, with `width` modes.

    Where inputs carry the noise, each in turn is at the strength that costs as much as time. An OptionError is raised
    if no noise reaches the position.
    """
    d, h, states = problem.dynamics, tuning.spreading / tuning.spreading_steps, _probes(problem, tuning.probes)
    active = active_states(problem, states, tuning.spreading)
    asked, at_once = math.sqrt(2.0 * problem.least_rate / problem.temperature), 0.0
    spread, bend, expand = np.zeros((d.n, d.n)), 0.0, forward_pass(kind_of(problem)).expand
    for k, x in enumerate(states):
        J, S = np.zeros((d.n + 1, d.n + width)), np.zeros((d.n + width,) * 2)
        control = np.full(width, 0.5)
        if d.input_form:
            control = asked * np.eye(width)[k % d.m]
            B = d.B_c(x)[:2]
            at_once = max(at_once, float(np.linalg.eigvalsh(B @ B.T)[-1]))
        expand(setup, (x, control, h, np.ones(d.n)), active, True, J, S)
        A, C = J[:-1, : d.n], J[:-1, d.n :]
        bend = max(bend, float(np.abs(S).max()))
        P = np.zeros((d.n, d.n))
        for _ in range(tuning.spreading_steps):
            P = A @ P @ A.T + C @ C.T / h
        spread += P / len(states)
    if not spread[:2, :2].any():
        raise OptionError(
            f"{type(d).__name__}: its noise never reaches x, y; its drift must say how they move, as in out[0] = x[2]"
        )
    most, squares, metric = float(np.linalg.eigvalsh(spread[:2, :2])[-1]), np.diag(spread), np.zeros(d.n)
    np.divide(squares[0], squares, out=metric, where=squares > 1e-9 * squares.max())
    return Noise(
        strength=math.sqrt(3.0 * most / tuning.spreading**3),
        position=math.sqrt(at_once if at_once else most / tuning.spreading),
        metric=metric, curved=bend > tuning.straight, active=active,
    )  # fmt: skip


def active_states(problem: Problem, states: list[Array], step: float) -> int:
    """Return the bits of the states that drift or q depend on at some states, by differences of a step."""
    found = 0
    for x in states:
        here, rate = problem.dynamics.f(x), problem.rate(x)
        for i, off in enumerate(np.eye(problem.dynamics.n)):
            other = x + off * step
            if np.any(problem.dynamics.f(other) != here) or problem.rate(other) != rate:
                found |= 1 << i
    return found


def _probes(problem: Problem, count: int) -> list[Array]:
    d = problem.dynamics
    lower, upper = d.box(problem.scene)
    fractions = np.arange(1, d.n + 1) * 0.7548776662 + np.arange(1, count + 1)[:, None] * 0.5698402910
    return list(lower + fractions % 1.0 * (upper - lower))
