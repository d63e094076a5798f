"""Options that belong to one command or another: scene and robot, files, recordings, sweeps, worlds and tables."""

from __future__ import annotations

from argparse import ArgumentTypeError
from pathlib import Path

from pirrht.control.settings import METHODS
from sim.options.record import Bounds, Option
from sim.options.settings import DRIVE, DRIVES, SINGLE

SCENE, GRID, RECORDING, FILES = "scene and robot", "grid", "recording", "files"
FAR = 1e6  # [m]
PLACE = Bounds(low=-FAR, high=FAR, why="positions are in metres, and worlds are smaller")


def obstacles(text: str) -> list[int]:
    """Numbers of obstacles, as in 5,12."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is no list of obstacles; write it like 5,12") from None


def _task(name: str, text: str, **more: object) -> Option:
    known: dict[str, object] = {"commands": DRIVES, "group": SCENE, "role": "task", "identifies": True, **more}
    return Option(name=name, text=text, **known)  # type: ignore[arg-type]


def _file(name: str, text: str, metavar: str, *commands: str, **more: object) -> Option:
    known: dict[str, object] = {"group": FILES, **more}
    return Option(name=name, text=text, metavar=metavar, commands=commands, kind=Path, **known)  # type: ignore[arg-type]


TASK = (
    Option(name="scene", text="built-in name or MJCF file", metavar="SCENE", commands=SINGLE, positional=True),
    Option(
        name="scenes", text="built-in names or MJCF files", metavar="SCENE", commands=("sweep",), positional=True,
        count="+",
    ),
    _task(
        "robot", "puck, unicycle, diffdrive, hover, rover, car or an MJCF file", metavar="NAME", unset="the scene's own"
    ),
    _task(
        "system", "what moves, in place of what the robot's file names: a `sim.systems.System`, or a function that "
        "returns one, of a module in this folder or installed; one without steering of its own gets references of a "
        "point at its pace, which are no optimum of it: classes are ordered by what they cost the point, and guides "
        "take more passes to make them feasible", metavar="MODULE:NAME", unset="the robot's own",
    ),
    _task(
        "radius", "footprint radius of the robot", kind=float, metavar="M", numeric=True, unset="the robot's own",
        bounds=Bounds(low=1e-3, high=100.0, why="smaller ones are points, and larger ones fit into no scene"),
    ),
    _task(
        "margin", "room that plans leave around the robot, where there is some: its footprint grows by so much, what "
        "collides of it does not", kind=float, metavar="M", numeric=True,
        unset="the scene's, or three standard deviations of what noise moves the robot in 0.01 s, 0.01 m at least and "
        "a quarter of the room in the narrowest passage at most",
        bounds=Bounds(low=0.0, high=10.0, why="less is a bump, and no scene has more room"),
    ),
    _task("start", "start: X Y [m] and TH [rad]", kind=float, count="+", metavar="X", unset="the scene's"),
    _task("goal", "goal disc", kind=float, count=3, metavar=("X", "Y", "R"), unset="the scene's"),
    _task(
        "workspace", "border of the robot's centre", kind=float, count=4, metavar=("X0", "X1", "Y0", "Y1"),
        unset="the scene's site or floor", bounds=PLACE,
    ),
    _task(
        "freeze", "weld bodies with joints where the scene's first keyframe, else its default pose, has them, and drop "
        "its actuators", kind=bool,
    ),
    _task(
        "without", "leave out bodies of the scene, say a robot of its own, and all that refers to them", count="+",
        metavar="BODY",
    ),
)  # fmt: skip

WARM = (
    Option(
        name="robots", text="built-in robots or MJCF files; without any, all built-in ones", metavar="ROBOT",
        commands=("warm",), positional=True, count="*",
    ),
    Option(
        name="moving", text="for scenes with moving obstacles, in place of static ones", kind=bool, default=False,
        commands=("warm",),
    ),
)  # fmt: skip

PLAN = (
    _file("output", "save the tree for `--tree`", "TREE.npz", "plan", short="o"),
    _file("png", "draw tree and references (extra `figures`)", "FILE", "plan"),
    _file("convergence", "draw the length of each class's best path per iteration", "FILE", "plan"),
)

ESTIMATE = (
    Option(
        name="at", text="state, X Y or more of it [m, rad, m/s], and what is not said is 0", kind=float, count="+",
        metavar="X", commands=("estimate",), required=True, of_robots="coordinates",
    ),
    Option(
        name="time", text="time of the drive, by which bodies move", kind=float, metavar="S", commands=("estimate",),
        default=0.0, numeric=True, bounds=Bounds(low=0.0, high=86_400.0, why="no drive of a day is of use"),
    ),
    Option(
        name="repeat", text="repeats with independent samples", kind=int, metavar="N", commands=("estimate",),
        default=1, numeric=True, bounds=Bounds(low=1, high=10_000, why="a table of more rows helps nobody"),
    ),
    Option(
        name="truth", text="add the exact value and control, solved for on a grid", kind=bool, default=False,
        commands=("estimate",),
    ),
)  # fmt: skip

RUN = (
    Option(
        name="truth", text="hold every control against the optimal one, solved for on a grid", kind=bool,
        default=False, commands=("run",), group=DRIVE,
    ),
    _file("record", "write a Rerun recording", "FILE.rrd", "run", group=RECORDING),
    Option(
        name="record-hz", text="references and samples per simulated second", kind=float, metavar="HZ", default=5.0,
        numeric=True, commands=("run",), group=RECORDING,
        bounds=Bounds(low=1e-6, high=1e6, why="slower recordings show nothing, and no physics step is shorter"),
    ),
    Option(
        name="record-samples", text="sampled paths to record", choices=("all", "some", "none"), default="some",
        metavar="WHICH", commands=("run",), group=RECORDING,
    ),
    Option(
        name="record-lift", text="obstacles whose H is the height in the tab Tree", kind=obstacles, metavar="K1,K2",
        commands=("run",), group=RECORDING, unset="two that tell the shortest classes apart",
    ),
    _file("video", "film the drive in MuJoCo (extra `video`)", "FILE.mp4", "run", group=RECORDING),
    _file("png", "its last picture (extra `video`)", "FILE.png", "run", group=RECORDING),
    Option(
        name="view", text="open the Rerun viewer", kind=bool, default=False, commands=("run", "play"),
        group=RECORDING,
    ),
    Option(
        name="serve", text="serve viewer and data to browsers of this machine; from a terminal until Ctrl-C",
        kind=bool, default=False, commands=("run", "play"), group=RECORDING,
    ),
    Option(
        name="connect", text="stream to a running viewer, rerun+http://127.0.0.1:9876/proxy", metavar="URL",
        commands=("run", "play"), group=RECORDING,
    ),
)  # fmt: skip

PLAY = (
    Option(
        name="headless", text="no window: step by step, as fast as it goes, and the same every time", kind=bool,
        default=False, commands=("play",), group=DRIVE,
    ),
    _file("script", "pushes, moves and noise by the time of the drive, as JSON", "FILE.json", "play", group=DRIVE),
)  # fmt: skip

SWEEP = (
    Option(
        name="methods", text=f"of {', '.join(METHODS)}", metavar="A,B", default="pi-rrht", commands=("sweep",),
        group=GRID,
    ),
    Option(
        name="noise", text="noise levels", metavar="B1,B2", commands=("sweep",), group=GRID, unset="the scene's own",
    ),
    Option(name="seeds", text="seeds A to B-1", metavar="A:B", default="0:10", commands=("sweep",), group=GRID),
    Option(
        name="jobs", text="processes", kind=int, metavar="N", commands=("sweep",), unset="all cores",
        bounds=Bounds(low=1, high=1024, why="every process has a scene and a tree of its own in memory"),
    ),
    Option(
        name="scheduler", text="let a Dask cluster drive: tcp://... (extra `cluster`)", metavar="URL",
        commands=("sweep",),
    ),
    _file("json", "write one record per run as JSON", "FILE", "sweep"),
    _file(
        "output", "keep finished runs as a Parquet dataset; the same command goes on where it stopped", "DIR", "sweep",
        short="o",
    ),
    Option(
        name="again", text="make runs that ended with an error anew (with -o)", kind=bool, default=False,
        commands=("sweep",), group=FILES,
    ),
)  # fmt: skip

OTHERS = (
    _file("json", "write the figures as JSON", "FILE", *SINGLE, "report"),
    _file("folder", "made by `pirrht sweep -o DIR`, finished or not", "DIR", "report", positional=True),
    _file("output", "where report.md and report.html go", "FOLDER", "report", short="o", unset="DIR"),
    _file("recording", "made by `pirrht run --record`, whole or not", "FILE.rrd", "export", positional=True),
    _file("output", "the table to write, .parquet or .npz", "TABLE", "export", short="o", required=True),
    _file(
        "world", "an SDF file (.world, .sdf), a map's .yaml, a file of motions (.json), or a mesh", "WORLD", "import",
        positional=True,
    ),
    _file("output", "the scene to write", "SCENE.xml", "import", short="o", required=True),
    Option(
        name="motion", text="WORLD is a file of motions, as that of DynaBARN, whatever its name ends in", kind=bool,
        commands=("import",),
    ),
    Option(
        name="decompose", text="WORLD is a mesh (.obj, .stl, .dae), in metres and with z up: write its convex "
        "parts, since MuJoCo collides with hulls (extra `decompose`)", kind=bool, commands=("import",),
    ),
    Option(
        name="world", attribute="number", text="which world of a file of motions", metavar="NUMBER",
        commands=("import",), unset="its only one",
    ),
    Option(
        name="start", text="start: X Y [m] and TH [rad]", kind=float, count="+", metavar="X", commands=("import",),
        bounds=PLACE,
    ),
    Option(
        name="goal", text="goal disc", kind=float, count=3, metavar=("X", "Y", "R"), commands=("import",), bounds=PLACE,
    ),
    Option(
        name="workspace", text="border of the robot's centre", kind=float, count=4, metavar=("X0", "X1", "Y0", "Y1"),
        commands=("import",), bounds=PLACE,
    ),
    Option(
        name="models", text="folders with the models that a Gazebo world includes; those around WORLD, in "
        "GZ_SIM_RESOURCE_PATH and in GAZEBO_MODEL_PATH are searched as well", kind=Path, count="+", metavar="DIR",
        commands=("import",),
    ),
    Option(
        name="without", text="models of a Gazebo world to leave out, like the robot in it", count="+", metavar="MODEL",
        commands=("import",),
    ),
    Option(
        name="unknown", text="unknown cells of a map are walls (occupied) or not (free)", metavar="RULE",
        commands=("import",), unset="occupied",
    ),
)  # fmt: skip

COMMANDS = (*WARM, *PLAN, *ESTIMATE, *RUN, *PLAY, *SWEEP, *OTHERS)
