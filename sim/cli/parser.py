"""Parse the command line of `pirrht` by its options."""

import argparse
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

import pirrht
from pirrht.control.settings import METHODS
from pirrht.errors import OptionError
from sim.drive.result import explained as figures
from sim.extras import BY_ENDING
from sim.files import check_writable
from sim.options import DAILY, options_of
from sim.recording.columns import explained
from sim.settings import DRIVES, PRESETS, SPECIAL, Option
from sim.systems import System, named, names
from sim.text import suggestion, table

ALIKE = 0.8  # likeness of an option that may have been meant
METHODS_TEXT = "methods:\n" + "\n".join(f"  {name:<11} {text}" for name, text in METHODS.items())
PRESETS_TEXT = "presets:\n" + "\n".join(f"  {name:<9} {text}" for name, (text, _, _) in PRESETS.items())
ORDER = "Precedence: command line, preset, scene (custom numerics pirrht_NAME), robot."
PLAYED = (
    "window: double-click the robot, an obstacle or the goal, and drag it with Ctrl and the right button;\n"
    "  8 and 9: less noise, more; Home: start again\n"
    'script: [{"at": 0.5, "push": [VX, VY], "for": 0.3}, {"at": 1, "move": "goal", "to": [X, Y]},\n'
    '  {"at": 1, "move": "NAME OF AN OBSTACLE", "by": [DX, DY]}, {"at": 2, "noise": 0.3}]'
)
ROS = (
    "in: map (latched) or, with --sense lidar, scan; odom, /tf, /tf_static, goal_pose; pirrht/cancel ends it\n"
    "out: cmd_vel, plan, pirrht/classes, pirrht/samples, /diagnostics\n"
    "a simulated robot for it: pirrht run house --robot diffdrive --ros"
)
TABLE = "columns, one row per control step (K = 1, 2, ..., ID a homology class):"
COMMANDS: dict[str, tuple[str, str]] = {  # of each: a sentence, and more of `--help-all`
    "demo": ("run the scene slit with little and with much noise, and explain the results", ""),
    "scenes": ("list the built-in scenes: robot, noise, moving obstacles, and a sentence on each", ""),
    "plan": ("grow the tree and print one row per homology class", ""),
    "run": (
        "plan and run; exit status 0 goal, 1 collision or time-out, 2 bad input",
        f"{METHODS_TEXT}\n\nresults of a run, in its summary and --json:\n{figures()}",
    ),
    "play": ("run in MuJoCo's viewer: push the robot, move goal and obstacles, change the noise", PLAYED),
    "estimate": ("estimate value, control and class shares at a state", METHODS_TEXT),
    "sweep": ("run many seeds, methods and noise levels: a table, a dataset", METHODS_TEXT),
    "report": ("summarise a sweep: intervals, comparisons on equal seeds, pictures", ""),
    "ros": ("plan for a robot of a ROS 2 graph, without an installation of ROS, until Ctrl-C (extra `ros`)", ROS),
    "warm": ("compile kernels ahead, so that the first command of a robot does not have to", ""),
    "export": ("turn a recording into a table (Parquet, NumPy) or messages of ROS 2 (MCAP)", f"{TABLE}\n{explained()}"),
    "import": ("turn a Gazebo world, a ROS map or bag, a mesh, voxels or DynaBARN's motions into a scene", ""),
}


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Shows numbers of several forms as they are."""

    def _format_args(self, action: argparse.Action, default_metavar: str) -> str:
        forms = action.metavar
        return forms if isinstance(forms, str) and " " in forms else super()._format_args(action, default_metavar)


class Parser(argparse.ArgumentParser):
    """Raises an error of one line."""

    def error(self, message: str) -> NoReturn:
        """Raise the OptionError of a command line that cannot be read, with what the option at fault takes."""
        _, _, command = self.prog.partition(" ")
        flags = message.partition(":")[0].removeprefix("argument ").split("/")
        takes = "".join(f"; give {usage_of(one)} ({one.text})" for one in options_of(command) if one.flag in flags)
        raise OptionError(f"{message}{takes}; see `{self.prog} --help`")


def read(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Read a command line, checked as far as possible without a scene; None: the arguments of this process."""
    words = sys.argv[1:] if argv is None else argv
    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        like = suggestion(words[0], COMMANDS)
        raise OptionError(f"{words[0]!r} is no command{like}; it must be one of {', '.join(COMMANDS)}")
    arguments, unknown = parser(everything="--help-all" in words).parse_known_args(words)
    if unknown:
        word = unknown[0].partition("=")[0]
        flags = [option.flag for option in options_of(arguments.command)]
        begun = [flag for flag in flags if flag.startswith(word) and word.startswith("--")]
        near = begun or get_close_matches(word, flags, 1, ALIKE)
        meant = f" (did you mean {' or '.join(near)}?)" if near else ""
        raise OptionError(
            f"unrecognized arguments: {' '.join(unknown)}{meant}; see `pirrht {arguments.command} --help`"
        )
    for option in options_of(arguments.command):
        if (value := getattr(arguments, option.dest)) is not None:
            option.check(value)
    return arguments


