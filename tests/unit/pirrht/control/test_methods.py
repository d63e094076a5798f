"""Methods differ in what they make of references and samples, and in nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from batches import batch_of

from pirrht.control.baselines import alone, class_values, follow_best
from pirrht.control.policy import ClassMemory
from pirrht.control.settings import SAMPLING
from pirrht.estimation.estimate import Estimate
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, Proposal, Tape
from sim.drive import episode
from sim.drive.metrics import EpisodeMetrics, TimedPlan
from sim.scenario import Scenario


def noisy(slit: Scenario) -> Problem:
    """The problem that `around_all` samples."""
    return slit.with_settings(noise=0.3).problem


def around_all(slit: Scenario, tree: HomologyTree, samples: int = 150, **settings) -> tuple[Estimate, list[str]]:
    """Samples around every reference of the slit at the start, in one batch."""
    controller = slit.with_settings(samples=samples, noise=0.3, **settings).controller(tree)
    integral, x = controller.path_integral, slit.start
    references = tree.references(x)
    times = integral.grid(min(r.cost for r in references))
    tapes = np.array([r.trajectory.tape(times) for r in references])
    corners = [np.vstack([r.trajectory.path.start[1:, :2], slit.space.scene.goal.center]) for r in references]
    names = {slit.space.homology.key(r.winding): r.id for r in references}
    counts = [samples, samples // 2, samples]
    batch = batch_of(integral, x, times, tapes, corners=corners, counts=counts, classes=names)
    estimate = integral.sample(batch, 5)
    return estimate, [r.id for r in references]


def test_the_plain_average_of_the_paper_is_the_mean_over_what_each_class_says_alone(slit, slit_tree):
    estimate, _ = around_all(slit, slit_tree, weights="average")
    each = -class_values(noisy(slit), estimate) / noisy(slit).temperature
    assert np.logaddexp.reduce(each) - np.log(len(each)) == pytest.approx(estimate.log_psi, rel=1e-12)
    for h, log_psi in enumerate(each):
        assert alone(noisy(slit), estimate, h).log_psi == pytest.approx(log_psi, rel=1e-12)


def test_alone_a_class_says_what_its_own_samples_would(slit, slit_tree):
    """Drawn around one reference only, the same paths have the same weights."""
    estimate, names = around_all(slit, slit_tree)
    part = estimate.parts[0]
    for h in range(len(names)):
        own = slice(*part.tables.first[h : h + 2])
        weight = -part.paths.work[own] / noisy(slit).temperature + part.paths.log_survival[own]
        weight = np.exp(weight - part.paths.log_ratio[own, h])
        weight *= part.paths.outcome[own] == 1
        result = alone(noisy(slit), estimate, h, {})
        assert result.log_psi == pytest.approx(np.log(weight.mean()), rel=1e-12)
        expected = weight @ part.paths.now[own] / (weight @ part.paths.span[own])
        push = estimate.push
        np.testing.assert_allclose(result.control, expected + push, rtol=1e-9)
        assert result.proposal_weights[h] == pytest.approx(1.0)


def test_the_best_class_has_the_least_value_unless_another_is_followed_that_is_nearly_as_good(slit, slit_tree):
    estimate, names = around_all(slit, slit_tree)
    values = class_values(noisy(slit), estimate)
    best, second = np.argsort(values)[:2]
    ratio, tape = values[best] / values[second], Tape(np.arange(2.0), np.zeros((1, 2)))
    proposals = tuple(Proposal(lead=tape, count=1, name=name, key=k) for k, name in enumerate(names))
    batch = Batch(state=slit.start, times=tape.times, proposals=proposals)
    for followed, consistency, expected in (
        (None, 0.8, best), (names[best], 0.8, best), (names[second], 0.999 * ratio, second),
        (names[second], 1.001 * ratio, best), ("9,9", 0.1, best),
    ):  # fmt: skip
        memory = ClassMemory(followed=followed)
        follow_best(noisy(slit), estimate, batch, memory, consistency)
        assert memory.followed == names[expected]


# -- all of them -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [*SAMPLING, "mppi"])
def test_equal_seeds_mean_equal_plant_noise_whatever_the_method(slit: Scenario, slit_tree: HomologyTree, method: str):
    scenario = slit.with_settings(method=method, samples=40, max_time=0.05, seed=4)
    tree = slit_tree if method in SAMPLING else None
    frames = episode.run(
        scenario.plant(), scenario.controller(tree), scenario.start, scenario.plant_rng(), max_time=0.05
    )
    noise = np.vstack([frame.advance.noise for frame in frames])
    steps = len(noise)
    assert steps == 25
    again = np.random.default_rng(np.random.SeedSequence(4).spawn(3)[2])
    np.testing.assert_array_equal(noise, np.sqrt(0.002) * again.standard_normal((steps, 2)))


def test_only_what_takes_back_nine_tenths_of_the_weight_is_a_reversal(slit: Scenario, slit_tree: HomologyTree):
    """Shares are martingales under the exact law: they cross one half often, and go from 0.9 to 0.1 once in nine."""
    scenario = slit.with_settings(samples=60, noise=0.3)
    (frame,) = episode.run(
        scenario.plant(), scenario.controller(slit_tree), slit.start, scenario.plant_rng(), max_time=0.01
    )
    metrics = EpisodeMetrics(scenario, slit.start, period=0.01, max_time=1.0)
    for share in (0.5, 0.95, 0.4, 0.2, 0.95, 0.6, 0.08, 0.45, 0.02, 0.6, 0.91):
        plan = replace(frame.plan, shares={"0,0": share, "1,0": 1.0 - share})
        metrics.frame(TimedPlan(plan=plan, plan_seconds=0.0), frame.advance)
    assert (metrics.class_switches, metrics.class_reversals) == (4, 2)
