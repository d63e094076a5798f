"""A plan in a small room, so that whatever must be compiled or loaded is before any clock runs."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from pirrht.errors import PirrhtError
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene
from pirrht.tree.homology_tree import HomologyTree
from sim.scenario import Scenario

VERTICES = 30
_CUBE = Obstacle(
    name="cube", kind=Kind.BOX, size=np.full(3, 0.3), position=np.array([2.0, 2.6, 0.3]), rotation=np.eye(3)
)
_ROOM = Scene(
    name="rehearsal",
    lower=np.zeros(2),
    upper=np.full(2, 4.0),
    obstacles=(_CUBE,),
    goal=Goal(center=np.array([3.3, 2.0]), radius=0.3),
    start=np.array([0.7, 2.0, 0.0]),
    robot_radius=0.2,
)


def rehearse(scenario: Scenario) -> None:
    """Do once, elsewhere, what `Scenario.grown_tree` and the references at the start need; results stay as they are."""
    s = scenario.settings
    tree = HomologyTree(
        FreeSpace.of(replace(_ROOM, defaults={})),
        scenario.steering(),
        limit=s.limit,
        classes=s.classes,
        rng=np.random.default_rng(0),
    )
    with suppress(PirrhtError):  # where this robot cannot turn in so small a room, the rest is loaded all the same
        tree.grow(VERTICES)
        tree.references(scenario.problem.dynamics.state_of(_ROOM.start), polished=s.polish)
