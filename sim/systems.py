"""Systems, one record each: dynamics, costs, steering and defaults; a registry that robots name them in.

A robot's MJCF names a system (`pirrht_dynamics`); `--system MODULE:NAME` takes one of somebody's own instead. Without
`steering` its references are those of a point that moves straight at a pace, on a tree of positions alone, and guides
make them feasible. References are then not the system's optimum, and their classes are ordered by what they cost the
point. The pace is where the system's cost per meter is least, if there is such a one; else declare `pace`.
"""

import importlib
import os
import re
import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError, one_line
from sim.settings import BY_SETTING, PRESETS, SPECIAL, Settings
from sim.states import ADAPTERS, StateAdapter, adapter_of
from sim.text import suggestion

LONGEST = 200  # characters of a reason that numba gives
_PLACES = re.compile(r'File "([^"\n]+)", line (\d+)|Raised from ([^\n]+) \((\d+)\)')  # as numba names them

_folders: set[Path] = set()  # of modules that systems came from
POSE = ("x", "y", "heading")  # states of the built-in systems on the ground


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class System:
    """A kind of robot: what the method and the simulator must know of it; OptionError where defaults cannot work."""

    name: str  # as in `<text name="pirrht_dynamics" data="NAME"/>`
    dynamics: Callable[[Settings], Any]  # the `pirrht.Dynamics`, of which `states` must be the same
    R: Array | Callable[[Array], Array]  # control cost, as in `pirrht.Problem`
    steering: Callable[[Any], Any] | None = None  # a `pirrht.Problem` -> its `pirrht.Steering`; None: guides find a way
    pace: float | None = None  # of references without steering [m/s]; None: what the cost says
    q: float | Callable[..., float] | str = 1.0  # state cost rate [cost/s], or MODULE:NAME of a function
    q_min: float | None = None
    urge: Callable[[Settings], float] | None = None  # that rate as settings have it, in place of q
    states: tuple[str, ...] = ()  # (n,) names of the components of a state; none: those of the dynamics
    defaults: Mapping[str, Any] = field(default_factory=dict)  # field of `Settings` -> value, where it is another
    home: Callable[[Any], Any] | None = None  # a `pirrht.Problem` -> MPPI's terminal cost; None: along shortest paths
    twists: int = 2  # numbers of `Dynamics.twist`, which a robot's `pirrht_command` turns into commands
    paper_samples: int = 200  # N under `--preset paper`
    heeds: tuple[str, ...] = ("noise",)  # of noise, speed and rho those that `dynamics` reads
    own: tuple[str, ...] = ()  # fields of `Settings` that scenes meant for other systems do not set
    robots: tuple[str, ...] = ()  # names of its robots in the help; none: the help leaves it out
    noise_in: str = ""  # the unit of `--noise`, for the help
    settings: Settings = field(init=False)  # of a run without options
    adapter: StateAdapter = field(init=False)  # of its states to joints, scenes and pictures

    def __post_init__(self) -> None:
        settings = (*self.defaults, *self.own)
        for given, known, what in ((settings, BY_SETTING, "setting"), (self.heeds, SPECIAL, "setting to heed")):
            for strange in set(given) - set(known):
                raise OptionError(f"system {self.name}: {strange!r} is no {what}; those are {', '.join(sorted(known))}")
        object.__setattr__(self, "settings", Settings(**self.defaults))
        if not self.states:
            object.__setattr__(self, "states", ADAPTERS[0].pose[: ADAPTERS[0].dimension])
            with suppress(Exception):  # `problem` reports what is wrong
                object.__setattr__(self, "states", tuple(self.dynamics(self.settings).states))
        try:
            object.__setattr__(self, "adapter", adapter_of(self.states))
        except ValueError as error:
            raise OptionError(f"system {self.name}: its states are {self.states}; {error}") from None

    def __repr__(self) -> str:
        return f"System({self.name})"

    @property
    def called(self) -> str:
        """Name in messages: the first robot that the help names, or its own name."""
        return self.robots[0] if self.robots else self.name

    def heard(self, scene: Mapping[str, float], meant: str) -> dict[str, float]:
        """Select a scene's options, by name, that are not meant for another system, `meant`."""
        deaf = self.own if meant != self.name else ()
        return {name: value for name, value in scene.items() if name.replace("-", "_") not in deaf}

    def preset(self, name: str | None) -> dict[str, Any]:
        """Return the settings of a preset; none without a name."""
        if name is None:
            return {}
        if name not in PRESETS:
            like = suggestion(name, PRESETS)
            raise OptionError(f"--preset is {name!r}{like}; it must be one of {', '.join(PRESETS)}")
        _, fixed, factors = PRESETS[name]
        own = {"samples": self.paper_samples} if name == "paper" else {}
        return {**fixed, **own, **{one: round(by * getattr(self.settings, one)) for one, by in factors.items()}}

    def problem(self, scene: Any, settings: Settings) -> Any:
        """Return the `pirrht.Problem` in a `pirrht.Scene`; OptionError or NotLinearlySolvable where it cannot work."""
        from pirrht.problem import Problem

        dynamics, q = self._made("dynamics", settings), self.q
        if tuple(getattr(dynamics, "states", ())) != self.states:
            raise OptionError(
                f"system {self.name}: {type(dynamics).__name__} has the states {getattr(dynamics, 'states', None)} and "
                f"the system says {self.states}; make them the same"
            )
        if self.urge is not None:
            q = float(self._made("urge", settings))
        elif isinstance(q, str):
            q = imported(q)
        return Problem(dynamics=dynamics, scene=scene, R=self.R, q=q, q_min=self.q_min, phi=settings.phi)

    def steered(self, problem: Any) -> Any:
        """Return the `pirrht.Steering` of a problem."""
        if self.steering is not None:
            return self._made("steering", problem)
        from pirrht.steering.pieces import SpaceLine, TrackedInSpace
        from pirrht.steering.straight_line import StraightLine, Tracked
        from pirrht.steering.turn_and_go import TurnAndGo
        from pirrht.traits import Traits

        line, tracked = (SpaceLine, TrackedInSpace) if self.adapter.dimension == 3 else (StraightLine, Tracked)
        try:
            if Traits.of(problem).isotropic_point:
                return line.of(problem)
            kind = tracked if problem.scene.footprint.is_disc else TurnAndGo
            return kind.of(problem, self.pace)
        except OptionError as error:
            raise OptionError(f"system {self.name}: {error}") from None

    def cost_to_go(self, problem: Any, remaining: Callable[[Array], Array]) -> Any:
        """Return the cost of the path from states (k, n) to the goal, for MPPI, by what remains of it (`cost_to_go`).

        It is the steering's own to the path's end, at the best of the goal's states there; a point's without one.
        """
        from pirrht.control.cost_to_go import cost_to_go
        from pirrht.traits import Traits

        if self.home is not None:
            return self._made("home", problem)
        d, goal, steering = problem.dynamics, problem.scene.goal, self.steered(problem)
        position = self.adapter.position
        traits = Traits.of(problem)
        if self.steering is None and not traits.isotropic_point:
            return lambda states: steering.cost_per_meter * np.hypot.reduce(remaining(states[:, position]), axis=1)
        if traits.noisy_position or d.f(d.state_of(problem.scene.start))[position].any():
            return cost_to_go(problem, remaining)
        ends = np.asarray(steering.roots(goal.center))

        def terminal_cost(states: Array) -> Array:
            rest = remaining(states[:, position])
            heads = np.repeat(ends[None], len(states), axis=0)
            heads[:, :, position] += (states[:, position] + rest - goal.center)[:, None]
            costs = [steering.distance(states, heads[:, k]) for k in range(len(ends))]
            return np.where(rest.any(axis=1), np.min(costs, axis=0), 0.0)

        return terminal_cost

    def _made(self, what: str, argument: Any) -> Any:
        """Call one of its functions; an error of its own names it."""
        try:
            return getattr(self, what)(argument)
        except PirrhtError:
            raise
        except Exception as error:
            raise OptionError(f"system {self.name}: {one_line(error)} in its {what}; fix it") from error


