"""First runs, from an empty cache of kernels: wall and processor time, in turn with another checkout's.

Each repeat runs `slit`, then the robots of --robot with the kernels that are there by then; --scene (crossing) begins
anew. Both checkouts run in this environment.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.errors import OptionError

HERE = Path(__file__).resolve().parent.parent.parent
HEADER = ["first run", "checkout", "wall [s]", "least", "processor [s]"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON: the median wall time, the least one, and the median processor time of each run."""
    checkouts = {"this": HERE} | ({} if options.against is None else {"other": options.against.resolve()})
    robots = [["slit", "--robot", robot] for robot in (options.robot or "rover").split(",")]
    spent: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for _ in range(options.repeats):
        for runs in ([["slit"], *robots], [[options.scene or "crossing"]]):
            for name, checkout in checkouts.items():
                with tempfile.TemporaryDirectory() as cache:
                    for words in runs:
                        spent.setdefault((" ".join(words), name), []).append(first_run(checkout, cache, words))
    table, values = [], list[dict[str, Any]]()
    for (run, name), times in spent.items():
        wall, processor = np.array(times).T
        median, least, worked = float(np.median(wall)), float(wall.min()), float(np.median(processor))
        table.append([run, name, f"{median:.1f}", f"{least:.1f}", f"{worked:.1f}"])
        values.append({"run": run, "checkout": name, "wall": wall.tolist(), "processor": processor.tolist()})
    return HEADER, table, values


def first_run(checkout: Path, cache: str, words: list[str]) -> tuple[float, float]:
    """Wall and processor time [s] of `pirrht run` with the sources of a checkout, helpers included."""
    known = os.environ | {"PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": cache}
    command = [sys.executable, "-P", "-m", "sim.cli", "run", *words]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, env=known, cwd=cache, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 1):  # 1: the robot did not arrive
        raise OptionError(f"{checkout}: pirrht run {' '.join(words)} failed: {done.stderr.strip()[-300:]}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
