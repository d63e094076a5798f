"""Wall times of several functions that take turns, so that a busy moment of the machine falls on all of them."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from sim.scenario import Scenario

STAT = Path("/proc/stat")  # what Linux knows of its processors' time
STOLEN = 7  # column of it, after its name, of what went to other machines on the same hardware


def interleaved(work: Mapping[str, Callable[[int], object]], repeats: int, *, warm: bool = False) -> dict[str, float]:
    """Median seconds of each function, called in turn with the number of the repeat; a first call is not counted.

    With `warm`, neither is one before each turn: what the others have left in caches and threads is no one's cost.
    """
    spent: dict[str, list[float]] = {name: [] for name in work}
    for repeat in range(-1, repeats):
        for name, function in work.items():
            if warm:
                function(repeat + 1)
            began = time.perf_counter()
            function(repeat + 1)
            spent[name].append(time.perf_counter() - began)
    return {name: float(np.median(times[1:])) for name, times in spent.items()}


def planning(scenario: Scenario, repeats: int) -> float:
    """Median processor time to grow a tree [s], each of another seed."""
    spent = []
    for seed in range(repeats):
        began = time.process_time()
        scenario.with_settings(seed=seed).grown_tree()
        spent.append(time.process_time() - began)
    return float(np.median(spent))


def ticks() -> tuple[int, int]:
    """Processor time that other machines took, and all of it, since this one began; zeros where nobody tells."""
    try:
        spent = [int(number) for number in STAT.read_text(encoding="ascii").split("\n", 1)[0].split()[1:]]
        return spent[STOLEN], sum(spent[: STOLEN + 1])
    except (OSError, IndexError, ValueError):
        return 0, 0


def row(
    figure: str,
    seconds: float,
    over: float | None = None,
    *,
    rate: str = "-",
    effective: str = "-",
    note: str = "",
) -> list[str]:
    """One row of the table of speeds; `over` is how many times our own figure it takes."""
    value, unit = (seconds, "s") if seconds >= 1.0 else (1e3 * seconds, "ms")
    return [figure, f"{value:.3g}", unit, "-" if over is None else f"{over:.3g}", rate, effective, note]