def imported(path: str) -> Any:
    """Import MODULE:NAME."""
    module, _, name = path.partition(":")
    return getattr(importlib.import_module(module), name)


def _dynamics(path: str) -> Callable[[Settings], Any]:
    """Return what makes dynamics of a class with the noise of the settings; the class is imported only then."""
    return lambda settings: imported(f"pirrht.systems.{path}")(b=settings.noise)


def _steering(path: str) -> Callable[[Any], Any]:
    """Return what makes the steering of a problem, of a class that is imported only then."""
    return lambda problem: imported(f"pirrht.steering.{path}").of(problem)


SYSTEMS = (  # an `urge` of v'v, where R = 2, asks for the speed v of the settings
    System(
        name="single_integrator", dynamics=_dynamics("single_integrator:SingleIntegrator"),
        steering=_steering("straight_line:StraightLine"), R=2.0 * np.eye(2), states=POSE[:2], urge=lambda s: s.speed**2,
        heeds=("noise", "speed"), robots=("puck",), noise_in="m/sqrt(s)",
    ),
    System(
        name="unicycle",
        dynamics=lambda s: imported("pirrht.systems.unicycle:Unicycle")(V=s.speed, rho=s.rho, b=s.noise),
        steering=_steering("dubins:Dubins"), R=np.eye(1), states=POSE,
        defaults={
            "noise": 0.03, "phi": 1000.0, "vertices": 2000, "samples": 300, "period": 0.1, "limit": 0.8,
            "max_time": 60.0, "exploration": 10.0,  # with its own noise control sequences hardly move, and few arrive
        },
        paper_samples=300, heeds=("noise", "speed", "rho"), robots=("unicycle", "diffdrive"), noise_in="rad/sqrt(s)",
    ),
    System(  # its noise has a unit, its paths a speed of their own
        name="double_integrator", dynamics=_dynamics("double_integrator:DoubleIntegrator"),
        steering=_steering("double_integrator:MassSteering"), R=2.0 * np.eye(2), states=("x", "y", "vx", "vy"),
        defaults={
            "vertices": 2000, "samples": 300, "period": 0.05,
            "horizon": 1.5,  # over longer ones noise alone carries control sequences into walls
        },
        paper_samples=300, own=("noise", "vertices", "samples", "dt", "period"), robots=("hover",),
        noise_in="m/s/sqrt(s)",
    ),
    System(  # its paths have a speed of their own
        name="rover", dynamics=_dynamics("rover:Rover"), R=np.diag([2.0, 0.5]), urge=lambda s: s.speed**2, states=POSE,
        defaults={"vertices": 2000, "samples": 300, "period": 0.05}, paper_samples=300, heeds=("noise", "speed"),
        own=("vertices", "samples", "dt", "period"), robots=("rover",), noise_in="m/sqrt(s), 2b rad/sqrt(s)",
    ),
    System(  # a rover whose wheels have inertia
        name="jackal", dynamics=_dynamics("rover:Rover"), R=np.diag([2.0, 0.5]), urge=lambda s: s.speed**2, states=POSE,
        defaults={"noise": 0.05, "vertices": 400, "samples": 300, "period": 0.1, "brake": 3.0, "max_time": 60.0},
        paper_samples=300, heeds=("noise", "speed"), own=("noise", "vertices", "samples", "dt", "period"),
        robots=("jackal",), noise_in="m/sqrt(s), 2b rad/sqrt(s)",
    ),
    System(
        name="second_order_car", dynamics=_dynamics("second_order_car:SecondOrderCar"), R=np.eye(2), q_min=1.0,
        q="pirrht.systems.second_order_car:cruising", states=(*POSE, "speed"), twists=3,
        defaults={"samples": 300, "period": 0.1, "phi": 1000.0, "max_time": 60.0}, paper_samples=300,
        own=("noise", "vertices", "samples", "dt", "period"), robots=("car",), noise_in="rad/sqrt(s), m/s/sqrt(s)",
    ),
    System(
        name="ball", dynamics=_dynamics("ball:Ball"), steering=_steering("pieces:SpaceLine"), R=2.0 * np.eye(3),
        states=("x", "y", "z"), urge=lambda s: s.speed**2, twists=3, heeds=("noise", "speed"), robots=("ball",),
        defaults={"noise": 0.35, "samples": 300, "period": 0.05, "limit": 1.0}, paper_samples=300, noise_in="m/sqrt(s)",
    ),
    System(  # its pace is about that of the best path over 3 m
        name="drone", dynamics=_dynamics("drone:Drone"), pace=1.0,
        R=2.0 * np.eye(3), states=("x", "y", "z", "vx", "vy", "vz"), twists=3, robots=("drone",),
        defaults={"noise": 0.3, "samples": 300, "period": 0.05, "limit": 1.0}, paper_samples=300,
        own=("noise", "vertices", "samples", "dt", "period"), noise_in="m/s/sqrt(s)",
    ),
)  # fmt: skip
_known: dict[str, System] = {system.name: system for system in SYSTEMS}
BUILT_IN = tuple(_known)


