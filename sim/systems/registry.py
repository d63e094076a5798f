"""The systems that are known by name: those that are built in, and whatever is registered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pirrht.errors import OptionError
from sim.options.table import SPECIAL
from sim.systems.built_in import SYSTEMS
from sim.systems.record import System

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


def refuse(system: System, given: Mapping[str, Any]) -> None:
    """Refuse numbers that were given (not None) and that a system has none of.

    Raises:
        OptionError: names the option and the systems that heed it.
    """
    for name in sorted(SPECIAL - set(system.heeds)):
        if given.get(name) is not None:
            *others, last = [one.called for one in _known.values() if name in one.heeds] or ["other systems"]
            who = " or ".join(filter(None, (", ".join(others), last)))
            ours = "" if system.name in BUILT_IN else f', or write `heeds=("{name}",)` and read it from its settings'
            raise OptionError(f"--{name} is for {who}, and this robot is a {system.called}; leave it out{ours}")
