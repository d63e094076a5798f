"""References without controls: the tree knows positions alone, guides make them feasible, and psi does not mind."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discs import disc
from guides import best
from moving import hall, moved
from scooter import Scooter
from thoroughly import first, thorough

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.errors import OptionError
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.steering.motion import running_cost
from pirrht.steering.steering import Steering
from pirrht.steering.straight_line import Tracked
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.second_order_car import SecondOrderCar, cruising, towards_goal
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from sim.mjcf import load


def scene() -> Scene:
    return load("slit", robot="puck").scene


def car(b: float = 0.1) -> Problem:
    return Problem(dynamics=SecondOrderCar(b=b), scene=scene(), R=np.eye(2), q=cruising, q_min=1.0)


def scooter() -> Problem:
    return Problem(dynamics=Scooter(), scene=scene(), R=np.diag([2.0, 0.5]))


@cache
def grown() -> tuple[Problem, FreeSpace, HomologyTree, PathIntegral]:
    """A problem in `slit`, its tree of positions and a sampler."""
    problem = car()
    space = FreeSpace.of(problem.scene)
    tree = HomologyTree(space, Tracked.of(problem), limit=0.6, rng=np.random.default_rng(0))
    tree.grow(300)
    return problem, space, tree, path_integral(problem, space, Sampling(dt=0.1, draws="independent", threads=1))


def guided(x: Array, reference: Reference) -> tuple[Array, DDPGuide | None]:
    """The grid of the rollouts from x (n,), and a guide."""
    problem, space, _, integral = grown()
    times = integral.grid(running_cost(problem, x, reference.trajectory))
    assert isinstance(integral.guidance, DDPGuidance)
    return times, best(integral.guidance, x, times, space.homology.key(reference.winding), reference.trajectory)


def mean_and_error(log_weight: Array) -> tuple[float, float, float]:
    """log psi, its standard error and the share of effective samples."""
    top = log_weight.max()
    w = np.exp(log_weight - top)
    spread = float(w.std() / w.mean() / np.sqrt(len(w)))
    return float(top + np.log(w.mean())), spread, float(w.mean() ** 2 / (w**2).mean())


def sampled(x: Array, times: Array, leads: tuple[ProposalControl, ...], seed: int) -> tuple[float, float, float]:
    proposals = tuple(Proposal(lead=lead, count=20_000 // len(leads)) for lead in leads)
    return mean_and_error(grown()[3].rollout(Batch(state=x, times=times, proposals=proposals), seed).log_weight)


def test_the_tree_knows_positions_and_references_are_the_same_whatever_else_a_state_has():
    _, _, tree, _ = grown()
    assert tree.states.shape[1] == 2
    found = tree.references(np.array([1.0, 2.5, 0.0, 0.0]))
    again = tree.references(np.array([1.0, 2.5, 2.0, 0.9]))
    assert [one.id for one in found] == [one.id for one in again]
    assert {one.id for one in found} == {"0,0", "0,1", "-1,0"}
    for one, other in zip(found, again, strict=True):
        assert one.cost == other.cost == pytest.approx(2.0 * one.length)
        assert one.trajectory.controls.shape[1] == 2
        assert not np.any(one.trajectory.controls)


def test_the_pace_is_where_a_meter_costs_least():
    open_to = scene()
    point = Problem(dynamics=SingleIntegrator(), scene=open_to, R=2 * np.eye(2), q=4.0)
    driver = Problem(dynamics=Unicycle(V=1.7), scene=open_to, R=np.eye(1))
    assert Tracked.of(point).pace == pytest.approx(2.0)  # sqrt(2 q / r)
    assert Tracked.of(point).cost_per_meter == pytest.approx(4.0)  # sqrt(2 q r)
    assert Tracked.of(driver).pace == pytest.approx(1.7)
    assert Tracked.of(car()).pace == pytest.approx(1.0, rel=2e-3)  # the least of (1 + v^2) / v
    assert Tracked.of(car()).cost_per_meter == pytest.approx(2.0, rel=1e-5)
    assert Tracked.of(scooter()).slack == pytest.approx(0.5 * np.pi)  # half a turn at the rate sqrt(2 q / r) = 2


def test_a_pace_that_the_cost_does_not_tell_must_be_declared():
    mass = Problem(dynamics=DoubleIntegrator(), scene=scene(), R=2 * np.eye(2))
    with pytest.raises(OptionError, match=r"cost of DoubleIntegrator does not tell how fast .* declare a pace"):
        Tracked.of(mass)
    assert Tracked.of(mass, 0.8).pace == 0.8
    assert Tracked.of(mass, 0.8).cost_per_meter == pytest.approx(1.0 / 0.8)  # a mass on its way needs no control
    with pytest.raises(OptionError, match="the pace of references is -1; it must be a positive number"):
        Tracked.of(mass, -1.0)


def test_open_loop_samples_of_such_references_follow_the_nominal_controls_of_their_guides():
    problem, space, tree, _ = grown()
    open_loop = Sampling(dt=0.1, guide="open-loop")
    controller = Controller(problem, space, tree, open_loop, rng=np.random.default_rng(0))
    plan = controller.plan(problem.dynamics.state_of(problem.scene.start))
    assert plan.estimate is not None
    assert plan.estimate.survivors > 0


def test_a_tree_of_positions_without_steering_for_the_system_is_refused_still():
    problem, space, _, _ = grown()

    class Plain(Steering):
        n = 2
        distance = connect = sample = None  # type: ignore[assignment]

        def roots(self, goal: Array) -> Array:
            return goal[None]

    Plain.__abstractmethods__ = frozenset()
    tree = HomologyTree(space, Plain(), rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match="Plain connects states of 2 numbers and SecondOrderCar has 4"):
        Controller(problem, space, tree, Sampling(dt=0.1), rng=np.random.default_rng(0))


@pytest.mark.parametrize("seed", first(range(4)))
def test_guides_of_a_car_are_of_their_references_class_and_dearer_than_the_taut_way_at_the_best_pace(seed):
    """From random states at any heading: q + u'Ru/2 is at least 1 + v^2, and that at least 2 |v|."""
    _, space, tree, _ = grown()
    rng = np.random.default_rng(seed)
    valid = total = 0
    while total < 8:
        x = np.array(
            [*rng.uniform(space.scene.lower, space.scene.upper), rng.uniform(-3.0, 3.0), rng.uniform(-0.3, 1.0)]
        )
        if space.clearance(x) < 0.05 or space.scene.goal.contains(x[:2]):
            continue
        for reference in tree.references(x):
            _, guide = guided(x, reference)
            total += 1
            if guide is None or not guide.valid:
                continue
            valid += 1
            assert guide.cost > 2.0 * reference.length - 0.15  # taut but for what the field's certificate costs
            assert np.all([space.clearance(state) > 0.0 for state in guide.states[: guide.length + 1]])
            travelled = np.diff(guide.states[: guide.length + 1, :2], axis=0)
            assert np.hypot(*travelled.T).sum() > reference.length - 0.1 - 0.2
    assert valid >= total - 1


