"""The tree of a task, and the references that it gives at the start."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pirrht.errors import NoReference, SceneError
from pirrht.freespace import FreeSpace
from pirrht.tree import file as tree_file
from pirrht.tree.homology_tree import HomologyTree
from pirrht.tree.reference import Reference
from sim.mjcf.covered import covered
from sim.scenario.task import Task

WIDER = (0.8, 1.0, 1.5)  # H_limit where no class reaches the goal within the robot's own
AMONG = 0.8  # H_limit where bodies move and nobody says another: who waits for one is turned about by it meanwhile


def rooted(task: Task, space: FreeSpace, rng: np.random.Generator, limit: float | None = None) -> HomologyTree:
    """A tree in a free space that has its roots only; within another limit than the settings' if one is given."""
    s = task.settings
    return HomologyTree(space, task.steering(), limit=limit or s.limit, classes=s.classes, rng=rng)


def empty(task: Task, limit: float | None = None) -> HomologyTree:
    """The task's own tree, before it has grown."""
    return rooted(task, task.space, np.random.default_rng(task.seeds()[0]), limit)


def grown(task: Task, progress: Callable[[int], None] | None = None) -> HomologyTree:
    """A tree of `settings.vertices` vertices, or the one that was saved as `settings.tree`.

    Where no class reaches the goal from the start within the robot's own limit, it is grown anew within wider ones.

    Raises:
        OptionError: that is no tree for this scene, robot and limit.
    """
    s = task.settings
    if s.tree is not None:
        return tree_file.load(s.tree, task.space, task.steering(), limit=s.limit, classes=s.classes)
    own = s.limit == (AMONG if task.moving else task.system.settings.limit)
    first: HomologyTree | None = None
    for limit in (s.limit, *(wider for wider in WIDER if own and wider > s.limit)):
        tree = empty(task, limit)
        tree.grow(s.vertices, progress=progress)
        if tree.lengths(tree.homology.asked(task.start, 0.0)):
            return tree
        first = first or tree
    assert first is not None
    return first


def references(task: Task, tree: HomologyTree) -> list[Reference]:
    """The best path of every class from the start, cheapest first.

    Raises:
        NoReference: no class reaches the goal.
        SceneError: none does, and a body that moves comes to rest there.
    """
    try:
        return tree.references(tree.homology.asked(task.start, 0.0), polished=task.settings.polish)
    except NoReference:
        why = covered(task.loaded.scene)
        if why is None:
            raise
        raise SceneError(
            f"{task.loaded.scene.name}: {why}, and no way was found that gets there before; let it rest elsewhere"
        ) from None
