"""One kind of robot: what the method and the simulator must know of it."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError, one_line
from sim.settings import BY_SETTING, PRESETS, SPECIAL, Settings

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
    q: float | Callable[..., float] | str = 1.0  # state cost rate [cost/s], or MODULE:NAME of a function
    q_min: float | None = None
    urge: Callable[[Settings], float] | None = None  # that rate as settings have it, in place of q
    states: tuple[str, ...] = ()  # (n,) names of the components of a state; none: those of the dynamics
    defaults: Mapping[str, Any] = field(default_factory=dict)  # field of `Settings` -> value, where it is another
    home: Callable[[Any], Any] | None = None  # a `pirrht.Problem` -> the terminal cost of MPPI; None: the steering's
    twists: int = 2  # numbers of `Dynamics.twist`, which a robot's `pirrht_command` turns into commands
    paper_samples: int = 200  # N under `--preset paper`
    heeds: tuple[str, ...] = ("noise",)  # of noise, speed and rho those that `dynamics` reads
    own: tuple[str, ...] = ()  # fields of `Settings` that scenes meant for other systems do not set
    robots: str = ""  # name of its robots in the help; empty: the help leaves it out
    noise_in: str = ""  # the unit of `--noise`, for the help
    settings: Settings = field(init=False)  # of a run without options

    def __post_init__(self) -> None:
        settings = (*self.defaults, *self.own)
        for given, known, what in ((settings, BY_SETTING, "setting"), (self.heeds, SPECIAL, "setting to heed")):
            for strange in set(given) - set(known):
                raise OptionError(f"system {self.name}: {strange!r} is no {what}; those are {', '.join(sorted(known))}")
        object.__setattr__(self, "settings", Settings(**self.defaults))
        if not self.states:
            object.__setattr__(self, "states", POSE[:2])
            with suppress(Exception):  # `problem` reports what is wrong
                object.__setattr__(self, "states", tuple(self.dynamics(self.settings).states))
        if self.states[:2] != POSE[:2]:
            raise OptionError(f'system {self.name}: its states are {self.states}; the first two must be "x" and "y"')

    def __repr__(self) -> str:
        return f"System({self.name!r}, states {' '.join(self.states)})"

    @property
    def called(self) -> str:
        """Name in messages: the robot that the help names, or its own name."""
        return self.robots or self.name

    @property
    def joints(self) -> tuple[str, ...]:
        """States that are the place of a robot, which its joints must be."""
        return tuple(name for name in self.states if name in POSE)

    def heard(self, scene: Mapping[str, float], meant: str) -> dict[str, float]:
        """Select a scene's options, by name, that are not meant for another system, `meant`."""
        deaf = self.own if meant != self.name else ()
        return {name: value for name, value in scene.items() if name.replace("-", "_") not in deaf}

    def preset(self, name: str | None) -> dict[str, Any]:
        """Return the settings of a preset; none without a name."""
        if name is None:
            return {}
        if name not in PRESETS:
            raise OptionError(f"--preset is {name!r}; it must be one of {', '.join(PRESETS)}")
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
        from pirrht.steering.straight_line import Tracked

        try:
            return Tracked.of(problem, self.pace)
        except OptionError as error:
            raise OptionError(f"system {self.name}: {error}") from None

    def way_home(self, problem: Any) -> Any:
        """Return the cost of the path from states (k, n) to the goal, for MPPI; None: a straight one.

        It is the steering's own to the rim of the goal's disc, at the best of its ends there; a point's without one.
        """
        if self.home is not None:
            return self._made("home", problem)
        d, goal, steering = problem.dynamics, problem.scene.goal, self.steered(problem)
        if self.steering is not None and (d.noisy_position or d.f(d.state_of(problem.scene.start))[:2].any()):
            return None
        ends = np.asarray(steering.roots(goal.center))

        def terminal_cost(states: Array) -> Array:
            off = states[:, :2] - goal.center
            away = np.hypot(*off.T)
            if self.steering is None:
                return np.asarray(steering.cost_per_meter * np.maximum(away - goal.radius, 0.0))
            heads = np.repeat(ends[None], len(states), axis=0)
            heads[:, :, :2] += (off * np.minimum(1.0, goal.radius / np.maximum(away, 1e-12))[:, None])[:, None]
            costs = [steering.distance(states, heads[:, k]) for k in range(len(ends))]
            return np.where(away > goal.radius, np.min(costs, axis=0), 0.0)

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


def typed(states: Sequence[str]) -> str:
    """Return names of states as the command line has them."""
    return " ".join({"heading": "TH", "speed": "V"}.get(name, name.upper()) for name in states)
