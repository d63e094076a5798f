"""Public JSON of plans, runs and estimates, which programs read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pirrht.estimation.estimate import Estimate
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.topology.homology import Homology
from sim.drawing.sides import passing
from sim.drive.truth import Truth
from sim.scenario import Scenario
from sim.scenario.convergence import Convergence


def obstacles_json(space: FreeSpace) -> list[dict[str, Any]]:
    """The topological obstacles that stand, in the order of every winding; those that move come after them."""
    return [
        {"marker": [float(v) for v in part.marker], "geoms": list(part.names)}
        for part in space.obstacles
        if part.marker is not None
    ]


def classes_json(
    references: Sequence[Reference], ids: Sequence[str] | None = None, homology: Homology | None = None
) -> list[dict[str, Any]]:
    """The classes, cheapest first; with a homology in time also how each passes the bodies that move."""
    return [
        {
            "id": name,
            "winding": list(r.winding),
            "signature": r.signature.tolist(),
            "cost": r.cost,
            "length": r.length,
            **({"bodies": passing(r, homology)} if homology is not None and homology.J else {}),
        }
        for r, name in zip(references, ids or [r.id for r in references], strict=True)
    ]


def passages_json(tree: HomologyTree, references: Sequence[Reference]) -> dict[str, Any]:
    """Count open passages, and list those on no reference, narrowest first, lengths [m]."""
    passages, collision = tree.passages, tree.space.collision
    used = np.zeros(passages.count, dtype=bool)
    for reference in references:
        used |= passages.crossed(reference.trajectory.points)
    unused = [
        {"at": passages.place[k].tolist(), "width": float(passages.width[k]), "between": passages.between(k, collision)}
        for k in np.flatnonzero(~used).tolist()
    ]
    return {"open": passages.count, "unused": unused}


def plan_json(
    scenario: Scenario,
    tree: HomologyTree,
    references: Sequence[Reference],
    passages: dict[str, Any],
    seconds: float,
    convergence: Convergence | None = None,
) -> dict[str, Any]:
    """The public JSON of `plan`; with a convergence also the lengths [m] per class while the tree grew.

    Args:
        passages: `passages_json` of tree and references.
        seconds: wall time of both, without compiling.
    """
    watched = {} if convergence is None else {"convergence": convergence_json(convergence)}
    return {
        "scene": scenario.loaded.scene.name,
        "robot": scenario.loaded.robot,
        "vertices": tree.size,
        "nodes": tree.node_count,
        "pruned_classes": int(tree.graph.pruned[0]),
        "seconds": seconds,
        "fcl_calls": scenario.space.collision.calls,
        **_ways_json(scenario, references),
        "passages": passages,
        **watched,
    }


def convergence_json(convergence: Convergence) -> dict[str, Any]:
    """Iterations, vertices and, by class id, the length [m] of the best path; null where there is none."""
    return {
        "iterations": convergence.iterations.tolist(),
        "vertices": convergence.vertices.tolist(),
        "lengths": {name: convergence.lengths[:, c].tolist() for c, name in enumerate(convergence.ids)},
    }


def settings_json(scenario: Scenario) -> dict[str, Any]:
    """Return the settings of a run by the names of the public JSON."""
    s = scenario.settings
    return {
        "scene": scenario.loaded.scene.name,
        "robot": scenario.loaded.robot,
        "method": s.method,
        "seed": s.seed,
        "noise": s.noise,
        "lambda": scenario.problem.temperature,
        "samples": s.samples,
        "dt": s.dt,
        "period": s.period,
        "margin": scenario.margin,
        **({"predict": s.predict} if scenario.moving else {}),
    }


def run_json(scenario: Scenario, references: Sequence[Reference], result: dict[str, Any]) -> dict[str, Any]:
    """The public JSON of `run`."""
    s = scenario.settings
    return {
        **settings_json(scenario),
        "grow": s.grow if s.real_time else s.grow or 0,
        **result,
        **_ways_json(scenario, references),
    }


def estimate_json(
    scenario: Scenario,
    references: Sequence[Reference],
    estimates: Sequence[Estimate | None],
    truth: Truth | None = None,
) -> dict[str, Any]:
    """The public JSON of `estimate`; null where every sample died. With a truth also that and the errors."""
    return {
        **({} if truth is None else _truth_json(truth, estimates)),
        "control": [None if e is None else e.control.tolist() for e in estimates],
        "value": [None if e is None else e.value for e in estimates],
        "value_stderr": [None if e is None else e.value_error for e in estimates],
        "control_stderr": [None if e is None else e.control_error.tolist() for e in estimates],
        "ess": [None if e is None else e.ess for e in estimates],
        "doubtful": [None if e is None else e.doubtful for e in estimates],
        "tail": [None if e is None else _known(e.tail) for e in estimates],
        "samples": [None if e is None else sum(part.size for part in e.parts) for e in estimates],
        "class_weights": [None if e is None else e.class_weights for e in estimates],
        "class_ess": [None if e is None else e.class_ess for e in estimates],
        "proposal_weights": [None if e is None else e.proposal_weights for e in estimates],
        **_ways_json(scenario, references),
    }


def _ways_json(scenario: Scenario, references: Sequence[Reference]) -> dict[str, Any]:
    """Classes, and what the numbers of a winding stand for: the obstacles, then the bodies that move."""
    return {
        "obstacles": obstacles_json(scenario.space),
        "movers": list(scenario.space.homology.names),
        "classes": classes_json(references, homology=scenario.homology),
    }


def _known(value: float) -> float | None:
    """A number, or null where there is none."""
    return None if np.isnan(value) else value


def _truth_json(truth: Truth, estimates: Sequence[Estimate | None]) -> dict[str, Any]:
    errors = [None if e is None else truth.errors(e) for e in estimates]
    return {
        "truth": {"value": truth.value, "control": truth.control.tolist()},
        "value_error": [None if error is None else error[0] for error in errors],
        "control_error": [None if error is None else error[1] for error in errors],
    }
