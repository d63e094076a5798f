"""The command `pirrht`: its parser, made of the table of options, and what becomes of errors."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any, NoReturn

import pirrht
from pirrht.control.settings import METHODS
from pirrht.errors import OptionError
from sim.drive.result import explained as figures
from sim.options.record import Option
from sim.options.table import check, gone, options_of
from sim.recording.columns import explained
from sim.settings import Settings
from sim.systems import named, names

EXPLAINED = "methods:\n" + "\n".join(f"  {name:<11} {text}" for name, text in METHODS.items())
ORDER = (
    "Defaults are those of the robot's system; a scene's own (custom numerics pirrht_NAME) win over these,\n"
    "a preset over both, and the command line over all."
    + "".join(
        f"\n{', '.join(name.replace('_', '-') for name in system.own)} of a {system.robots} are its own "
        "in scenes that are meant for other robots."
        for system in map(named, names())
        if system.own
    )
)
PLAYED = (
    "in the window: double-click the robot, an obstacle or the goal, and drag it with Ctrl and the right button;\n"
    "  8 and 9: less noise, more; Home: back to the start once a drive has ended\n"
    'a script: [{"at": 0.5, "push": [VX, VY], "for": 0.3}, {"at": 1, "move": "goal", "to": [X, Y]},\n'
    '  {"at": 1, "move": "NAME OF AN OBSTACLE", "by": [DX, DY]}, {"at": 2, "noise": 0.3}]'
)
TABLE = "columns, one row per control step (K = 1, 2, ..., ID a homology class):"

COMMANDS: dict[str, tuple[str, str]] = {  # what the help says of each, and at its end
    "demo": ("little and much noise in the scene slit, one after the other, and what to make of them", ""),
    "scenes": ("list the built-in scenes: robot, noise, how many bodies move, and a sentence on each", ""),
    "plan": ("grow the tree and print one row per homology class", ORDER),
    "run": (
        "plan, then drive; exit status 0 goal, 1 collision or time-out, 2 bad input",
        f"{ORDER}\n\n{EXPLAINED}\n\nfigures of a drive, as its summary and --json tell them:\n{figures()}",
    ),
    "play": (
        "drive in a window of MuJoCo's: push the robot, move goal and obstacles, change the noise; exit status as run",
        f"{ORDER}\n\n{PLAYED}\n\n{EXPLAINED}",
    ),
    "estimate": ("what the controller would do at one state", f"{ORDER}\n\n{EXPLAINED}"),
    "sweep": ("many seeds, methods and noise levels: a table, a dataset", f"{ORDER}\n\n{EXPLAINED}"),
    "report": ("sum up a sweep: intervals, comparisons on equal seeds, pictures", ""),
    "warm": ("compile kernels ahead, so that the first command of a robot does not have to", ""),
    "export": ("turn a recording into a table: Parquet or NumPy", f"{TABLE}\n{explained()}"),
    "import": ("turn a Gazebo world, a ROS map, a mesh or the motions of DynaBARN into a scene", ""),
}


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Raise the OptionError of a command line that cannot be read."""
        if message == "argument --seeds: expected one argument":  # it is what a leading minus sign leads to
            message += " A:B, and seeds are not negative"
        raise OptionError(f"{message}; see `{self.prog} --help`")


def read(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """A command line, checked as far as that goes without a scene; None: the words that this process was started with.

    Raises:
        OptionError: it cannot be read, or an option has a value that cannot work.
    """
    arguments, unknown = parser().parse_known_args(argv)
    for word in unknown:
        name = word.partition("=")[0]
        if name.startswith("--"):
            gone(name.removeprefix("--"), name)
    said = vars(arguments)
    words = [*unknown, str(said.get("scene")), *said.get("scenes", ())]
    if said.get("goal") is not None and any(map(_is_number, words)):
        raise OptionError("a goal has no heading: --goal takes X Y R, a disc that is reached in whatever direction")
    if unknown:
        raise OptionError(f"unrecognized arguments: {' '.join(unknown)}; see `pirrht {arguments.command} --help`")
    check(arguments.command, vars(arguments))
    return arguments


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    whole = Parser(
        prog="pirrht",
        description="Topology-guided path integral control (PI-RRHT*): plan with FCL, drive in MuJoCo, watch in Rerun.",
    )
    whole.add_argument("--version", action="version", version=f"pirrht {pirrht.__version__}")
    commands = whole.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=Parser)
    for name, (text, end) in COMMANDS.items():
        one = commands.add_parser(
            name, help=text, description=text, epilog=end or None, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        groups: dict[str, Any] = {"": one}
        for option in options_of(name):
            if option.group not in groups:
                groups[option.group] = one.add_argument_group(option.group)
            _add(groups[option.group], option)
    return whole


def _add(group: Any, option: Option) -> None:
    """Give a parser an option; None stands for what was not said, unless it is no number and has a default."""
    words: dict[str, Any] = {"help": helped(option).replace("%", "%%")}
    if option.kind is bool:
        words |= {"action": "store_true" if option.sets else "store_false"}
    else:
        words |= {"type": option.kind, "metavar": option.metavar or None, "nargs": option.count}
    if option.positional:
        group.add_argument(option.dest, **words)
        return
    default = None if option.numeric else option.default
    short = [f"-{option.short}"] if option.short else []
    group.add_argument(*short, option.flag, dest=option.dest, default=default, required=option.required, **words)


def helped(option: Option) -> str:
    """Return the help of an option: its meaning, then its default."""
    known = default_of(option)
    return f"{meaning(option)}; default: {known}" if known else meaning(option)


def meaning(option: Option) -> str:
    """An option's text, and what it is of each kind of robot, alike ones together."""
    told: dict[str, list[str]] = {}
    for system in map(named, names() if option.of_robots else ()):
        if system.robots and getattr(system, option.of_robots):
            told.setdefault(getattr(system, option.of_robots), []).append(system.robots)
    of_each = ", ".join(f"{what} of a {' or '.join(robots)}" for what, robots in told.items())
    return f"{option.text}: {of_each}" if of_each else option.text


def default_of(option: Option) -> str:
    """An option's default in words: of every system, and whether a scene may say otherwise; empty if it has none."""
    scene = ", or the scene's" if option.numeric else ""
    if option.kind is bool or option.positional or option.required:
        return ""
    if option.role != "setting" or option.default is not None:
        known = option.unset or ("" if option.default is None else _worded(option.default))
        return f"{known}{scene}" if known and not option.unset else known
    if option.unset:
        return option.unset
    if not hasattr(Settings, option.dest):
        return ""
    heeding = [named(name) for name in names() if not option.special or option.dest in named(name).heeds]
    values = {system.robots: _worded(getattr(system.settings, option.dest)) for system in heeding if system.robots}
    alike = len(set(values.values())) == 1
    known = next(iter(values.values())) if alike else ", ".join(f"{who} {value}" for who, value in values.items())
    return f"{known}{scene}" if known else ""


def _worded(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return "infinite" if math.isinf(value) else f"{value:g}"
    return str(value)
