"""Public JSON of plans, runs and estimates, which programs read."""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.risk import CollisionProbability
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.topology.signature import Signature, class_id
from sim.drawing.colors import passing
from sim.drawing.ways import ways_in
from sim.drive.metrics import Truth
from sim.scenario import Scenario

SENSED = ("sense", "lidar", "sense_pose", "cell", "unknown")  # settings of a lidar


def classes_json(
    references: Sequence[Reference], homology: Signature, names: Sequence[str], space: FreeSpace | None = None
) -> list[dict[str, Any]]:
    """The classes, cheapest first; with a homology in time also how each passes obstacles, static ones by `names`.

    Of paths through a `space` of three dimensions their ways are named.
    """
    bodies = passing(references, homology, names)
    ways = ways_in(space, references, names)
    return [
        {"id": r.id, "winding": list(r.winding), "signature": r.signature.tolist(), "cost": r.cost, "length": r.length}
        | ({"bodies": words} if homology.J else {})
        | ({"way": ways[k]} if ways else {})
        for k, (r, words) in enumerate(zip(references, bodies, strict=True))
    ]


def passages_json(tree: HomologyTree, references: Sequence[Reference]) -> dict[str, Any]:
    """Count open passages, and list those on no reference, narrowest first, lengths [m]."""
    passages, collision, unused = tree.passages, tree.space.collision, set(range(tree.passages.count))
    for reference in references if unused else ():  # in space there are no passages
        unused -= {*np.flatnonzero(passages.crossed(reference.trajectory.points)).tolist()}
    found = [
        {"at": passages.place[k].tolist(), "width": float(passages.width[k]), "between": passages.between(k, collision)}
        for k in sorted(unused)
    ]
    return {"open": passages.count, "unused": found}


def plan_json(
    scenario: Scenario, tree: HomologyTree, references: Sequence[Reference], seconds: float,
    collision: CollisionProbability | None = None,
) -> dict[str, Any]:  # fmt: skip
    """The public JSON of `plan`; `seconds` is the wall time of tree and references, without compiling."""
    return {
        "scene": scenario.loaded.scene.name, "robot": scenario.loaded.robot, "vertices": tree.size,
        "nodes": tree.node_count, "pruned_classes": int(tree.graph.pruned[0]), "seconds": seconds,
        "fcl_calls": scenario.space.collision.calls, **_windings_json(scenario, references),
        "passages": passages_json(tree, references), **_risk(collision), "margin": scenario.margin,
        "risk": scenario.settings.risk, **footprint_json(scenario),
    }  # fmt: skip


def _risk(collision: CollisionProbability | None) -> dict[str, Any]:
    return {"collision_probability": None if collision is None else collision._asdict()}


def convergence_json(
    tree: HomologyTree, x: Array, vertices: int, *, every: int, progress: Callable[[int], None] | None = None
) -> dict[str, Any]:
    """Grow a tree to so many vertices, and note each class's best length [m] from x (n,) every so often (Fig. 3a).

    Lengths are not shortened and never rise: infinite before a class is found. The tree does not depend on the notes.

    Returns:
        iterations of Algorithm 1 (random states drawn) and vertices at each note, and lengths by class, shortest first.
    """
    counts = [(tree.draws, tree.size)]
    notes = [tree.lengths(x)]

    while tree.size < vertices:
        before = tree.size
        tree.grow(min(vertices, before + every), progress=progress)
        if tree.size == before:
            break
        counts.append((tree.draws, tree.size))
        notes.append(tree.lengths(x))
    # A path once found stays one, also when the state's nearest vertices or the K cheapest classes become others.
    known = {
        winding: np.minimum.accumulate([note.get(winding, np.inf) for note in notes]).tolist()
        for winding in sorted({winding for note in notes for winding in note})
    }
    lengths = {class_id(winding): known[winding] for winding in sorted(known, key=lambda one: known[one][-1])}
    return {"iterations": [n for n, _ in counts], "vertices": [n for _, n in counts], "lengths": lengths}


