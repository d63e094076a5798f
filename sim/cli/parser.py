"""The command `pirrht`: plan, run, estimate and sweep from a terminal."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from pirrht.control.methods import METHODS
from pirrht.errors import OptionError
from sim.recording.columns import explained

EXPLAINED = "methods:\n" + "\n".join(f"  {name:<11} {text}" for name, text in METHODS.items())


GONE = {  # options of earlier versions -> why
    "--rounds": "refitting guides within a plan never paid",
    "--memory": "sampling around the last plan's tape never paid",
}


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Raise the OptionError of a command line that cannot be read."""
        if message == "argument --seeds: expected one argument":  # it is what a leading minus sign leads to
            message += " A:B, and seeds are not negative"
        raise OptionError(f"{message}; see `{self.prog} --help`")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; 0 is success, 1 a drive that failed, 2 bad input, 130 an interruption."""
    import sim.cli

    return sim.cli.main(argv)


def read(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """What the words of a command ask for; None: those that this process was started with.

    Raises:
        OptionError: they cannot be read, or name an option that is gone.
    """
    arguments, unknown = _parser().parse_known_args(argv)
    for name in (word.partition("=")[0] for word in unknown):
        if name in GONE:
            raise OptionError(f"{name} is gone: {GONE[name]}; leave it out")
    if unknown:
        raise OptionError(f"unrecognized arguments: {' '.join(unknown)}; see `pirrht {arguments.command} --help`")
    return arguments


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="pirrht",
        description="Topology-guided path integral control (PI-RRHT*): plan with FCL, drive in MuJoCo, watch in Rerun.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=Parser)
    commands.add_parser("scenes", help="list the built-in scenes")
    plan = commands.add_parser("plan", help="grow the tree and print one row per homology class")
    plan.add_argument("-o", "--output", type=Path, metavar="TREE.npz", help="save the tree for `--tree`")
    plan.add_argument("--png", type=Path, metavar="FILE", help="draw tree and references (extra `figures`)")
    plan.add_argument(
        "--convergence", type=Path, metavar="FILE", help="draw the length of each class's best path per iteration"
    )
    run = commands.add_parser("run", help="plan, then drive; exit status 0 goal, 1 collision or time-out, 2 bad input")
    _run_options(run)
    estimate = commands.add_parser("estimate", help="what the controller would do at one state")
    estimate.add_argument("--at", type=float, nargs="+", required=True, metavar="X", help="state: X Y [TH]")
    estimate.add_argument("--repeat", type=int, default=1, metavar="N", help="repeats with independent samples (1)")
    estimate.add_argument("--truth", action="store_true", help="add the exact value and control, solved for on a grid")
    for command in (run, estimate):
        _explain_methods(command)
    for command in (plan, run, estimate):
        command.add_argument("scene", metavar="SCENE", help="built-in name or MJCF file")
        _common_options(command, skip=("tree",) if command is plan else ())
        command.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")
    sweep = commands.add_parser("sweep", help="many seeds, methods and noise levels: a table, a dataset")
    sweep.add_argument("scenes", nargs="+", metavar="SCENE", help="built-in names or MJCF files")
    _common_options(sweep, skip=("noise", "method", "seed"))
    _sweep_options(sweep)
    _explain_methods(sweep)
    _report_options(commands)
    _export_options(commands)
    world = commands.add_parser("import", help="turn a Gazebo world of static primitives or a ROS map into a scene")
    world.add_argument("world", type=Path, metavar="WORLD", help="an SDF file (.world, .sdf), or a map's .yaml")
    world.add_argument("-o", "--output", type=Path, required=True, metavar="SCENE.xml", help="the scene to write")
    world.add_argument("--start", type=float, nargs="+", metavar="X", help="start: X Y [TH]")
    world.add_argument("--goal", type=float, nargs=3, metavar=("X", "Y", "R"), help="goal disc")
    world.add_argument(
        "--workspace", type=float, nargs=4, metavar=("X0", "X1", "Y0", "Y1"), help="border of the robot's centre"
    )
    world.add_argument(
        "--unknown", metavar="RULE", help="unknown cells of a map are walls (occupied) or not (free) (occupied)"
    )
    return parser


def _common_options(parser: argparse.ArgumentParser, skip: Sequence[str] = ()) -> None:
    """Options of the contract; None means: what the preset, the scene or the robot says."""
    scene = parser.add_argument_group("scene and robot")
    scene.add_argument("--robot", metavar="NAME", help="puck, unicycle, diffdrive or an MJCF file (the scene's own)")
    scene.add_argument("--radius", type=float, metavar="M", help="footprint radius of the robot")
    scene.add_argument("--start", type=float, nargs="+", metavar="X", help="start: X Y [TH]")
    scene.add_argument("--goal", type=float, nargs=3, metavar=("X", "Y", "R"), help="goal disc")
    problem = parser.add_argument_group("problem")
    numbers: list[tuple[argparse._ArgumentGroup, str, Any, str, str]] = [
        (problem, "speed", float, "M/S", "speed V of a car (1)"),
        (problem, "rho", float, "M", "turning radius of a car at |u| = 1 and V = 1 (1)"),
        (problem, "noise", float, "B", "noise b (puck 0.1 m/sqrt(s), car 0.03 rad/sqrt(s))"),
        (problem, "phi", float, "COST", "final cost off the goal (puck infinite, car 1000)"),
        (problem, "seed", int, "N", "seed of tree, samples and plant noise (0)"),
    ]
    planner = parser.add_argument_group("planner and sampler")
    numbers += [
        (planner, "vertices", int, "N", "grow until the tree has N vertices (puck 1000, car 2000)"),
        (planner, "classes", int, "K", "at most K classes per vertex, 0 for all (16)"),
        (planner, "limit", float, "H", "H_limit of |1 - H_i| <= H_limit (puck 0.6, car 0.8)"),
        (planner, "samples", int, "N", "samples around each reference (puck 200, car 300)"),
        (planner, "target-error", float, "EPS", "sample on, doubling, until the control's standard error is below EPS"),
        (planner, "budget", int, "N", "samples around each reference at most under --target-error (16 --samples)"),
        (planner, "dt", float, "S", "rollout step (0.1)"),
        (
            planner,
            "period",
            float,
            "S",
            "control period after which the plan is made anew (puck 0.01, car 0.1)",
        ),
        (planner, "threads", int, "N", "threads of the sampler; results do not depend on it (all cores)"),
    ]
    for group, name, kind, metavar, text in numbers:
        if name not in skip:
            group.add_argument(f"--{name}", type=kind, metavar=metavar, help=text)
    planner.add_argument("--exit", metavar="RULE", help="first exit along the step (bridge) or at its end (endpoint)")
    planner.add_argument(
        "--steps",
        metavar="RULE",
        help="rollout steps with --exit bridge: split near walls and goal (fitted) or all of --dt (uniform, paper)",
    )
    planner.add_argument("--weights", metavar="RULE", help="how references mix: balance or average (the paper)")
    planner.add_argument(
        "--guide",
        metavar="RULE",
        help="samples follow the reference from where they are (feedback) or open-loop (paper)",
    )
    planner.add_argument(
        "--between",
        metavar="RULE",
        help="between plans the control follows the state (classes) or is held (hold, paper)",
    )
    planner.add_argument(
        "--allocation",
        metavar="RULE",
        help="samples of a puck go to the references by contribution in earlier plans, or equal (paper)",
    )
    planner.add_argument(
        "--draws", metavar="RULE", help="samples in pairs of opposite noise (antithetic) or independent (paper)"
    )
    planner.add_argument(
        "--no-polish",
        dest="polish",
        action="store_false",
        default=None,
        help="references as the tree has them",
    )
    planner.add_argument(
        "--preset",
        metavar="NAME",
        help="paper: dt = period = 0.1, its N, open loop, plain average, endpoint exit, uniform steps, equal, "
        "independent samples",
    )
    if "tree" not in skip:
        planner.add_argument(
            "--tree", metavar="TREE.npz", help="a tree that `pirrht plan -o` saved, instead of growing one"
        )
    if "method" not in skip:
        planner.add_argument("--method", metavar="NAME", help=f"one of {', '.join(METHODS)} (pi-rrht)")
    planner.add_argument(
        "--consistency",
        type=float,
        metavar="C",
        help="of best-class: the value of the class followed so far counts C times, 1 for no preference (0.8)",
    )
    planner.add_argument("--horizon", type=float, metavar="S", help="of mppi: length of its tape (3)")
    planner.add_argument(
        "--exploration", type=float, metavar="X", help="of mppi: noise of its samples over the robot's (puck 1, car 10)"
    )
    planner.add_argument("--plant", metavar="NAME", help="mujoco, or sde: the analytic equation (mujoco)")
    planner.add_argument(
        "--max-time", type=float, metavar="S", help="end of the drive in simulated time (puck 30, car 60)"
    )


def _explain_methods(parser: argparse.ArgumentParser) -> None:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EXPLAINED


def _run_options(parser: argparse.ArgumentParser) -> None:
    drive = parser.add_argument_group("drive")
    drive.add_argument(
        "--real-time",
        action="store_true",
        default=None,
        help="drive against the clock and plan ahead meanwhile, with as many samples as there is time for, --samples "
        "at least; results depend on the machine and differ from run to run",
    )
    drive.add_argument(
        "--grow",
        type=int,
        metavar="N",
        help="vertices that the tree gains between two plans (0; with --real-time at most, in the time that is left)",
    )
    drive.add_argument(
        "--truth", action="store_true", help="hold every control against the optimal one, solved for on a grid"
    )
    recording = parser.add_argument_group("recording")
    recording.add_argument("--record", type=Path, metavar="FILE.rrd", help="write a Rerun recording")
    recording.add_argument(
        "--record-hz",
        type=float,
        default=5.0,
        metavar="HZ",
        help="references and samples per simulated second (5)",
    )
    recording.add_argument(
        "--record-samples",
        choices=("all", "some", "none"),
        default="some",
        help="sampled paths to record (some)",
    )
    recording.add_argument(
        "--record-lift",
        type=_obstacles,
        metavar="K1,K2",
        help="obstacles whose H is the height in the tab Tree (two that tell the shortest classes apart)",
    )
    recording.add_argument("--video", type=Path, metavar="FILE.mp4", help="film the drive in MuJoCo (extra `video`)")
    recording.add_argument("--png", type=Path, metavar="FILE.png", help="its last picture (extra `video`)")
    recording.add_argument("--view", action="store_true", help="open the Rerun viewer")
    recording.add_argument(
        "--serve",
        action="store_true",
        help="serve viewer and data to browsers of this machine; from a terminal until Ctrl-C",
    )
    recording.add_argument(
        "--connect", metavar="URL", help="stream to a running viewer, rerun+http://127.0.0.1:9876/proxy"
    )


def _obstacles(text: str) -> list[int]:
    """Numbers of obstacles, as in 5,12."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of obstacles; write it like 5,12") from None