@pytest.mark.parametrize(
    "x",
    [np.array([1.0, 2.5, 0.0, 0.0]), thorough(np.array([2.0, 4.0, -1.0, 1.0]))],
    ids=["car at rest", "car under way"],
)
def test_psi_does_not_depend_on_what_was_tracked(x):
    """Guide, guide put aside with weaker gains, and it with the guide's tape: within 3 errors. Seeds 1 to 3."""
    _, _, tree, _ = grown()
    times, guide = guided(x, tree.references(x)[0])
    assert guide is not None
    assert guide.valid
    off = np.array([0.02, -0.02, 0.05, 0.03])[: len(x)]
    aside = replace(guide, states=guide.states + off, gains=0.8 * guide.gains)
    both = (LinearFeedback(guide), Tape(times, guide.tape))
    found = [
        sampled(x, times, leads, k)
        for k, leads in enumerate([(LinearFeedback(guide),), (LinearFeedback(aside),), both], 1)
    ]
    for i, (one, its, _) in enumerate(found):
        assert its < 0.15
        for other, error, _ in found[:i]:
            assert abs(one - other) < 3.0 * np.hypot(its, error)


def test_a_car_that_faces_away_is_turned_about():
    """At rest with its back to the slit: every class has a guide, none of which stays behind the start."""
    x = np.array([1.0, 2.5, 3.0, 0.0])
    for reference in grown()[2].references(x):
        _, guide = guided(x, reference)
        assert guide is not None
        assert guide.valid
        assert guide.states[guide.length, 0] > 4.5


@pytest.mark.parametrize("x", [(0.0, 0.0, 0.5, -0.3), (0.0, 0.0, 0.2, -1.0), (3.0, 1.2, 0.1, -0.5)])
def test_homing_lets_a_car_that_reverses_towards_the_goal_go_on_so(x):
    """Into the disc of radius 0.3 m, 2 m further left, within 6 s, never faster than 1 m/s and never ahead."""
    car, state, a, h = SecondOrderCar(b=0.1), np.array(x), np.zeros(2), 0.01
    goal = (x[0] - 2.0, 0.0)
    for _ in range(600):
        towards_goal(state, np.zeros(0), car.B_c(state), goal, 0.3, 50.0, a)
        state = car.step(state, car.input_of(state, a), np.zeros(2), h)
        assert -1.0 - 1e-9 <= state[3] < 0.0
        if np.hypot(state[0] - goal[0], state[1] - goal[1]) < 0.3:
            return
    pytest.fail(f"still at {state}")


def test_a_way_is_tracked_as_if_no_body_were_near_whatever_the_time():
    """Where a body is matters to the guide that is made of it; here one stands across the whole of the way."""
    start, end = np.array([[1.0, 2.5]]), np.array([[5.5, 2.5]])

    def course(y: float) -> Array:
        room = hall(
            "hall", [moved("walker", [(0.0, 3.0, y, 0.0), (6.0, 3.0, y - 0.5, 0.0)], disc("disc", 0.0, 0.0, 0.4))]
        )
        problem = Problem(dynamics=SecondOrderCar(b=0.3), scene=room, R=np.eye(2), q=cruising, q_min=1.0)
        integral, steering = (
            path_integral(problem, FreeSpace.of(room), Sampling(dt=0.1, threads=1)),
            Tracked.of(problem),
        )
        assert isinstance(integral.guidance, DDPGuidance)
        way, times = steering.trajectory(steering.connect(start, end)), 0.1 * np.arange(60)
        made, length = integral.guidance.starts.tracked(np.array([1.0, 2.5, 0.0, 1.0]), way, times)
        assert length > 40
        return made.states[:length]

    across = course(2.7)
    np.testing.assert_array_equal(across, course(4.5))
    np.testing.assert_allclose(across[:, 1], 2.5, atol=1e-6)
