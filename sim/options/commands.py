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
    Option(
        name="scene", text="built-in name or MJCF file", metavar="SCENE", commands=SINGLE, positional=True,
        common=True,
    ),
    Option(
        name="scenes", text="built-in names or MJCF files", metavar="SCENE", commands=("sweep",), positional=True,
        count="+", common=True,
    ),
    _task(
        "robot", "puck, unicycle, diffdrive, hover, rover, car or an MJCF file", metavar="NAME", unset="the scene's",
        common=True,
    ),
    _task(
        "system", "a `sim.systems.System`, or a function that returns one, of a module in this folder or installed",
        metavar="MODULE:NAME", unset="the robot's",
    ),
    _task(
        "radius", "footprint radius of the robot", kind=float, metavar="M", numeric=True, unset="the robot's",
        bounds=Bounds(low=1e-3, high=100.0, why="smaller ones are points, and larger ones fit into no scene"),
    ),
    _task(
        "margin", "safety margin of plans around the footprint", kind=float, metavar="M", numeric=True,
        unset="the scene's, or three standard deviations of the noise in 0.01 s",
        bounds=Bounds(low=0.0, high=10.0, why="less is a contact, and no scene has more clearance"),
    ),
    _task("start", "X Y [m] and TH [rad]", kind=float, count="+", metavar="X", unset="the scene's", common=True),
    _task("goal", "disc [m]", kind=float, count=3, metavar=("X", "Y", "R"), unset="the scene's", common=True),
    _task(
        "workspace", "border of the robot's centre", kind=float, count=4, metavar=("X0", "X1", "Y0", "Y1"),
        unset="the scene's site or floor", bounds=PLACE,
    ),
    _task(
        "freeze", "weld bodies with joints at the first keyframe or default pose, and drop actuators", kind=bool,
    ),
    _task(
        "without", "leave out bodies of the scene and what refers to them", count="+", metavar="BODY",
    ),
)  # fmt: skip

WARM = (
    Option(
        name="robots", text="built-in robots or MJCF files; none: all built-in ones", metavar="ROBOT",
        commands=("warm",), positional=True, count="*",
    ),
    Option(
        name="moving", text="for scenes with moving obstacles", kind=bool, default=False,
        commands=("warm",),
    ),
)  # fmt: skip

PLAN = (
    _file("output", "save the tree for `--tree`", "TREE.npz", "plan", short="o", common=True),
    _file("png", "draw tree and references (extra `figures`)", "FILE", "plan", common=True),
    _file("convergence", "draw the length of each class's best path per iteration", "FILE", "plan"),
)

ESTIMATE = (
    Option(
        name="at", text="state, see the table; missing numbers are 0", kind=float, count="+",
        metavar="X", commands=("estimate",), required=True, common=True,
    ),
    Option(
        name="time", text="time at which moving obstacles are evaluated", kind=float, metavar="S",
        commands=("estimate",), default=0.0, numeric=True,
        bounds=Bounds(low=0.0, high=86_400.0, why="no run of a day is useful"),
    ),
    Option(
        name="repeat", text="repeats with independent samples", kind=int, metavar="N", commands=("estimate",),
        default=1, numeric=True, common=True,
        bounds=Bounds(low=1, high=10_000, why="a table of more rows helps nobody"),
    ),
    Option(
        name="truth", text="add the exact value and control from a grid", kind=bool, default=False,
        commands=("estimate",), common=True,
    ),
)  # fmt: skip

RUN = (
    Option(
        name="truth", text="compare each control with the exact one from a grid", kind=bool,
        default=False, commands=("run",), group=DRIVE,
    ),
    _file("record", "write a Rerun recording", "FILE.rrd", "run", group=RECORDING, common=True),
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
        commands=("run",), group=RECORDING, unset="two that separate the shortest classes",
    ),
    _file("video", "film of the run (extra `video`)", "FILE.mp4", "run", group=RECORDING, common=True),
    _file("png", "last picture of the film (extra `video`)", "FILE.png", "run", group=RECORDING, common=True),
    Option(
        name="view", text="open the Rerun viewer", kind=bool, default=False, commands=("run", "play"),
        group=RECORDING, common=True,
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
        name="headless", text="no window, as fast as possible, deterministic", kind=bool,
        default=False, commands=("play",), group=DRIVE, common=True,
    ),
    _file(
        "script", "pushes, moves and noise by the time of the run, as JSON", "FILE.json", "play", group=DRIVE,
        common=True,
    ),
)  # fmt: skip

