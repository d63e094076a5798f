"""The settings of a run: its system's, what the scene asks for, a preset and what the user said, in that order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pirrht.control.methods import TREELESS
from pirrht.errors import OptionError
from sim.options.settings import BETWEEN, PLANTS, SETTINGS
from sim.options.table import BY_SETTING, refuse_idle

__all__ = ["BETWEEN", "PLANTS", "PRESETS", "Settings", "refuse_idle", "settle"]

# The paper plans every dt and holds an open-loop control, averages over the classes and reads exit at step ends.
PRESETS: dict[str, dict[str, Any]] = {
    "paper": {option.dest: option.paper for option in SETTINGS if option.paper is not None},
}
DRIVES_AT_MOST = 10_000_000  # control steps of a drive


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Everything a run depends on besides the scene; all numbers in SI units.

    Raises:
        OptionError: a value is out of its option's bounds, or goes badly with another one.
    """

    noise: float = 0.1
    speed: float = 1.0
    rho: float = 1.0
    phi: float = np.inf
    seed: int = 0
    vertices: int = 1000
    grow: int | None = None  # vertices per period of a drive; None: 0, in real time as many as there is time for
    real_time: bool = False
    classes: int = 16
    samples: int = 200
    dt: float = 0.1
    period: float = 0.01
    limit: float = 0.6
    method: str = "pi-rrht"
    consistency: float = 0.8  # of "best-class"
    horizon: float = 3.0  # of "mppi" [s]
    exploration: float = 1.0  # of "mppi": noise of its samples over that of the robot
    plant: str = "mujoco"
    predict: str = "known"  # what plans take to come of bodies that move
    speed_limit: float = 0.0  # of ways among them [m/s]; 0: five times the best speed
    exit: str = "bridge"
    steps: str = "fitted"
    weights: str = "balance"
    between: str = "classes"
    guide: str = "feedback"
    target_error: float | None = None
    budget: int | None = None
    allocation: str = "contribution"
    draws: str = "antithetic"
    polish: bool = True
    max_time: float = 30.0
    threads: int | None = None
    tree: str | None = None  # file of a saved tree that is used instead of growing one
    plan_seed: int | None = None  # seed of the tree alone; None: derived from `seed`

    def __repr__(self) -> str:
        other = [f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if getattr(self, f.name) != f.default]
        return f"Settings({', '.join(other) or 'defaults'})"

    def __post_init__(self) -> None:
        for name, option in BY_SETTING.items():
            value = getattr(self, name)
            if value is not None:
                option.check(value)
        if self.budget is not None and (self.target_error is None or self.budget < self.samples):
            raise OptionError(f"--budget is {self.budget}; it needs --target-error and at least --samples")
        if self.real_time and self.target_error is not None:
            raise OptionError("--real-time and --target-error both say when to stop sampling; leave one of them out")
        if self.method == "mppi" and self.horizon < self.dt:
            raise OptionError(f"--horizon is {self.horizon:g}; it must be at least a step, --dt {self.dt:g}")
        if self.max_time / self.period > DRIVES_AT_MOST:
            raise OptionError(
                f"--max-time {self.max_time:g} is {self.max_time / self.period:.3g} periods of --period "
                f"{self.period:g}; a drive has at most {DRIVES_AT_MOST:,}: lower the one or raise the other"
            )
        self._check_growth()

    def _check_growth(self) -> None:
        if self.grow and self.method in TREELESS:
            raise OptionError(f"--grow is {self.grow}; --method {self.method} has no tree that could grow")
        bounds = BY_SETTING["vertices"].bounds
        assert bounds is not None
        size = self.vertices + (self.grow or 0) * self.max_time / self.period
        if not self.real_time and size > bounds.high:
            raise OptionError(
                f"--grow {self.grow} adds up to {size:.3g} vertices by --max-time {self.max_time:g}; a tree has at "
                f"most {bounds.high:,.0f}: lower one of them or raise --period"
            )


def settle(base: Settings, scene: Mapping[str, float], preset: Mapping[str, Any], given: Mapping[str, Any]) -> Settings:
    """The settings in force: a system's own, overlaid by what the scene, a preset and the user say (not None).

    Args:
        scene: by name of the option; what is no setting is left aside, here and in `given`.

    Raises:
        OptionError: a value that cannot work.
    """
    if "method" in given:  # a sweep settles before it takes each of its methods
        refuse_idle(given, [given["method"] or base.method])
    if given.get("tree") is not None and given.get("vertices") is not None:
        raise OptionError("--vertices and --tree: a saved tree brings its own vertices; leave one of them out")
    asked = {name.replace("-", "_"): value for name, value in scene.items()}
    said = {name: value for name, value in given.items() if value is not None}
    merged = {name: value for name, value in {**asked, **preset, **said}.items() if name in BY_SETTING}
    settings = replace(base, **{name: BY_SETTING[name].check(value) for name, value in merged.items()})
    if said.get("steps") == "fitted" and settings.exit == "endpoint":
        raise OptionError("--steps fitted goes with --exit bridge; steps that end a path at their ends are uniform")
    return settings