def _export_options(commands: Any) -> None:
    export = commands.add_parser(
        "export",
        help="turn a recording into a table: Parquet or NumPy",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"columns, one row per control step (K = 1, 2, ..., ID a homology class):\n{explained()}",
    )
    export.add_argument("recording", type=Path, metavar="FILE.rrd", help="made by `pirrht run --record`, whole or not")
    export.add_argument(
        "-o", "--output", type=Path, required=True, metavar="TABLE", help="the table to write, .parquet or .npz"
    )


def _report_options(commands: Any) -> None:
    report = commands.add_parser("report", help="sum up a sweep: intervals, comparisons on equal seeds, pictures")
    report.add_argument("folder", type=Path, metavar="DIR", help="made by `pirrht sweep -o DIR`, finished or not")
    report.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="where report.md and report.html go (DIR)")
    report.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")


def _sweep_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--methods", default="pi-rrht", metavar="A,B", help=f"of {', '.join(METHODS)} (pi-rrht)")
    parser.add_argument("--noise", metavar="B1,B2", help="noise levels (the scene's own)")
    parser.add_argument("--seeds", default="0:10", metavar="A:B", help="seeds A to B-1 (0:10)")
    parser.add_argument("--plan-seed", type=int, default=0, metavar="N", help="seed of the trees (0)")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes (all cores)")
    parser.add_argument("--scheduler", metavar="URL", help="let a Dask cluster drive: tcp://... (extra `cluster`)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write one record per run as JSON")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="keep finished runs as a Parquet dataset; the same command goes on where it stopped",
    )
    parser.add_argument("--again", action="store_true", help="make runs that ended with an error anew (with -o)")


if __name__ == "__main__":
    sys.exit(main())
