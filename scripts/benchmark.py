"""Figures of speed and quality, each a table and, with --json, a file.

    python scripts/benchmark.py speed       rollouts and planning beside JAX, pytorch_mppi and OMPL (if installed:
                                            pip install 'pirrht[bench]'), control step, recording; or one --part of it;
                                            --part moving: among 24 moving obstacles; --part plant: physics steps
    python scripts/benchmark.py first-run   first runs from an empty cache of kernels, of --robot and --scene too, in
                                            turn with those of another checkout (--against)
    python scripts/benchmark.py obstacles   planning and control step against the number of obstacles
    python scripts/benchmark.py effective   effective samples of all plans of drives: six robots, scenes, worlds of BARN
    python scripts/benchmark.py barn        success, time and score of a Jackal with lidar in worlds of BARN (50, or
                                            --worlds, or --scenes grown); --known: with the map; --method: by another
    python scripts/benchmark.py sensing     rooms driven with a lidar: time of a map's update, classes that change
    python scripts/benchmark.py dynabarn    the same among moving cylinders: 15 worlds of DynaBARN by lidar, or --known
    python scripts/benchmark.py worst       where their 30 (--plans) weakest plans lose these, and what is to blame
    python scripts/benchmark.py quality --part grid|car|control|samples|psi|shares|drives   how far from the optimum
    python scripts/benchmark.py calibration  plans at random states of random scenes: how often is the truth within the
                                            standard errors that they claim? --part car: v of the car;
                                            --part moving: at random states and times among bodies;
                                            --part mazes: which errors beyond 5 standard errors go without a warning?
    python scripts/benchmark.py risk        predicted probability of a collision against the exact law, held for a
                                            physics step, at random states of random scenes; --part moving;
                                            --part kept: margins of --risk 0.1 to 0.003 against that law,
                                            in random scenes or a --scene;
                                            --part tradeoff: cost against collisions of drives at many margins;
                                            --part promise: drives with --risk 0.01 through random scenes
    python scripts/benchmark.py mass        v of a mass at random states: a million samples of three kinds, and plans;
                                            --part line: on a line, against the exact grid; --robot rover|car
    python scripts/benchmark.py maps        import of ROS maps and the first plan against pixels, 1000 to 4000 a side
    python scripts/benchmark.py roadmap     classes of a --scene in space over time, and a roadmap's distinct paths
    python scripts/benchmark.py presets     time, effective samples and error of v of each preset, on slit and clutter

Times depend on the machine: quote ratios from one run.
"""

import argparse
import importlib
from pathlib import Path

from pirrht.errors import PirrhtError
from sim.files import check_writable, write_json
from sim.text import table

PARTS = {
    "quality": ("control", "grid", "car", "samples", "psi", "shares", "drives"),  # the first is the default
    "speed": (None, "rollouts", "planners", "drive", "systems", "moving", "plant"),
    "calibration": (None, "car", "moving", "mazes", "rectangle", "space"),
    "mass": (None, "line"),
    "risk": (None, "moving", "kept", "tradeoff", "promise"),
}
TABLES = (
    *("speed", "first-run", "obstacles", "maps", "presets", "roadmap"),
    *("effective", "barn", "dynabarn", "sensing", "worst", "quality", "calibration", "risk", "mass"),
)


def main() -> int:
    """Print a table; with --json also write it."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=TABLES)
    parser.add_argument("--scene", help="built-in name or MJCF file (the table's own)")
    parser.add_argument(
        "--robot",
        help="of `effective` and `worst` (all), `mass` and `speed --part systems` (hover), `--part moving` (puck), "
        "`first-run` (rover, or some with commas)",
    )
    parser.add_argument("--drive", type=float, default=2.0, help="simulated seconds of the drives that are timed (2)")
    parser.add_argument(
        "--part",
        help="of `quality`: "
        + ", ".join(map(str, PARTS["quality"]))
        + "; of `speed`: rollouts, planners, drive (all), systems, moving, plant; "
        "of `calibration`: car, moving, mazes, rectangle, space; of `mass`: line",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=300,
        help="drives per row of `quality` and `risk` (300), per scene of `effective` (2), per world of `barn` or "
        "`dynabarn` (10)",
    )
    parser.add_argument(
        "--png",
        type=Path,
        help="draw `calibration`, `maps`, samples and drives of `quality`, or kept and tradeoff of `risk`",
    )
    parser.add_argument("--shapes", nargs="+", metavar="SHAPE", help="of `effective`: footprints, radii of discs")
    parser.add_argument("--worlds", nargs="+", metavar="N", help="of `barn` and `dynabarn` (all)")
    parser.add_argument("--known", action="store_true", help="`barn`: with the map given; `dynabarn`: all motions")
    parser.add_argument("--method", metavar="NAME", help="of `barn` (pi-rrht)")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="of `first-run`")
    parser.add_argument("--repeats", type=int, default=3, help="of `first-run` (3)")
    random = parser.add_argument_group("calibration and mass")
    random.add_argument(
        "--scenes",
        type=int,
        help="random scenes (30; of the car 3; of `--part moving` the built-in ones), or BARN's worlds; of `barn` "
        "worlds that are grown",
    )
    random.add_argument("--states", type=int, help="random states in each (12; of the car 8); of `mass` in all (20)")
    random.add_argument(
        "--plans", type=int, help="plans at each state and noise level (20; of `mass` 10, of `worst` 30 in all)"
    )
    random.add_argument(
        "--samples", type=int, help="of each kind at each state of `mass` (1000000; on the line 100000)"
    )
    random.add_argument("--first-seed", type=int, default=0, help="of the scenes, which count up from it (0)")
    random.add_argument("--noises", type=float, nargs="+", metavar="b", help="levels (0.1 0.2 0.3; the robot's own)")
    random.add_argument("--at", type=float, nargs="+", action="append", metavar="X", help="a state of --scene; repeat")
    random.add_argument(
        "--near-goal", type=float, metavar="M", help="`calibration`: random states so near the goal's disc instead [m]"
    )
    random.add_argument("--workers", type=int, default=1, help="processes; more than one plan on a single thread (1)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    known = PARTS.get(options.what, (None,))
    options.part = options.part or known[0]
    if options.part not in known:
        parser.error(
            f"`{options.what}` has no part {options.part!r}; it has {', '.join(filter(None, known)) or 'none'}"
        )
    if options.png is not None:
        check_writable(options.png, "--png")
    try:
        header, rows, values = importlib.import_module(f"benchmarks.{options.what.replace('-', '_')}").rows(options)
    except PirrhtError as error:
        parser.error(str(error))
    print(table(header, rows))
    if options.json:
        write_json(options.json, values)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
