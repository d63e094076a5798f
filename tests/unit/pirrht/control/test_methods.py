"""Methods differ in what they make of references and samples; MPPI is the path integral of one warm sequence."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from batches import batch_of
from closed_forms import SEEDS, annulus, disc_entry, within
from discs import block, scene_of
from moving import hall, moved
from trees import grown, point

from pirrht import Controller, Estimate, FreeSpace, HomologyTree, OptionError, Problem, Sampling
from pirrht.control.baselines import Mppi, alone, class_values, follow_best
from pirrht.control.run_state import ClassShares
from pirrht.control.settings import SAMPLING
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.steering.motion import step_means
from pirrht.steering.straight_line import StraightLine, Tracked
from pirrht.systems.rover import Rover
from sim.drive import episode
from sim.drive.metrics import EpisodeMetrics, TimedPlan


def noisy(slit) -> Problem:
    """The problem that `around_all` samples."""
    return slit.with_settings(noise=0.3).problem


def around_all(slit, tree: HomologyTree, samples: int = 150, **settings) -> tuple[Estimate, list[str]]:
    """Samples around every reference of the slit at the start, in one batch."""
    integral = slit.with_settings(samples=samples, noise=0.3, **settings).controller(tree).path_integral
    references = tree.references(slit.start)
    times = integral.grid(min(r.cost for r in references))
    tapes = np.array([r.trajectory.tape(times) for r in references])
    corners = [np.vstack([r.trajectory.path.start[1:, :2], slit.space.scene.goal.center]) for r in references]
    names = {slit.space.homology.key(r.winding): r.id for r in references}
    counts = [samples, samples // 2, samples]
    batch = batch_of(integral, slit.start, times, tapes, corners=corners, counts=counts, classes=names)
    return integral.sample(batch, 5), [r.id for r in references]


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
        weight = np.exp(weight - part.paths.log_ratio[own, h]) * (part.paths.outcome[own] == 1)
        result = alone(noisy(slit), estimate, h, {})
        assert result.log_psi == pytest.approx(np.log(weight.mean()), rel=1e-12)
        expected = weight @ part.paths.now[own] / (weight @ part.paths.span[own])
        np.testing.assert_allclose(result.control, expected + estimate.push, rtol=1e-9)
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
        shares = ClassShares(followed=followed)
        follow_best(noisy(slit), estimate, batch, shares, consistency)
        assert shares.followed == names[expected]


@pytest.mark.parametrize("method", [*SAMPLING, "mppi"])
def test_equal_seeds_mean_equal_plant_noise_whatever_the_method(slit, slit_tree: HomologyTree, method: str):
    scenario = slit.with_settings(method=method, samples=40, max_time=0.05, seed=4)
    tree = slit_tree if method in SAMPLING else None
    rng = scenario.plant_rng()
    frames = episode.run(scenario.plant(), scenario.controller(tree), scenario.start, rng, max_time=0.05)
    again = np.random.default_rng(np.random.SeedSequence(4).spawn(3)[2]).standard_normal((25, 2))
    np.testing.assert_array_equal(np.vstack([frame.advance.noise for frame in frames]), np.sqrt(0.002) * again)


def test_only_what_takes_back_nine_tenths_of_the_weight_is_a_reversal(slit, slit_tree: HomologyTree):
    """Shares are martingales under the exact law: they cross one half often, and go from 0.9 to 0.1 once in nine."""
    scenario = slit.with_settings(samples=60, noise=0.3)
    rng = scenario.plant_rng()
    (frame,) = episode.run(scenario.plant(), scenario.controller(slit_tree), slit.start, rng, max_time=0.01)
    metrics = EpisodeMetrics(scenario, slit.start, period=0.01, max_time=1.0)
    for share in (0.5, 0.95, 0.4, 0.2, 0.95, 0.6, 0.08, 0.45, 0.02, 0.6, 0.91):
        plan = replace(frame.plan, shares={"0,0": share, "1,0": 1.0 - share})
        metrics.frame(TimedPlan(plan=plan, plan_seconds=0.0), frame.advance)
    assert (metrics.class_switches, metrics.class_reversals) == (4, 2)


B, RADIUS = 0.3, 0.3


def test_a_tape_that_finds_no_survivor_goes_on_shifted_by_the_time_that_passed(slit):
    scenario = slit.with_settings(noise=1.0)
    sampling = Sampling(dt=0.05, samples=60, guide="open-loop")
    mppi = Mppi(scenario.problem, slit.space, sampling, horizon=0.5, rng=np.random.default_rng(1))
    first, middle = mppi.plan(slit.start), np.array([3.4, 2.5])
    assert first.fallback is None
    for k, (elapsed, steps) in enumerate(((0.05, 1), (0.1, 3))):
        mppi.observe(middle[None], elapsed)
        plan = mppi.plan(middle)
        assert plan.fallback == "no survivor", k
        np.testing.assert_allclose(plan.tape[:-steps], first.tape[steps:], atol=1e-12)
        assert np.all(plan.tape[-steps:] == 0.0)
        np.testing.assert_array_equal(plan.control, plan.tape[0])


def test_part_of_a_step_shifts_a_tape_by_its_share():
    times, tape = np.array([0.0, 1.0, 2.0, 3.0]), np.array([[1.0], [2.0], [5.0]])
    np.testing.assert_allclose(step_means(tape, np.diff(times), times, times + 0.25), [[1.25], [2.75], [3.75]])


def test_there_are_at_least_as_many_samples_as_around_the_references(slit, slit_tree: HomologyTree):
    scenario = slit.with_settings(method="mppi")
    assert scenario.controller(None).path_integral.sampling.samples >= 200 * len(slit_tree.references(slit.start))
    assert slit.with_settings(method="mppi", classes=2).controller(None).path_integral.sampling.samples == 400


def test_what_mppi_does_not_have_is_refused(slit):
    with pytest.raises(OptionError, match="open-loop"):
        Mppi(slit.problem, slit.space, slit.sampling, rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match="horizon is -1; it must be a positive number of seconds"):
        Mppi(slit.problem, slit.space, Sampling(guide="open-loop"), horizon=-1.0, rng=np.random.default_rng(0))
    with pytest.raises(OptionError, match="--horizon is 0"):
        slit.with_settings(horizon=0.0)


@pytest.mark.slow
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
    return disc_entry(annulus(B, RADIUS)[0], B, RADIUS, np.maximum(np.hypot(*states[:, :2].T), RADIUS))[0]


@pytest.mark.slow
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


@cache
def alone_in_a_room(b: float) -> Controller:
    """A rover in an empty square of 3 m whose goal is 1.8 m away, in the middle of its height."""
    scene = scene_of([], start=(0.6, 1.5), goal=(2.4, 1.5), side=3.0)
    problem, space = Problem(dynamics=Rover(b=b), scene=scene, R=np.diag([2.0, 0.5])), FreeSpace.of(scene)
    tree = grown(space, Tracked.of(problem), 200, limit=0.6)
    return Controller(problem, space, tree, Sampling(samples=1000, threads=1), rng=np.random.default_rng(1))


@pytest.mark.slow
@pytest.mark.parametrize("b", [0.1, 0.2])
def test_where_two_valleys_are_worth_the_same_v_is_lambda_ln_2_below_that_of_one(b):
    """Across from the goal turning left and driving ahead costs what turning right and reversing does.

    Within 3 standard errors of three plans of 1000 samples: of both, and around each guide alone.
    """
    controller, x = alone_in_a_room(b), np.array([0.6, 1.5, np.pi / 2])
    controller.begin(x)
    batch = controller.batch(x, controller.tree.references(x))
    assert len(batch.proposals) == 2
    values = []
    for seed, proposals in enumerate([batch.proposals, batch.proposals[:1], batch.proposals[1:]]):
        whole = [replace(one, count=1000) for one in proposals]
        estimate = controller.path_integral.sample(replace(batch, proposals=tuple(whole)), seed)
        values.append((estimate.value, estimate.value_error))
    (v, error), *single = values
    gain = controller.problem.temperature * np.log(2.0)
    for one, its in single:
        assert abs(one - gain - v) < 3.0 * np.hypot(error, its)
        assert gain > 4.0 * np.hypot(error, its)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_both_optima_are_sampled_where_noise_makes_them_alike(seed: int):
    """To pass a bar before it comes down, or to pass below its end later."""
    rows = [(0.0, 2.19, 3.28, -2.86), (0.91, 2.43, 2.95, -1.67), (1.82, 2.27, 2.32, -0.48), (2.58, 2.14, 1.80, -0.86)]
    scene = hall("sweeper", [moved("bar", rows, block("bar", 0.0, 0.0, (0.46, 0.07)))], goal=(4.23, 2.735))
    controller, x = point(scene, 0.2, 600, seed=seed, samples=300, threads=1), np.array([0.38, 1.447])
    controller.begin(x, 0.758)
    assert controller.plan(x).estimate is not None
    [(own, other)] = [optima for optima in controller.run.starts.optima.values() if len(optima) > 1]
    assert own.log_ratio_to(other) > 3.0
    assert own.penalised == pytest.approx(other.penalised, abs=3.0 * controller.problem.temperature)
