"""Speeds are those from which a robot can stop, whatever law a plan has."""

from dataclasses import replace

import numpy as np
import pytest

from pirrht import FreeSpace, Plan, Rover, Scene
from pirrht.control.governor import governed

TASK = {"lower": (0, 0), "upper": (6, 4), "start": (1, 2, 0), "goal": (5.5, 2, 0.3), "robot_radius": 0.2}
STATIC = FreeSpace.of(Scene.from_boxes([[3.0, 1.0, 3.2, 3.0]], **TASK)).static
HELD = Plan(
    state=np.array([1.0, 2.0, 0.0]), times=np.array([0.0, 0.1]), references=(), ids=(), estimate=None, fallback=None,
    instead=np.array([[2.0, 0.0]]),
)  # fmt: skip


@pytest.mark.parametrize(("x", "least", "most"), [(1.0, 2.0, 2.0), (2.3, 0.5, 1.4), (2.7, 0.0, 0.6)])
def test_a_control_that_is_held_is_slowed_down_to_where_the_robot_can_stop(x, least, most):
    plan = governed(HELD, Rover(b=0.1), STATIC, 3.0)
    speed, turn = plan.at(np.array([x, 2.0, 0.0]), 0.0)
    assert least <= speed <= most
    assert turn == 0.0
    assert speed * 0.12 + speed**2 / 6.0 <= 2.8 - x  # the reaction and the brake


def test_what_needs_no_governor_stays_as_it_is():
    fallback = replace(HELD, fallback="no survivor", law=lambda x, s: np.zeros(2))
    assert governed(HELD, Rover(b=0.1), STATIC, 0.0) is HELD
    assert governed(fallback, Rover(b=0.1), STATIC, 3.0) is fallback
