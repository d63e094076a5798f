"""Options of commands, of which parser, numerics of scenes, help and docs/cli.md follow, and sizes of plans."""

import math
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pirrht.control.settings import METHODS
from pirrht.errors import OptionError
from sim.settings import BY_SCENE, BY_SETTING, GROUPS, PLACES, SCENE_OPTIONS, SETTINGS, SINGLE, Option
from sim.states import ADAPTERS

GIB = 2.0**30
MEMORY_SHARE = 0.5  # of the memory of a machine may go to one plan
PATH_STEPS = 100_000  # steps of one path at most
PLAN_STEPS = 1e9  # steps of all paths of a plan at most
TAIL = 40.0  # paths are cut so many lambda after the cheapest reference (`pirrht.estimation.sampler`)
DOUBLINGS = 16  # of --samples under --target-error, without --budget
DAILY = {  # options that `--help` of a command with a scene lists
    "scene", "scenes", "robot", "footprint", "start", "goal", "noise", "seed", "method", "risk", "preset", "samples",
    "vertices", "real-time", "sense", "output", "png", "at", "repeat", "truth", "record", "video", "view", "headless",
    "script", "methods", "seeds", "jobs", "json",
}  # fmt: skip
*_, RUN, GRID, RECORDING, FILES, ROS = GROUPS
PLANE = ADAPTERS[0]


def obstacles(text: str) -> list[int]:
    """Numbers of obstacles, as in 5,12."""
    return [int(part) for part in text.split(",")]


def _one(commands: str, name: str, text: str, metavar: Any = "", **more: Any) -> Option:
    if more.get("kind") is bool:
        more["default"] = False
    number = more.get("kind") in (int, float) and more.get("default") is not None
    return Option(name=name, text=text, metavar=metavar, commands=tuple(commands.split()), numeric=number, **more)


_file = partial(_one, kind=Path, group=FILES)
_output = partial(_file, output=True)
_flag = partial(_one, kind=bool)
_singles = " ".join(SINGLE)


def _ros(commands: str, name: str, text: str, metavar: Any = "", **more: Any) -> Option:
    return replace(_one(commands, name, text, metavar, group=ROS, **more), numeric=False)  # no scene carries it


