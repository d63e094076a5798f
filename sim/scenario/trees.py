"""The tree of a task, and the references that it gives at the start."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import NoReference, SceneError
from pirrht.freespace import FreeSpace
from pirrht.tree import file as tree_file
from pirrht.tree.homology_tree import HomologyTree
from pirrht.tree.left_out import left_out
from pirrht.tree.reference import Reference
from sim.mjcf.covered import covered
from sim.scenario.task import Task

WIDER = (0.8, 1.0, 1.5)  # H_limit where the robot's own leaves out what it should not
AMONG = 0.8  # H_limit where bodies move and nobody says another: who waits for one is turned about by it meanwhile


def rooted(task: Task, space: FreeSpace, rng: np.random.Generator, limit: float | None = None) -> HomologyTree:
    """A tree in a free space that has its roots only; within another limit than the settings' if one is given."""
    s = task.settings
    return HomologyTree(space, task.steering(), limit=limit or s.limit, classes=s.classes, rng=rng)


def empty(task: Task, limit: float | None = None) -> HomologyTree:
    """The task's own tree, before it has grown."""
    return rooted(task, task.space, np.random.default_rng(task.seeds()[0]), limit)


def grown(task: Task, progress: Callable[[int], None] | None = None, at: Array | None = None) -> HomologyTree:
    """A tree of `settings.vertices` vertices, or the one that was saved as `settings.tree`.

    Where no class reaches the goal, or the limit leaves out a way that is not much longer than the shortest, it is
    grown anew within a wider one, unless the limit was asked for.

    Args:
        at: the state (n,) from which; None: the start.

    Raises:
        OptionError: that is no tree for this scene, robot and limit.
    """
    s, x = task.settings, task.start if at is None else at
    if s.tree is not None:
        return tree_file.load(s.tree, task.space, task.steering(), limit=s.limit, classes=s.classes)
    first = tree = _grown_within(task, s.limit, progress)
    while task.widens and tree.limit < WIDER[-1]:
        least = max((way.limit for way in left_out(tree, x)), default=0.0)
        if not least and _reaches(tree, x):
            return tree
        wider = (limit for limit in WIDER if limit > tree.limit)
        tree = _grown_within(task, next((limit for limit in wider if limit >= least), WIDER[-1]), progress)
    return tree if tree is first or _reaches(tree, x) else first


def _reaches(tree: HomologyTree, x: Array) -> bool:
    """Whether any class reaches the goal from x (n,)."""
    return bool(tree.lengths(tree.homology.asked(x, 0.0)))


def _grown_within(task: Task, limit: float, progress: Callable[[int], None] | None) -> HomologyTree:
    tree = empty(task, limit)
    tree.grow(task.settings.vertices, progress=progress)
    return tree


def references(task: Task, tree: HomologyTree, waits: bool = False) -> list[Reference]:
    """The best path of every class from the start, cheapest first.

    Args:
        waits: whether there may be none among moving obstacles, since a drive waits for a way.

    Raises:
        NoReference: no class reaches the goal.
        SceneError: none does, and a body that moves comes to rest there.
    """
    try:
        return tree.references(tree.homology.asked(task.start, 0.0), polished=task.settings.polish)
    except NoReference:
        why = covered(task.loaded.scene)
        if why is None and waits and task.moving:
            return []
        if why is None:
            raise
        raise SceneError(
            f"{task.loaded.scene.name}: {why}, and no way was found that gets there before; let it rest elsewhere"
        ) from None
