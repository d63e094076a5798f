"""All options, and what follows from them: those of a command, those that were said, those that a scene may carry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pirrht.errors import OptionError
from sim.options.commands import COMMANDS, TASK
from sim.options.record import Option
from sim.options.settings import SETTINGS

OPTIONS: tuple[Option, ...] = (*TASK, *SETTINGS, *COMMANDS)
BY_SETTING = {option.dest: option for option in SETTINGS if option.role == "setting"}
NUMERICS = {option.name: option for option in OPTIONS if option.numeric}  # in scenes, as `pirrht_NAME`
TASKS = tuple(option.dest for option in OPTIONS if option.role == "task")  # arguments of `sim.scenario.prepare`
IDENTIFYING = frozenset(option.dest for option in OPTIONS if option.identifies)  # the dataset of a sweep
SPECIAL = frozenset(option.dest for option in OPTIONS if option.special)  # heeded by some systems only
GONE = {  # options of earlier versions -> why
    "rounds": "refitting guides within a plan never paid",
    "memory": "sampling around the last plan's tape never paid",
}


def options_of(command: str) -> list[Option]:
    """The options of a command, in the order of its help."""
    return [option for option in OPTIONS if command in option.commands]


def check(command: str, said: Mapping[str, Any]) -> None:
    """Refuse what a command was told that none of its options may be; None is what was not said.

    Raises:
        OptionError: names the option and what it may be.
    """
    for option in options_of(command):
        value = said.get(option.dest)
        if value is not None:
            option.check(value)


def task(said: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments of `sim.scenario.prepare` for scene and robot, as said."""
    return {name: said.get(name) for name in TASKS}


def settings(command: str, said: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of a run by field of `Settings`, as a command was given them."""
    return {option.dest: said.get(option.dest) for option in options_of(command) if option.role == "setting"}


def completed(command: str, said: Mapping[str, Any], scene: Mapping[str, float]) -> dict[str, Any]:
    """Numbers of the command alone, by name: as said, else as the scene has them, else their defaults."""
    found = {}
    for option in options_of(command):
        if option.role == "command" and option.numeric:
            value = said.get(option.dest)
            found[option.dest] = option.check(scene.get(option.name, option.default)) if value is None else value
    return found


def identity(known: Mapping[str, Any]) -> dict[str, Any]:
    """Select those of the settings common to all runs that identify the dataset of a sweep."""
    return {name: value for name, value in known.items() if name in IDENTIFYING}


def refuse_idle(given: Mapping[str, Any], methods: Sequence[str]) -> None:
    """Refuse what was given (not None) and that none of the methods would heed.

    Raises:
        OptionError: names the option and what it belongs to.
    """
    for name, option in BY_SETTING.items():
        if given.get(name) is None:
            continue
        if option.methods and not set(option.methods) & set(methods):
            raise OptionError(
                f"{option.flag} is of the method {option.methods[0]} alone, which is not asked for; leave it out"
            )
        fixed = {option.fixed.get(method) for method in methods}
        if None not in fixed and fixed and given[name] not in fixed:
            raise OptionError(f"{option.flag}: the method {methods[0]} has no such choice; leave it out")


def gone(name: str, label: str) -> None:
    """Refuse an option of an earlier version.

    Raises:
        OptionError: says why it is gone.
    """
    if name in GONE:
        raise OptionError(f"{label} is gone: {GONE[name]}; leave it out")
