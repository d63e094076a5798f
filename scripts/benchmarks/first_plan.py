"""What a plan claims that knows nothing from before."""

import time
from typing import Any

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.errors import NoReference


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
