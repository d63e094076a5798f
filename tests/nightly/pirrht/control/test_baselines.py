"""Best class and MPPI against all classes and closed forms; several local optima of one class."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from closed_forms import SEEDS, annulus, disc_entry, wave_number, within
from discs import block, scene_of
from moving import hall, moved
from scipy.special import k0
from trees import grown
from unit.pirrht.control.test_methods import RADIUS, B

from pirrht.control.baselines import Mppi
from pirrht.control.controller import Controller
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.in_time import InTime
from pirrht.steering.straight_line import StraightLine, Tracked
from pirrht.systems.rover import Rover
from pirrht.systems.single_integrator import SingleIntegrator


def test_where_there_is_one_class_the_best_of_them_is_what_all_of_them_say():
    problem, space = annulus(0.3)
    tree = HomologyTree(space, StraightLine(), limit=0.6, rng=np.random.default_rng(0))
    plans = {}
    for method in ("pi-rrht", "best-class"):
        sampling = Sampling(samples=100, first=0.01)
        controller = Controller(problem, space, tree, sampling, method=method, rng=np.random.default_rng(3))
        plans[method] = [controller.plan(problem.scene.start[:2])]
        controller.observe(np.array([[1.19, 0.01]]), 0.01)
        plans[method].append(controller.plan(np.array([1.19, 0.01])))
    for one, other in zip(*plans.values(), strict=True):
        np.testing.assert_allclose(one.control, other.control, rtol=1e-9)
        np.testing.assert_allclose(one.tape, other.tape, rtol=1e-9, atol=1e-12)
        assert one.estimate.value == pytest.approx(other.estimate.value, rel=1e-12)
        nearby = one.state + 0.003
        np.testing.assert_allclose(one.at(nearby, 0.004), other.at(nearby, 0.004), rtol=1e-9)


def exact_beyond(states):
    """The value of entering the disc of `annulus`, as the cost behind the horizon."""
    problem, _ = annulus(B, RADIUS)
    k = wave_number(problem, B)
    r = np.maximum(np.hypot(*states[:, :2].T), RADIUS)
    return -problem.temperature * np.log(k0(k * r) / k0(k * RADIUS))


def test_with_the_exact_cost_to_go_value_and_control_are_exact():
    problem, space = annulus(B, RADIUS)
    x, sampling = np.array([1.0, 0.0]), Sampling(dt=0.02, samples=1500, guide="open-loop", draws="independent")
    psi, controls, sizes = [], [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        mppi = Mppi(problem, space, sampling, horizon=0.4, terminal_cost=exact_beyond, rng=rng)
        plans = [mppi.plan(x) for _ in range(2)]  # the second around the tape that the first found
        psi.append([np.exp(plan.estimate.log_psi) for plan in plans])
        sizes.append([plan.estimate.ess for plan in plans])
        controls.append(plans[1].control)
    value, speed = disc_entry(problem, B, RADIUS, 1.0)
    assert within(psi, np.exp(-value / problem.temperature))
    cold, after = np.median(sizes, axis=0)
    assert after > 4.0 * cold  # a warm start is the better proposal
    assert within(controls, [-speed, 0.0])


# -- local optima --------------------------------------------------------------------------------------------------


@cache
def alone_in_a_room(b: float) -> Controller:
    """A rover in an empty square of 3 m whose goal is 1.8 m away, in the middle of its height."""
    scene = scene_of([], start=(0.6, 1.5), goal=(2.4, 1.5), side=3.0)
    problem = Problem(dynamics=Rover(b=b), scene=scene, R=np.diag([2.0, 0.5]))
    space = FreeSpace.of(scene)
    tree = grown(space, Tracked.of(problem), 200, limit=0.6)
    return Controller(problem, space, tree, Sampling(samples=1000, threads=1), rng=np.random.default_rng(1))


@pytest.mark.parametrize("b", [0.1, 0.2])
def test_where_two_valleys_are_worth_the_same_v_is_lambda_ln_2_below_that_of_one(b):
    """Across from the goal turning left and driving ahead costs what turning right and reversing does.

    Within 3 standard errors of three plans of 1000 samples: of both, and around each guide alone.
    """
    controller, x = alone_in_a_room(b), np.array([0.6, 1.5, np.pi / 2])
    controller.begin(x)
    batch = controller.batch(x, controller.tree.references(x))
    assert len(batch.proposals) == 2
    integral, values = controller.path_integral, []
    for seed, proposals in enumerate([batch.proposals, batch.proposals[:1], batch.proposals[1:]]):
        whole = [replace(one, count=1000) for one in proposals]
        estimate = integral.sample(replace(batch, proposals=tuple(whole)), seed)
        values.append((estimate.value, estimate.value_error))
    (v, error), *single = values
    gain = controller.problem.temperature * np.log(2.0)
    for one, its in single:
        assert abs(one - gain - v) < 3.0 * np.hypot(error, its)
        assert gain > 4.0 * np.hypot(error, its)


@pytest.mark.parametrize("seed", range(3))
def test_both_optima_are_sampled_where_noise_makes_them_alike(seed: int):
    """To pass a bar before it comes down, or to pass below its end later."""
    rows = [(0.0, 2.19, 3.28, -2.86), (0.91, 2.43, 2.95, -1.67), (1.82, 2.27, 2.32, -0.48), (2.58, 2.14, 1.80, -0.86)]
    scene = hall("sweeper", [moved("bar", rows, block("bar", 0.0, 0.0, (0.46, 0.07)))], goal=(4.23, 2.735))
    problem, space = Problem(dynamics=SingleIntegrator(b=0.2), scene=scene, R=2.0 * np.eye(2)), FreeSpace.of(scene)
    tree = grown(space, InTime(), 600, seed=seed)
    controller = Controller(problem, space, tree, Sampling(samples=300, threads=1), rng=np.random.default_rng(1))
    x = np.array([0.38, 1.447])
    controller.begin(x, 0.758)
    assert controller.plan(x).estimate is not None
    [(own, other)] = [optima for optima in controller.run.memory.optima.values() if len(optima) > 1]
    assert own.log_ratio_to(other) > 3.0
    assert own.penalised == pytest.approx(other.penalised, abs=3.0 * problem.temperature)
