"""References of a run: one path per homology class from its tree, and what is left of guides that the tree lacks."""

from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.control.policy import ClassFromStart, RunState, from_start
from pirrht.control.settings import ControlSettings, ControlTuning, TimeBudget
from pirrht.errors import NoReference
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.topology.signature import integers


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
    """Return the references at x (n,), cheapest first: those of the tree (Algorithm 5), and those left from guides."""
    method, memory = settings.use, run.memory
    if tree is None or method.most == 0:
        return []
    driven = run.path.winding()
    before = {integers(np.subtract(whole, driven)): path for whole, path in memory.paths.items()}
    try:
        found = tree.references(
            tree.at(x, run.now), shortened=settings.shortened, before=before, over_budget=budget.short,
            threads=threads, most=run.most,
        )  # fmt: skip
    except NoReference:
        if rest := _remaining_guides(tree, x, run):
            return rest
        if not run.planned and tree.too_fast(x):
            raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit, hasty=True) from None
        raise
    classes = from_start(run, found)
    left_out = {} if run.most is None else memory.paths
    memory.paths = left_out | {one: reference.path for one, reference in zip(classes, found, strict=True)}
    if method.most is not None:
        return found[: method.most][: run.most]
    found += _remaining_guides(tree, x, run, classes)
    return sorted(found, key=lambda reference: reference.cost)[: run.most]


def _remaining_guides(
    tree: HomologyTree, x: Array, run: RunState, known: Sequence[ClassFromStart] = ()
) -> list[Reference]:
    """Return what is left of guides from x (n,), of classes that are not `known`; close to walls trees lack curves."""
    references, named = list[Reference](), run.homology.named
    for whole, (guide, *_) in run.memory.optima.items():
        if whole not in run.memory.sampled or whole in known:
            continue
        rest = guide.rest(run.since_plan, tree.space.scene.goal.center)
        winding = integers(np.subtract(whole, run.path.winding()))
        signature = run.homology.signature(run.homology.at(x, run.now), winding)
        if rest is not None and np.all(np.abs(signature - 1.0) <= tree.limit):
            references.append(Reference(winding=winding, signature=signature, trajectory=rest, named=named))
    return references
