"""Settings of a run from its system, scene, preset and user, in that order; what fits no memory is refused."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError
from sim.options.settings import SETTINGS
from sim.options.table import BY_SETTING, refuse_idle


class Preset(NamedTuple):
    """Settings under one name."""

    text: str
    fixed: dict[str, Any]  # field of `Settings` -> value
    factors: dict[str, float]  # field of `Settings` -> factor on the robot's own value


PRESETS = {
    "paper": Preset(
        "the published method: open loop, plain average, endpoint exit, uniform steps, equal independent samples",
        {option.dest: option.paper for option in SETTINGS if option.paper is not None}, {},
    ),
    "fast": Preset(
        "a quarter of the samples, half of the vertices, at most 6 classes",
        {"classes": 6}, {"samples": 0.25, "vertices": 0.5},
    ),
    "accurate": Preset("four times the samples, twice the vertices", {}, {"samples": 4.0, "vertices": 2.0}),
}  # fmt: skip
DRIVES_AT_MOST = 10_000_000  # control steps of a drive
GIB = 2.0**30
SHARE = 0.5  # of the memory of a machine may go to one plan
STEPS = 100_000  # of one path
WORK = 1e9  # steps of all paths of a plan
TAIL = 40.0  # paths are cut so many lambda after the cheapest reference (`pirrht.estimation.sampler`)
DOUBLINGS = 16  # of --samples under --target-error, without --budget


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """Size of a plan, besides its settings."""

    states: int  # n
    controls: int  # m
    obstacles: int  # M
    classes: int  # H, those allowed at the start
    distance: float  # from start to goal [m]
    speed: float  # at which it is driven [m/s]
    temperature: float  # lambda [cost]
    rate: float  # least q [cost/s]

    def seconds(self, settings: Settings) -> float:
        """About how long paths are before they are cut [s]."""
        if settings.method == "mppi":
            return settings.horizon
        return (2.0 * self.distance / self.speed + TAIL * self.temperature) / self.rate

    def steps(self, settings: Settings) -> float:
        """Count the rollout steps of a path."""
        return max(1.0, self.seconds(settings) / settings.dt)

    def samples(self, settings: Settings) -> float:
        """Count the samples that a plan draws at most."""
        most = settings.samples * DOUBLINGS if settings.budget is None else settings.budget
        return self.classes * float(settings.samples if settings.target_error is None else most)

    def sampling(self, settings: Settings) -> float:
        """Estimate the memory of samples, their proposals, and their weights under all of these [bytes]."""
        n, m, steps = self.states, self.controls, self.steps(settings)
        proposals = self.classes if settings.method in ("pi-rrht", "best-class") else 1
        each = 8.0 * (6 + 2 * m + 3 * proposals)
        if settings.method == "mppi":
            each += 8.0 * (steps + 1) * n  # those under way at the end of the tape are traced
        return self.samples(settings) * each + proposals * steps * 8.0 * (2 * m + 9)

    def tree(self, settings: Settings) -> float:
        """Estimate the memory of vertices, their nodes and the edges between them [bytes]."""
        near = 2.0 * math.e * math.log(settings.vertices + 1.0)
        nodes = min(4, settings.classes or 4)
        return settings.vertices * (8.0 * self.obstacles + 120.0 * nodes + 92.0 * near)


def check(settings: Settings, size: Size, memory: float | None = None) -> None:
    """Refuse a plan that is too large.

    Args:
        memory: of the machine [bytes]; None: look.

    Raises:
        OptionError: tells the size, the limit, and which option to change.
    """
    if settings.method == "optimal":
        return
    limit = SHARE * (physical() if memory is None else memory)
    steps, work = size.steps(settings), size.steps(settings) * size.samples(settings)
    if steps > STEPS:
        loud = settings.method != "mppi" and TAIL * size.temperature > 2.0 * size.distance / size.speed
        ways = ["lower --noise"] if loud else ["lower --horizon"] if settings.method == "mppi" else []
        longest = BY_SETTING["dt"].bounds
        if not ways or longest is None or size.seconds(settings) <= STEPS * longest.high:
            ways = ["raise --dt", *ways]
        raise OptionError(
            f"--dt {settings.dt:g}: a path of {size.seconds(settings):.3g} s has {steps:.3g} steps, and at most "
            f"{STEPS:,} are possible; {' or '.join(ways)}"
        )
    _refuse(size.tree(settings), limit, f"a tree of {settings.vertices} --vertices", "lower --vertices")
    drawn = f"{size.samples(settings):.3g} samples around {size.classes} classes"
    remedy = "--budget or --samples" if settings.target_error is not None else "--samples or --classes"
    _refuse(size.sampling(settings), limit, f"a plan of {drawn}", f"lower {remedy}")
    if work > WORK:
        raise OptionError(
            f"a plan of {drawn} takes {work:.3g} steps, and at most {WORK:.0e} are possible; lower {remedy}, or "
            "raise --dt"
        )


def physical() -> float:
    """The memory of this machine [bytes]."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):  # no such question on this system
        return 8.0 * GIB


def _refuse(needed: float, limit: float, what: str, remedy: str) -> None:
    if needed > limit:
        raise OptionError(
            f"{what} would take about {needed / GIB:.3g} GiB of memory, and at most {limit / GIB:.3g} GiB of this "
            f"machine's are given to it; {remedy}"
        )