COMMAND_OPTIONS = (
    _one(_singles, "scene", "built-in name or MJCF file", "SCENE", positional=True),
    _one("sweep", "scenes", "built-in names or MJCF files", "SCENE", positional=True, count="+"),
    _one("warm", "robots", "built-in robots or MJCF files; none: all built-in", "ROBOT", positional=True, count="*"),
    _flag("warm", "moving", "for scenes with moving obstacles"),
    _output("plan", "output", "save the tree for `--tree`", "TREE.npz", short="o"),
    _output("plan", "png", "draw tree and references (extra `figures`)", "FILE", extra="figures"),
    _output("plan", "convergence", "draw the length of each class's best path per iteration (extra `figures`)", "FILE",
            extra="figures"),
    _one("estimate", "at", "state, see the table; missing numbers are 0", "X", kind=float, count="+", required=True),
    _one("estimate", "time", "time of the estimate, among moving obstacles", "S", kind=float, default=0.0,
         bounds=(0.0, 86_400.0)),
    _one("estimate", "repeat", "repeats with independent samples", "N", kind=int, default=1, bounds=(1, 10_000)),
    _flag("estimate", "truth", "add the exact value and control from a grid"),
    _flag("run", "truth", "compare each control with the exact one from a grid", group=RUN),
    _output("run", "record", "write a Rerun recording", "FILE.rrd", group=RECORDING),
    _one("run", "record-hz", "how often references and samples are recorded, per simulated second", "HZ", kind=float,
         default=5.0,
         bounds=(1e-6, 1e6), group=RECORDING),
    _one("run", "record-samples", "which sampled paths are recorded", "WHICH", choices=("all", "some", "none"),
         default="some",
         group=RECORDING),
    _one("run", "record-lift", "obstacles whose H is the height in the tab Tree, as in 5,12", "K1,K2", kind=obstacles,
         unset="two that separate the shortest classes", group=RECORDING),
    _output("run", "video", "write a film of the run (extra `video`)", "FILE.mp4", group=RECORDING, extra="video"),
    _output("run", "png", "write the last picture of the film (extra `video`)", "FILE.png", group=RECORDING,
            extra="video"),
    _flag("run play", "view", "open the Rerun viewer", group=RECORDING),
    _flag("run play", "serve", "serve browsers of this machine, from a terminal until Ctrl-C", group=RECORDING),
    _one("run play", "connect", "stream to a viewer, rerun+http://127.0.0.1:9876/proxy", "URL", group=RECORDING),
    _flag("play", "headless", "no window, as fast as possible, deterministic", group=RUN),
    _file("play", "script", "pushes, moves and noise by the time of the run, as JSON", "FILE.json", group=RUN),
    _one("sweep", "methods", f"methods, of {', '.join(METHODS)}", "A,B", default="pi-rrht", group=GRID),
    _one("sweep", "noise", "noise levels", "B1,B2", group=GRID, unset="the scene's"),
    _one("sweep", "seeds", "seeds A to B-1", "A:B", default="0:10", group=GRID),
    _one("sweep", "jobs", "processes", "N", kind=int, unset="all cores", bounds=(1, 1024)),
    _one("sweep", "scheduler", "send runs to a Dask cluster: tcp://... (extra `cluster`)", "URL", extra="cluster"),
    _output("sweep", "json", "write one record per run as JSON", "FILE"),
    _file("sweep", "output", "keep runs as a Parquet dataset; the same command continues it", "DIR", short="o"),
    _flag("sweep", "again", "repeat runs that ended with an error (with -o)", group=FILES),
    _output(f"{_singles} report", "json", "write the results as JSON", "FILE"),
    _file("report", "folder", "made by `pirrht sweep -o DIR`, complete or not", "DIR", positional=True),
    _file("report", "output", "folder of report.md and report.html", "FOLDER", short="o", unset="DIR"),
    _file("export", "recording", "made by `pirrht run --record`, complete or not", "FILE.rrd", positional=True),
    _output("export", "output", "the table to write, .parquet or .npz, or messages, .mcap (extra `ros`)", "FILE",
            short="o", required=True),
    _file("import", "world", "a Gazebo world or SDF file, the .yaml of a map, a bag of ROS (folder, .mcap, .db3, "
          ".bag), motions (.json), a mesh, or voxels (.npy, .npz, .bt)", "WORLD", positional=True),
    _output("import", "output", "the scene to write", "SCENE.xml", short="o", required=True),
    _flag("import", "motion", "WORLD is a file of motions (DynaBARN)"),
    _flag("import", "decompose", "WORLD is a mesh (not needed)"),
    _one("import", "cell", "side of a voxel", "M", kind=float, bounds=(1e-6, 1e6)),
    _one("import", "world", "number of the world in a file of motions", "NUMBER", attribute="number",
         unset="its only one"),
    *(replace(BY_SCENE[name], commands=("import",), role="command", group="", bounds=PLACES, unset="")
      for name in ("start", "goal", "workspace")),
    _one("import", "models", "folders of a Gazebo world's models, before GZ_SIM_RESOURCE_PATH, "
         "GAZEBO_MODEL_PATH and those around WORLD", "DIR", kind=Path, count="+"),
    _one("import", "without", "models of a Gazebo world to leave out", "MODEL", count="+"),
    _one("import", "topic", "which of several topics of a kind in a bag", "NAME", count="+", attribute="topics"),
    _flag("run", "ros", "be a robot of a ROS 2 graph (extra `ros`)", group=RUN, extra="ros"),
    _ros("run", "odom-hz", "how often odometry, /tf and /clock are published", "HZ", kind=float, default=50.0,
         bounds=(1.0, 1000.0)),
    _ros("run", "command-timeout", "time without a command after which the robot stops", "S", kind=float, default=0.5,
         bounds=(0.01, 86_400.0)),
    _ros("run", "wait", "time for which a run waits for the first command", "S", kind=float, default=60.0,
         bounds=(0.0, 86_400.0)),
    _ros("run", "odom-frame", "frame of the odometry", "FRAME", default="odom"),
    _ros("run ros", "domain", "number of the graph", "N", kind=int, unset="ROS_DOMAIN_ID, or 0", bounds=(0, 232)),
    _ros("run ros", "interface", "network interface, a name or an address", "NAME", unset="loopback"),
    _ros("run ros", "peer", "addresses where nodes are looked for as well", "ADDRESS", count="+"),
    _ros("run ros", "namespace", "put before names of topics that have no slash in front", "NAME", unset="none"),
    _ros("run ros", "map-frame", "frame of maps, plans and goals", "FRAME", default="map"),
    _ros("run ros", "base-frame", "frame of the robot", "FRAME", default="base_link"),
    _ros("run ros", "remap", "other names of topics", "FROM:=TO", count="+"),
    _ros("run ros", "qos", "quality of service of topics, as in scan=reliable,10 or map=best-effort,volatile",
         "TOPIC=QUALITY", count="+"),
    _ros("run ros", "stamped", "commands are TwistStamped", kind=bool),
    _ros("ros", "pose-from", "pose of the robot: by odometry and the frame it is in (odom), or by /tf alone (tf)",
         "RULE", choices=("odom", "tf"), default="odom"),
    _ros("ros", "goal-radius", "distance to a goal at which the robot has arrived", "M", kind=float, default=0.25,
         bounds=(0.01, 100.0)),
    _ros("ros", "late", "age of odometry, scans and plans from which on the robot stops", "S", kind=float,
         default=0.5, bounds=(0.01, 60.0)),
    _ros("ros", "map-late", "age of the map from which on it stops; 0: never", "S", kind=float, default=0.0,
         bounds=(0.0, 3600.0)),
    _ros("ros", "max-speed", "most speed of a command", "M/S", kind=float, default=math.inf, infinite=True,
         bounds=(1e-3, 100.0)),
    _ros("ros", "max-turn", "most turn rate of a command", "RAD/S", kind=float, default=math.inf, infinite=True,
         bounds=(1e-3, 100.0)),
    _flag("ros", "once", "end at the first goal: exit status 0", group=ROS),
    _one("import", "unknown", "unknown cells of a map are walls (occupied) or not (free)", "RULE", unset="occupied"),
)  # fmt: skip
OPTIONS: tuple[Option, ...] = (*SCENE_OPTIONS, *SETTINGS, *COMMAND_OPTIONS)
NUMERICS = {option.name: option for option in OPTIONS if option.numeric}  # in scenes, as `pirrht_NAME`


