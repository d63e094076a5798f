"""What a plan leaves out, by the time that is left."""

from __future__ import annotations

import pytest

from pirrht.control.settings import TUNING, TimeBudget

WHOLE, FEW = 0.1, TUNING.few_vertices


def budget(share: float = 1.0) -> TimeBudget:
    """A budget of which a share is left."""
    times = iter([WHOLE])
    return TimeBudget(lambda: next(times, share * WHOLE))


def test_without_a_limit_nothing_is_left_out():
    unlimited = TimeBudget()
    assert not unlimited.short()
    assert not unlimited.enough(FEW)
    assert unlimited.most_classes(4) is None


@pytest.mark.parametrize(("share", "short"), [(0.31, False), (0.29, True), (-0.1, True)])
def test_time_is_short_when_a_share_of_what_was_left_is(share: float, short: bool):
    assert budget(share).short() == short


@pytest.mark.parametrize("classes", [1, 3, 16])
def test_after_a_plan_that_fits_just_so_there_is_time_for_as_many_classes_and_else_for_fewer(classes: int):
    spent = TUNING.before_samples
    assert budget(1.0 - 0.999 * spent).most_classes(classes) == classes
    assert budget(1.0 - 1.3 * spent).most_classes(classes) == max(1, int(classes / 1.3))
    assert budget(-10.0).most_classes(classes) == 1
