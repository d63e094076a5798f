"""Guides of any system: gains are Riccati's, derivatives are exact, and psi is the same whatever is followed."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from batches import led
from discs import disc, scene_of
from guides import best, psi_around, valid
from thoroughly import thorough
from trees import grown
from wind import Balloon

from pirrht import (
    Dynamics,
    FreeSpace,
    HomologyTree,
    OptionError,
    PathIntegral,
    Problem,
    Reference,
    Sampling,
    path_integral,
)
from pirrht.geometry.disc import DISC
from pirrht.proposals.backward_pass import backward_pass
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.guide import DDPGuide, LinearFeedback, empty_course
from pirrht.proposals.proposal import Tape
from pirrht.rollouts.cpu import kind_of
from pirrht.steering.double_integrator import MassSteering
from pirrht.steering.motion import Trajectory, running_cost
from pirrht.steering.straight_line import StraightLine, Tracked
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.rover import Rover
from pirrht.systems.second_order_car import SecondOrderCar, cruising
from sim.mjcf import load
from sim.scenario import prepare

STEP = 0.1


def in_the_open(dynamics: Dynamics) -> PathIntegral:
    """A sampler in a wide empty room."""
    scene = scene_of(start=(0.0, 0.0), goal=(3.0, 1.0, 0.4), lower=(-20.0, -20.0), side=20.0, radius=0.15)
    R = 0.02 * np.linalg.inv(dynamics.B_c(np.zeros(4)) @ dynamics.B_c(np.zeros(4)).T)
    return path_integral(Problem(dynamics=dynamics, scene=scene, R=R), FreeSpace.of(scene), Sampling(dt=STEP))


def test_in_the_open_a_masss_gains_are_those_of_riccatis_recursion():
    """From the Hessian of the time to the goal's rim back, under the exact step of a mass that sways."""
    integral = in_the_open(DoubleIntegrator(b=0.1))
    b, times = 0.1, STEP * np.arange(41)
    push = Trajectory(
        controls=np.tile([1.0, 0.3], (20, 1)), durations=np.full(20, STEP), path=None, cost=2.0, length=3.0
    )
    guide = best(integral.guidance, np.zeros(4), times, 0, push)

    def rim(x: np.ndarray) -> float:
        gap, v = np.array([3.0, 1.0]) - x[:2], x[2:]
        along = gap @ v / np.sqrt(v @ v)
        return float((along - np.sqrt(0.16 - gap @ gap + along**2)) / np.sqrt(v @ v))

    h, unit, end = 2e-4, np.eye(4), guide.states[guide.length]
    corners = ((1, 1), (-1, -1), (1, -1), (-1, 1))
    P = np.array([
        [sum(s * t * rim(end + h * (s * unit[i] + t * unit[j])) for s, t in corners) / (4 * h * h) for j in range(4)]
        for i in range(4)
    ])  # fmt: skip
    A = np.eye(4) + STEP * np.eye(4, k=2)
    C = b * STEP * np.block([
        [0.5 * STEP * np.eye(2), -STEP / np.sqrt(12.0) * np.eye(2)], [np.eye(2), np.zeros((2, 2))]
    ])  # fmt: skip
    for i in range(guide.length - 1, -1, -1):
        stiff = integral.problem.temperature * STEP * np.eye(4) + C.T @ P @ C
        K = -np.linalg.solve(stiff, C.T @ P @ A)
        np.testing.assert_allclose(guide.gains[i], K, atol=2e-4 * np.abs(K).max())
        left = integral.problem.temperature * STEP * np.linalg.inv(stiff)
        if np.linalg.eigvalsh(left).max() <= 1.0:
            np.testing.assert_allclose(guide.share[i] @ guide.share[i], left, atol=1e-4)
        np.testing.assert_allclose(guide.share[i] @ guide.inverse[i], np.eye(4), atol=1e-12)
        assert guide.volume[i] == pytest.approx(np.linalg.slogdet(guide.share[i])[1], abs=1e-10)
        assert np.linalg.eigvalsh(guide.share[i]).max() <= 1.0 + 1e-12
        P = A.T @ P @ A + A.T @ P @ C @ K
        P = 0.5 * (P + P.T)


