"""Rounds of a weak plan: the laws of the last one were known before its samples, and it alone is weighed."""

import numpy as np
import pytest
from corners import START, controller

from pirrht.control import proposals
from pirrht.control.settings import TimeBudget
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch

SAMPLES = 60
ONE_WAY = (1.0, -2.0, 2.0, 0.0)  # a box that leaves one class


def first_plan(monkeypatch, last: int | None = None):
    """The batch that a first plan weighs, its estimate, numbers of its rounds; round `last` has another seed."""
    made, numbers, seed_of = controller(None, ONE_WAY, samples=SAMPLES, least=1e6), [], proposals.round_seed

    def seed(own: int, number: int) -> int:
        numbers.append(number)
        return seed_of(own, number) + (number == last)

    made.path_integral.tuning = made.path_integral.tuning._replace(first_plan=16)
    monkeypatch.setattr(proposals, "round_seed", seed)
    assert made.tree is not None
    draft = made.proposals.draft(START, made.tree.references(START), made.run, TimeBudget())
    batch, estimate = made.proposals.estimate(draft, 7, made.run, TimeBudget())
    monkeypatch.undo()
    assert estimate is not None
    assert made.run.starts.fits
    return batch, estimate, numbers


def guides_of(batch: Batch) -> list[DDPGuide]:
    return [one.lead.guide for one in batch.proposals if isinstance(one.lead, LinearFeedback)]


@pytest.mark.slow
def test_the_laws_of_a_weak_plan_do_not_depend_on_the_samples_that_it_is_weighed_by(monkeypatch):
    batch, estimate, numbers = first_plan(monkeypatch)
    assert len(numbers) > 3
    again, other, _ = first_plan(monkeypatch, last=numbers[-1])
    assert estimate.value != other.value
    assert [one.count for one in batch.proposals] == [one.count for one in again.proposals]
    assert len(guides_of(batch)) > 1
    for one, two in zip(guides_of(batch), guides_of(again), strict=True):
        for name in ("states", "modes", "gains", "share"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    earlier, *_ = first_plan(monkeypatch, last=numbers[-2])  # on samples of the round before they do
    assert any(
        not np.array_equal(one.modes, two.modes) for one, two in zip(guides_of(batch), guides_of(earlier), strict=True)
    )


def test_the_cheapest_class_gets_a_guide_even_if_it_was_postponed():
    made = controller(None, ONE_WAY, samples=SAMPLES)
    assert made.tree is not None
    references = made.tree.references(START)
    made.run.retries.postpone(references[0].id, 99)
    assert guides_of(made.proposals.draft(START, references, made.run, TimeBudget()).batch)


def test_a_weak_plan_is_weighed_by_its_last_round_alone(monkeypatch):
    batch, estimate, numbers = first_plan(monkeypatch)
    drawn = sum(part.size for part in estimate.parts)
    assert drawn == sum(batch.counts)
    assert numbers == list(range(len(numbers)))
    assert drawn >= SAMPLES * 2 ** (len(numbers) - 2)
