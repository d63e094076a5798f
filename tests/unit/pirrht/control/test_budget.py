"""What a plan leaves out, by the time that is left."""

from __future__ import annotations

import pytest

from pirrht.control.settings import TUNING, TimeBudget

WHOLE, FEW = 0.1, TUNING.few_vertices
FIT = TUNING.before_samples * WHOLE  # time in which two plans must have got ready to sample [s]


def budget(share: float = 1.0) -> TimeBudget:
    """A budget of which a share is left."""
    times = iter([WHOLE])
    return TimeBudget(lambda: next(times, share * WHOLE))


def test_without_a_limit_nothing_is_left_out():
    unlimited = TimeBudget()
    assert not unlimited.short()
    assert unlimited.enough is None
    assert unlimited.noted(4, []) == []
    assert unlimited.most_classes([(4, 0.05)]) is None
    assert budget().most_classes([]) is None


@pytest.mark.parametrize(
    ("share", "vertices", "is_enough"),
    [(1.0, FEW, False), (0.59, FEW, True), (0.59, FEW - 1, False), (0.29, 0, True)],
)
def test_a_small_tree_is_enough_only_when_time_is_short(share: float, vertices: int, is_enough: bool):
    enough = budget(share).enough
    assert enough is not None
    assert enough(vertices) == is_enough


@pytest.mark.parametrize(("share", "short"), [(0.31, False), (0.29, True), (-0.1, True)])
def test_time_is_short_when_a_share_of_what_was_left_is(share: float, short: bool):
    assert budget(share).short() == short


@pytest.mark.parametrize("classes", [1, 3, 16])
def test_a_plan_that_fits_just_so_is_made_again_of_as_many_classes_and_one_that_does_not_of_fewer(classes: int):
    assert budget().most_classes([(classes, 0.999 * FIT)] * 2) == classes
    fewer = max(1, int(classes * (1.0 + (1.0 / 1.3 - 1.0) / TUNING.per_class)))
    assert budget().most_classes([(classes, 1.3 * FIT)] * 2) == fewer
    assert budget().most_classes([(classes, 0.999 * TUNING.first_share * FIT)]) == classes


def test_there_is_always_time_for_one_class_and_the_slowest_of_the_last_plans_counts():
    assert budget().most_classes([(8, 10.0), (8, 1e-9)]) == 1
    recent = [(8, 10.0)]
    for _ in range(TUNING.recent):
        recent = budget(0.9).noted(2, recent)
    assert recent == [(2, pytest.approx(0.1 * WHOLE))] * TUNING.recent