def register(system: System) -> System:
    """Make a system known by its name, in place of an earlier one; OptionError if that one is built in."""
    if not isinstance(system, System):
        raise OptionError(f"{system!r} is no sim.systems.System; make one with System(name=..., dynamics=..., ...)")
    if system.name in BUILT_IN and _known[system.name] is not system:
        raise OptionError(f"system {system.name}: that name is taken by one that is built in; choose another")
    _known[system.name] = system
    return system


def names() -> tuple[str, ...]:
    """Return the names of all that are registered, built-in ones first."""
    return tuple(_known)


def named(name: str) -> System:
    """Return the system of that name; OptionError if none has it."""
    if name not in _known:
        raise OptionError(f"no system is called {name!r}; known are {', '.join(_known)}, or give --system MODULE:NAME")
    return _known[name]


def refuse(system: System, given: Mapping[str, Any]) -> None:
    """Refuse numbers that were given (not None) and that a system has none of; OptionError names those that heed it."""
    for name in sorted(SPECIAL - set(system.heeds)):
        if given.get(name) is not None:
            *others, last = [one.called for one in _known.values() if name in one.heeds] or ["other systems"]
            who = f"{', '.join(others)} or {last}" if others else last
            ours = "" if system.name in BUILT_IN else f', or write `heeds=("{name}",)` and read it from its settings'
            raise OptionError(f"--{name} is for {who}, not for {system.called}; leave it out{ours}")


