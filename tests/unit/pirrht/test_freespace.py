"""A new task in the same world is examined without examining the world again."""

from dataclasses import replace

import numpy as np
import pytest
from discs import scene_of

from pirrht import FreeSpace, Goal, Kind, Obstacle, SceneError

PLACES = {Kind.BOX: (1.0, 1.0, 0.1), Kind.CYLINDER: (2.6, 1.2, 0.1), Kind.SPHERE: (1.8, 2.6, 0.1)}
SHAPE = {"size": np.array([0.3, 0.2, 0.4]), "rotation": np.eye(3)}
POSTS = [Obstacle(name=kind.value, kind=kind, position=np.array(at), **SHAPE) for kind, at in PLACES.items()]
SCENE = scene_of(POSTS, start=(0.3, 0.3), goal=(3.6, 3.0, 0.2), side=(4.0, 3.5), radius=0.15, name="posts")
TASK = {"start": np.array([3.5, 0.4, 1.0]), "goal": Goal(center=np.array([0.4, 2.9]), radius=0.3)}


def test_a_new_task_is_that_of_a_fresh_examination() -> None:
    space, fresh = FreeSpace.of(SCENE).with_task(**TASK), FreeSpace.of(replace(SCENE, **TASK))
    assert (space.scene.start is TASK["start"], space.scene.goal is TASK["goal"]) == (True, True)
    assert [o.members for o in space.obstacles] == [o.members for o in fresh.obstacles] == [(0,), (1,), (2,)]
    numbers = ([s.homology.markers, s.homology.goal, *s.homology.cuts.arrays, *s.field.arrays] for s in (space, fresh))
    for one, other in zip(*numbers, strict=True):
        np.testing.assert_array_equal(one, other)
    assert space.field[:6] == fresh.field[:6]


def test_what_a_new_task_leaves_out_stays_and_the_old_one_is_kept() -> None:
    space = FreeSpace.of(SCENE)
    moved = space.with_task(goal=TASK["goal"])
    assert moved.scene.start is SCENE.start
    assert space.scene.goal is SCENE.goal
    assert moved.field is space.field


def test_a_task_that_cannot_be_is_refused() -> None:
    for start in ((1.0, 1.0, 0.0), (5.0, 1.0, 0.0)):  # in the box, and outside
        with pytest.raises(SceneError, match="posts: the start"):
            FreeSpace.of(SCENE).with_task(start=np.array(start))
