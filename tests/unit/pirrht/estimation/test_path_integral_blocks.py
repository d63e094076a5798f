"""Rates and blocks that depend on the state, and which problems are linearly solvable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from closed_forms import (
    strip,
    strip_space,
)

from pirrht.arrays import Array
from pirrht.errors import NotLinearlySolvable, OptionError
from pirrht.problem import Problem
from pirrht.rollouts.cpu import kernels_for
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle


def curved_rate(x, p):
    """q = p2 + p3 x^2, a plain Python function as a user would write it."""
    return p[2] + p[3] * x[0] * x[0]


def still(x, p, out):
    for i in range(out.shape[0]):
        out[i] = 0.0


def wider_gain(x, p, out):
    """G_c = (1 + p1 x^2) I."""
    s = 1.0 + p[1] * x[0] * x[0]
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = s, 0.0, 0.0, s


def wider_noise(x, p, out):
    """B_c = p0 (1 + p1 x^2) I."""
    s = p[0] * (1.0 + p[1] * x[0] * x[0])
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = s, 0.0, 0.0, s


@dataclass(frozen=True, eq=False)
class Uneven(Dynamics):
    """dx = g(x) (u dt + b dw) with g = 1 + widening x^2; the rate q = base + rise x^2 reads the same parameters."""

    b: float
    widening: float = 0.0
    base: float = 1.0
    rise: float = 0.0

    n = 2
    m = 2
    drift = staticmethod(still)
    control_block = staticmethod(wider_gain)
    diffusion_block = staticmethod(wider_noise)

    @property
    def parameters(self) -> Array:  # type: ignore[override]
        return np.array([self.b, self.widening, self.base, self.rise])

    def twist(self, x: Array, rate: Array) -> Array:
        return rate


def uneven(L: float, dynamics: Uneven, R: Callable[[Array], Array] | Array) -> Problem:
    return Problem(dynamics=dynamics, scene=strip_space(L).scene, R=R, q=curved_rate, q_min=dynamics.base, phi=0.0)


def two(x: Array) -> Array:
    return 2.0 * np.eye(2)


def test_kernels_over_a_users_functions_are_built_once():
    kernels = [kernels_for(uneven(0.5, Uneven(b=b), two)) for b in (0.3, 0.5)]
    assert kernels[0] is kernels[1]


def test_a_rate_given_as_a_function_needs_its_least_value(slit):
    with pytest.raises(OptionError, match="q_min"):
        Problem(dynamics=SingleIntegrator(), scene=slit.problem.scene, R=np.eye(2), q=curved_rate)


# -- linear solvability ------------------------------------------------------------------------------------------


def test_lambda_follows_from_the_blocks():
    assert strip(0.3, 0.5).temperature == pytest.approx(2.0 * 0.3**2)
    scene = strip_space(0.5).scene
    car = Problem(dynamics=Unicycle(b=0.03, rho=2.0), scene=scene, R=np.eye(1))
    assert car.temperature == pytest.approx(0.03**2 * 2.0**2)


def test_an_inconsistent_triple_is_refused_with_both_matrices():
    with pytest.raises(NotLinearlySolvable) as caught:
        Problem(dynamics=SingleIntegrator(b=0.5), scene=strip_space(0.5).scene, R=np.diag([1.0, 2.0]))
    message = str(caught.value)
    assert "[[1, 0], [0, 0.5]]" in message  # G R^-1 G'
    assert "[[0.25, 0], [0, 0.25]]" in message  # B B'
    assert "\n" not in message
