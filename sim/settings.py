"""Settings of a run and of its scene: each is stated once, with its default, unit, limits and help, and checked."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from pirrht.control.settings import BETWEEN, METHODS, TREELESS
from pirrht.errors import OptionError
from pirrht.estimation.sampling import ALLOCATIONS, DRAWS, EXITS, GUIDES, STEPS, WEIGHTS
from sim.states import forms_of
from sim.text import suggestion

SCENES = ("plan", "run", "play", "estimate", "sweep")  # commands that take a scene
DRIVES = (*SCENES, "ros")  # and the one whose scene others publish
SINGLE = ("plan", "run", "play", "estimate")  # those that take one method, noise and seed
GROUPS = ("scene and robot", "problem", "planner and sampler", "run", "grid", "recording", "files", "ROS 2")  # headings
SCENE, PROBLEM, PLANNER, RUN, GRID, *_ = GROUPS
SEED = 2**63 - 1  # the largest seed
PLACES = (-1e6, 1e6)  # coordinates of a scene [m]
RUN_PERIODS = 10_000_000  # control steps of a run at most
FORMS = {name: forms_of(f"{name}_form") for name in ("start", "goal", "workspace")}
_KINDS: dict[str, Callable[[str], Any]] = {"int": int, "float": float, "bool": bool, "Sequence[float]": float}


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One option of the command line; a scene may carry those that are numbers with a default."""

    name: str  # as it is typed, without the dashes
    text: str  # for a person, without the default
    commands: tuple[str, ...] = DRIVES
    group: str = ""  # heading of the help
    kind: Callable[[str], Any] = str  # of one value; bool for a flag
    metavar: str | tuple[str, ...] = ""  # for a number its unit
    count: int | str | None = None  # of values; "+" for one or more
    choices: tuple[str, ...] = ()
    bounds: tuple[float, float] | None = None  # least and greatest value, both allowed
    infinite: bool = False  # whether infinity is allowed as well
    default: Any = None  # in parsed arguments; settings have theirs in `Settings` and in systems
    unset: str = ""  # the help's word for a default of None
    attribute: str = ""  # name in records and in parsed arguments; empty: as `name`
    short: str = ""  # another way to type it
    positional: bool = False
    output: bool = False  # whether it names a file that is written
    required: bool = False
    role: str = "command"  # "setting" of a run, "scene", or of the "command" alone
    numeric: bool = False  # a scene may carry it, as the custom numeric `pirrht_NAME`
    extra: str = ""  # of the package, which it needs

    @property
    def dest(self) -> str:
        """Its name in `Settings` and in parsed arguments."""
        return self.attribute or self.name.replace("-", "_")

    @property
    def flag(self) -> str:
        """Its name as it is typed."""
        return str(self.metavar) if self.positional else f"--{self.name}"

    def check(self, value: Any, label: str = "") -> Any:
        """The value in its own type; OptionError where the option, in messages `label`, cannot have it."""
        label = label or self.flag
        if self.choices and value not in self.choices:
            raise OptionError(
                f"{label} is {value!r}{suggestion(value, self.choices)}; it must be one of {', '.join(self.choices)}"
            )
        if self.bounds is None:
            return value
        return self._number(value, label) if self.count is None else [self._number(one, label) for one in value]

    def _number(self, value: Any, label: str) -> Any:
        low, high = self.bounds or PLACES
        whole = self.kind is int

        with suppress(TypeError):  # it is no number
            if (low <= value <= high and not (whole and value % 1)) or (self.infinite and value == math.inf):
                return int(value) if whole else value
        required = f"{low:g} or more, and at most {high:g}{' (inf is allowed)' if self.infinite else ''}"
        if low > 0:
            required = f"a positive number, from {low:g} to {high:g}"
        if whole:
            required = f"a whole number of at least {low} and at most {high}"
        shown = f"{value:g}" if isinstance(value, float) else reprlib.repr(value)
        raise OptionError(f"{label} is {shown}; it must be {required}")


def stated(value: Any, text: str, metavar: Any = "", bounds: tuple[float, float] | None = None, **more: Any) -> Any:
    """A field of a record with its default value and all that its `Option` has."""
    return field(default=value, metadata={"text": text, "metavar": metavar, "bounds": bounds, **more})


def placed(name: str, unset: str, text: str, **more: Any) -> Any:
    """Field of numbers of one of several forms."""
    forms = FORMS[name]
    return stated(None, text + forms.text, forms.metavar, count="+", unset=unset, **more)


def one_of(choices: tuple[str, ...], text: str, metavar: str = "RULE", **more: Any) -> Any:
    """A field whose default is the first of some choices."""
    return stated(choices[0], text, metavar, choices=choices, **more)


