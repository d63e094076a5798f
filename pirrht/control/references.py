"""References of a run: one path per homology class from its tree, and what is left of guides that the tree lacks."""

from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.control.run_state import ClassFromStart, RunState, from_start
from pirrht.control.settings import ControlSettings, ControlTuning, TimeBudget
from pirrht.errors import NoReference
from pirrht.estimation.sampler import PathIntegral
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.topology.signature import integers


def regrow(tree: HomologyTree | None, x: Array, time: float, tuning: ControlTuning) -> None:
    """Grow a tree in space and time for a run from x (n,) at a time [s], unless it was grown for that."""
    if tree is None or not tree.steering.timed:
        return
    here = tree.at(x, time)
    scene, d = tree.space.scene, tree.space.scene.dimension
    origin = np.array([*scene.place, 0.0]) if tree.origin is None else tree.origin
    if np.hypot.reduce(here[:d] - origin[:d]) > scene.robot_radius or abs(here[d] - origin[d]) > tuning.elsewhen:
        tree.aim(here)
        tree.grow(tree.size + tuning.regrowth)


def extract_references(
    tree: HomologyTree | None, x: Array, run: RunState, budget: TimeBudget, settings: ControlSettings,
    integral: PathIntegral,
) -> list[Reference]:  # fmt: skip
    """Return the references at x (n,), cheapest first: those of the tree (Algorithm 5), and those left from guides.

    Once there are guides, paths of hopeless classes are not shortened.
    """
    method, threads = settings.use, integral.threads
    if tree is None or method.most == 0:
        return []
    driven = run.route.path.winding()
    before = {integers(np.subtract(whole, driven)): path for whole, path in run.starts.paths.items()}
    try:
        found = tree.references(
            tree.at(x, run.now), shortened=settings.shortened, before=before, over_budget=budget.short,
            threads=threads, most=run.effort.most,
            hopeless=integral.guidance.hopeless if integral.guidance is not None and run.starts.optima else None,
        )  # fmt: skip
    except NoReference:
        if rest := _remaining_guides(tree, x, run):
            return rest
        if not run.planned and tree.too_fast(x):
            raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit, hasty=True) from None
        raise
    if not run.starts.optima:
        found = tree.with_alternatives(tree.at(x, run.now), found, threads)
    classes = from_start(run, found)
    paths = {one: reference.path for one, reference in zip(classes, found, strict=True)}
    run.starts.keep_paths(paths, all_of_them=run.effort.most is None)
    if method.most is not None:
        return found[: method.most][: run.effort.most]
    found += _remaining_guides(tree, x, run, classes)
    return sorted(found, key=lambda reference: reference.cost)[: run.effort.most]


def _remaining_guides(
    tree: HomologyTree, x: Array, run: RunState, known: Sequence[ClassFromStart] = ()
) -> list[Reference]:
    """Return what is left of guides from x (n,), of classes that are not `known`; close to walls trees lack curves."""
    references = list[Reference]()
    homology, driven = run.route.homology, run.route.path.winding()
    for whole, (guide, *_) in run.starts.optima.items():
        if whole not in run.starts.sampled or whole in known:
            continue
        rest = guide.rest(run.clock.since_plan, tree.space.scene.goal.center)
        winding = integers(np.subtract(whole, driven))
        signature = homology.signature(homology.at(x, run.now), winding)
        if rest is not None and np.all(np.abs(signature - 1.0) <= tree.limit):
            references.append(Reference(winding=winding, signature=signature, trajectory=rest, named=homology.named))
    return references