def options_of(command: str) -> list[Option]:
    """The options of a command, in the order of its help."""
    own = (option for option in OPTIONS if command in option.commands)
    return sorted(own, key=lambda option: ("", *GROUPS).index(option.group))


def of_run(command: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Select what `prepare` takes, by field of `SceneOptions` and `Settings`, as a command was given it."""
    known = BY_SCENE | BY_SETTING
    return {name: given.get(name) for name, option in known.items() if command in option.commands}


def completed(command: str, given: Mapping[str, Any], scene: Mapping[str, float]) -> dict[str, Any]:
    """Numbers of the command alone, by name: as given, else as the scene has them, else their defaults."""
    own = {o.dest: o for o in options_of(command) if o.role == "command" and o.numeric and given.get(o.dest) is None}
    return {name: option.check(scene.get(option.name, option.default)) for name, option in own.items()}


def check_size(task: Any, memory: float | None = None) -> None:
    """Refuse plans that never end or do not fit into half of the `memory` [bytes], by default the machine's."""
    s = task.settings
    d = task.problem.dynamics
    scene = task.loaded.scene
    classes = task.classes_at_start()

    if s.method == "optimal":
        return
    mppi = s.method == "mppi"
    targeted = s.target_error is not None
    speed = s.speed if "speed" in task.system.heeds else 1.0
    cost = (
        2.0 * math.dist(scene.goal.center, scene.start[task.system.adapter.position]) / speed
        + TAIL * task.problem.temperature
    )
    seconds = s.horizon if mppi else cost / task.problem.least_rate  # of a path, about
    steps = max(1.0, seconds / s.dt)
    samples = float(classes * ((s.budget or s.samples * DOUBLINGS) if targeted else s.samples))
    proposals = classes if s.method in ("pi-rrht", "best-class") else 1
    traced = (steps + 1) * d.n if mppi else 0  # paths that outlast the control sequence
    drawn = 8.0 * (samples * (6 + 2 * d.m + 3 * proposals + traced) + proposals * steps * (2 * d.m + 9))
    near = 2.0 * math.e * math.log(s.vertices + 1.0)
    grown = s.vertices * (8.0 * len(task.space.obstacles) + 120.0 * min(4, s.classes or 4) + 92.0 * near)
    if memory is None:
        memory = 8.0 * GIB
        with suppress(AttributeError, OSError, ValueError):  # a system that does not answer this
            memory = float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    limit = MEMORY_SHARE * memory
    plan = f"a plan of {samples:.3g} samples around {classes} classes"
    fewer = f"lower {'--budget or --samples' if targeted else '--samples or --classes'}"
    fits = f"GiB of memory, and at most {limit / GIB:.3g} GiB of this machine's are given to it"
    for needed, most, message in (
        (steps, PATH_STEPS, f"--dt {s.dt:g}: a path of {seconds:.3g} s has {steps:.3g} steps, and at most "
         f"{PATH_STEPS:,} are possible; lower {'--horizon' if mppi else '--noise'} or raise --dt"),
        (grown, limit, f"a tree of {s.vertices} --vertices takes about {grown / GIB:.3g} {fits}; lower --vertices"),
        (drawn, limit, f"{plan} takes about {drawn / GIB:.3g} {fits}; {fewer}"),
        (steps * samples, PLAN_STEPS, f"{plan} takes {steps * samples:.3g} steps, and at most {PLAN_STEPS:.0e} are "
         f"possible; {fewer}, or raise --dt"),
    ):  # fmt: skip
        if needed > most:
            raise OptionError(message)
