"""Motions of bodies: poses between rows, after the last, over again."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.errors import SceneError
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Kind, Obstacle

ROWS = np.array([[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [3.0, 1.0, 2.0, 1.0]])


def test_a_pose_lies_between_its_rows_and_a_body_stands_still_after_the_last():
    motion = Motion(rows=ROWS)
    np.testing.assert_allclose(
        motion.pose(np.array([-1.0, 0.5, 2.0, 9.0])), [[0, 0, 0], [0.5, 0, 0], [1, 1, 0.5], [1, 2, 1]]
    )
    assert motion.last == 3.0


def test_a_motion_that_starts_over_has_the_period_of_its_last_row():
    motion = Motion(rows=ROWS, repeat=True)
    times = np.linspace(0.1, 2.9, 7)
    np.testing.assert_allclose(motion.pose(times + 6.0), motion.pose(times), atol=1e-12)
    assert np.isinf(motion.last)


def test_the_solids_of_a_body_turn_and_move_with_it():
    solid = Obstacle(name="o", kind=Kind.BOX, size=np.ones(3), position=np.array([1.0, 0.0, 0.2]), rotation=np.eye(3))
    quarter = Motion(rows=np.array([[0.0, 2.0, 3.0, 0.5 * np.pi]]))
    (there,) = Mover(name="m", solids=(solid,), motion=quarter).at(5.0)
    np.testing.assert_allclose(there.position, [2.0, 4.0, 0.2], atol=1e-12)
    np.testing.assert_allclose(there.rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("rows", "repeat", "words"),
    [
        ([[0.5, 0, 0, 0]], False, "must be at 0"),
        ([[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0]], False, "row 3 of a motion is at 1 s after one at 1 s"),
        ([[0, 0, 0, 0], [1, np.nan, 0, 0]], False, "row 2"),
        ([[0, 0, 0]], False, "a yaw"),
        ([[0, 0, 0, 0]], True, "two or more"),
    ],
)
def test_rows_that_are_no_motion_are_refused(rows, repeat, words):
    with pytest.raises(SceneError, match=words):
        Motion(rows=np.array(rows, dtype=float), repeat=repeat)
