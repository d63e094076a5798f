"""How samples are shared out, when there are enough, and the shape of the tail of their weights."""

from types import SimpleNamespace

import numpy as np
import pytest
from batches import batch_of
from closed_forms import at_strip, in_strip, straight
from scipy.stats import genpareto

from pirrht import Controller, HomologyTree
from pirrht.estimation.estimate import Allocation, Estimate
from pirrht.estimation.sampling import TUNING
from pirrht.estimation.weights import deviation, heavy, tail_shape
from pirrht.proposals.proposal import Proposal, Tape


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


def test_the_controller_shares_samples_out_by_promises_and_then_by_contributions(slit, slit_tree: HomologyTree):
    def drawn(controller: Controller) -> list[int]:
        return np.diff(controller.plan(slit.start).estimate.rollouts.tables.first).tolist()

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


def test_sampling_goes_on_doubling_until_the_control_is_known_or_the_budget_is_spent():
    def until(**options) -> list[int]:
        integral = in_strip(dt=0.1, samples=50, guide="open-loop", threads=1, **options)
        x = np.array([0.2, 0.0])
        times = integral.grid(2.0 * (0.5 - x[0]))
        tapes, corners = straight(x, [np.array([side, 0.0]) for side in (0.5, -0.5)], times)
        estimate = integral.sample(batch_of(integral, x, times, tapes, corners=corners), 3)
        drawn = [part.size // 2 for part in estimate.parts]
        if options["target"] > 1e-6:
            assert estimate.control_error.max() <= options["target"]
        return drawn

    assert until(target=10.0) == [50]
    found = until(target=0.05)
    assert found == [50, *(50 * 2**k for k in range(len(found) - 1))]
    assert len(found) > 2
    assert until(target=1e-9) == [50, 50, 100, 200, 400]  # 16 N
    assert (until(target=1e-9, budget=130), until(target=1e-9, budget=50)) == ([50, 50, 30], [50])


@pytest.mark.parametrize("shape", [-0.3, 0.0, 0.3, 0.6, 0.9, 1.3])
@pytest.mark.parametrize("log_scale", [-800.0, 0.0])
def test_weights_of_a_known_shape_are_told_it(shape, log_scale):
    """20 times 20 000 weights, seed 0: within three standard errors of its mean, and of the pull to one half."""
    rng = np.random.default_rng(0)
    drawn = [np.log(genpareto.rvs(shape, size=20_000, random_state=rng)) + log_scale for _ in range(20)]
    found = np.array([tail_shape(one) for one in drawn])
    pull = 10.0 * (0.5 - shape) / (3.0 * np.sqrt(20_000) + 10.0)
    assert abs(np.mean(found) - shape - pull) < 3.0 * np.std(found, ddof=1) / np.sqrt(20) + 0.01


def test_who_died_counts_for_the_number_of_samples_alone():
    z = np.random.default_rng(2).normal(size=5000)
    assert tail_shape(np.concatenate([z, np.full(5000, -np.inf)])) == pytest.approx(
        tail_shape(np.concatenate([z, np.full(5000, -50.0)])), abs=1e-9
    )


@pytest.mark.parametrize("weights", [np.zeros(0), np.zeros(10), np.full(100, -np.inf), np.zeros(1000)])
def test_of_few_or_equal_weights_no_shape_is_told(weights):
    assert np.isnan(tail_shape(weights))
    assert not heavy(tail_shape(weights), len(weights))


def test_few_samples_stand_less_of_a_tail():
    assert heavy(0.65, 500)
    assert not heavy(0.65, 5000)
    assert heavy(0.71, 10**6)


def assert_cautious(estimates: list[Estimate]) -> None:
    """Errors of v and u count the largest term several times: no less than the spread, which 300 plans tell to 4 %."""
    found = np.array([[e.value, *e.control] for e in estimates])
    errors = np.array([[e.value_error, *e.control_error] for e in estimates])
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / found.std(axis=0, ddof=1)
    assert np.all(ratio > 0.88), ratio
    assert np.all(ratio < 1.9), ratio


@pytest.mark.slow
@pytest.mark.parametrize("counts", [[400, 400], [400, 150]], ids=["equal counts", "unequal counts"])
@pytest.mark.parametrize("weights", ["balance", "average"])
def test_the_reported_error_covers_the_spread_of_300_repeats(weights, counts):
    integral = in_strip(dt=0.05, first=0.0125, guide="open-loop", weights=weights)
    assert_cautious([at_strip(integral, 0.2, (1, -1), seed, counts=counts) for seed in range(300)])


@pytest.mark.slow
def test_the_reported_error_covers_the_spread_of_300_plans_in_the_slit(slit, slit_tree: HomologyTree):
    controller = slit.with_settings(noise=0.1, samples=200).controller(slit_tree)
    assert_cautious([controller.plan(slit.start).estimate for _ in range(300)])


@pytest.mark.slow
@pytest.mark.parametrize("weights", ["balance", "average"])
def test_unequal_counts_leave_the_mean_of_psi_over_1000_repeats(weights):
    integral = in_strip(dt=0.1, guide="open-loop", weights=weights, threads=1)

    def psi(counts: list[int]) -> np.ndarray:
        return np.exp([at_strip(integral, 0.2, (1, -1), seed, counts=counts).log_psi for seed in range(1000)])

    equal = psi([50, 50])
    for counts in ([85, 15], [15, 85]):
        other = psi(counts)
        assert abs(other.mean() - equal.mean()) <= 3.0 * np.sqrt((equal.var(ddof=1) + other.var(ddof=1)) / 1000), counts
