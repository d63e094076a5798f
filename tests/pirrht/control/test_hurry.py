"""What a plan leaves out, by the time that is left."""

from __future__ import annotations

import pytest

from pirrht.control.hurry import FEW, GROWN, PRESSED, enough_of, pressed_of


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
