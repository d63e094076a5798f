"""How much work goes into the paper's figures; less for a quick look, or for a test."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sim.scenario import Scenario, prepare

Tick = Callable[[], object]  # called when a piece of work is done


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """Counts, so that a seed means a figure; None: what the scene says."""

    seed: int = 0
    vertices: int | None = None  # of a tree
    samples: int | None = None  # around each reference in a drive
    max_time: float | None = None  # of a drive [s]
    noises: tuple[float, ...] = (
        *(0.05, 0.1, 0.15, 0.175, 0.2, 0.2125, 0.225, 0.2375, 0.25, 0.2625, 0.275, 0.3, 0.325, 0.35, 0.4),
    )
    draws: int = 30_000  # samples around each reference in an estimate of the shares ...
    estimates: int = 8  # ... of which so many are made
    paths: int = 2000  # optimal paths of the grid

    def scenario(self, scene: str, **given: Any) -> Scenario:
        """A scene under this effort; `given` has the last word."""
        own = {"seed": self.seed, "vertices": self.vertices, "samples": self.samples, "max_time": self.max_time}
        return prepare(scene, given={**own, **given})
