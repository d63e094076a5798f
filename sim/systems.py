"""What moves, as one record per system: dynamics, costs, steering and defaults; a registry that robots name them in.

A robot's MJCF names a system (`pirrht_dynamics`); `--system MODULE:NAME` takes one of somebody's own instead. Ten lines
make one:

    from sim.systems import System

    BOAT = System(
        name="boat",
        dynamics=lambda settings: Boat(settings.noise),
        steering=lambda problem: GroundTrack(),
        R=2 * np.eye(2),
        defaults={"samples": 300},
    )

Without `steering` its references are those of a point that moves straight at a pace, on a tree of positions alone, and
guides make them feasible. That costs: references are not the system's optimum, their classes are ordered by what they
cost the point, whatever its start faces, and a guide takes about three times the passes of one from references of its
own. The pace is where the system's cost per meter is least, if that tells one; else declare `pace`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError
from sim.options.table import BY_SETTING, SPECIAL
from sim.settings import PRESETS, Settings

POSE = ("x", "y", "heading")  # states that are the place of a robot; the others move with it
VELOCITIES = ("vx", "vy")  # those that are its speeds along x and y [m/s]
SPEED = ("speed",)  # that of its body along its heading [m/s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class System:
    """A kind of robot: what the method and the simulator must know of it.

    Raises:
        OptionError: a default is no setting, or has a value that cannot work.
    """

    name: str  # as in `<text name="pirrht_dynamics" data="NAME"/>`
    dynamics: Callable[[Settings], Any]  # the `pirrht.Dynamics`, of which `states` must be the same
    R: Array | Callable[[Array], Array]  # control cost, as in `pirrht.Problem`
    steering: Callable[[Any], Any] | None = None  # a `pirrht.Problem` -> its `pirrht.Steering`; None: guides find a way
    pace: float | None = None  # of references without steering [m/s]; None: what the cost says
    q: float | Callable[..., float] | str = 1.0  # state cost rate [cost/s], likewise; or MODULE:NAME of a function
    q_min: float | None = None
    states: tuple[str, ...] = ("x", "y")  # (n,) names of the components of a state
    defaults: Mapping[str, Any] = field(default_factory=dict)  # field of `Settings` -> value, where it is another
    home: Callable[[Any], Any] | None = None  # a `pirrht.Problem` -> `beyond` of `pirrht.control.mppi`; None: straight
    twists: int = 2  # numbers of `Dynamics.twist`, which a robot's `pirrht_command` turns into commands
    paper_samples: int = 200  # N under `--preset paper`
    heeds: tuple[str, ...] = ("noise",)  # of noise, speed and rho those that `dynamics` reads
    own: tuple[str, ...] = ()  # fields of `Settings` that scenes meant for other systems do not set
    robots: str = ""  # what the help calls its robots; empty: it says nothing of them
    noise_in: str = ""  # the unit of `--noise`, for the help

    def __post_init__(self) -> None:
        for name, known, what in (
            ("defaults", BY_SETTING, "setting"),
            ("own", BY_SETTING, "setting"),
            ("heeds", SPECIAL, "setting to heed"),
        ):
            strange = [entry for entry in getattr(self, name) if entry not in known]
            if strange:
                raise OptionError(
                    f"system {self.name}: {strange[0]!r} is no {what}; those are {', '.join(sorted(known))}"
                )
        if self.states[:2] != POSE[:2]:
            raise OptionError(f'system {self.name}: its states are {self.states}; the first two must be "x" and "y"')
        _ = self.settings

    @property
    def settings(self) -> Settings:
        """Those of a run that nobody says anything about."""
        return Settings(**self.defaults)

    @property
    def joints(self) -> tuple[str, ...]:
        """States that are the place of a robot, which its joints must be."""
        return tuple(name for name in self.states if name in POSE)

    @property
    def coordinates(self) -> str:
        """Its states, as they are typed after `--at`."""
        return typed(self.states)

    def heard(self, scene: Mapping[str, float], meant: str) -> dict[str, float]:
        """What a scene says of options, by name of the option, less what it says for the system that it is meant for.

        Args:
            meant: name of that system.
        """
        deaf = self.own if meant != self.name else ()
        return {name: value for name, value in scene.items() if name.replace("-", "_") not in deaf}

    def preset(self, name: str | None) -> dict[str, Any]:
        """The settings of a preset; none without a name.

        Raises:
            OptionError: there is none of that name.
        """
        if name is None:
            return {}
        if name not in PRESETS:
            raise OptionError(f"--preset is {name!r}; it must be one of {', '.join(PRESETS)}")
        return {**PRESETS[name], "samples": self.paper_samples}

    def refuse(self, given: Mapping[str, Any]) -> None:
        """Refuse numbers that were given (not None) and that this system has none of.

        Raises:
            OptionError: names the option and the systems that heed it.
        """
        for name in sorted(SPECIAL - set(self.heeds)):
            if given.get(name) is not None:
                who = " or ".join(system.robots or system.name for system in _known.values() if name in system.heeds)
                raise OptionError(
                    f"--{name} is for {who or 'other systems'}, and this robot is a {self.name}; leave it out"
                )

    def problem(self, scene: Any, settings: Settings) -> Any:
        """The `pirrht.Problem` in a `pirrht.Scene`.

        Raises:
            OptionError, NotLinearlySolvable: the system cannot work there.
        """
        from pirrht.problem import Problem

        dynamics = self._asked("dynamics", settings)
        if tuple(getattr(dynamics, "states", ())) != self.states:
            raise OptionError(
                f"system {self.name}: {type(dynamics).__name__} has the states {getattr(dynamics, 'states', None)} and "
                f"the system says {self.states}; make them the same"
            )
        return Problem(dynamics=dynamics, scene=scene, R=self.R, q=self._rate(), q_min=self.q_min, phi=settings.phi)

    def steered(self, problem: Any) -> Any:
        """The `pirrht.Steering` of a problem.

        Raises:
            OptionError: there is none.
        """
        return self._asked("steering", problem) if self.steering is not None else self._tracked(problem)

    def way_home(self, problem: Any) -> Any:
        """What the way from states (k, n) to the goal costs, as `pirrht.control.mppi` takes it; None: a straight one.

        Raises:
            OptionError: it cannot be told.
        """
        if self.home is None and self.steering is None:
            return self._straight_home(problem)
        return None if self.home is None else self._asked("home", problem)

    def _straight_home(self, problem: Any) -> Any:
        steering, goal = self.steered(problem), problem.scene.goal

        def beyond(states: Array) -> Array:
            away = np.hypot(*(states[:, :2] - goal.center).T) - goal.radius
            return np.asarray(steering.cost_per_meter * np.maximum(away, 0.0))

        return beyond

    def _rate(self) -> float | Callable[..., float]:
        if not isinstance(self.q, str):
            return self.q
        module, _, name = self.q.partition(":")
        found: Callable[..., float] = getattr(importlib.import_module(module), name)
        return found

    def _tracked(self, problem: Any) -> Any:
        from pirrht.steering.tracked import Tracked

        try:
            return Tracked.of(problem, self.pace)
        except OptionError as error:
            raise OptionError(f"system {self.name}: {error}") from None

    def _asked(self, what: str, argument: Any) -> Any:
        try:
            return getattr(self, what)(argument)
        except PirrhtError:
            raise
        except Exception as error:
            told = " ".join(f"{type(error).__name__}: {error}".split())
            raise OptionError(f"system {self.name}: {told} in its {what}; mend it") from error


def typed(states: Sequence[str]) -> str:
    """Names of states as the command line calls them."""
    return " ".join({"heading": "TH", "speed": "V"}.get(name, name.upper()) for name in states)


_known: dict[str, System] = {}


def register(system: System) -> System:
    """Make a system known by its name; a later one takes the place of an earlier one, but of none that is built in.

    Raises:
        OptionError: it is no `System`, or its name is that of a built-in one.
    """
    if not isinstance(system, System):
        raise OptionError(f"{system!r} is no sim.systems.System; make one with System(name=..., dynamics=..., ...)")
    if system.name in BUILT_IN and _known[system.name] is not system:
        raise OptionError(f"system {system.name}: that name is taken by one that is built in; choose another")
    _known[system.name] = system
    return system


def names() -> tuple[str, ...]:
    """The names of all that are registered, built-in ones first."""
    return tuple(_known)


def named(name: str) -> System:
    """The system of that name.

    Raises:
        OptionError: none has it.
    """
    if name not in _known:
        raise OptionError(f"no system is called {name!r}; known are {', '.join(_known)}, or give --system MODULE:NAME")
    return _known[name]


def _point(settings: Settings) -> Any:
    from pirrht.systems.single_integrator import SingleIntegrator

    return SingleIntegrator(b=settings.noise)


def _car(settings: Settings) -> Any:
    from pirrht.systems.unicycle import Unicycle

    return Unicycle(V=settings.speed, rho=settings.rho, b=settings.noise)


def _mass(settings: Settings) -> Any:
    from pirrht.systems.double_integrator import DoubleIntegrator

    return DoubleIntegrator(b=settings.noise)


def _rover(settings: Settings) -> Any:
    from pirrht.systems.rover import Rover

    return Rover(b=settings.noise)


def _second_order_car(settings: Settings) -> Any:
    from pirrht.systems.second_order_car import SecondOrderCar

    return SecondOrderCar(b=settings.noise)


def _straight(problem: Any) -> Any:
    from pirrht.steering.straight_line import StraightLine

    return StraightLine.of(problem)


def _dubins(problem: Any) -> Any:
    from pirrht.steering.dubins import Dubins

    return Dubins.of(problem)


def _pushed(problem: Any) -> Any:
    from pirrht.steering.double_integrator import MassSteering

    return MassSteering.of(problem)


def _driven(problem: Any) -> Any:
    from pirrht.steering.rover import RoverSteering

    return RoverSteering.of(problem)


def _pushed_home(problem: Any) -> Any:
    """The cost of the optimum without obstacles to the goal disc's nearest point, at any velocity there."""
    steering, goal = _pushed(problem), problem.scene.goal

    def beyond(states: Array) -> Array:
        off = states[:, :2] - goal.center
        away = np.hypot(*off.T)
        rim = goal.center + off * np.minimum(1.0, goal.radius / np.maximum(away, 1e-12))[:, None]
        costs = steering.distance(states, np.hstack([rim, np.full_like(rim, np.nan)]))
        return np.where(away > goal.radius, costs, 0.0)

    return beyond


