"""A system or a scene that the method cannot serve is refused by name, and told what would have worked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from discs import scene_of

from pirrht import (
    Controller,
    Desirability,
    Dubins,
    Dynamics,
    FreeSpace,
    HomologyTree,
    OptionError,
    Problem,
    Sampling,
    SingleIntegrator,
    StraightLine,
    Unicycle,
)
from pirrht.arrays import Array
from pirrht.systems.dynamics import no_drift

SCENE = scene_of(start=(1.0, 2.0, 0.3), goal=(3.0, 0.0, 0.2), lower=(0.0, -1.0), side=(4.0, 3.0))


def system(**changes: Any) -> Dynamics:
    """A double integrator, whose class is called Boat, but for what is changed."""

    def twist(self: Dynamics, x: Array, rate: Array) -> Array:
        return rate

    m = changes.get("m", 2)
    body = {
        "n": 4,
        "m": m,
        "states": ("x", "y", "vx", "vy"),
        "parameters": np.zeros(0),
        "drift": staticmethod(no_drift),
    }
    blocks = {"control_block": np.eye(m), "diffusion_block": 0.1 * np.eye(m), "twist": twist}
    boat: Dynamics = type("Boat", (Dynamics,), body | blocks | changes)()
    return boat


def posed(dynamics: Dynamics, R: Any = None) -> Problem:
    return Problem(dynamics=dynamics, scene=SCENE, R=np.eye(dynamics.m) if R is None else R)


REFUSED = {
    "a height": ({"states": ("x", "y", "z", "vx")}, r'"z" is a third position, but scenes are planar'),
    "a line": ({"n": 1, "m": 1, "states": ("x",)}, "at least the 2 states x and y"),
    "y before x": ({"states": ("y", "x", "vx", "vy")}, r'\(y, x, vx, vy\); the first two must be "x" and "y"'),
    "undeclared states": ({"states": Dynamics.states}, r"n is 4, but its states are \(x, y\); name each once, as in"),
    "a name twice": ({"states": ("x", "y", "vx", "vx")}, r"name each once, as in states ="),
    "no control": ({"m": 0}, "m is 0; of 4 states at least 1 and at most 4"),
    "more controls than states": ({"m": 5}, "m is 5; of 4 states"),
    "a block of G": ({"control_block": np.eye(3)}, r"control_block is \(3, 3\); with n = 4, m = 2 it must be \(2, 2\)"),
    "a list": (
        {"control_block": [[1.0, 0.0], [0.0, 1.0]]},
        "control_block is a list; it must be an array or a function",
    ),
    "no inverse": ({"diffusion_block": np.zeros((2, 2))}, "diffusion_block is .* it must have an inverse"),
    "no drift": ({"drift": None}, "drift missing; a Dynamics declares n, m, parameters, drift"),
    "a method": ({"drift": no_drift}, r"drift\(x, p, out\) cannot be called .* make it a @staticmethod"),
    "a method of itself": (
        {"drift": lambda self, x, p, out: None},
        r"drift\(x, p, out\) cannot be called .* make it a @staticmethod",
    ),
    "a row of B": (
        {"diffusion_block": np.ones(2)},
        r"diffusion_block is \(2,\); with n = 4, m = 2 it must be \(2, 2\)",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_system_that_cannot_be_served_is_refused_by_its_class(case: str) -> None:
    changes, remedy = REFUSED[case]
    with pytest.raises(OptionError, match=f"^Boat: .*{remedy}") as caught:
        posed(system(**changes))
    assert "\n" not in str(caught.value)


def test_a_steering_of_other_states_than_the_systems_is_refused_by_both_names() -> None:
    problem = posed(system())
    space = FreeSpace.of(SCENE)
    tree = HomologyTree(space, StraightLine(), rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match=r"^StraightLine connects states of 2 numbers and Boat has 4; .* for Boat$"):
        Controller(problem, space, tree, Sampling(), rng=np.random.default_rng(0))


def test_a_steering_whose_roots_are_no_states_is_refused_by_name() -> None:
    class Skewed(Dubins):
        def roots(self, goal: Array) -> Array:
            return goal[None, :]

    with pytest.raises(OptionError, match=r"^Skewed: n is 3 and its roots are \(1, 2\); .* roots \(k, n\)$"):
        HomologyTree(FreeSpace.of(SCENE), Skewed(), rng=np.random.default_rng(0))


def test_a_control_cost_of_another_shape_is_refused() -> None:
    for R in (np.eye(2), np.float64(1.0), lambda x: np.eye(3)):
        with pytest.raises(OptionError, match=r"^R is .*; Unicycle has m = 1, so it must be \(1, 1\)$"):
            posed(Unicycle(), R)


@pytest.mark.parametrize("q", [np.inf, np.nan, "1", np.ones(2)])
def test_a_cost_rate_that_is_no_finite_number_is_refused(q: Any) -> None:
    with pytest.raises(OptionError, match=r"^q is .*; it must be a finite number, or a function q\(x, p\)"):
        Problem(dynamics=SingleIntegrator(), scene=SCENE, R=np.eye(2), q=q)


@pytest.mark.parametrize("R", [np.zeros((2, 2)), -np.eye(2), np.array([[1.0, 0.5], [0.0, 1.0]])])
def test_a_control_cost_that_is_not_positive_definite_is_refused(R: Array) -> None:
    with pytest.raises(OptionError, match=r"^R is .*; it must be symmetric and positive definite$"):
        Problem(dynamics=SingleIntegrator(), scene=SCENE, R=R)


def test_straight_lines_and_grids_refuse_what_they_do_not_know() -> None:
    class Adrift(SingleIntegrator):
        @staticmethod
        def drift(x: Array, p: Array, out: Array) -> None:
            out[0], out[1] = 2.0, 0.0

    with pytest.raises(OptionError, match=r"^straight lines steer a point .*, not Boat with n = 4 and m = 2; bring a"):
        StraightLine.of(posed(system()))
    with pytest.raises(OptionError, match=r"^no grid solves the dynamics Adrift;"):
        Desirability.of(posed(Adrift()), FreeSpace.of(SCENE))


def test_a_plan_at_what_is_no_state_of_the_system_is_refused() -> None:
    problem, space = posed(SingleIntegrator()), FreeSpace.of(SCENE)
    tree = HomologyTree(space, StraightLine(), rng=np.random.default_rng(0))
    controller = Controller(problem, space, tree, Sampling(), rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match=r"^the state has the shape \(3,\); SingleIntegrator \(x, y\) has 2 numbers$"):
        controller.plan(SCENE.start)


def test_headings_states_and_bounds_follow_from_the_names_of_the_states() -> None:
    trailer = system(n=5, states=("x", "y", "speed", "heading", "t"))
    assert (trailer.angles, SingleIntegrator().angles, Unicycle().angles) == ((3,), (), (2,))
    np.testing.assert_array_equal(trailer.state_of(SCENE.start), [1.0, 2.0, 0.0, 0.3, 0.0])
    np.testing.assert_array_equal(SingleIntegrator().state_of(SCENE.start), SCENE.start[:2])
    np.testing.assert_array_equal(Unicycle().state_of(SCENE.start), SCENE.start)
    lower, upper = trailer.box(SCENE)
    np.testing.assert_array_equal(lower, [0.0, -1.0, -1.0, -np.pi, -1.0])
    np.testing.assert_array_equal(upper, [4.0, 3.0, 1.0, np.pi, 1.0])


def test_differences_of_headings_are_at_most_half_a_turn() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-20, 20, (2, 50, 3))
    off = Unicycle().difference(x, y)
    np.testing.assert_array_equal(off[:, :2], (x - y)[:, :2])
    assert np.abs(off[:, 2]).max() <= np.pi
    np.testing.assert_allclose(np.exp(1j * off[:, 2]), np.exp(1j * (x - y)[:, 2]))
    np.testing.assert_array_equal(Unicycle().difference(x[7], y[7]), off[7])
    np.testing.assert_array_equal(SingleIntegrator().difference(x[:, :2], y[:, :2]), (x - y)[:, :2])