SWEEP = (
    Option(
        name="methods", text=f"of {', '.join(METHODS)}", metavar="A,B", default="pi-rrht", commands=("sweep",),
        group=GRID, common=True,
    ),
    Option(
        name="noise", text="noise levels", metavar="B1,B2", commands=("sweep",), group=GRID, unset="the scene's",
        common=True,
    ),
    Option(
        name="seeds", text="seeds A to B-1", metavar="A:B", default="0:10", commands=("sweep",), group=GRID,
        common=True,
    ),
    Option(
        name="jobs", text="processes", kind=int, metavar="N", commands=("sweep",), unset="all cores", common=True,
        bounds=Bounds(low=1, high=1024, why="every process has a scene and a tree of its own in memory"),
    ),
    Option(
        name="scheduler", text="send runs to a Dask cluster: tcp://... (extra `cluster`)", metavar="URL",
        commands=("sweep",),
    ),
    _file("json", "write one record per run as JSON", "FILE", "sweep", common=True),
    _file(
        "output", "keep finished runs as a Parquet dataset; the same command continues it", "DIR", "sweep",
        short="o", common=True,
    ),
    Option(
        name="again", text="repeat runs that ended with an error (with -o)", kind=bool, default=False,
        commands=("sweep",), group=FILES,
    ),
)  # fmt: skip

OTHERS = (
    _file("json", "write the results as JSON", "FILE", *SINGLE, "report", common=True),
    _file("folder", "made by `pirrht sweep -o DIR`, complete or not", "DIR", "report", positional=True),
    _file("output", "folder of report.md and report.html", "FOLDER", "report", short="o", unset="DIR"),
    _file("recording", "made by `pirrht run --record`, complete or not", "FILE.rrd", "export", positional=True),
    _file("output", "the table to write, .parquet or .npz", "TABLE", "export", short="o", required=True),
    _file(
        "world", "an SDF file (.world, .sdf), a map's .yaml, a file of motions (.json), or a mesh", "WORLD", "import",
        positional=True,
    ),
    _file("output", "the scene to write", "SCENE.xml", "import", short="o", required=True),
    Option(
        name="motion", text="WORLD is a file of motions (DynaBARN)", kind=bool,
        commands=("import",),
    ),
    Option(
        name="decompose", text="WORLD is a mesh (.obj, .stl, .dae) in metres, z up: write its convex parts "
        "(extra `decompose`)", kind=bool, commands=("import",),
    ),
    Option(
        name="world", attribute="number", text="number of a world in a file of motions", metavar="NUMBER",
        commands=("import",), unset="its only one",
    ),
    Option(
        name="start", text="X Y [m] and TH [rad]", kind=float, count="+", metavar="X", commands=("import",),
        bounds=PLACE,
    ),
    Option(
        name="goal", text="disc [m]", kind=float, count=3, metavar=("X", "Y", "R"), commands=("import",), bounds=PLACE,
    ),
    Option(
        name="workspace", text="border of the robot's centre", kind=float, count=4, metavar=("X0", "X1", "Y0", "Y1"),
        commands=("import",), bounds=PLACE,
    ),
    Option(
        name="models", text="folders of models that a Gazebo world includes, besides GZ_SIM_RESOURCE_PATH, "
        "GAZEBO_MODEL_PATH and folders around WORLD", kind=Path, count="+", metavar="DIR",
        commands=("import",),
    ),
    Option(
        name="without", text="models of a Gazebo world to leave out", count="+", metavar="MODEL",
        commands=("import",),
    ),
    Option(
        name="unknown", text="unknown cells of a map are walls (occupied) or not (free)", metavar="RULE",
        commands=("import",), unset="occupied",
    ),
)  # fmt: skip

COMMANDS = (*WARM, *PLAN, *ESTIMATE, *RUN, *PLAY, *SWEEP, *OTHERS)