def extras_of(arguments: argparse.Namespace) -> list[str]:
    """Return the extras of the package that a command needs with its options."""
    given = [(option, getattr(arguments, option.dest)) for option in options_of(arguments.command)]
    endings = [value.suffix.lower() for _, value in given if isinstance(value, Path)]
    files = [BY_ENDING[ending] for ending in endings if ending in BY_ENDING]
    files += ["ros"] if arguments.command == "ros" else []
    return [option.extra for option, value in given if option.extra and value not in (None, False)] + files


def check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse files that could not be written, before any work is done."""
    for option in options_of(arguments.command):
        if option.output and (file := getattr(arguments, option.dest)) is not None:
            check_writable(file, option.flag)


def parser(*, everything: bool = False) -> argparse.ArgumentParser:
    """Build the parser of all commands, whose help has `everything` or what is used daily."""
    whole = Parser(
        prog="pirrht",
        allow_abbrev=False,
        description="Topology-guided path integral control (PI-RRHT*). FCL checks for collisions, MuJoCo simulates, "
        "Rerun records.",
    )
    whole.add_argument("--version", action="version", version=f"pirrht {pirrht.__version__}")
    commands = whole.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=Parser)
    for name, (text, more) in COMMANDS.items():
        takes_scene = name in DRIVES
        notes = [robots_text(), PRESETS_TEXT, ORDER] if takes_scene else []
        notes += [more] if everything or not takes_scene else [f"More options: pirrht {name} --help-all"]
        scene = {"sweep": "SCENE ... ", "ros": ""}.get(name, "SCENE ")
        one = commands.add_parser(
            name, help=text, add_help=False, allow_abbrev=False,
            usage=f"pirrht {name} {scene}[options]" if takes_scene else None,
            description=text, epilog="\n\n".join(filter(None, notes)) or None,
            formatter_class=Formatter,
        )  # fmt: skip
        _fill(one, name, everything or not takes_scene)
    return whole


def usage_of(option: Option) -> str:
    """Return an option as it is typed with its values, as in --goal X Y R."""
    metavar = " ".join(option.metavar) if isinstance(option.metavar, tuple) else option.metavar
    more = " ..." * (option.count == "+" and " " not in metavar)
    return (option.flag if option.positional else f"{option.flag} {metavar}".rstrip()) + more


def robots_text() -> str:
    """Return the table of robots: unit of the noise, state, and the settings that differ between them."""
    columns = ("noise", "phi", "vertices", "samples", "period", "max_time")
    rows = []
    for system in _robots():
        numbers = [f"{getattr(system.settings, name):g}" for name in columns]
        rows += [[robot, system.noise_in, system.adapter.typed(), *numbers] for robot in system.robots]
    return table(["robot", "unit of --noise", "state", *columns], rows)


def _robots() -> list[System]:
    return [system for system in map(named, names()) if system.robots]


def _fill(one: argparse.ArgumentParser, name: str, everything: bool) -> None:
    """Give a parser the options of a command; None stands for an option or a number that was not given."""
    groups: dict[str, Any] = {"": one}
    for option in options_of(name):
        if option.group not in groups:
            groups[option.group] = one.add_argument_group(option.group)
        text = f"{option.text}; default: {known}" if (known := default_of(option)) else option.text
        shown = everything or option.name in DAILY
        words: dict[str, Any] = {"help": text.replace("%", "%%") if shown else argparse.SUPPRESS}
        if option.kind is bool:
            words["action"] = "store_false" if option.name.startswith("no-") else "store_true"
        else:
            words |= {"type": option.kind, "metavar": option.metavar or None, "nargs": option.count}
        if option.positional:
            typed = [option.dest]
        else:
            typed = [*([f"-{option.short}"] if option.short else []), option.flag]
            default = None if option.numeric else option.default
            words |= {"dest": option.dest, "required": option.required, "default": default}
        groups[option.group].add_argument(*typed, **words)
    one.add_argument("-h", "--help", "--help-all", action="help", help=argparse.SUPPRESS)


def default_of(option: Option) -> str:
    """Return an option's default in words; empty if it has none."""
    if option.kind is bool or option.positional or option.required:
        return ""
    values = {option.default}
    if option.role == "setting" and option.default is None and not option.unset:
        users = [one for one in _robots() if option.dest not in SPECIAL or option.dest in one.heeds]
        values = {getattr(one.settings, option.dest) for one in users}
    if len(values) > 1:
        return "the robot's"
    (value,) = values
    if value is None:
        return option.unset
    return f"{value:g}".replace("inf", "infinite") if isinstance(value, float) else str(value)