def test_derivatives_of_a_step_are_those_of_complex_steps():
    """First ones to 1e-7; second ones to 1e-4, against central differences of complex steps. A car that accelerates."""
    integral = in_the_open(SecondOrderCar(b=0.1))
    B, costate = integral.problem.dynamics.B_c(np.zeros(4)), np.array([0.7, -1.2, 0.4, 2.0])

    def step(z: np.ndarray) -> np.ndarray:
        x, a, mean, f = z[:4], B @ z[4:6], z[:4].copy(), np.zeros(4, complex)
        mean[2:] += STEP * (0.5 * a - B @ z[6:] / np.sqrt(12.0))
        f[:2] = mean[3] * np.cos(mean[2]), mean[3] * np.sin(mean[2])
        moved = x + STEP * f
        moved[2:] += STEP * a
        return moved

    def jacobian(z: np.ndarray) -> np.ndarray:
        return np.array([step(z + 1e-30j * e).imag / 1e-30 for e in np.eye(8)]).T

    z = np.array([0.3, -0.4, 0.8, 1.1, 2.0, -3.0, 1.0, 0.5])
    J, S, task = np.zeros((5, 8)), np.zeros((8, 8)), integral.guidance.tasks[1.0]
    assert (task.active, task.curved) == (0b1100, True)
    given = (z[:4], z[4:], STEP, costate)
    forward_pass(kind_of(integral.problem, DISC)).expand(integral.setup, given, task.active, True, J, S)
    np.testing.assert_allclose(J[:4], jacobian(z), atol=1e-7)
    np.testing.assert_allclose(J[4], 0.0, atol=1e-9)
    exact = np.array([costate @ (jacobian(z + 1e-5 * e) - jacobian(z - 1e-5 * e)) / 2e-5 for e in np.eye(8)])
    np.testing.assert_allclose(S, exact, atol=1e-4)


