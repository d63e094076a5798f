"""MPPI is the path integral of one warm-started tape: exact with the exact cost-to-go, shifted as time passes."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import annulus

from pirrht.control.baselines import Mppi, shifted, straight_home
from pirrht.errors import OptionError
from pirrht.estimation.sampling import Sampling
from pirrht.planner.tree import HomologyTree
from pirrht.steering.motion import running_cost
from pirrht.steering.straight_line import StraightLine
from sim.scenario import Scenario

B, RADIUS = 0.3, 0.3


def test_without_a_cost_behind_the_horizon_nothing_is_found():
    problem, space = annulus(B, RADIUS)
    sampling = Sampling(samples=200, guide="open-loop")
    mppi = Mppi(
        problem, space, sampling, horizon=0.2, terminal_cost=lambda states: np.full(len(states), np.inf),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    plan = mppi.plan(np.array([1.2, 0.0]))
    assert plan.fallback == "no survivor"
    assert np.all(plan.control == 0.0)


def test_a_tape_that_finds_no_survivor_goes_on_shifted_by_the_time_that_passed(slit: Scenario):
    scenario = slit.with_settings(noise=1.0)
    sampling = Sampling(dt=0.05, samples=60, guide="open-loop")
    mppi = Mppi(scenario.problem, slit.space, sampling, horizon=0.5, rng=np.random.default_rng(1))
    first = mppi.plan(slit.start)
    assert first.fallback is None
    tape = first.tape
    middle = np.array([3.4, 2.5])
    for k, (elapsed, steps) in enumerate(((0.05, 1), (0.1, 3))):
        mppi.observe(middle[None], elapsed)
        plan = mppi.plan(middle)
        assert plan.fallback == "no survivor", k
        np.testing.assert_allclose(plan.tape[:-steps], tape[steps:], atol=1e-12)
        assert np.all(plan.tape[-steps:] == 0.0)
        np.testing.assert_array_equal(plan.control, plan.tape[0])


def test_part_of_a_step_shifts_a_tape_by_its_share():
    times, tape = np.array([0.0, 1.0, 2.0, 3.0]), np.array([[1.0], [2.0], [5.0]])
    np.testing.assert_allclose(shifted(times, tape, times + 0.25), [[1.25], [2.75], [3.75]])


def test_the_way_home_costs_what_the_straight_reference_does(slit: Scenario):
    beyond = straight_home(slit.problem)
    line, goal = StraightLine.of(slit.problem), slit.space.scene.goal
    tail = goal.center + np.array([[1.0, 0.4]])
    reference = line.trajectory(line.connect(tail, goal.center[None]))
    assert beyond(tail)[0] == pytest.approx(running_cost(slit.problem, tail[0], reference) - 2.0 * goal.radius)
    assert beyond(goal.center[None])[0] == 0.0


def test_there_are_at_least_as_many_samples_as_around_the_references(slit: Scenario, slit_tree: HomologyTree):
    scenario = slit.with_settings(method="mppi")
    assert scenario.mppi().path_integral.sampling.samples >= 200 * len(slit_tree.references(slit.start))
    assert slit.with_settings(method="mppi", classes=2).mppi().path_integral.sampling.samples == 400


def test_what_mppi_does_not_have_is_refused(slit: Scenario):
    with pytest.raises(OptionError, match="open-loop"):
        Mppi(slit.problem, slit.space, slit.sampling, rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match="horizon is -1 s"):
        Mppi(slit.problem, slit.space, Sampling(guide="open-loop"), horizon=-1.0, rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match="--horizon is 0"):
        slit.with_settings(horizon=0.0)
