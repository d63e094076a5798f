"""Static obstacles that change during an episode: what the next plan is made with, and what is kept of the last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.proposals import Whole
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.problem import Problem
from pirrht.topology.driven import Driven, DrivenInTime
from pirrht.topology.homology import Homology, integers
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.homology_tree import HomologyTree

Renewed = tuple[Problem, FreeSpace, HomologyTree | None]


def renewed(
    problem: Problem, space: FreeSpace, tree: HomologyTree | None, scene: Scene, vertices: int | None
) -> Renewed | None:
    """Return the problem, the free space and a tree in another scene; None if it is as it was.

    Args:
        vertices: of the tree; None: as many as the last one has.

    Raises:
        OptionError: the goal is another, or obstacles move.
        SceneError: the goal point is in collision, or the workspace is too large for the robot.
    """
    before = space.scene
    goal = problem.scene.goal
    if not _same(goal, scene.goal):
        raise OptionError(f"an update keeps the goal, {goal}; for {scene.goal} make another Controller")
    if before.movers or scene.movers:
        raise OptionError(
            f"an update is of static obstacles, and {len(scene.movers or before.movers)} move here; make another "
            "Controller"
        )
    parts = "lower", "upper", "robot_radius", "robot_height"
    alike = all(np.array_equal(getattr(before, part), getattr(scene, part)) for part in parts)
    pairs = zip(before.obstacles, scene.obstacles, strict=False)
    if alike and len(before.obstacles) == len(scene.obstacles) and all(_same(*pair) for pair in pairs):
        return None
    now = space.updated(replace(scene, goal=before.goal, waivers=before.waivers))
    grown = None
    if tree is not None:
        grown = HomologyTree(now, tree.steering, limit=tree.limit, classes=tree.classes, rng=tree.rng)
        grown.grow(tree.size if vertices is None else vertices)
    return replace(problem, scene=scene), now, grown


def entered(driven: Driven | DrivenInTime, homology: Homology) -> Driven:
    """Return the driven path among static obstacles, which counts turns about other markers from here on."""
    assert isinstance(driven, Driven)
    driven.enter(homology)
    return driven


def heirs(space: FreeSpace, driven: Driven, lines: Mapping[Whole, Array]) -> dict[Whole, Whole]:
    """Map earlier classes to what they are now, those whose path ahead, (k, 2) [m], is still free."""
    found = {}
    for whole, line in lines.items():
        if np.all(space.collision.segments_free(line[:-1], line[1:])):
            rest = space.homology.winding(np.vstack([driven.here, line]))
            found[whole] = integers(np.add(driven.winding(), rest))
    return found


def renamed(classes: Mapping[Whole, Whole], before: Homology | TimedHomology, after: Homology) -> dict[str, str]:
    """Map the earlier names of classes to the names now."""
    return {before.name(then): after.name(now) for then, now in classes.items()}


def _same(one: Any, other: Any) -> bool:
    """Whether two records hold the same values."""
    pairs = ((getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    return one is other or all(np.array_equal(mine, its) for mine, its in pairs)
