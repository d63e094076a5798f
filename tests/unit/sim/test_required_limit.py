"""Short paths that H_limit excludes are found, with the limit that allows them."""

from __future__ import annotations

import numpy as np
from discs import block

from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.straight_line import StraightLine
from pirrht.systems.single_integrator import SingleIntegrator
from sim.scenario.required_limit import required_limit

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


def test_the_limit_that_is_reported_allows_the_path_and_a_little_less_does_not():
    space = hook()
    least = required_limit(grown(space, 0.3), BEHIND)
    assert 0.3 < least < 1.0
    shortest = min(grown(space, least + 0.1).lengths(BEHIND).values())
    assert all(length > 1.1 * shortest for length in grown(space, least - 0.1).lengths(BEHIND).values())


def test_a_wide_limit_allows_all():
    assert required_limit(grown(hook(), 1.5), BEHIND) == 0.0
