"""Systems and scenes that the method cannot serve are refused by name; noise through inputs."""

from dataclasses import replace

import numpy as np
import pytest
from by_inputs import Driven, PushedMass, around_a_disc, driven
from discs import scene_of

from pirrht import (
    Ball,
    Controller,
    Desirability,
    Dubins,
    Dynamics,
    FreeSpace,
    HomologyTree,
    NotLinearlySolvable,
    OptionError,
    Problem,
    Sampling,
    Scene,
    SceneError,
    SingleIntegrator,
    SpaceLine,
    StraightLine,
    TurnAndGo,
    Unicycle,
    grown_tree,
)
from pirrht.control.cost_to_go import cost_to_go, straight_lines
from pirrht.proposals.proposal import Batch
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.dynamics import no_drift
from pirrht.systems.rover import Rover

SCENE = scene_of(start=(1.0, 2.0, 0.3), goal=(3.0, 0.0, 0.2), lower=(0.0, -1.0), side=(4.0, 3.0))


def made(name: str, body) -> Dynamics:
    """A system of a class of some name, without drift and parameters unless there are some."""

    def twist(self: Dynamics, x: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return rate

    usual = {"parameters": np.zeros(0), "drift": staticmethod(no_drift), "twist": twist}
    system: Dynamics = type(name, (Dynamics,), usual | body)()
    return system


def boat(**changes) -> Dynamics:
    """A double integrator, whose class is called Boat, but for what is changed."""
    m = changes.get("m", 2)
    blocks = {"control_block": np.eye(m), "diffusion_block": 0.1 * np.eye(m)}
    return made("Boat", {"n": 4, "m": m, "states": ("x", "y", "vx", "vy")} | blocks | changes)


def posed(dynamics: Dynamics, R=None) -> Problem:
    return Problem(dynamics=dynamics, scene=SCENE, R=np.eye(dynamics.m) if R is None else R)


METHOD = r"drift\(x, p, out\) cannot be called .* make it a @staticmethod"
REFUSED = {
    "a height": ({"states": ("x", "y", "z", "vx")}, r'"z" is a third position'),
    "a line": ({"n": 1, "m": 1, "states": ("x",)}, "at least the 2 states x and y"),
    "y before x": ({"states": ("y", "x", "vx", "vy")}, r'\(y, x, vx, vy\); the first two must be "x" and "y"'),
    "undeclared states": ({"states": Dynamics.states}, r"n is 4, but its states are \(x, y\); name each once, as in"),
    "a name twice": ({"states": ("x", "y", "vx", "vx")}, r"name each once, as in states ="),
    "no control": ({"m": 0}, "m is 0; of 4 states at least 1 and at most 4"),
    "more controls than states": ({"m": 5}, "m is 5; of 4 states"),
    "a block of G": ({"control_block": np.eye(3)}, r"control_block is \(3, 3\); with n = 4, m = 2 it must be \(2, 2\)"),
    "a list": ({"control_block": [[1.0, 0.0]]}, "control_block is a list; it must be an array or a function"),
    "no inverse": ({"diffusion_block": np.zeros((2, 2))}, "diffusion_block is .* it must have an inverse"),
    "no drift": ({"drift": None}, "drift missing; a Dynamics declares n, m, parameters, drift"),
    "a method": ({"drift": no_drift}, METHOD),
    "a method of itself": ({"drift": lambda self, x, p, out: None}, METHOD),
    "row of B": ({"diffusion_block": np.ones(2)}, r"diffusion_block is \(2,\); with n = 4, m = 2 it must be \(2, 2\)"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_system_that_cannot_be_served_is_refused_by_its_class(case: str) -> None:
    changes, remedy = REFUSED[case]
    with pytest.raises(OptionError, match=f"^Boat: .*{remedy}") as caught:
        posed(boat(**changes))
    assert "\n" not in str(caught.value)


def test_a_steering_of_other_states_than_the_systems_is_refused_by_both_names() -> None:
    problem = posed(boat())
    space = FreeSpace.of(SCENE)
    tree = HomologyTree(space, StraightLine(), rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match=r"^StraightLine connects states of 2 numbers and Boat has 4; .* for Boat$"):
        Controller(problem, space, tree, Sampling(), rng=np.random.default_rng(0))


def test_a_steering_whose_roots_are_no_states_is_refused_by_name() -> None:
    class Skewed(Dubins):
        def roots(self, goal: np.ndarray) -> np.ndarray:
            return goal[None, :]

    with pytest.raises(OptionError, match=r"^Skewed: n is 3 and its roots are \(1, 2\); .* roots \(k, n\)$"):
        HomologyTree(FreeSpace.of(SCENE), Skewed(), rng=np.random.default_rng(0))


def test_a_control_cost_of_another_shape_is_refused() -> None:
    for R in (np.eye(2), np.float64(1.0), lambda x: np.eye(3)):
        with pytest.raises(OptionError, match=r"^R is .*; Unicycle has m = 1, so it must be \(1, 1\)$"):
            posed(Unicycle(), R)


@pytest.mark.parametrize("q", [np.inf, np.nan, "1", np.ones(2)])
def test_a_cost_rate_that_is_no_finite_number_is_refused(q) -> None:
    with pytest.raises(OptionError, match=r"^q is .*; it must be a finite number, or a function q\(x, p\)"):
        Problem(dynamics=SingleIntegrator(), scene=SCENE, R=np.eye(2), q=q)


@pytest.mark.parametrize("R", [np.zeros((2, 2)), -np.eye(2), np.array([[1.0, 0.5], [0.0, 1.0]])])
def test_a_control_cost_that_is_not_positive_definite_is_refused(R: np.ndarray) -> None:
    with pytest.raises(OptionError, match=r"^R is .*; it must be symmetric and positive definite$"):
        Problem(dynamics=SingleIntegrator(), scene=SCENE, R=R)


def test_straight_lines_and_grids_refuse_what_they_do_not_know() -> None:
    class Adrift(SingleIntegrator):
        @staticmethod
        def drift(x: np.ndarray, p: np.ndarray, out: np.ndarray) -> None:
            out[0], out[1] = 2.0, 0.0

    for problem, steering in (
        (posed(boat()), "Boat .* Tracked"),
        (posed(Rover(), np.diag([2.0, 0.5])), "Rover .* Tracked"),
    ):
        says = rf"^straight lines steer a point .*, not {steering}.of\(problem\), or bring a"
        with pytest.raises(OptionError, match=says):
            StraightLine.of(problem)
    with pytest.raises(OptionError, match=r"^a disc needs no room to turn; take Tracked.of\(problem\)"):
        TurnAndGo.of(problem)
    with pytest.raises(OptionError, match=r"^no grid solves the dynamics Adrift;"):
        Desirability.of(posed(Adrift()), FreeSpace.of(SCENE))


def test_what_is_no_state_of_the_system_is_refused_wherever_a_state_is_asked_for() -> None:
    problem, space = posed(SingleIntegrator()), FreeSpace.of(SCENE)
    tree = HomologyTree(space, StraightLine(), rng=np.random.default_rng(0))
    controller = Controller(problem, space, tree, Sampling(), rng=np.random.default_rng(0))
    blank = Desirability(problem=problem, space=space, spacing=1.0, dt=None, grid=None, evaluate=None, gain=np.eye(2))
    batch = Batch(state=SCENE.start, times=np.arange(3.0), proposals=())

    system = r"SingleIntegrator \(x, y\)"
    for ask, owner in (
        (controller.plan, system), (controller.begin, system), (lambda x: controller.step(x, 0.1), system),
        (lambda x: controller.observe([x], 0.1), system), (lambda x: controller.expect(x, 0.1), system),
        (lambda x: controller.path_integral.rollout(replace(batch, state=x), 0), system),
        (blank.value, system), (blank.control, system), (blank.shares, system), (tree.references, "StraightLine"),
        (tree.too_fast, "StraightLine"), (lambda x: grown_tree(space, StraightLine(), x), "StraightLine"),
    ):  # fmt: skip
        for x in (SCENE.start, [1.0], "here", [np.nan, 1.0]):
            with pytest.raises(OptionError, match=rf"^the state is .*; {owner} takes 2 finite numbers$"):
                ask(x)
    with pytest.raises(OptionError, match=r"^the state is \(1\); a robot in .* takes 2 finite numbers"):
        space.clearance(np.ones(1))


def test_a_tree_for_a_state_in_a_wall_is_refused_with_the_walls_name() -> None:
    voxels = np.zeros((12, 8, 6), dtype=bool)
    voxels[5:7, :, :4] = True
    scene = Scene.from_voxels(voxels, 0.5, start=(1, 2, 1), goal=(5, 2, 1, 0.4), robot_radius=0.2)
    lines = SpaceLine.of(Problem(dynamics=Ball(), scene=scene, R=np.eye(3)))
    walls = Scene.from_boxes(
        [[1, 1, 2, 2]], lower=(0, 0), upper=(4, 4), start=(3, 3), goal=(0.5, 3, 0.3), robot_radius=0.2
    )
    for task, steering, x, says in (
        (scene, lines, [3.0, 2.0, 1.0], r'\(3, 2, 1\) is in collision .* lacks 0.2 m to "block 1"'),
        (scene, lines, [3.0, 2.0, 9.0], "lies outside the workspace"),
        (walls, StraightLine(), [1.5, 1.5], r'\(1.5, 1.5\) is in collision .* lacks 0.2 m to "box 1"'),
    ):
        with pytest.raises(SceneError, match=says):
            grown_tree(FreeSpace.of(task), steering, x)


def test_headings_states_and_bounds_follow_from_the_names_of_the_states() -> None:
    trailer = boat(n=5, states=("x", "y", "speed", "heading", "t"))
    assert (trailer.angles, SingleIntegrator().angles, Unicycle().angles) == ((3,), (), (2,))
    np.testing.assert_array_equal(trailer.state_of(SCENE.start), [1.0, 2.0, 0.0, 0.3, 0.0])
    np.testing.assert_array_equal(SingleIntegrator().state_of(SCENE.start), SCENE.start[:2])
    np.testing.assert_array_equal(Unicycle().state_of(SCENE.start), SCENE.start)
    lower, upper = trailer.box(SCENE)
    np.testing.assert_array_equal(lower, [0.0, -1.0, -1.0, -np.pi, -1.0])
    np.testing.assert_array_equal(upper, [4.0, 3.0, 1.0, np.pi, 1.0])


def test_differences_of_headings_are_at_most_half_a_turn() -> None:
    x, y = np.random.default_rng(0).uniform(-20, 20, (2, 50, 3))
    off = Unicycle().difference(x, y)
    np.testing.assert_array_equal(off[:, :2], (x - y)[:, :2])
    assert np.abs(off[:, 2]).max() <= np.pi
    np.testing.assert_allclose(np.exp(1j * off[:, 2]), np.exp(1j * (x - y)[:, 2]))
    np.testing.assert_array_equal(Unicycle().difference(x[7], y[7]), off[7])
    np.testing.assert_array_equal(SingleIntegrator().difference(x[:, :2], y[:, :2]), (x - y)[:, :2])


X = np.array([0.3, -0.2, 0.7])
PAPERS = {"input_matrix": None, "control_block": np.eye(2), "diffusion_block": np.eye(2)}


def cart(**changes) -> Dynamics:
    """A car driven by speed and turn rate, whose class is called Cart, but for what is changed."""
    form = {"input_matrix": staticmethod(Driven.input_matrix), "input_noise": np.diag([0.5, 1.0])}
    return made("Cart", {"n": 3, "m": 2, "states": ("x", "y", "heading")} | form | changes)


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
        (PAPERS, "input_noise belongs to the input form; leave it out, or declare an input_matrix"),
        (PAPERS | {"input_noise": None, "stratonovich": True}, "stratonovich belongs to the input form"),
    ],
)
def test_an_input_form_that_is_none_is_refused_by_name(changes, told):
    with pytest.raises(OptionError, match=f"^Cart: {told}"):
        Problem(dynamics=cart(**changes), scene=around_a_disc(), R=np.diag([2.0, 0.5]))


@pytest.mark.parametrize(
    ("dynamics", "R", "told"),
    [
        (cart(), (2.0, 2.0), r"Cart: .* R\^-1 = s s' .*R\^-1 = \[\[0.5, 0\], .*s s' = \[\[0.25, 0\], .*choose R"),
        (SingleIntegrator(b=0.5), (1.0, 2.0), r".* G R\^-1 G' = \[\[1, 0\], \[0, 0.5\]\], B B' = \[\[0.25, 0\], "),
    ],
)
def test_noise_and_cost_without_a_common_lambda_are_refused_with_both_matrices(dynamics, R, told):
    with pytest.raises(NotLinearlySolvable, match=f"^{told}") as caught:
        posed(dynamics, np.diag(R))
    assert "\n" not in str(caught.value)


def test_lambda_is_what_turns_the_inverse_of_the_cost_into_the_noise():
    s = np.array([[0.5, 0.2], [0.1, 0.4]])
    problem = Problem(dynamics=cart(input_noise=s), scene=around_a_disc(), R=0.3 * np.linalg.inv(s @ s.T))
    assert problem.temperature == pytest.approx(0.3)


def test_controls_and_noise_units_turn_into_each_other_in_both_forms():
    u = np.array([0.7, -0.3])
    for d, x in ((Driven(), X), (PushedMass(), np.array([*X, 0.1])), (DoubleIntegrator(b=0.1), np.array([*X, 0.1]))):
        a = d.to_noise(x, u)
        np.testing.assert_allclose(d.noise_gain(x) @ u, a, rtol=1e-12)
        np.testing.assert_allclose(d.input_of(x, a), u, rtol=1e-12)
        np.testing.assert_allclose(d.B_c(x) @ a, d.G_c(x) @ u, rtol=1e-12)
        assert d.B_c(x).shape == d.G_c(x).shape == (d.rows, d.m)


@pytest.mark.parametrize("stratonovich", [False, True])
def test_a_step_goes_along_the_heading_of_its_start_or_of_its_middle(stratonovich):
    u, dw, h = np.array([0.8, 1.5]), np.array([0.02, -0.1]), 0.1
    d = Driven(stratonovich)
    way, turn = h * u + np.array([0.5, 1.0]) * dw
    heading = X[2] + (0.5 * turn if stratonovich else 0.0)
    moved = X + np.array([way * np.cos(heading), way * np.sin(heading), turn])
    np.testing.assert_allclose(d.step(X, u, dw, h), moved, rtol=1e-12)


def test_the_cost_to_go_is_that_at_the_best_speed_along_the_heading():
    """sqrt(2 q r) per meter, whatever turning would cost."""
    point, x = Problem(dynamics=SingleIntegrator(b=0.5), scene=around_a_disc(), R=2.0 * np.eye(2)), [0.8, -0.6, 1.0]
    for problem in (driven(), point):
        beyond = cost_to_go(problem, straight_lines(problem.scene.goal))(np.array([x[: problem.dynamics.n]]))
        assert beyond[0] == pytest.approx(np.sqrt(2.0 * 2.0) * 0.5)
