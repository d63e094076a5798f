"""Samples of a class are shared by two proposals."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.estimation.estimate import Allocation
from pirrht.proposals.proposal import Proposal, Tape

TIMES = np.arange(3.0)


def tape() -> Tape:
    return Tape(TIMES, np.zeros((2, 2)))


def asked(*rows: tuple[str, int]) -> list[Proposal]:
    return [Proposal(lead=tape(), count=count, name=name) for name, count in rows]


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
