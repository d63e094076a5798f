"""Public JSON of plans, runs and estimates, which programs read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from pirrht.estimation.estimate import Estimate
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.topology.homology import Homology
from sim.drawing.sides import passing
from sim.drive.truth import Truth
from sim.scenario import Scenario
from sim.scenario.convergence import Convergence


def classes_json(references: Sequence[Reference], homology: Homology) -> list[dict[str, Any]]:
    """The classes, cheapest first; with a homology in time also how each passes moving obstacles."""
    return [
        {"id": r.id, "winding": list(r.winding), "signature": r.signature.tolist(), "cost": r.cost, "length": r.length}
        | ({"bodies": passing(r, homology)} if homology.J else {})
        for r in references
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
    scenario: Scenario, tree: HomologyTree, references: Sequence[Reference], seconds: float
) -> dict[str, Any]:
    """The public JSON of `plan`; `seconds` is the wall time of tree and references, without compiling."""
    return {
        "scene": scenario.loaded.scene.name,
        "robot": scenario.loaded.robot,
        "vertices": tree.size,
        "nodes": tree.node_count,
        "pruned_classes": int(tree.graph.pruned[0]),
        "seconds": seconds,
        "fcl_calls": scenario.space.collision.calls,
        **_windings_json(scenario, references),
        "passages": passages_json(tree, references),
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
    s, loaded = scenario.settings, scenario.loaded
    return {
        "scene": loaded.scene.name,
        "robot": loaded.robot,
        **{name: getattr(s, name) for name in ("method", "seed", "noise")},
        "lambda": scenario.problem.temperature,
        **{name: getattr(s, name) for name in ("samples", "dt", "period")},
        "margin": scenario.margin,
        **({"predict": s.predict} if scenario.moving else {}),
    }


def run_json(scenario: Scenario, references: Sequence[Reference], result: dict[str, Any]) -> dict[str, Any]:
    """The public JSON of `run`."""
    grow = scenario.settings.grow if scenario.settings.real_time else scenario.settings.grow or 0
    return {**settings_json(scenario), "grow": grow, **result, **_windings_json(scenario, references)}


def estimate_json(
    scenario: Scenario,
    references: Sequence[Reference],
    estimates: Sequence[Estimate | None],
    truth: Truth | None = None,
) -> dict[str, Any]:
    """The public JSON of `estimate`; null where every sample died. With a truth also that and the errors."""

    def each(figure: Callable[[Estimate], Any]) -> list[Any]:
        return [None if e is None else figure(e) for e in estimates]

    exact = {}
    if truth is not None:
        exact = {
            "truth": {"value": truth.value, "control": truth.control.tolist()},
            "value_error": each(lambda e: truth.errors(e)[0]),
            "control_error": each(lambda e: truth.errors(e)[1]),
        }
    names = ("value", "ess", "doubtful", "class_weights", "class_ess", "proposal_weights")
    return {
        **exact,
        **{name: each(attrgetter(name)) for name in names},
        "control": each(lambda e: e.control.tolist()),
        "value_stderr": each(lambda e: e.value_error),
        "control_stderr": each(lambda e: e.control_error.tolist()),
        "tail": each(lambda e: None if np.isnan(e.tail) else e.tail),
        "samples": each(lambda e: sum(part.size for part in e.parts)),
        **_windings_json(scenario, references),
    }


def _windings_json(scenario: Scenario, references: Sequence[Reference]) -> dict[str, Any]:
    """Classes, and the obstacles of the numbers of a winding: static ones with a marker, then moving ones."""
    parts = [(part.marker, part.names) for part in scenario.space.obstacles]
    return {
        "obstacles": [{"marker": m.tolist(), "geoms": list(names)} for m, names in parts if m is not None],
        "movers": list(scenario.space.homology.names),
        "classes": classes_json(references, scenario.homology),
    }
