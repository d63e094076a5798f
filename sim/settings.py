"""The settings of a run: robot defaults, what the scene asks for, a preset and what the user said, in that order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pirrht.control.best_class import CONSISTENCY
from pirrht.control.controller import BETWEEN
from pirrht.control.methods import METHODS, TREELESS
from pirrht.control.mppi import HORIZON
from pirrht.errors import OptionError
from pirrht.estimation.sampling import ALLOCATIONS, DRAWS, EXITS, GUIDES, STEPS, WEIGHTS

PLANTS = ("mujoco", "sde")
PRESETS: dict[str, dict[str, Any]] = {
    # The paper plans every dt and holds an open-loop control, averages over the classes and reads exit at step ends.
    "paper": {
        "dt": 0.1,
        "period": 0.1,
        "exit": "endpoint",
        "steps": "uniform",
        "weights": "average",
        "guide": "open-loop",
        "allocation": "equal",
        "draws": "independent",
        "between": "hold",
    },
}
BASELINES = {"consistency": "best-class", "horizon": "mppi", "exploration": "mppi"}  # option -> its only method
WITHOUT = {"mppi": {"guide": "open-loop", "draws": "independent"}}  # what else does nothing there
PAPER_SAMPLES = {"single_integrator": 200, "unicycle": 300}


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Everything a run depends on besides the scene; all numbers in SI units."""

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
    consistency: float = CONSISTENCY  # of "best-class"
    horizon: float = HORIZON  # of "mppi" [s]
    exploration: float = 1.0  # of "mppi": noise of its samples over that of the robot
    plant: str = "mujoco"
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

    def __post_init__(self) -> None:
        for name in ("noise", "speed", "rho", "dt", "period", "limit", "max_time", *BASELINES):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise OptionError(f"--{_flag(name)} is {value:g}; it must be a positive number")
        if np.isnan(self.phi) or self.phi < 0:
            raise OptionError(f"--phi is {self.phi:g}; it must be 0 or more ('inf' is allowed)")
        least = {"vertices": 1, "samples": 1, "threads": 1}
        least |= {"seed": 0, "grow": 0, "classes": 0, "plan_seed": 0}
        for name, bound in least.items():
            value = getattr(self, name)
            if value is not None and value < bound:
                raise OptionError(f"--{_flag(name)} is {value}; it must be a whole number of at least {bound}")
        if self.target_error is not None and not self.target_error > 0:
            raise OptionError(f"--target-error is {self.target_error:g}; it must be a positive number")
        if self.budget is not None and (self.target_error is None or self.budget < self.samples):
            raise OptionError(f"--budget is {self.budget}; it needs --target-error and at least --samples")
        if self.grow and self.method in TREELESS:
            raise OptionError(f"--grow is {self.grow}; --method {self.method} has no tree that could grow")
        if self.real_time and self.target_error is not None:
            raise OptionError("--real-time and --target-error both say when to stop sampling; leave one of them out")
        if self.method == "mppi" and self.horizon < self.dt:
            raise OptionError(f"--horizon is {self.horizon:g}; it must be at least a step, --dt {self.dt:g}")
        choices = {
            "method": METHODS,
            "plant": PLANTS,
            "exit": EXITS,
            "steps": STEPS,
            "weights": WEIGHTS,
            "guide": GUIDES,
            "allocation": ALLOCATIONS,
            "draws": DRAWS,
            "between": BETWEEN,
        }
        for name, known in choices.items():
            if getattr(self, name) not in known:
                raise OptionError(f"--{name} is {getattr(self, name)!r}; it must be one of {', '.join(known)}")


ROBOT_DEFAULTS = {
    "single_integrator": Settings(),
    "unicycle": Settings(
        noise=0.03,
        phi=1000.0,
        vertices=2000,
        samples=300,
        period=0.1,
        limit=0.8,
        max_time=60.0,
        exploration=10.0,  # with the robot's own noise tapes hardly move, and none of a few drives arrives
    ),
}


def settle(
    dynamics_name: str,
    scene_defaults: Mapping[str, float],
    given: Mapping[str, Any],
    preset: str | None = None,
) -> Settings:
    """The settings in force: robot's defaults, overlaid by the scene's, a preset's and the given ones (not None).

    Raises:
        OptionError: a value that cannot work, or an unknown preset.
    """
    if preset is not None and preset not in PRESETS:
        raise OptionError(f"--preset is {preset!r}; it must be one of {', '.join(PRESETS)}")
    base = ROBOT_DEFAULTS[dynamics_name]
    for name in ("speed", "rho"):
        if dynamics_name != "unicycle" and given.get(name) is not None:
            raise OptionError(f"--{name} is for cars and this robot is none; leave it out or choose --robot unicycle")
    if "method" in given:  # a sweep settles before it takes each of its methods
        refuse_idle(given, [given["method"] or base.method])
    if given.get("tree") is not None and given.get("vertices") is not None:
        raise OptionError("--vertices and --tree: a saved tree brings its own vertices; leave one of them out")
    known = {f.name for f in fields(Settings)}
    asked = {_field(name): value for name, value in scene_defaults.items() if _field(name) in known}
    layers: list[Mapping[str, Any]] = [asked]
    if preset is not None:
        layers.append({**PRESETS[preset], "samples": PAPER_SAMPLES[dynamics_name]})
    layers.append({name: value for name, value in given.items() if value is not None and name in known})
    merged = {name: value for layer in layers for name, value in layer.items()}
    settings = replace(base, **{name: _typed(name, value, base) for name, value in merged.items()})
    if given.get("steps") == "fitted" and settings.exit == "endpoint":
        raise OptionError("--steps fitted goes with --exit bridge; steps that end a path at their ends are uniform")
    return settings


def refuse_idle(given: Mapping[str, Any], methods: Sequence[str]) -> None:
    """Refuse what was given (not None) and that none of the methods would heed.

    Raises:
        OptionError: names the option and what it belongs to.
    """
    for name, method in BASELINES.items():
        if given.get(name) is not None and method not in methods:
            raise OptionError(f"--{name} is of the method {method} alone, which is not asked for; leave it out")
    for method, fixed in WITHOUT.items():
        for name, value in fixed.items() if set(methods) == {method} else ():
            if given.get(name) not in (None, value):
                raise OptionError(f"--{name}: the method {method} has no such choice; leave it out")


def _typed(name: str, value: Any, base: Settings) -> Any:
    if isinstance(getattr(base, name), int) and isinstance(value, float):
        if value != int(value):
            raise OptionError(f"--{_flag(name)} is {value:g}; it must be a whole number")
        return int(value)
    return value


def _flag(name: str) -> str:
    return name.replace("_", "-")


def _field(name: str) -> str:
    return name.replace("-", "_")
