"""How samples are shared out and what the estimates say about their own errors.

The strip |x| < L, left at no cost, has a closed form (see test_path_integral). Its estimates here come from seeds
0, 1, ...; "within so many standard errors" refers to the spread over these seeds.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from batches import batch_of

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Allocation, Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import TUNING, Sampling
from pirrht.estimation.weights import deviation
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.proposal import Proposal, Tape
from pirrht.steering.straight_line import StraightLine
from pirrht.systems.single_integrator import SingleIntegrator
from sim.scenario import Scenario

HALF, NOISE = 0.5, 0.5  # of the strip: half its width L [m], b [m/sqrt(s)]
X = np.array([0.2, 0.0])


@pytest.fixture(scope="module")
def strip() -> tuple[Problem, FreeSpace]:
    """A corridor with a goal that nobody finds."""
    scene = Scene(
        name="strip", lower=np.array([-HALF, -25.0]), upper=np.array([HALF, 25.0]), obstacles=(),
        goal=Goal(center=np.array([0.45, 24.9]), radius=5e-4), start=np.zeros(3), robot_radius=0.1,
    )  # fmt: skip
    return Problem(dynamics=SingleIntegrator(b=NOISE), scene=scene, R=2.0 * np.eye(2), q=1.0, phi=0.0), FreeSpace.of(
        scene
    )


def both_sides(integral: PathIntegral) -> tuple[Array, Array, list[Array]]:
    """Steps, tapes and corners of a reference to each side of the strip."""
    times = integral.grid(2.0 * (HALF - X[0]))
    steering, ends = StraightLine(pace=1.0), [np.array([side * HALF, 0.0]) for side in (1.0, -1.0)]
    tapes = np.array([steering.trajectory(steering.connect(X, end)).tape(times) for end in ends])
    corners = [np.array([X + 20.0 * (end - X)]) for end in ends]
    return times, tapes, corners


def to_both_sides(integral: PathIntegral, seed: int, **options) -> Estimate:
    """Around a reference to each side of the strip."""
    times, tapes, corners = both_sides(integral)
    return integral.estimate(integral.rollout(batch_of(integral, X, times, tapes, corners=corners, **options), seed))


@pytest.mark.parametrize("paired", [False, True])
def test_the_spread_of_a_sum_is_that_of_its_independent_terms_and_more_of_the_largest(paired):
    """Twelve terms around one reference and eight around another, one by one or in pairs; numbers of seed 0."""
    terms, first = np.random.default_rng(0).normal(size=(20, 3)), np.array([0, 12, 20])
    variance, largest = np.zeros(3), np.zeros(3)
    for part in (terms[:12], terms[12:]):
        alone = part.reshape(-1, 2, 3).sum(axis=1) if paired else part
        squares = (alone - alone.mean(axis=0)) ** 2 * len(alone) / (len(alone) - 1)
        variance, largest = variance + squares.sum(axis=0), np.maximum(largest, squares.max(axis=0))
    np.testing.assert_allclose(deviation(terms, first, paired), np.sqrt(variance + TUNING.outlying * largest))


def learn(allocation: Allocation, **contributions: float) -> None:
    """Learn from an estimate to whose weight a single sample per class contributes."""
    rollouts = SimpleNamespace(tables=SimpleNamespace(first=np.arange(len(contributions) + 1)))
    weight = np.array([*contributions.values()])
    batch = SimpleNamespace(proposals=[SimpleNamespace(name=name) for name in contributions])
    allocation.learn(batch, SimpleNamespace(rollouts=rollouts, weight=weight, proposal_weights=weight.tolist()))


def test_samples_go_where_they_contribute_and_none_goes_without():
    allocation = Allocation()
    assert allocation.counts(["a", "b", "c"], [0.0] * 3, [True] * 3, 200) == [200, 200, 200]
    learn(allocation, a=0.9, b=0.1)
    assert allocation.counts(["a", "b"], [0.0] * 2, [True] * 2, 200) == [336, 64]  # 30 each, and 9 : 1 of what is left
    shares = allocation.counts(["a", "b", "c"], [0.0] * 3, [True] * 3, 200)
    assert sum(shares) == 600
    assert shares[1] < shares[2] < shares[0]  # a new class counts as an average one
    learn(allocation, a=0.0, b=1.0)
    assert allocation.counts(["a", "b"], [0.0] * 2, [True] * 2, 200)[0] > 200  # one plan is not enough to change sides
    for _ in range(20):
        learn(allocation, a=0.0, b=1.0)
    assert allocation.counts(["a", "b"], [0.0] * 2, [True] * 2, 200)[0] == pytest.approx(30, abs=5)


def test_the_controller_shares_samples_out_by_promises_and_then_by_contributions(
    slit: Scenario, slit_tree: HomologyTree
):
    def drawn(controller: Controller) -> list[int]:
        estimate = controller.plan(slit.start).estimate
        assert estimate is not None
        return np.diff(estimate.rollouts.tables.first).tolist()

    adaptive, equal = (
        slit.with_settings(noise=0.2, samples=100, allocation=rule).controller(slit_tree)
        for rule in ("contribution", "equal")
    )
    assert drawn(equal) == drawn(equal) == [100, 100, 100]
    first = drawn(adaptive)
    assert sum(first) == 300
    assert first[0] > first[1] > 15  # the slit is promised more
    second = drawn(adaptive)
    assert sum(second) == 300
    assert second[0] > 200  # the slit carries all the weight
    assert min(second) >= 15
    adaptive.begin(slit.start)
    assert drawn(adaptive) == first


def asked(*rows: tuple[str, int]) -> list[Proposal]:
    return [Proposal(lead=tape(), count=count, name=name) for name, count in rows]


def tape() -> Tape:
    return Tape(np.arange(3.0), np.zeros((2, 2)))


def test_classes_that_are_worth_more_than_a_few_samples_have_some_next_to_their_guides_and_none_is_lost():
    ways = [tape(), tape(), tape()]
    allocation = Allocation()
    allocation.shares["b"] = np.array([0.8, 0.2])
    found = allocation.split(asked(("a", 700), ("b", 50), ("c", 30)), lambda k: [ways[k]])
    assert [(one.name, one.count) for one in found] == [("a", 350), ("b", 40), ("c", 30), ("a", 350), ("b", 10)]
    assert [one.lead for one in found[3:]] == ways[:2]


@pytest.mark.parametrize("count", [2, 8, 30])
def test_equal_counts_are_split_however_few_samples_there_are(count):
    found = Allocation().split(asked(("a", count), ("b", count)), lambda k: [tape()])
    assert [one.count for one in found] == [count // 2] * 4


def test_sampling_goes_on_doubling_until_the_control_is_known_or_the_budget_is_spent(strip):
    def until(**options) -> list[int]:
        settings = Sampling(dt=0.1, samples=50, guide="open-loop", threads=1, **options)
        integral = path_integral(*strip, settings)
        times, tapes, corners = both_sides(integral)
        estimate = integral.sample(batch_of(integral, X, times, tapes, corners=corners), 3)
        drawn = [part.size // 2 for part in estimate.parts]
        if options["target"] > 1e-6:
            assert estimate.control_error.max() <= options["target"]
        return drawn

    assert until(target=10.0) == [50]
    found = until(target=0.05)
    assert found == [50, *(50 * 2**k for k in range(len(found) - 1))]
    assert len(found) > 2
    assert until(target=1e-9) == [50, 50, 100, 200, 400]  # 16 N
    assert until(target=1e-9, budget=130) == [50, 50, 30]
    assert until(target=1e-9, budget=50) == [50]
