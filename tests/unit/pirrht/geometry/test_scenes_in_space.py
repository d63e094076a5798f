"""Scenes in space are stated as those in the plane, with three numbers for a place."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from spaces import window

from pirrht import Footprint, Goal, SceneError
from pirrht.geometry.obstacle import Motion, Mover


def test_three_numbers_make_a_scene_in_space():
    scene = window()
    assert scene.dimension == 3
    assert scene.place.tolist() == [0.8, 2.0, 1.0]
    assert repr(scene) == (
        "Scene('space', 6 x 4 x 3 m, 4 obstacles, 0 that move, from (0.8, 2, 1) to (5.2, 2, 1), robot of 0.2 m)"
    )
    assert scene.goal.contains(np.array([[5.0, 2.1, 1.1], [5.0, 2.1, 1.3]])).tolist() == [True, False]


MOVER = Mover(name="cart", solids=window().obstacles[:1], motion=Motion(rows=np.array([[0.0, 0.0, 0.0, 0.0]])))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"upper": np.array([6.0, 4.0])}, r"greatest corner of the workspace is \(6, 4\); it must be x, y, z \[m\]"),
        ({"lower": np.zeros(2), "upper": np.array([6.0, 4.0])}, r"goal center is \(5.2, 2, 1\); it must be x, y \[m\]"),
        ({"goal": Goal(center=np.array([5.2, 2.0]), radius=0.3)}, r"goal center is \(5.2, 2\); it must be x, y, z"),
        ({"goal": Goal(center=np.array([5.2, 2.0, 3.2]), radius=0.3)},
         r"goal \(5.2, 2, 3.2\) lies outside the workspace \[0, 6\] x \[0, 4\] x \[0, 3\]"),
        ({"start": np.array([0.8, 2.0])}, r"start is \(0.8, 2\); .* in space x, y, z \[m\]"),
        ({"footprint": Footprint.rectangle(0.5, 0.4)}, "a robot in space is a ball"),
        ({"movers": (MOVER,)}, "rows of the motion of cart must be t, x, y, z and a quaternion"),
    ],
)  # fmt: skip
def test_what_no_scene_in_space_can_have_is_refused(changes: dict[str, Any], message: str):
    with pytest.raises(SceneError, match=message):
        replace(window(), **changes)