def options_of_record(record: type, role: str, group: str) -> tuple[Option, ...]:
    """The options that the fields of a record state."""
    found = []
    for one in fields(record):
        kind = _KINDS.get(str(one.type).split(" ")[0], str)
        name = one.name.replace("_", "-")
        numeric = kind in (int, float) and "count" not in one.metadata and (role == "scene" or one.default is not None)
        more = {"name": f"no-{name}" if one.default is True else name, "group": group, "kind": kind, **one.metadata}
        found.append(Option(attribute=one.name, role=role, numeric=numeric, **more))
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneOptions:
    """Choices of scene, robot and task; None where the scene decides. OptionError: a value is out of its bounds."""

    # fmt: off
    robot: Any = stated(None, "puck, unicycle, diffdrive, hover, rover, jackal, car, ball, drone or an MJCF file",
                        "NAME", unset="the scene's")
    system: Any = stated(None,
                         "a `sim.systems.System`, or a function that returns one, from a module here or installed",
                         "MODULE:NAME", unset="the robot's")
    radius: float | None = stated(None, "footprint radius of the robot", "M", (1e-3, 100.0), unset="the robot's")
    footprint: Any = stated(None, "jackal, turtlebot4, car or LENGTHxWIDTH[@OFFSET] [m], middle OFFSET ahead of x, y",
                            "SHAPE", unset="the robot's")
    margin: float | None = stated(None, "safety margin of plans around the footprint", "M", (0.0, 10.0),
                                  unset="the scene's, or three standard deviations of the noise in 0.01 s, less in "
                                        "narrow passages")
    start: Sequence[float] | None = placed("start", "the scene's", "", commands=SCENES)
    goal: Sequence[float] | None = placed("goal", "the scene's", "", commands=SCENES)
    workspace: Sequence[float] | None = placed("workspace", "the scene's site or floor",
                                               "border of the robot's centre: ", bounds=PLACES)
    freeze: bool | None = stated(None, "weld bodies with joints at keyframe or default pose, and drop actuators",
                                 commands=SCENES)
    without: Sequence[str] | None = stated(None, "leave out bodies and what refers to them", "BODY", count="+",
                                           commands=SCENES)
    preset: str | None = stated(None, "paper, fast or accurate", "NAME", group=PLANNER)
    # fmt: on

    def __post_init__(self) -> None:
        _check(self, BY_SCENE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Everything a run depends on besides the scene, in SI units; OptionError: out of bounds, or two that clash."""

    # fmt: off
    noise: float = stated(0.1, "noise b in the robot's unit", "B", (1e-6, 1e3), group=PROBLEM,
                          commands=(*SINGLE, "ros"))
    speed: float = stated(1.0, "speed of a unicycle, best speed of a puck or rover", "M/S", (1e-3, 1e3), group=PROBLEM)
    rho: float = stated(1.0, "turning radius of a unicycle at |u| = 1 and V = 1", "M", (1e-3, 1e4), group=PROBLEM)
    phi: float = stated(np.inf, "final cost of a path that ends off the goal", "COST", (0.0, 1e12), infinite=True,
                        group=PROBLEM)
    risk: float | None = stated(None, "take the least margin with which runs collide at most this often (twice "
                                "the 95 % bound)", "DELTA", (1e-6, 0.5), unset="by --margin", group=PROBLEM)
    risk_infeasible: str = one_of(("stop", "best"), "where no margin keeps --risk: stop, or take the nearest",
                                  group=PROBLEM)
    seed: int = stated(0, "seed of tree, samples and plant noise", "N", (0, SEED), group=PROBLEM,
                       commands=(*SINGLE, "ros"))
    method: str = one_of(tuple(METHODS), ", ".join(METHODS), metavar="NAME", commands=(*SINGLE, "ros"))
    samples: int = stated(200, "samples around each reference", "N", (1, 10_000_000))
    vertices: int = stated(1000, "vertices of the tree", "N", (1, 1_000_000))
    classes: int = stated(16, "classes per vertex at most, 0 for all", "K", (0, 10_000))
    limit: float = stated(0.6, "H_limit of |1 - H_i| <= H_limit; a default is widened to 0.8, 1 or 1.5 until all "
                          "classes of at most 1.5 times the shortest path are in, or --classes of them", "H",
                          (1e-3, 100.0))
    target_error: float | None = stated(None, "draw until the control's standard error is less", "EPS", (1e-6, 1e3))
    budget: int | None = stated(None, "most samples of a reference under --target-error", "N", (1, 100_000_000),
                                unset="16 --samples")
    dt: float = stated(0.1, "rollout step", "S", (1e-5, 10.0))
    period: float = stated(0.01, "control period: time between plans", "S", (1e-5, 100.0))
    threads: int | None = stated(None, "threads; results do not depend on it", "N", (1, 1024), unset="all cores")
    exit: str = one_of(EXITS, "first exit along the step (bridge) or at its end (endpoint, paper)")
    steps: str = one_of(STEPS, "rollout steps: split near walls and goal (fitted) or all of --dt (uniform, paper)")
    weights: str = one_of(WEIGHTS, "balance, average (paper) or biased (no likelihood ratio, as Biased-MPPI)")
    guide: str = one_of(GUIDES, "proposals: feedback or open-loop (paper)")
    between: str = one_of(BETWEEN, "between plans the control follows the state (classes) or is held (hold, paper)")
    allocation: str = one_of(ALLOCATIONS, "samples per reference: by contribution to earlier plans, or equal (paper)")
    draws: str = one_of(DRAWS, "pairs of opposite noise (antithetic) or independent samples (paper)")
    polish: bool = stated(True, "do not shorten references")
    tree: str | None = stated(None, "a tree that `pirrht plan -o` saved", "TREE.npz", commands=SCENES[1:])
    consistency: float = stated(0.8, "best-class: factor on the value of the class followed", "C", (1e-3, 1e3))
    look_ahead: float = stated(0.6, "pursuit: distance to the point that is steered to", "M", (0.01, 100.0))
    horizon: float = stated(3.0, "mppi: length of its control sequence", "S", (1e-3, 1e4))
    mppi_terminal: str = one_of(("path", "straight"), "mppi: cost after its horizon by the shortest path or the "
                                "straight line")
    exploration: float = stated(1.25, "mppi: noise of its samples, as a multiple of the robot's; with more it collides "
                                "less often, at more cost", "X", (1e-3, 1e3))
    predict: str = one_of(("known", "velocity"), "motions of obstacles: known, or predicted by constant velocity")
    speed_limit: float = stated(0.0, "speed limit among moving obstacles; 0: five times the best speed", "M/S",
                                (0.0, 1e3))
    brake: float = stated(0.0, "deceleration: the robot keeps to speeds from which it can stop; 0: it stops at once",
                          "M/S2", (0.0, 100.0))
    sense: str = one_of(("map", "lidar"), "plans know the scene, or what a lidar shows")
    lidar: str | None = stated(None, "what differs from 270 degrees, 720 rays, 0.1 to 30 m, sigma 1 mm, 10 Hz: fov, "
                               "rays, least, most, sigma, rate, x, y, z, yaw", "PART=VALUE,...", unset="BARN's",
                               commands=SCENES)
    sense_pose: float = stated(0.0, "standard deviation of the place that the robot believes to be at", "M",
                               (0.0, 1.0), commands=SCENES)
    cell: float = stated(0.05, "side of a cell of the lidar's map", "M", (0.005, 1.0))
    unknown: float = stated(0.0, "price of a metre of a path that no ray has shown", "COST", (0.0, 1e6))
    plant: str = one_of(("mujoco", "sde"), "simulate in MuJoCo (mujoco), or by the equation alone (sde)",
                        metavar="NAME", commands=SCENES)
    max_time: float = stated(30.0, "simulated time after which a run ends", "S", (1e-3, 86_400.0),
                            commands=SCENES)
    real_time: bool = stated(False, "run against the clock; results differ from run to run", group=RUN,
                             commands=("run",))
    grow: int | None = stated(None, "vertices that the tree gains between two plans; in real time at most", "N",
                              (0, 10_000), unset="0", group=RUN, commands=("run", "play"))
    plan_seed: int | None = stated(None, "seed of trees", "N", (0, SEED), default=0, group=GRID, commands=("sweep",))
    # fmt: on

    def __repr__(self) -> str:
        other = [f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if getattr(self, f.name) != f.default]
        return f"Settings({', '.join(other) or 'defaults'})"

    def __post_init__(self) -> None:
        _check(self, BY_SETTING)

        grow = self.grow or 0
        length = self.max_time / self.period
        most = (BY_SETTING["vertices"].bounds or PLACES)[1]

        size = self.vertices + grow * length
        for wrong, message in (
            *self._sensing(),
            (self.budget is not None and (self.target_error is None or self.budget < self.samples),
             f"--budget is {self.budget}; it needs --target-error and at least --samples"),
            (self.real_time and self.target_error is not None,
             "--real-time and --target-error both decide when sampling ends; leave one of them out"),
            (self.method == "mppi" and self.horizon < self.dt,
             f"--horizon is {self.horizon:g}; it must be at least a step, --dt {self.dt:g}"),
            (length > RUN_PERIODS,
             f"--max-time {self.max_time:g} is {length:.3g} periods of --period {self.period:g}; a run has at most "
             f"{RUN_PERIODS:,}: lower the one or raise the other"),
            (grow and self.method in TREELESS,
             f"--grow is {grow}; --method {self.method} has no tree that could grow"),
            (not self.real_time and size > most,
             f"--grow {grow} adds up to {size:.3g} vertices by --max-time {self.max_time:g}; a tree has at most "
             f"{most:,}: lower one of them or raise --period"),
        ):  # fmt: skip
            if wrong:
                raise OptionError(message)

    def _sensing(self) -> tuple[tuple[bool, str], ...]:
        """Return what of a lidar's settings cannot be, and why."""
        lidar = self.sense == "lidar"
        parts = self.lidar is not None or self.unknown > 0.0 or self.sense_pose > 0.0
        cell = {one.name: one.default for one in fields(self)}["cell"]
        return (
            (lidar and (self.plant != "mujoco" or self.method == "optimal"),
             f"--sense lidar needs a plant in MuJoCo and a method that replans, and this is --plant {self.plant} "
             f"--method {self.method}"),
            (self.unknown > 0.0 and self.method in TREELESS,
             f"--unknown is a price of references, and --method {self.method} has none; leave it out"),
            (not lidar and (parts or self.cell != cell),
             "--lidar, --cell, --unknown and --sense-pose go with --sense lidar"),
            (lidar and self.risk is not None,
             "--risk is the risk among known obstacles; leave it out with --sense lidar, and give --margin"),
        )  # fmt: skip


def _check(record: Settings | SceneOptions, options: Mapping[str, Option]) -> None:
    """Refuse values of a record that its options do not admit."""
    for name, option in options.items():
        if (value := getattr(record, name)) is not None:
            option.check(value)


SCENE_OPTIONS = options_of_record(SceneOptions, "scene", SCENE)
SETTINGS = options_of_record(Settings, "setting", PLANNER)
BY_SCENE = {option.dest: option for option in SCENE_OPTIONS}
BY_SETTING = {option.dest: option for option in SETTINGS}
SPECIAL = frozenset(("noise", "speed", "rho"))  # settings that only systems use that name them
IDENTIFYING = {*BY_SCENE, *BY_SETTING} - {"threads"}  # runs with different values belong into different datasets
ONLY = {  # setting -> the method that uses it
    "consistency": "best-class", "look_ahead": "pursuit", "horizon": "mppi", "exploration": "mppi",
    "mppi_terminal": "mppi",
}  # fmt: skip
FIXED = {"mppi": {"guide": "open-loop", "draws": "independent"}}  # method -> settings that have one value there
PRESETS: dict[str, tuple[str, dict[str, Any], dict[str, float]]] = {  # name -> text, values, factors on the robot's own
    "paper": (
        "the published method: open loop, plain average, endpoint exit, uniform steps, equal independent samples",
        {"dt": 0.1, "period": 0.1, "exit": "endpoint", "steps": "uniform", "weights": "average", "guide": "open-loop",
         "between": "hold", "allocation": "equal", "draws": "independent"}, {},
    ),
    "fast": (
        "a quarter of the samples, half of the vertices, at most 6 classes",
        {"classes": 6}, {"samples": 0.25, "vertices": 0.5},
    ),
    "accurate": ("four times the samples, twice the vertices", {}, {"samples": 4.0, "vertices": 2.0}),
}  # fmt: skip


def refuse_unused(given: Mapping[str, Any], methods: Sequence[str]) -> None:
    """Refuse settings that were given (not None) and that none of the methods uses; OptionError names the method."""
    for name in [name for name in BY_SETTING if given.get(name) is not None]:
        flag = BY_SETTING[name].flag
        if name in ONLY and ONLY[name] not in methods:
            raise OptionError(
                f"{flag} is of the method {ONLY[name]} alone, which is not among those chosen; leave it out"
            )
        if methods and all(given[name] != FIXED.get(one, {}).get(name, given[name]) for one in methods):
            raise OptionError(f"{flag}: the method {methods[0]} has no such choice; leave it out")


def resolve(
    base: Settings, scene: Mapping[str, float], preset: Mapping[str, Any], given: Mapping[str, Any]
) -> Settings:
    """Overlay a system's settings by those of the scene, a preset and the user (not None); OptionError: none can be.

    What is no setting is left aside in `scene`, by name of the option, and in `given`.
    """
    if "method" in given:  # a sweep resolves settings before it takes each of its methods
        refuse_unused(given, [given["method"] or base.method])
    if given.get("tree") is not None and given.get("vertices") is not None:
        raise OptionError("--vertices and --tree: a saved tree brings its own vertices; leave one of them out")
    own = {name.replace("-", "_"): value for name, value in scene.items()}
    user = {name: value for name, value in given.items() if value is not None}
    merged = {name: value for name, value in {**own, **preset, **user}.items() if name in BY_SETTING}
    settings = replace(base, **{name: BY_SETTING[name].check(value) for name, value in merged.items()})
    if user.get("steps") == "fitted" and settings.exit == "endpoint":
        raise OptionError("--steps fitted goes with --exit bridge; steps that end a path at their ends are uniform")
    return settings
