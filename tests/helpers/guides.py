"""The best guide of a class, as a controller's first plan or the one after it has it."""

from __future__ import annotations

from pirrht.arrays import Array
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide
from pirrht.steering.motion import Trajectory


def best(
    guidance: DDPGuidance, x: Array, times: Array, key: int, trajectory: Trajectory, last: DDPGuide | None = None,
    elapsed: float = 0.0, time: float = 0.0,
) -> DDPGuide | None:  # fmt: skip
    """The best local optimum from x (n,), started from a guide made `elapsed` [s] ago if there is one."""
    found = guidance.optima(guidance.query(x, times, key, time), trajectory, [] if last is None else [last], elapsed)
    return found[0] if found else None
