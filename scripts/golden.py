"""Hash the results of the default settings, to compare a rearranged source with the one before it.

    python scripts/golden.py make before.json                        # in one checkout
    python scripts/golden.py compare before.json                     # in another: exit 1 where a hash differs
    python scripts/golden.py compare before.json --only "run|rover"  # of the cases that a pattern matches

The package of the folder in which it starts is used. Everything goes through the command line, so that any two versions
can be compared: arrays of trees, the JSON of `plan`, `estimate` and `run` without measured times, and all rows of a
recording. Six robots, static and moving obstacles, known motion and prediction at constant velocity. Next to each hash
stands the wall time of its command. The hashes belong to one machine and one set of libraries; they are no test.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

# A mesh, an ellipsoid, a lying capsule and more discs than are asked one by one for their cuts.
FOREST = """<mujoco><option timestep="0.002"/>
<asset><mesh name="wedge" vertex="0 0 0 .5 0 0 0 .4 0 0 0 .4 .5 0 .4 0 .4 .4"/></asset>
<worldbody><geom name="floor" type="plane" size="4 3 .1" pos="4 3 0" contype="0" conaffinity="0"/>
<site name="start" pos=".6 .7 0"/><site name="goal" type="cylinder" size=".3 .01" pos="7.2 5.2 0"/>
<geom name="mesh" type="mesh" mesh="wedge" pos="5.5 1.5 .2"/>
<geom name="egg" type="ellipsoid" size=".3 .2 .3" pos="2.2 4.6 .2" euler="0 0 30"/>
<geom name="log" type="capsule" size=".1 .3" pos="6.1 3.6 .1" euler="90 0 20"/>{discs}</worldbody></mujoco>"""
PLACES = "2.1 1.3  3.4 2.4  1.5 2.7  4.6 3.6  3.2 4.0  5.4 4.7  2.8 5.2  4.3 1.2  6.6 2.4  1.2 4.6"
TIMES = {"seconds", "step_ms", "deadline_misses", "plan_seconds"}  # of a clock, not of the method
SHORT = "--max-time 1.5"

PLANS = {
    "slit puck": "slit",
    "clutter unicycle": "clutter --vertices 1000",
    "clutter diffdrive": "clutter --robot diffdrive --vertices 600 --seed 3",
    "forest puck": "{forest} --radius .2 --seed 1 --limit .8",
    "forest unicycle": "{forest} --robot unicycle --radius .2 --rho .4 --vertices 800",
    "slit all classes": "slit --classes 0 --limit 1.2 --vertices 400",
    "slit hover": "slit --robot hover --vertices 400",
    "slit rover": "slit --robot rover --vertices 400",
    "slit car": "slit --robot car --vertices 400",
    "crossing puck": "crossing --vertices 400",
    "crossing velocity": "crossing --vertices 400 --predict velocity",
    "closing_door hover": "closing_door --robot hover --vertices 400",
    "closing_door unicycle": "closing_door --robot unicycle --vertices 400",
}
ESTIMATES = {
    "slit hover": "slit --robot hover --at 1 2.5 .3 0 --noise .2 --repeat 2 --vertices 400",
    "slit rover": "slit --robot rover --at 1 2.5 0 --noise .2 --repeat 2 --vertices 400",
    "slit car": "slit --robot car --at 1 2.5 0 .5 --noise .2 --repeat 2 --vertices 400",
    "slit diffdrive": "slit --robot diffdrive --at 1 2.5 0 --noise .2 --repeat 2 --vertices 400",
    "crossing puck": "crossing --at 1 3 --noise .2 --repeat 2 --vertices 400",
    "closing_door": "closing_door --at 1 2.5 --repeat 2 --vertices 400",
    "closing_door truth": "closing_door --at 1 2.5 --noise .2 --truth --vertices 400",
    "closing_door unicycle": "closing_door --robot unicycle --at 1 2.5 0 --repeat 2 --vertices 400",
    "crossing rover": "crossing --robot rover --at 1 3 0 --repeat 2 --vertices 400",
    "slit .1": "slit --at 1 2.5 --repeat 3",
    "slit .3": "slit --at 2 2.6 --noise .3 --repeat 3",
    "slit paper": "slit --at 1 2.5 --noise .3 --preset paper --repeat 3",
    "slit endpoint": "slit --at 1 2.5 --noise .2 --exit endpoint --repeat 2",
    "slit uniform": "slit --at 2.3 2.63 --noise .3 --steps uniform --repeat 2",
    "slit open loop": "slit --at 1 2.5 --noise .2 --guide open-loop --repeat 2",
    "slit target": "slit --at 1.5 2.4 --noise .2 --target-error .05 --repeat 2",
    "slit truth": "slit --at 1 2.5 --noise .3 --truth",
    "clutter": "clutter --at 1 1 .5 --repeat 2 --vertices 800",
    "clutter endpoint": "clutter --at 1 1 .5 --repeat 2 --vertices 800 --exit endpoint",
    "clutter open loop": "clutter --at 1 1 .5 --noise .3 --guide open-loop --vertices 500",
    "forest puck": "{forest} --radius .2 --limit .8 --at 1 1 --noise .2 --repeat 2",
    "forest unicycle": "{forest} --robot unicycle --radius .2 --rho .4 --vertices 800 --at 1 1 1 --repeat 2",
}
RUNS = {
    "slit hover": f"slit --robot hover --noise .2 {SHORT}",
    "slit rover": f"slit --robot rover --noise .2 {SHORT}",
    "slit car": f"slit --robot car --noise .2 {SHORT}",
    "crossing puck": f"crossing --noise .1 {SHORT}",
    "crossing velocity": f"crossing --noise .1 --predict velocity {SHORT}",
    "crossing hover": f"crossing --robot hover --predict velocity --period .1 {SHORT}",
    "crossing unicycle": f"crossing --robot unicycle --predict velocity --period .1 {SHORT}",
    "closing_door": f"closing_door {SHORT}",
    "closing_door velocity": f"closing_door --predict velocity {SHORT}",
    "closing_door rover": f"closing_door --robot rover --period .1 {SHORT}",
    "closing_door car": f"closing_door --robot car --predict velocity --period .1 {SHORT}",
    "slit": f"slit {SHORT}",
    "slit .3": f"slit --noise .3 {SHORT}",
    "slit hold": f"slit --noise .2 --between hold {SHORT}",
    "slit paper": f"slit --noise .3 --preset paper {SHORT}",
    "slit endpoint": f"slit --noise .2 --exit endpoint {SHORT}",
    "slit sde": f"slit --noise .3 --plant sde {SHORT}",
    "slit best-class": f"slit --noise .3 --method best-class {SHORT}",
    "slit single": f"slit --noise .2 --method single {SHORT}",
    "slit passive": f"slit --noise .4 --method passive --period .1 {SHORT}",
    "slit mppi": f"slit --noise .2 --method mppi --period .05 {SHORT}",
    "slit optimal": f"slit --noise .3 --method optimal {SHORT}",
    "slit grow": f"slit --noise .2 --grow 20 --period .05 {SHORT}",
    "clutter": f"clutter --vertices 800 {SHORT}",
    "clutter diffdrive": f"clutter --robot diffdrive --vertices 800 {SHORT}",
    "clutter mppi": f"clutter --method mppi {SHORT}",
    "forest puck": "{forest} --radius .2 --limit .8 --noise .2 " + SHORT,
    "forest unicycle": "{forest} --robot unicycle --radius .2 --rho .4 --vertices 800 " + SHORT,
}
RECORDED = {"slit .3": f"slit --noise .3 {SHORT}", "clutter": f"clutter --vertices 600 {SHORT}"}


def main() -> int:
    """Make hashes, or compare with those of a file."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("what", choices=("make", "compare"))
    parser.add_argument("file", type=Path)
    parser.add_argument("--only", default="", metavar="PATTERN", help="cases whose name this expression matches")
    options = parser.parse_args()
    now = fingerprints(options.only)
    if options.what == "make":
        options.file.write_text(json.dumps(now, indent=1) + "\n")
        return 0
    before = {
        name: then for name, then in json.loads(options.file.read_text()).items() if re.search(options.only, name)
    }
    names = sorted({*before, *now})
    differ = [name for name in names if before.get(name, [None])[0] != now.get(name, [None])[0]]
    for name in differ:
        print(f"differs: {name}  {before.get(name)} -> {now.get(name)}")
    print(f"{len(names) - len(differ)} of {len(names)} equal")
    print(f"{sum(then[1] for then in before.values()):.0f} s before, {sum(one[1] for one in now.values()):.0f} s now")
    return 1 if differ else 0


