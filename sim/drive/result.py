"""Result of a finished run: the one record that the JSON of `run`, rows of sweeps and scores are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

_KINDS = {"str": "string", "float": "float64", "int": "int64"}  # annotation -> Arrow


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column of a table, or a figure of a record."""

    name: str
    kind: str  # of Arrow: string, float64 or int64
    unit: str
    text: str


def _figure(unit: str, text: str) -> Any:
    return field(metadata={"unit": unit, "text": text})


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveResult:
    """The figures of a run, in SI units; `FIGURES` describes them."""

    outcome: str = _figure("", "goal, collision or timeout; null if the run ended with an error")
    time: float = _figure("s", "simulated time of the drive")
    cost: float = _figure("cost", "integral of q + u'Ru/2 up to the exit, phi not included")
    path_length: float = _figure("m", "driven, without the path's noise: by chords, less what noise adds to them")
    noisy_path_length: float = _figure("m", "driven with the noise of every physics step: grows with their number")
    steps: int = _figure("1", "control steps")
    vertices: int = _figure("1", "of the tree")
    min_clearance: float = _figure(
        "m",
        "clearance: free distance around the footprint, the disc as which the robot plans with its margin, least after "
        "any physics step, 0 after a collision; below 0 where a body that is slimmer passed without touching",
    )
    value_estimate: float | None = _figure(
        "cost", "v at the start: estimated, of the method optimal exact; infinite if no sample survived"
    )
    executed_class: str | None = _figure("", "homology class of the driven path; null unless the goal was reached")
    class_switches: int = _figure("1", "control steps whose class of greatest weight differs from the one before")
    class_reversals: int = _figure("1", "times that a class of nine tenths of the weight followed on another such one")
    fallbacks: int = _figure("1", "control steps without a reference or a surviving sample: the robot brakes")
    blocked_time: float = _figure("s", "simulated time of those steps")
    doubtful_plans: int = _figure("1", "control steps whose plan rests on fewer than 10 effective samples")
    least_ess: float | None = _figure("1", "least effective sample size of a plan; null for methods without samples")
    least_ess_time: float | None = _figure("s", "simulated time of that plan")
    step_ms: Mapping[str, float]  # median, p95 and max of the wall time of a plan [ms]
    deadline_misses: int  # plans that took longer than the period
    blocked: Sequence[tuple[float, float]] = ()  # from when to when the robot was [s]
    real_time: Mapping[str, Any] | None = None  # how a real-time drive kept its times (`clock.figures`)

    def __repr__(self) -> str:
        path = f"cost {self.cost:.4g}, {self.path_length:.3g} m, least clearance {self.min_clearance:.3g} m"
        return f"DriveResult({self.outcome} after {self.time:.4g} s: {path}, {self.steps} steps)"

    def json(self) -> dict[str, Any]:
        """Return the figures under the names of the public JSON."""
        known = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in known.items() if name != "real_time" or value is not None}


FIGURES = tuple(
    Column(name=f.name, kind=_KINDS[str(f.type).split(" ")[0]], unit=f.metadata["unit"], text=f.metadata["text"])
    for f in fields(DriveResult)
    if f.metadata
)


def explained() -> str:
    """Return all figures as text, one per line."""
    width = max(len(f.name) for f in FIGURES)
    units = {f.name: "" if f.unit in ("", "1") else f"[{f.unit}] " for f in FIGURES}
    return "\n".join(f"  {f.name:{width}}  {units[f.name]}{f.text}" for f in FIGURES)
