"""The obstacle course is as hard and as varied as it claims."""

from __future__ import annotations

from functools import cache
from itertools import combinations

import mujoco
import numpy as np
import pytest

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.steering.dubins import Dubins
from pirrht.topology.obstacles import Component
from sim.mjcf import Loaded, load

NARROW = 4 * 0.15  # four robot radii [m]
Gap = tuple[float, Array, Array]  # width and the two points that are nearest, seen from above


@cache
def course() -> tuple[Loaded, FreeSpace]:
    loaded = load("clutter")
    return loaded, FreeSpace.of(loaded.scene)


@cache
def references(seed: int) -> list[Reference]:
    _, space = course()
    tree = HomologyTree(space, Dubins(), limit=0.8, classes=16, rng=np.random.default_rng(seed))
    tree.grow(2000)
    return tree.references(space.scene.start)


@cache
def gaps() -> tuple[Gap, ...]:
    """The exact gap between each two obstacles that are less than 2 m apart."""
    loaded, space = course()
    data = mujoco.MjData(loaded.model)
    mujoco.mj_kinematics(loaded.model, data)
    geoms = np.flatnonzero(loaded.obstacle_geoms)

    def between(one: Component, other: Component) -> Gap:
        widths = []
        for i in one.members:
            for j in other.members:
                ends = np.zeros(6)
                pair = int(geoms[i]), int(geoms[j])
                width = mujoco.mj_geomDistance(loaded.model, data, *pair, 2.0, ends)
                widths.append((width, ends[0:2], ends[3:5]))
        return min(widths, key=lambda gap: gap[0])

    found = (between(one, other) for one, other in combinations(space.obstacles, 2))
    return tuple(gap for gap in found if gap[0] < 2.0)


def crosses(path: Array, a: Array, b: Array) -> bool:
    """Whether a polyline (k, 2) crosses the segment from a to b."""
    along, normal = b - a, np.array([a[1] - b[1], b[0] - a[0]])
    side, progress = (path - a) @ normal, (path - a) @ along / (along @ along)
    change = np.flatnonzero(side[:-1] * side[1:] < 0)
    share = side[change] / (side[change] - side[change + 1])
    at = progress[change] + share * (progress[change + 1] - progress[change])
    return bool(np.any((at > 0) & (at < 1)))


def test_every_gap_is_wide_enough_for_the_noise():
    assert min(width for width, _, _ in gaps()) > 0.5


@pytest.mark.parametrize("seed", [0, 1])
def test_the_cheapest_way_squeezes_through_two_gaps(seed):
    path = references(seed)[0].trajectory.points
    passed = [width for width, a, b in gaps() if crosses(path, a, b)]
    assert sum(width < NARROW for width in passed) >= 2


@pytest.mark.parametrize("seed", [0, 1])
def test_ten_classes_lie_within_thirty_percent(seed):
    costs = np.array([reference.cost for reference in references(seed)])
    assert len(costs) >= 10
    assert costs[9] <= 1.3 * costs[0]
