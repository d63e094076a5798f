"""Best class and MPPI: one class is all of them; MPPI is exact with the exact cost-to-go, at any horizon."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import SEEDS, annulus, disc_entry, wave_number, within
from scipy.special import k0
from unit.pirrht.control.test_mppi import RADIUS, B

from pirrht.control.baselines import Mppi
from pirrht.control.controller import Controller
from pirrht.estimation.sampling import Sampling
from pirrht.planner.tree import HomologyTree
from pirrht.steering.straight_line import StraightLine


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