@cache
def beside_a_pillar() -> PathIntegral:
    """A mass before a pillar of radius 0.3 that stands in its way to the goal."""
    scene = scene_of([disc("pillar", 2.0, 1.9, 0.3)], start=(0.5, 2.0), goal=(4.0, 2.0, 0.3), side=(5.0, 4.0))
    problem = Problem(dynamics=DoubleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
    return path_integral(problem, FreeSpace.of(scene), Sampling(dt=STEP, threads=1))


def test_a_backward_pass_knows_what_a_small_step_gains():
    """Put aside by 1 cm, a guide whose paths bow next to the pillar gains 2 e times what is expected, to 5 %."""
    integral, times = beside_a_pillar(), STEP * np.arange(90)
    up = np.array([[1.0, 0.5]] * 10 + [[0.6, -0.55]] * 22)  # past it on the farther side
    push = Trajectory(controls=up, durations=np.full(32, STEP), path=None, cost=3.2, length=3.6)
    guide = valid(integral, np.array([0.5, 2.0, 0.0, 0.0]), times, (0,), push)
    course, trial = (empty_course(len(times) - 1, 4, integral.guidance.width) for _ in range(2))
    off = np.zeros_like(guide.modes)
    off[3, 1], off[9, 1] = 1.0, -1.0
    course.states[0], course.control[:] = guide.states[0], guide.modes + off
    trial.states[0] = guide.states[0]
    task, kind = integral.guidance.tasks[10.0], kind_of(integral.problem, DISC)
    forward, backward = forward_pass(kind).forward, backward_pass(kind)
    steps, _, before = forward(integral.setup, task, times, course, guide.length, 0.0, 4, trial)
    course.states[:], course.control[:] = trial.states, trial.control
    expected = backward(integral.setup, task, times, course, steps, 4, 0.0)
    share = 1e-3
    _, _, after = forward(integral.setup, task, times, course, steps, share, 4, trial)
    assert expected > 1e-3
    assert before - after == pytest.approx(2.0 * share * expected, rel=0.05)


# Where, from these curves, descent at the actual noise level creeps along walls for hundreds of rounds.
@pytest.mark.parametrize("state", [(3.678, 1.202, 3.111), (9.944, -1.841, -1.994), (4.758, -4.111, 3.028)])
def test_a_cold_guide_and_one_continued_from_it_at_the_same_state_agree_in_cost(state):
    """Five continuations gain less than three lambda in all, and none of them leaves its class or touches anything."""
    scenario = prepare("clutter", robot="unicycle", given={"seed": 8, "vertices": 400})
    x, integral = np.array(state), path_integral(scenario.problem, scenario.space, scenario.sampling)
    references = scenario.grown_tree().references(x)
    times = integral.grid(min(running_cost(scenario.problem, x, r.trajectory) for r in references))
    made = 0
    for reference in references:
        key = scenario.space.homology.key(reference.winding)
        cold = best(integral.guidance, x, times, key, reference.trajectory)
        if cold is None:  # a curve that takes longer than any path that weighs anything
            continue
        assert cold.valid
        made += 1
        last: DDPGuide | None = cold
        for _ in range(5):
            last = best(integral.guidance, x, times, key, reference.trajectory, last, 0.0)
            assert last.valid
        assert abs(last.penalised - cold.penalised) < 3.0 * scenario.problem.temperature
    assert made > 0


@cache
def in_slit(robot: str) -> tuple[FreeSpace, HomologyTree, PathIntegral]:
    """A tree in `slit`, and a sampler."""
    scene = load("slit", robot="puck").scene
    if robot == "mass":
        problem, vertices = Problem(dynamics=DoubleIntegrator(b=0.1), scene=scene, R=2 * np.eye(2)), 1000
    else:
        problem = Problem(dynamics=SecondOrderCar(b=0.1), scene=scene, R=np.eye(2), q=cruising, q_min=1.0)
        vertices = 300
    space = FreeSpace.of(scene)
    tree = grown(space, (MassSteering if robot == "mass" else Tracked).of(problem), vertices, limit=0.6)
    return space, tree, path_integral(problem, space, Sampling(dt=0.1, draws="independent", threads=1))


def led_to(robot: str, x: np.ndarray, reference: Reference) -> tuple[np.ndarray, DDPGuide]:
    """Times and the guide of a reference."""
    integral = in_slit(robot)[2]
    times = integral.grid(running_cost(integral.problem, x, reference.trajectory))
    return times, valid(integral, x, times, reference.winding, reference.trajectory)


@pytest.mark.parametrize(
    ("robot", "x"),
    [
        ("mass", (1.0, 2.5, 0.0, 0.0)), ("mass", (0.5, 0.5, 0.0, 0.0)), ("mass", (1.0, 3.5, 0.5, 0.8)),
        ("car", (1.0, 2.5, 0.0, 0.0)), thorough("car", (2.0, 4.0, -1.0, 1.0)),
    ],
)  # fmt: skip
def test_psi_does_not_depend_on_what_is_followed(robot, x):
    """Tape, guide, guide put aside with weaker gains, and tape and guide together; seeds 1, 2, ..."""
    (_, tree, integral), x, mass = in_slit(robot), np.array(x), robot == "mass"
    reference = tree.references(x)[0]
    times, guide = led_to(robot, x, reference)
    off, gains = ((0.02, -0.02, 0.0, 0.03), 0.7) if mass else ((0.02, -0.02, 0.05, 0.03), 0.8)
    aside = LinearFeedback(replace(guide, states=guide.states + np.array(off), gains=gains * guide.gains))
    tape, led = Tape(times, reference.trajectory.tape(times) if mass else guide.tape), LinearFeedback(guide)
    followed = [(tape,), (led,), (aside,), (tape, led)] if mass else [(led,), (aside,), (led, tape)]
    counts = [20_000 if mass else 20_000 // len(leads) for leads in followed]
    found = [psi_around(integral, x, times, *row) for row in zip(followed, counts, range(1, 5), strict=False)]
    for (one, its, _), (other, error, _) in combinations(found, 2):
        assert abs(one - other) < 3.0 * np.hypot(its, error)
    assert all(error < (0.1 if mass else 0.15) for _, error, _ in found)
    assert not mass or found[1][1] < 0.01


def test_a_car_that_faces_away_is_turned_about():
    """At rest with its back to the slit: every class has a guide, none of which stays behind the start."""
    (_, tree, _), x = in_slit("car"), np.array([1.0, 2.5, 3.0, 0.0])
    for reference in tree.references(x):
        _, guide = led_to("car", x, reference)
        assert guide.states[guide.length, 0] > 4.5


def test_a_pace_that_the_cost_does_not_tell_must_be_declared():
    mass = in_slit("mass")[2].problem
    with pytest.raises(OptionError, match=r"cost of DoubleIntegrator does not tell how fast .* give a pace"):
        Tracked.of(mass)
    assert Tracked.of(mass, 0.8).cost_per_meter == pytest.approx(1.0 / 0.8)  # a mass on its way needs no control
    with pytest.raises(OptionError, match="the pace of references is -1; it must be a positive number"):
        Tracked.of(mass, -1.0)


ROVER = [(0.0, 0.0, 3.0), (1.5, 0.9, 0.5), (2.2, 0.2, -2.0)]
MASS = [(0, 0, 0, 0), (0, 0, -1.0, 0.5), (1.5, 0.9, 1.0, 0), (1.9, 1.7, 0, -2.0)]
FROM = [*((Rover(b=0.1), x) for x in ROVER), *((DoubleIntegrator(b=0.1), x) for x in MASS)]


@pytest.mark.parametrize(("system", "x"), FROM)
def test_homing_brings_a_rover_and_a_mass_into_the_goal_from_anywhere(system, x):
    """Noise 0.1, q / lambda = 50: the disc around (2, 1) of radius 0.3 within 6 s, a rover at no more than 1 m/s.

    If it lies behind a rover, backwards all the way.
    """
    state, a = np.array(x, dtype=float), np.zeros(2)
    way = 1.0 if np.array([np.cos(x[2]), np.sin(x[2])]) @ (np.array([2.0, 1.0]) - x[:2]) > 0.0 else -1.0
    for _ in range(600):
        system.homing(state, system.parameters, system.B_c(state), (2.0, 1.0), 0.3, 50.0, a)
        u = system.input_of(state, a)
        assert isinstance(system, DoubleIntegrator) or -1e-12 <= way * u[0] <= 1.0 + 1e-12
        state = system.step(state, u, np.zeros(2), 0.01)
        if np.hypot(state[0] - 2.0, state[1] - 1.0) < 0.3:
            return
    pytest.fail(f"still at {state}")


AT = np.array([0.5, 1.0])


def around_a_post(dynamics: Dynamics, **sampling: object) -> PathIntegral:
    """A sampler in a room of 3 x 2 m with a post below the way."""
    scene = scene_of([disc("post", 1.4, 0.7, 0.1)], start=AT, goal=(2.5, 1.0, 0.3), side=(3.0, 2.0))
    B = dynamics.B_c(AT)
    problem = Problem(dynamics=dynamics, scene=scene, R=0.02 * np.linalg.inv(B @ B.T))
    return path_integral(problem, FreeSpace.of(scene), Sampling(draws="independent", threads=1, **sampling))


def straight_guide(integral: PathIntegral, times: np.ndarray) -> tuple[Trajectory, DDPGuide]:
    """The reference over ground at 1 m/s to the rim of the goal, and its guide."""
    steering = StraightLine(pace=1.0, cost_rate=2.0)
    way = steering.trajectory(steering.connect(AT, np.array([2.2, 1.0])))
    way = replace(way, controls=way.controls - integral.problem.dynamics.f(AT))
    return way, valid(integral, AT, times, (0,), way)


@pytest.mark.thorough
def test_the_control_of_a_point_in_the_wind_is_the_slope_of_its_value():
    """u = -R^-1 dv/dx by differences of 0.02 m on one stream of noise, within 0.1 m/s; 20 000 samples, seed 4."""
    integral = around_a_post(Balloon(), first=0.01)
    times = integral.grid(4.0)
    lead = LinearFeedback(straight_guide(integral, times)[1])

    def at(x: np.ndarray) -> object:
        return integral.estimate(led(integral, x, times, lead, count=20_000, seed=4))

    slope = [(at(AT + h).value - at(AT - h).value) / 0.04 for h in 0.02 * np.eye(2)]
    middle = at(AT)
    assert np.all(middle.control_error < 0.05)
    np.testing.assert_allclose(middle.control, -np.linalg.solve(integral.problem.control_cost(AT), slope), atol=0.1)
