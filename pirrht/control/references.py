"""References of a drive: whether a tree fits the problem, its paths from plan to plan, and a tree in another scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.proposals import Whole, kept
from pirrht.errors import NoReference, OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.motion import Motions
from pirrht.steering.trajectory import SPACING, Trajectory
from pirrht.topology.driven import Driven
from pirrht.topology.homology import Homology
from pirrht.topology.signature import integers


def validate_tree(problem: Problem, tree: HomologyTree) -> None:
    """Raise an OptionError for a tree of another kind of system, or one without times where obstacles move."""
    steering, dynamics = type(tree.steering).__name__, type(problem.dynamics).__name__
    if problem.scene.movers and not tree.steering.timed:
        raise OptionError(
            f"{steering} knows no times, and bodies move in the scene; grow the tree with InTime.of(problem)"
        )
    zero = np.zeros(problem.dynamics.n)
    if len(tree.steering.vertex_of(tree.at(zero, 0.0))) != tree.steering.n:
        raise OptionError(
            f"{steering} connects states of {tree.steering.n} numbers and {dynamics} has {problem.dynamics.n}; grow "
            f"the tree with a Steering for {dynamics}"
        )


def check_drives(problem: Problem, tree: HomologyTree, *, guided: bool) -> None:
    """Raise an OptionError for references without controls, unless samples are `guided` by something else."""
    if not (tree.steering.drives or guided):
        raise OptionError(
            f"{type(problem.dynamics).__name__} has no steering of its own, and its references no controls that "
            'samples could follow: guide them by "feedback", not "open-loop"'
        )


def blame_speed(tree: HomologyTree | None, x: Array) -> None:
    """Raise a NoReference of its own at a state x (n,) that would have references at rest."""
    if tree is not None and tree.too_fast(x):
        raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit, hasty=True) from None


class ReferenceCache:
    """Queries a tree for references; the paths of one plan, by class, are where the next one's shortening begins.

    Args:
        polished: shorten references inside their class.
        threads: for shortening.

    Attributes:
        unseen: names of earlier classes by key, where the last plan updated only some.
    """

    def __init__(self, *, polished: bool, threads: int) -> None:
        self._polished, self._threads = polished, threads
        self._known: dict[Whole, Motions] = {}
        self.unseen: dict[int, str] = {}

    def lines(self) -> dict[Whole, Array]:
        """Return the paths of the last plan, (k, 2) [m] each, by class."""
        return {whole: np.vstack(path.points(SPACING)) for whole, path in self._known.items()}

    def inherit(self, heirs: Mapping[Whole, Whole]) -> None:
        """Rename classes to what they are now; drop the others."""
        self._known = kept(self._known, heirs)

    def reversed(self, tree: HomologyTree | None, x: Array, now: float) -> dict[Whole, Trajectory]:
        """Return paths from x (n,) at a time [s] driven backwards, by winding; none if nothing reverses."""
        turned = None if tree is None else tree.steering.backwards(tree.at(x, now))
        if tree is None or turned is None:
            return {}
        try:
            found = tree.references(turned, polished=self._polished, threads=self._threads)
        except NoReference:
            return {}
        return {one.winding: tree.steering.reversing(one.trajectory) for one in found}

    def references(
        self, tree: HomologyTree, homology: Homology, x: Array, driven: Sequence[int], *,
        pressed: Callable[[], bool], most: int | None,
    ) -> list[Reference]:  # fmt: skip
        """Return the references at x (n,), cheapest first.

        Args:
            driven: class (M,) of the driven path [turns].
            pressed: whether time is short (`HomologyTree.references`).
            most: number of classes; None: all.

        Raises:
            NoReference: no allowed class reaches the goal from x.
        """
        self.unseen = {}
        before = {integers(np.subtract(whole, driven)): path for whole, path in self._known.items()}
        found = tree.references(
            x, polished=self._polished, before=before, pressed=pressed, threads=self._threads, most=most
        )
        left_out: dict[Whole, Motions] = {}
        if most is not None:
            left_out = self._known
            self.unseen = {homology.key(way): homology.name(whole) for way, whole in zip(before, left_out, strict=True)}
        self._known = left_out | {integers(np.add(driven, one.winding)): one.path for one in found}
        return found


def renewed(
    problem: Problem, space: FreeSpace, tree: HomologyTree | None, scene: Scene, vertices: int | None
) -> tuple[Problem, FreeSpace, HomologyTree | None] | None:
    """Return the problem, the free space and a tree in another scene; None if the scene is unchanged.

    Args:
        vertices: of the tree; None: as many as the last one has.

    Raises:
        OptionError: the goal is another, or obstacles move.
        SceneError: all of the goal is in collision, or the workspace is too large for the robot.
    """
    before, goal = space.scene, problem.scene.goal
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
    now = space.updated(replace(scene, waivers=before.waivers))
    grown = None
    if tree is not None:
        grown = HomologyTree(now, tree.steering, limit=tree.limit, classes=tree.classes, rng=tree.rng)
        grown.grow(tree.size if vertices is None else vertices)
    return replace(problem, scene=scene), now, grown


def heirs(space: FreeSpace, driven: Driven, lines: Mapping[Whole, Array]) -> dict[Whole, Whole]:
    """Map earlier classes to what they are now, those whose path ahead, (k, 2) [m], is still free."""
    found = {}
    for whole, line in lines.items():
        if np.all(space.collision.segments_free(line[:-1], line[1:])):
            rest = space.homology.winding(np.vstack([driven.here, line]))
            found[whole] = integers(np.add(driven.winding(), rest))
    return found


def _same(one: Any, other: Any) -> bool:
    """Compare two records by value."""
    pairs = ((getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    return one is other or all(np.array_equal(mine, its) for mine, its in pairs)