def settings_json(scenario: Scenario) -> dict[str, Any]:
    """Return the settings of a run by the names of the public JSON."""
    s, loaded = scenario.settings, scenario.loaded
    known = {"scene": loaded.scene.name, "robot": loaded.robot, "method": s.method, "seed": s.seed, "noise": s.noise}
    known |= {"lambda": scenario.problem.temperature, "samples": s.samples, "dt": s.dt, "period": s.period}
    phi = scenario.problem.phi if np.isfinite(scenario.problem.phi) else None
    return {
        **known,
        "margin": scenario.margin,
        "risk": s.risk,
        "phi": phi,
        **({"predict": s.predict} if scenario.moving else {}),
        **({name: getattr(s, name) for name in SENSED} if s.sense == "lidar" else {}),
        **footprint_json(scenario),
    }


def footprint_json(scenario: Scenario) -> dict[str, Any]:
    """Return the corners of the robot, x ahead and y to the left of its place [m]; nothing of a disc."""
    body = scenario.loaded.scene.body
    return {} if body.is_disc else {"footprint": body.hull.tolist()}


def run_json(
    scenario: Scenario, references: Sequence[Reference], result: dict[str, Any],
    collision: CollisionProbability | None = None,
) -> dict[str, Any]:  # fmt: skip
    """The public JSON of `run`, with the probability of a collision that its first plan predicts."""
    grow = scenario.settings.grow if scenario.settings.real_time else scenario.settings.grow or 0
    settings = settings_json(scenario) | {"grow": grow}
    return {**settings, **result, **_risk(collision), **_windings_json(scenario, references)}


def estimate_json(
    scenario: Scenario, references: Sequence[Reference], estimates: Sequence[Estimate | None],
    truth: Truth | None = None, collisions: Sequence[CollisionProbability | None] = (),
) -> dict[str, Any]:  # fmt: skip
    """The public JSON of `estimate`; null where every sample died. With a truth also that and the errors."""
    exact: dict[str, Any] = {}
    figures: dict[str, Callable[[Estimate], Any]] = {}
    if truth is not None:
        exact["truth"] = {
            "value": truth.value,
            "control": truth.control.tolist(),
            "class_weights": dict(truth.shares),
            "class_weights_stderr": truth.share_errors,
        }
        figures |= {"value_error": lambda e: truth.errors(e)[0], "control_error": lambda e: truth.errors(e)[1]}
    names = ("value", "ess", "doubtful", "class_weights", "class_ess", "proposal_weights")
    figures |= {name: attrgetter(name) for name in names} | {
        "control": lambda e: e.control.tolist(),
        "value_stderr": attrgetter("value_error"),
        "control_stderr": lambda e: e.control_error.tolist(),
        "class_weights_stderr": attrgetter("class_weight_errors"),
        "tail": lambda e: None if np.isnan(e.tail) else e.tail,
        "samples": lambda e: sum(part.size for part in e.parts),
    }
    found = {name: [None if e is None else of(e) for e in estimates] for name, of in figures.items()}
    risks = {"collision_probability": [_risk(one)["collision_probability"] for one in collisions]}
    return {**exact, **found, **risks, **_windings_json(scenario, references)}


def _windings_json(scenario: Scenario, references: Sequence[Reference]) -> dict[str, Any]:
    """Classes, and the obstacles of the numbers of a winding: static ones with a marker, then moving ones."""
    space, names = scenario.space, scenario.names
    parts = zip(names, space.homology.markers.tolist(), (part.names for part in space.obstacles), strict=True)
    return {
        "obstacles": [{"name": name, "marker": marker, "geoms": list(geoms)} for name, marker, geoms in parts],
        "movers": list(space.homology.names),
        "classes": classes_json(references, scenario.homology, names, space),
    }