BUILT_IN: tuple[str, ...] = ()
for _system in (
    System(
        name="single_integrator",
        dynamics=_point,
        steering=_straight,
        R=2.0 * np.eye(2),
        paper_samples=200,
        robots="puck",
        noise_in="in m/sqrt(s)",
    ),
    System(
        name="unicycle",
        dynamics=_car,
        steering=_dubins,
        R=np.eye(1),
        states=POSE,
        defaults={
            "noise": 0.03,
            "phi": 1000.0,
            "vertices": 2000,
            "samples": 300,
            "period": 0.1,
            "limit": 0.8,
            "max_time": 60.0,
            "exploration": 10.0,  # with the robot's own noise tapes hardly move, and none of a few drives arrives
        },
        paper_samples=300,
        heeds=("noise", "speed", "rho"),
        robots="unicycle",
        noise_in="in rad/sqrt(s)",
    ),
    System(
        name="double_integrator",
        dynamics=_mass,
        steering=_pushed,
        R=2.0 * np.eye(2),
        states=("x", "y", "vx", "vy"),
        defaults={"vertices": 2000, "samples": 300, "period": 0.05},
        home=_pushed_home,
        paper_samples=300,
        own=("noise", "vertices", "samples", "dt", "period"),  # its noise has a unit, its paths a pace of their own
        robots="hover",
        noise_in="in m/s/sqrt(s)",
    ),
    System(
        name="rover",
        dynamics=_rover,
        steering=_driven,
        R=np.diag([2.0, 0.5]),
        states=POSE,
        defaults={"vertices": 2000, "samples": 300, "period": 0.05},
        paper_samples=300,
        own=("vertices", "samples", "dt", "period"),  # its paths have a pace of their own
        robots="rover",
        noise_in="in m/sqrt(s) of the speed and half the rad/sqrt(s) of the turn rate",
    ),
    System(
        name="second_order_car",
        dynamics=_second_order_car,
        R=np.eye(2),
        q="pirrht.systems.second_order_car:cruising",
        q_min=1.0,
        states=(*POSE, "speed"),
        defaults={"samples": 300, "period": 0.1, "phi": 1000.0, "max_time": 60.0},
        twists=3,
        paper_samples=300,
        own=("noise", "vertices", "samples", "dt", "period"),
        robots="car",
        noise_in="in both rad/sqrt(s) and m/s/sqrt(s)",
    ),
):
    register(_system)
BUILT_IN = names()
