"""What a plan leaves out, by the time that is left."""

from __future__ import annotations

import pytest

from pirrht.control.policy import ALONE, FEW, GROWN, PRESSED, RECENT, SPENT, TimeBudget, enough_of, pressed_of


class Clock:
    """Time that is left [s]."""

    left = 0.1

    def __call__(self) -> float:
        return self.left


def test_without_a_limit_nothing_is_left_out():
    assert not pressed_of(None)()
    assert enough_of(None) is None


@pytest.mark.parametrize(
    ("share", "vertices", "is_enough"),
    [(1.0, FEW, False), (GROWN - 0.01, FEW, True), (GROWN - 0.01, FEW - 1, False), (PRESSED - 0.01, 0, True)],
)
def test_a_small_tree_is_enough_only_when_time_is_short(share, vertices, is_enough):
    clock = Clock()
    enough = enough_of(clock)
    assert enough is not None
    clock.left *= share
    assert enough(vertices) == is_enough


@pytest.mark.parametrize("share", [PRESSED + 0.01, PRESSED - 0.01, -0.1])
def test_time_is_short_when_a_share_of_what_was_left_is(share):
    clock = Clock()
    pressed = pressed_of(clock)
    clock.left *= share
    assert pressed() == (share < PRESSED)


def after(*plans: tuple[int, float]) -> TimeBudget:
    pace = TimeBudget()
    for classes, taken in plans:
        pace.note(classes, taken)
    return pace


def test_without_a_clock_or_a_plan_every_class_is_looked_at():
    assert after((4, 0.05)).most(None) is None
    assert TimeBudget().most(Clock()) is None


@pytest.mark.parametrize("classes", [1, 3, 16])
def test_a_plan_that_fits_just_so_is_made_again_of_as_many_classes_and_one_that_does_not_of_fewer(classes: int):
    time = SPENT * Clock.left
    assert after(*[(classes, 0.999 * time)] * 2).most(Clock()) == classes
    assert after(*[(classes, 1.3 * time)] * 2).most(Clock()) == max(1, int(classes * (1.0 + 2.0 * (1.0 / 1.3 - 1.0))))
    assert after((classes, 0.999 * ALONE * time)).most(Clock()) == classes  # nothing ran beside the first


def test_there_is_always_time_for_one_class_and_the_slowest_of_the_last_plans_tells():
    assert after((8, 10.0), (8, 1e-9)).most(Clock()) == 1
    assert after((8, 10.0), *[(2, 0.01)] * RECENT).most(Clock()) == 2 + 2 * int(2.0 * (SPENT * Clock.left / 0.01 - 1.0))
