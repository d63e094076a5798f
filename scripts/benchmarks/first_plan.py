"""What a plan claims that knows nothing from before."""

import time
from collections.abc import Sequence
from typing import Any

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.errors import NoReference
from pirrht.estimation.sampler import PathIntegral
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.proposals.proposal import Batch
from sim.scenario import Scenario


def controller_of(scenario: Scenario, tree: HomologyTree) -> Controller:
    """The controller that samples."""
    controller = scenario.controller(tree)
    assert isinstance(controller, Controller)
    return controller


def first_batch(scenario: Scenario, most: int | None = None) -> tuple[PathIntegral, Batch, Sequence[Reference], bool]:
    """The sampler and batch of a plan at the start, its first references, and whether these hold tapes."""
    tree = scenario.grown_tree()
    controller = controller_of(scenario, tree)
    references = tree.references(tree.at(scenario.start, 0.0))[:most]
    batch = controller.batch(scenario.start, references)
    return controller.path_integral, batch, references, tree.steering.drives


def first_plan(controller: Controller, x: Array, t: float = 0.0) -> dict[str, Any] | None:
    """What the first plan claims of a drive from x at t [s]; None without a reference or a survivor."""
    controller.begin(x, t)
    began = time.perf_counter()
    try:
        e = controller.plan(x).estimate
    except NoReference:
        return None
    seconds = time.perf_counter() - began
    if e is None:
        return None
    return {
        "v": e.value,
        "v_error": e.value_error,
        "u": e.control.tolist(),
        "u_error": e.control_error.tolist(),
        "ess": e.ess,
        "shares": e.class_weights,
        "samples": sum(part.size for part in e.parts),
        "ms": 1e3 * seconds,
    }
