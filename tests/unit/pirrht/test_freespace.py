"""A new task in the same world is examined without examining the world again."""

from dataclasses import replace

import numpy as np
import pytest
from discs import scene_of

from pirrht import FreeSpace, Goal, Kind, Obstacle, Scene, SceneError
from pirrht.geometry.collision import Collision
from pirrht.topology.obstacles import _Planar, components

PLACES = {Kind.BOX: (1.0, 1.0, 0.1), Kind.CYLINDER: (2.6, 1.2, 0.1), Kind.SPHERE: (1.8, 2.6, 0.1)}
SHAPE = {"size": np.array([0.3, 0.2, 0.4]), "rotation": np.eye(3)}
POSTS = [Obstacle(name=kind.value, kind=kind, position=np.array(at), **SHAPE) for kind, at in PLACES.items()]
SCENE = scene_of(POSTS, start=(0.3, 0.3), goal=(3.6, 3.0, 0.2), side=(4.0, 3.5), radius=0.15, name="posts")
TASK = {"start": np.array([3.5, 0.4, 1.0]), "goal": Goal(center=np.array([0.4, 2.9]), radius=0.3)}


def test_a_new_task_is_that_of_a_fresh_examination() -> None:
    space, fresh = FreeSpace.of(SCENE).with_task(**TASK), FreeSpace.of(replace(SCENE, **TASK))
    assert (space.scene.start is TASK["start"], space.scene.goal is TASK["goal"]) == (True, True)
    assert [o.members for o in space.obstacles] == [o.members for o in fresh.obstacles] == [(0,), (1,), (2,)]
    held = [(s.homology.cuts.held.values(), s.field.held.values()) for s in (space, fresh)]
    numbers = ([s.homology.markers, s.homology.goal, *a, *b] for s, (a, b) in zip((space, fresh), held, strict=True))
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


def ragged(seed: int) -> Scene:
    """A room of 6 m x 4 m whose walls are cells, as a scan sees them."""
    rng = np.random.default_rng(seed)
    walls = np.zeros((80, 120), dtype=bool)
    walls[20:60, 40:42] = walls[30:50, 80:82] = walls[0:18, 60:62] = True
    near = np.pad(walls, 1)
    walls |= (near[:-2, 1:-1] | near[2:, 1:-1] | near[1:-1, :-2] | near[1:-1, 2:]) & (rng.random(walls.shape) < 0.3)
    walls |= rng.random(walls.shape) < 0.002
    walls[35:45, 3:13] = walls[35:45, 105:118] = False
    return Scene.from_grid(walls, 0.05, start=(0.4, 2.0), goal=(5.6, 2.0, 0.2), robot_radius=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_cells_that_touch_are_one_obstacle_by_rectangles_as_by_cuts(seed: int, monkeypatch: pytest.MonkeyPatch):
    collision = Collision(ragged(seed).world, ragged(seed).footprint)
    cuts, common = [], _Planar.common

    def counted(self, i, j, *rest, **more):
        cuts.append(i != j)
        return common(self, i, j, *rest, **more)

    monkeypatch.setattr(_Planar, "common", counted)
    quick = components(collision)
    few = sum(cuts)
    monkeypatch.setattr(_Planar, "sure", lambda self, i, near: np.zeros(len(near), dtype=bool))
    slow = components(collision)
    assert [part.members for part in quick] == [part.members for part in slow]
    assert 2 * few < sum(cuts) - few


def test_a_line_is_free_by_clearance_and_fcl_as_by_fcl_alone():
    space, rng = FreeSpace.of(ragged(0)), np.random.default_rng(0)
    found = []
    for _ in range(60):
        line = np.cumsum([rng.uniform([0.3, 0.3], [5.7, 3.7]), *rng.normal(0.0, 0.03, (30, 2))], axis=0)
        free = bool(np.all(space.collision.segments_free(line[:-1], line[1:])))
        assert space.segments_free(line) == free
        found.append(free)
    assert 10 < sum(found) < 55


def test_walls_of_many_points_are_those_of_few_at_a_time():
    space = FreeSpace.of(ragged(1))
    members, points = range(len(space.scene.obstacles)), np.random.default_rng(0).uniform(0.0, [6.0, 4.0], (12_000, 2))
    whole = space.collision.nearest_walls(points, members, 1.1)
    parts = [space.collision.nearest_walls(some, members, 1.1) for some in np.array_split(points, 5)]
    for one, others in zip(whole, zip(*parts, strict=True), strict=True):
        np.testing.assert_array_equal(one, np.concatenate(others))
