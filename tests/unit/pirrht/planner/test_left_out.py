"""Short ways that H_limit leaves out are found, with the limit that allows them."""

from __future__ import annotations

import numpy as np
import pytest
from discs import block

from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.planner.left_out import left_out
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.straight_line import StraightLine
from pirrht.systems.single_integrator import SingleIntegrator

BEHIND = np.array([1.3, 1.5])  # in the pocket of a hook that is open to the left


def hook() -> FreeSpace:
    """A wall 2 m high right of BEHIND, with an arm to the left at its lower end."""
    walls = (
        block("wall", 2.0, 1.5, (0.1, 1.0)),
        block("arm", 1.3, 0.6, (0.8, 0.1)),
        block("post", 3.2, 2.6, (0.1, 0.1)),
    )
    return FreeSpace.of(
        Scene(
            name="hook",
            lower=np.zeros(2),
            upper=np.array([4.0, 3.0]),
            obstacles=walls,
            goal=Goal(center=np.array([3.4, 1.5]), radius=0.2),
            start=np.array([*BEHIND, 0.0]),
            robot_radius=0.1,
        )
    )


def grown(space: FreeSpace, limit: float) -> HomologyTree:
    problem = Problem(dynamics=SingleIntegrator(), scene=space.scene, R=2.0 * np.eye(2))
    tree = HomologyTree(space, StraightLine.of(problem), limit=limit, rng=np.random.default_rng(0))
    tree.grow(400)
    return tree


def test_the_limit_that_is_reported_allows_the_way_and_a_little_less_does_not():
    space = hook()
    ways = left_out(grown(space, 0.3), BEHIND)
    assert ways
    assert [way.length for way in ways] == sorted(way.length for way in ways)
    shortest = ways[0]
    assert 0.3 < shortest.limit < 1.0
    found = grown(space, shortest.limit + 0.1).references(BEHIND)
    assert min(one.length for one in found) == pytest.approx(shortest.length, rel=0.15)
    assert all(one.length > 1.1 * shortest.length for one in references(grown(space, shortest.limit - 0.1)))


def references(tree: HomologyTree) -> list:
    return [] if not tree.lengths(BEHIND) else tree.references(BEHIND)


def test_nothing_is_left_out_by_a_wide_limit():
    assert left_out(grown(hook(), 1.5), BEHIND) == []