def chosen(which: str | System) -> System:
    """Return a system, registered: itself, one that is known by name, or MODULE:NAME of a module that is imported.

    The module is looked for in the current folder first, as `python -m` does, and later imports look there last. A
    function of that name is called for the system. OptionError: there is none, or the module cannot be imported.
    """
    if isinstance(which, System):
        return register(which)
    if which in _known:
        return _known[which]
    module, _, name = str(which).partition(":")
    if not (module and name):
        known = ", ".join(_known)
        like = suggestion(which, _known)
        raise OptionError(f"--system is {which!r}{like}; write MODULE:NAME, as in my_module:BOAT, or one of {known}")
    folder = os.getcwd()
    importlib.invalidate_caches()
    sys.path.insert(0, folder)
    try:
        there = vars(importlib.import_module(module))
        made = there.get(name)
        made = made() if callable(made) else made
    except (Exception, SystemExit) as error:
        raise OptionError(f"--system {which}: {_why(error, module, name, folder)}") from None
    finally:
        with suppress(ValueError):
            sys.path.remove(folder)
        if folder not in sys.path:
            sys.path.append(folder)
    if there.get("__file__") is not None:
        _folders.add(Path(there["__file__"]).resolve().parent)
    if not isinstance(made, System):
        others = ", ".join(other for other, value in there.items() if isinstance(value, System)) or "none"
        what = "missing" if made is None else f"of the type {type(made).__name__}"
        raise OptionError(f"--system {which}: {name} is {what}; write a sim.systems.System of {module}: {others}")
    return register(made)


def _why(error: BaseException, module: str, name: str, folder: str) -> str:
    """Return why a module cannot be imported, and what to do about it."""
    file = Path(module)
    missing = isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}.")
    places = [f" (line {at.lineno} of {at.filename})" for at in _theirs(error, {Path(folder).resolve()})]
    if missing and (file.suffix == ".py" or os.sep in module):
        return f"{file.name} is a file, not a module; in its folder, write --system {file.stem}:{name}"
    if missing:
        return f"there is no module {module} in {folder} or among what is installed; fix the name, or set PYTHONPATH"
    said = error if isinstance(error, PirrhtError) else one_line(error)
    return f"{said} while {module} was imported{''.join(places[-1:])}; fix it"


def source(which: str | System | None) -> bytes:
    """Return the file of the module that a system is from, as far as there is one; results depend on it."""
    module = sys.modules.get(which.partition(":")[0]) if isinstance(which, str) and ":" in which else None
    file = getattr(module, "__file__", None)
    return Path(file).read_bytes() if file is not None and Path(file).is_file() else b""


def blamed(error: BaseException) -> str | None:
    """Locate and name an error in a file of a folder that a system came from; what numba cannot compile it names."""
    if frames := _theirs(error, _folders):
        return f"{frames[-1].filename}, line {frames[-1].lineno}, in {frames[-1].name}: {one_line(error)}; fix it"
    text = re.sub(r"\x1b\[\d*m", "", str(error)) if type(error).__module__.startswith("numba.") else ""
    places = [(Path(one or other).resolve(), line or at) for one, line, other, at in _PLACES.findall(text)]
    if not (theirs := [f"{path}, line {line}" for path, line in places if path.parent in _folders]):
        return None
    lines = (" ".join(line.partition("Raised from")[0].split()) for line in text.splitlines())
    reason = next((line for line in lines if line and not line.startswith("Failed in ")), "").strip(" .:>")[:LONGEST]
    return f"{theirs[-1]}: numba cannot compile this ({reason}); use numbers, arrays and functions of math and NumPy"


def _theirs(error: BaseException, folders: set[Path]) -> list[traceback.FrameSummary]:
    """Return the frames of a traceback that are in files of these folders, the last one last."""
    return [at for at in traceback.extract_tb(error.__traceback__) if Path(at.filename).parent in folders]
