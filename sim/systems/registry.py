"""Systems by name: those of the package, one row each, and whatever is registered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pirrht.errors import OptionError
from sim.settings import SPECIAL, Settings
from sim.systems.record import POSE, System, imported


def _dynamics(path: str) -> Callable[[Settings], Any]:
    """Return what makes dynamics of a class with the noise of the settings; the class is imported only then."""
    return lambda settings: imported(f"pirrht.systems.{path}")(b=settings.noise)


def _steering(path: str) -> Callable[[Any], Any]:
    """Return what makes the steering of a problem, of a class that is imported only then."""
    return lambda problem: imported(f"pirrht.steering.{path}").of(problem)


def _unicycle(settings: Settings) -> Any:
    return imported("pirrht.systems.unicycle:Unicycle")(V=settings.speed, rho=settings.rho, b=settings.noise)


def _at_speed(settings: Settings) -> float:
    """Return the state cost rate at which a control cost v'v, of R = 2, asks for the speed of the settings."""
    return settings.speed**2


SYSTEMS = (
    System(
        name="single_integrator", dynamics=_dynamics("single_integrator:SingleIntegrator"),
        steering=_steering("straight_line:StraightLine"), R=2.0 * np.eye(2), states=POSE[:2], urge=_at_speed,
        heeds=("noise", "speed"), robots="puck", noise_in="m/sqrt(s)",
    ),
    System(
        name="unicycle", dynamics=_unicycle, steering=_steering("dubins:Dubins"), R=np.eye(1), states=POSE,
        defaults={
            "noise": 0.03, "phi": 1000.0, "vertices": 2000, "samples": 300, "period": 0.1, "limit": 0.8,
            "max_time": 60.0, "exploration": 10.0,  # with its own noise control sequences hardly move, and few arrive
        },
        paper_samples=300, heeds=("noise", "speed", "rho"), robots="unicycle", noise_in="rad/sqrt(s)",
    ),
    System(  # its noise has a unit, its paths a speed of their own
        name="double_integrator", dynamics=_dynamics("double_integrator:DoubleIntegrator"),
        steering=_steering("double_integrator:MassSteering"), R=2.0 * np.eye(2), states=("x", "y", "vx", "vy"),
        defaults={"vertices": 2000, "samples": 300, "period": 0.05}, paper_samples=300,
        own=("noise", "vertices", "samples", "dt", "period"), robots="hover", noise_in="m/s/sqrt(s)",
    ),
    System(  # its paths have a speed of their own
        name="rover", dynamics=_dynamics("rover:Rover"), R=np.diag([2.0, 0.5]), urge=_at_speed, states=POSE,
        defaults={"vertices": 2000, "samples": 300, "period": 0.05}, paper_samples=300, heeds=("noise", "speed"),
        own=("vertices", "samples", "dt", "period"), robots="rover", noise_in="m/sqrt(s), 2b rad/sqrt(s)",
    ),
    System(
        name="second_order_car", dynamics=_dynamics("second_order_car:SecondOrderCar"), R=np.eye(2), q_min=1.0,
        q="pirrht.systems.second_order_car:cruising", states=(*POSE, "speed"), twists=3,
        defaults={"samples": 300, "period": 0.1, "phi": 1000.0, "max_time": 60.0}, paper_samples=300,
        own=("noise", "vertices", "samples", "dt", "period"), robots="car", noise_in="rad/sqrt(s), m/s/sqrt(s)",
    ),
)  # fmt: skip
_known: dict[str, System] = {system.name: system for system in SYSTEMS}
BUILT_IN = tuple(_known)


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
    """Return the names of all that are registered, built-in ones first."""
    return tuple(_known)


def named(name: str) -> System:
    """Return the system of that name.

    Raises:
        OptionError: none has it.
    """
    if name not in _known:
        raise OptionError(f"no system is called {name!r}; known are {', '.join(_known)}, or give --system MODULE:NAME")
    return _known[name]


def refuse(system: System, given: Mapping[str, Any]) -> None:
    """Refuse numbers that were given (not None) and that a system has none of.

    Raises:
        OptionError: names the option and the systems that heed it.
    """
    for name in sorted(SPECIAL - set(system.heeds)):
        if given.get(name) is not None:
            *others, last = [one.called for one in _known.values() if name in one.heeds] or ["other systems"]
            who = f"{', '.join(others)} or {last}" if others else last
            ours = "" if system.name in BUILT_IN else f', or write `heeds=("{name}",)` and read it from its settings'
            raise OptionError(f"--{name} is for {who}, and this robot is a {system.called}; leave it out{ours}")
