"""Systems by name: those of the package, one row each, whatever is registered, and somebody's own: MODULE:NAME."""

from __future__ import annotations

import importlib
import os
import re
import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.errors import OptionError, PirrhtError, one_line
from sim.settings import SPECIAL, Settings
from sim.systems.record import POSE, System, imported

LONGEST = 200  # characters of a reason that numba gives
_PLACES = re.compile(r'File "([^"\n]+)", line (\d+)|Raised from ([^\n]+) \((\d+)\)')  # as numba names them

_folders: set[Path] = set()  # of modules that systems came from


def _dynamics(path: str) -> Callable[[Settings], Any]:
    """Return what makes dynamics of a class with the noise of the settings; the class is imported only then."""
    return lambda settings: imported(f"pirrht.systems.{path}")(b=settings.noise)


def _steering(path: str) -> Callable[[Any], Any]:
    """Return what makes the steering of a problem, of a class that is imported only then."""
    return lambda problem: imported(f"pirrht.steering.{path}").of(problem)


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
        name="unicycle",
        dynamics=lambda s: imported("pirrht.systems.unicycle:Unicycle")(V=s.speed, rho=s.rho, b=s.noise),
        steering=_steering("dubins:Dubins"), R=np.eye(1), states=POSE,
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
            raise OptionError(f"--{name} is for {who}, and this robot is a {system.called}; leave it out{ours}")


def chosen(which: str | System) -> System:
    """Return a system, registered: itself, one that is known by name, or MODULE:NAME of a module that is imported.

    The module is looked for in the current folder first, as `python -m` does, and later imports look there last. A
    function of that name is called for the system.

    Raises:
        OptionError: there is no such module or name, it is no system, or the module cannot be imported.
    """
    if isinstance(which, System):
        return register(which)
    if which in _known:
        return _known[which]
    module, _, name = str(which).partition(":")
    if not (module and name):
        known = ", ".join(_known)
        raise OptionError(f"--system is {which!r}; write MODULE:NAME, as in my_module:BOAT, or one of {known}")
    folder = os.getcwd()
    importlib.invalidate_caches()
    sys.path.insert(0, folder)
    try:
        there = vars(importlib.import_module(module))
        made = there.get(name)
        made = made() if callable(made) and not isinstance(made, System) else made
    except (Exception, SystemExit) as error:
        why = f"{error if isinstance(error, PirrhtError) else one_line(error)} while {module} was imported"
        places = [f"line {at.lineno} of {at.filename}" for at in _theirs(error, {Path(folder).resolve()})]
        why += f" ({places[-1]}); fix it" if places else "; fix it"
        if isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}."):
            why = f"there is no module {module} in {folder} or among what is installed; fix the name, or set PYTHONPATH"
        raise OptionError(f"--system {which}: {why}") from None
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
