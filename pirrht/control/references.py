"""References of a run: whether a tree fits the problem, one path per class, and a tree in another scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.policy import ClassFromStart, RunState, from_start
from pirrht.control.settings import ControlSettings, ControlTuning, TimeBudget
from pirrht.errors import NoReference, OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.motion import SPACING
from pirrht.topology.homology import Driven
from pirrht.topology.signature import integers


def validate(tree: HomologyTree | None, problem: Problem, settings: ControlSettings) -> None:
    """Check that a tree serves a method, is of a problem's kind of system, and has times where obstacles move.

    Raises:
        OptionError: it is not so.
    """
    if tree is None:
        if settings.use.most != 0:
            raise OptionError(f"the method {settings.method!r} needs a tree")
        return
    steering, dynamics = type(tree.steering).__name__, type(problem.dynamics).__name__
    if problem.scene.movers and not tree.steering.timed:
        raise OptionError(
            f"{steering} knows no times, and obstacles move in the scene; grow the tree with InTime.of(problem)"
        )
    zero = np.zeros(problem.dynamics.n)
    if len(tree.steering.vertex_of(tree.at(zero, 0.0))) != tree.steering.n:
        raise OptionError(
            f"{steering} connects states of {tree.steering.n} numbers and {dynamics} has {problem.dynamics.n}; grow "
            f"the tree with a Steering for {dynamics}"
        )


def validate_guides(tree: HomologyTree | None, integral: PathIntegral) -> None:
    """Check that the references of a tree have controls that samples can follow.

    Raises:
        OptionError: they have none, and no feedback law is optimised either.
    """
    if tree is not None and not (tree.steering.drives or integral.proposals.tracks):
        dynamics = type(integral.problem.dynamics).__name__
        raise OptionError(
            f"{dynamics} has no steering of its own, and its references no controls that samples could follow: guide "
            'them by "feedback", not "open-loop"'
        )


def regrow(tree: HomologyTree | None, x: Array, time: float, tuning: ControlTuning) -> None:
    """Grow a tree in space and time for a run from x (n,) at a time [s], unless it was grown for that."""
    if tree is None or not tree.steering.timed:
        return
    scene, here = tree.space.scene, tree.at(x, time)
    origin = np.array([*scene.start[:2], 0.0]) if tree.origin is None else tree.origin
    if np.hypot(*(here[:2] - origin[:2])) > scene.robot_radius or abs(here[2] - origin[2]) > tuning.elsewhen:
        tree.aim(here)
        tree.grow(tree.size + tuning.regrowth)


def extract_references(
    tree: HomologyTree | None, x: Array, run: RunState, budget: TimeBudget, settings: ControlSettings, threads: int
) -> list[Reference]:
    """Return the references at x (n,), cheapest first: of the tree (Algorithm 5), and what is left of guides.

    Raises:
        NoReference: there is none.
    """
    method = settings.use
    if tree is None or method.most == 0:
        return []
    memory, driven, most = run.memory, run.path.winding(), budget.most_classes(run.recent)
    before = {integers(np.subtract(whole, driven)): path for whole, path in memory.paths.items()}
    memory.others = {}
    try:
        found = tree.references(
            tree.at(x, run.now), shortened=settings.shortened, before=before, over_budget=budget.short,
            threads=threads, most=most,
        )  # fmt: skip
    except NoReference:
        if rest := _remaining_guides(tree, x, run):
            return rest
        if not run.planned and tree.too_fast(x):
            raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit, hasty=True) from None
        raise
    left_out = {} if most is None else memory.paths
    memory.others = dict(zip(map(run.homology.key, before), map(run.homology.name, left_out), strict=False))
    memory.paths = left_out | {integers(np.add(driven, one.winding)): one.path for one in found}
    if method.most is not None:
        return found[: method.most][:most]
    rest = _remaining_guides(tree, x, run, from_start(run, found))
    return sorted([*found, *rest], key=lambda reference: reference.cost)[:most] if rest else found[:most]


def _remaining_guides(
    tree: HomologyTree, x: Array, run: RunState, known: Sequence[ClassFromStart] = ()
) -> list[Reference]:
    """Return what is left of guides from x (n,), of classes that are not `known`; close to walls trees lack curves."""
    references: list[Reference] = []
    driven = run.path.winding()
    for whole, (guide, *_) in run.memory.optima.items():
        if whole not in run.memory.sampled or whole in known:
            continue
        rest = guide.rest(run.since_plan, tree.space.scene.goal.center)
        if rest is None:
            continue
        winding = integers(np.subtract(whole, driven))
        signature = run.homology.signature(run.homology.at(x, run.now), winding)
        if np.all(np.abs(signature - 1.0) <= tree.limit):
            named = run.homology.named
            references.append(Reference(winding=winding, signature=signature, trajectory=rest, named=named))
    return references


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


def continue_among(space: FreeSpace, run: RunState) -> None:
    """Continue a run among other static obstacles; classes keep their names, and memory while their paths are free."""
    path, memory, before, goal = run.path, run.memory, run.homology, space.scene.goal.center
    path.enter(space.homology)
    rests = {whole: guide.rest(run.since_plan, goal) for whole, (guide, *_) in memory.optima.items()}
    guides = _heirs(space, path, {whole: rest.points for whole, rest in rests.items() if rest is not None})
    lines = {whole: np.vstack(one.points(SPACING)) for whole, one in memory.paths.items()}
    paths = guides | _heirs(space, path, lines)
    names = {before.name(then): space.homology.name(now) for then, now in paths.items()}
    run.homology, run.memory = space.homology, memory.renamed(guides, paths, names)


def _heirs(
    space: FreeSpace, driven: Driven, lines: Mapping[ClassFromStart, Array]
) -> dict[ClassFromStart, ClassFromStart]:
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
