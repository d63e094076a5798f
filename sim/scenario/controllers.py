"""Who plans the drives of a task: PI-RRHT* and its kin over a tree, or MPPI."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pirrht.control.controller import Controller
from pirrht.control.methods import TREELESS
from pirrht.control.mppi import Mppi
from pirrht.control.prediction import ByVelocity, Prediction
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.tree.homology_tree import HomologyTree
from sim.scenario.task import Task
from sim.scenario.trees import rooted

QUICK = 400  # vertices at most of a tree that is grown within a control period


def controller(task: Task, tree: HomologyTree | None) -> Controller | Mppi:
    """The receding-horizon controller over a grown tree; MPPI if that is the method."""
    s = task.settings
    if s.method == "mppi":
        return mppi(task)
    return Controller(
        task.problem,
        task.space,
        tree,
        _at_once(task) if s.method in ("single", "passive") else task.sampling,
        method=s.method,
        polished=s.polish,
        consistency=s.consistency,
        between=s.between,
        homology=task.homology,
        predict=_prediction(task, trees=s.method not in TREELESS),
        rng=np.random.default_rng(task.seeds()[1]),
    )


def mppi(task: Task) -> Mppi:
    """MPPI, with at least as many samples as "pi-rrht" draws from the start."""
    s = task.settings
    sampling = replace(_at_once(task), first=None, guide="open-loop", draws="independent")
    problem = task.system.problem(task.loaded.scene, replace(s, noise=s.exploration * s.noise))
    home, rng = task.system.way_home(problem), np.random.default_rng(task.seeds()[1])
    return Mppi(
        problem, task.space, sampling, horizon=s.horizon, beyond=home, homology=task.homology,
        predict=_prediction(task, trees=False), rng=rng,
    )  # fmt: skip


def _at_once(task: Task) -> Sampling:
    """Sampling around one reference, or none, with at least as many samples as "pi-rrht" draws from the start."""
    s, classes = task.settings, task.classes_at_start()
    budget = None if s.budget is None else s.budget * classes
    return replace(task.sampling, samples=s.samples * classes, budget=budget)


def _prediction(task: Task, *, trees: bool) -> Prediction | None:
    """What plans take to come of bodies that move; None: they know."""
    if not task.moving or task.settings.predict == "known":
        return None
    seeds = task.seeds()[0].spawn(1)[0]

    def grown(space: FreeSpace) -> HomologyTree:
        return rooted(task, space, np.random.default_rng(seeds.spawn(1)[0]))

    vertices = min(task.settings.vertices, QUICK)
    return ByVelocity(task.space, task.in_time, grown if trees else None, vertices=vertices)
