"""Noise that enters through inputs, dx = f dt + G (u dt + s dw): what is refused, and steps by the equation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from by_inputs import Driven, PushedMass, around_a_disc, driven

from pirrht import Dynamics, NotLinearlySolvable, OptionError, Problem, SingleIntegrator
from pirrht.arrays import Array
from pirrht.control.baselines import straight_home
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.dynamics import no_drift

X = np.array([0.3, -0.2, 0.7])


def system(**changes: Any) -> Dynamics:
    """A car driven by speed and turn rate, whose class is called Cart, but for what is changed."""

    def twist(self: Dynamics, x: Array, rate: Array) -> Array:
        return rate

    body = {
        "n": 3,
        "m": 2,
        "states": ("x", "y", "heading"),
        "parameters": np.zeros(0),
        "drift": staticmethod(no_drift),
        "input_matrix": staticmethod(Driven.input_matrix),
        "input_noise": np.diag([0.5, 1.0]),
        "twist": twist,
    }
    cart: Dynamics = type("Cart", (Dynamics,), body | changes)()
    return cart


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"input_noise": None}, "input_noise missing; a Dynamics declares .*input_matrix, input_noise"),
        ({"input_noise": np.eye(3)}, r"input_noise is \(3, 3\); with n = 3, m = 2 it must be \(2, 2\)"),
        ({"input_noise": 0.5}, "input_noise is a float; it must be an array: s is constant"),
        ({"input_noise": np.diag([0.5, 0.0])}, r"input_noise is \[\[0.5, 0.0\], .*it must have an inverse"),
        ({"input_matrix": np.eye(2)}, r"input_matrix is \(2, 2\); with n = 3, m = 2 it must be \(3, 2\)"),
        ({"input_matrix": "G"}, "input_matrix is a str; it must be an array or a function"),
        ({"input_matrix": Driven.input_matrix}, r"input_matrix\(x, p, out\) cannot be called without self"),
        ({"control_block": np.eye(2)}, "control_block belongs to the paper's form; leave it out"),
        (
            {"input_matrix": None, "control_block": np.eye(2), "diffusion_block": np.eye(2)},
            "input_noise belongs to the input form; leave it out, or declare an input_matrix",
        ),
        (
            {"input_matrix": None, "input_noise": None, "stratonovich": True, "control_block": np.eye(2)}
            | {"diffusion_block": np.eye(2)},
            "stratonovich belongs to the input form",
        ),
    ],
)
def test_an_input_form_that_is_none_is_refused_by_name(changes, told):
    with pytest.raises(OptionError, match=f"^Cart: {told}"):
        Problem(dynamics=system(**changes), scene=around_a_disc(), R=np.diag([2.0, 0.5]))


def test_noise_and_cost_without_a_common_lambda_are_refused_with_both_matrices():
    told = r"^Cart: no lambda solves lambda R\^-1 = s s' .*R\^-1 = \[\[0.5, 0\], .*s s' = \[\[0.25, 0\], .*choose R"
    with pytest.raises(NotLinearlySolvable, match=told):
        Problem(dynamics=system(), scene=around_a_disc(), R=np.diag([2.0, 2.0]))


def test_lambda_is_what_turns_the_inverse_of_the_cost_into_the_noise():
    s = np.array([[0.5, 0.2], [0.1, 0.4]])
    problem = Problem(dynamics=system(input_noise=s), scene=around_a_disc(), R=0.3 * np.linalg.inv(s @ s.T))
    assert problem.temperature == pytest.approx(0.3)


def test_controls_and_noise_units_turn_into_each_other_in_both_forms():
    u = np.array([0.7, -0.3])
    for d, x in ((Driven(), X), (PushedMass(), np.array([*X, 0.1])), (DoubleIntegrator(b=0.1), np.array([*X, 0.1]))):
        a = d.to_noise(x, u)
        np.testing.assert_allclose(d.noise_gain(x) @ u, a, rtol=1e-12)
        np.testing.assert_allclose(d.input_of(x, a), u, rtol=1e-12)
        np.testing.assert_allclose(d.B_c(x) @ a, d.G_c(x) @ u, rtol=1e-12)
        assert d.B_c(x).shape == d.G_c(x).shape == (d.rows, d.m)


def test_noise_acts_on_the_position_where_a_row_of_it_is_not_zero():
    assert Driven().noisy_position
    assert not PushedMass().noisy_position


@pytest.mark.parametrize("stratonovich", [False, True])
def test_a_step_goes_along_the_heading_of_its_start_or_of_its_middle(stratonovich):
    u, dw, h = np.array([0.8, 1.5]), np.array([0.02, -0.1]), 0.1
    d = Driven(stratonovich)
    way, turn = h * u + np.array([0.5, 1.0]) * dw
    heading = X[2] + (0.5 * turn if stratonovich else 0.0)
    moved = X + np.array([way * np.cos(heading), way * np.sin(heading), turn])
    np.testing.assert_allclose(d.step(X, u, dw, h), moved, rtol=1e-12)


def test_the_way_home_is_priced_at_the_best_speed_along_the_heading():
    """sqrt(2 q r) per meter, whatever turning would cost."""
    beyond = straight_home(driven())
    assert beyond(np.array([[0.8, -0.6, 1.0]]))[0] == pytest.approx(np.sqrt(2.0 * 2.0) * 0.5)
    assert straight_home(Problem(dynamics=SingleIntegrator(b=0.5), scene=around_a_disc(), R=2.0 * np.eye(2)))(
        np.array([[0.8, -0.6]])
    )[0] == pytest.approx(np.sqrt(2.0 * 2.0) * 0.5)
