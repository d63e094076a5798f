"""Passages: the gaps that are known in closed form are found, where they are and as wide as they are."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from discs import block, scattered, scene_of

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages, find_passages
from pirrht.geometry.scene import Scene

RADIUS = 0.1


def passages_of(scene: Scene) -> tuple[Passages, FreeSpace]:
    space = FreeSpace.of(scene)
    return find_passages(space.field, space.collision), space


def two_blocks(gap: float, yaw: float) -> tuple[Scene, Array]:
    """Two long blocks with a gap between their ends; the line through them is at an angle [rad]."""
    along = np.array([np.cos(yaw), np.sin(yaw)])
    at = [np.array([3.0, 3.1]) + side * (0.8 + 0.5 * gap) * along for side in (-1, 1)]
    blocks = [block(f"block{i}", *place, (0.8, 0.2), yaw) for i, place in enumerate(at)]
    return scene_of(blocks, start=(0.5, 0.5), goal=(5.5, 5.5)), np.array([3.0, 3.1])


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.1, np.pi / 2, 2.5])
@pytest.mark.parametrize("diameters", [1.02, 1.2, 2.0, 4.0])
def test_a_gap_between_two_blocks_is_a_passage_of_its_width_across_their_line(diameters: float, yaw: float):
    gap = 2.0 * RADIUS * diameters
    scene, middle = two_blocks(gap, yaw)
    found, _ = passages_of(scene)
    k = int(np.argmin(np.hypot(*(found.place - middle).T)))
    across = (found.place[k] - middle) @ [np.cos(yaw), np.sin(yaw)]
    assert abs(across) < 2e-3
    assert found.width[k] == pytest.approx(gap, abs=2e-3)
    assert abs(np.cos(found.heading[k] - yaw)) < 0.05
    assert sorted(found.between(k, FreeSpace.of(scene).collision)) == ["block0", "block1"]


@pytest.mark.parametrize("gap", [-0.1, 0.0, 0.1, 0.19])
def test_a_gap_narrower_than_the_robot_is_none(gap: float):
    scene, middle = two_blocks(gap, 0.4)
    found, _ = passages_of(scene)
    assert not np.any(np.hypot(*(found.place - middle).T) < 0.3)


def test_a_doorway_whose_jambs_belong_together_is_a_passage():
    walls = [block("left", 1.4, 3.0, (1.45, 0.1)), block("right", 4.6, 3.0, (1.45, 0.1))]
    found, space = passages_of(scene_of(walls, start=(3.0, 1.0), goal=(3.0, 5.0)))
    assert space.homology.M == 0
    assert found.count == 1
    np.testing.assert_allclose(found.place[0], [3.0, 3.0], atol=0.1)
    assert found.width[0] == pytest.approx(0.3, abs=2e-3)


@pytest.mark.parametrize("seed", range(6))
def test_every_two_discs_with_none_between_them_have_a_passage_midway(seed: int):
    """The saddles of the distance from discs are the middles of gaps to which no third disc is nearer."""
    found, space = passages_of(scattered(seed))
    rows = [(o.position[:2], o.size[0]) for o in space.scene.obstacles]
    for (a, r), (b, s) in combinations(rows, 2):
        gap = np.hypot(*(b - a)) - r - s
        middle = a + (b - a) * (r + 0.5 * gap) / np.hypot(*(b - a))
        least = min(np.hypot(*(c - middle)) - t for c, t in rows)
        border = min(*middle, *(6.0 - middle))
        if least < 0.5 * gap - 1e-9 or border < 0.5 * gap or gap > 1.2:
            continue
        near = np.hypot(*(found.place - middle).T)
        assert near.min() < 0.02
        assert found.width[np.argmin(near)] == pytest.approx(gap, abs=3e-3)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_found_is_free_and_as_wide_as_fcl_says_narrowest_first(seed: int):
    found, space = passages_of(scattered(seed))
    assert np.all(np.diff(found.width) >= 0.0)
    np.testing.assert_allclose(space.collision.clearance(found.place), 0.5 * found.width - RADIUS, atol=3e-3)
    assert np.all(space.collision.free(found.axis[:, :2]))
    np.testing.assert_array_equal(found.axis[: found.count, :2], found.place)