def fingerprints(only: str = "") -> dict[str, tuple[str, float]]:
    """Return hash and wall time [s] by name of each case; two commands run at a time."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        discs = [
            f'<geom name="disc{i}" type="cylinder" size="{0.18 + 0.02 * (i % 4):g} .3" pos="{at} .3"/>'
            for i, at in enumerate(PLACES.split("  "))
        ]
        (place / "forest.xml").write_text(FOREST.format(discs="".join(discs)))
        jobs: dict[str, Callable[[], tuple[str, float]]] = {}
        tables = (
            ("plan", PLANS, _plan),
            ("estimate", ESTIMATES, _json),
            ("run", RUNS, _json),
            ("record", RECORDED, _rows),
        )
        for number, (kind, table, work) in enumerate(tables):
            for k, (name, words) in enumerate(table.items()):
                if not re.search(only, f"{kind} {name}"):
                    continue
                there = place / f"{number}-{k}"
                there.mkdir()
                line = words.format(forest=place / "forest.xml")
                command = "run" if kind == "record" else kind
                jobs[f"{kind} {name}"] = partial(_timed, work, f"{command} {line}", there)
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            return dict(zip(jobs, pool.map(lambda job: job(), jobs.values()), strict=True))


def _timed(work: Callable[[str, Path], str], line: str, there: Path) -> tuple[str, float]:
    began = time.perf_counter()
    return work(line, there), round(time.perf_counter() - began, 1)


def _cli(line: str, *more: str) -> None:
    command = [sys.executable, "-m", "sim.cli", *line.split(), *more]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1) or done.stderr.startswith("Traceback") or "No module named" in done.stderr:
        raise SystemExit(f"pirrht {line}: {done.stderr}")


def _json(line: str, there: Path) -> str:
    _cli(line, "--json", str(there / "result.json"))
    return _digest(_timeless(json.loads((there / "result.json").read_text())))


def _plan(line: str, there: Path) -> str:
    _cli(line, "--json", str(there / "result.json"), "-o", str(there / "tree.npz"))
    with np.load(there / "tree.npz") as tree:
        arrays = {name: _bytes(tree[name]) for name in sorted(tree.files) if name not in ("about", "digest")}
    return _digest([_timeless(json.loads((there / "result.json").read_text())), arrays])


def _rows(line: str, there: Path) -> str:
    """All rows of a recording, however they were batched, but for measured times."""
    from rerun.chunk import RrdReader

    record = there / "run.rrd"
    _cli(line, "--record", str(record))
    rows = []
    for chunk in RrdReader(str(record)).stream():
        if chunk.entity_path.startswith(("/timing", "/__properties", "/log")):
            continue
        batch = chunk.to_record_batch()
        kept = [name for name in batch.schema.names if "RowId" not in name and not name.startswith("log_")]
        for row in batch.select(kept).to_pylist():
            rows.append(_digest([chunk.entity_path, {name: str(value) for name, value in row.items()}]))
    return _digest(sorted(rows))


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _timeless(one) for name, one in value.items() if name not in TIMES and name != "scene"}
    return [_timeless(one) for one in value] if isinstance(value, list) else value


def _bytes(array: Any) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


if __name__ == "__main__":
    sys.exit(main())
