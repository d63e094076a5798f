"""Maps that grow: the time of an update, and whether classes keep their identity, in random rooms driven with lidar.

A room of a side has posts and walls in random places, wide enough apart for a Jackal, which drives through it without
a map. The map explains a change of a plan's favourite class if the same plan without the last scan keeps the favourite:
a switch. If it does not, the favourite wavers. It is renamed if its way stays and the name does not. With --known the
same rooms are driven with the map given, where every change wavers.
"""

import argparse
from collections.abc import Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from benchmarks.moving_text import prepared
from benchmarks.pool import spread
from worlds.page import Page, box, drum

from pirrht.arrays import Array
from pirrht.errors import NoReference, SceneError
from pirrht.geometry.polyline import even, lengths
from sim.scenario import Scenario

SIDES, ROOM, ROOMS = (5.0, 10.0, 20.0, 40.0), 10.0, 30  # of rooms whose updates are timed, and of those driven [m]
GAP = 0.9  # between what stands [m]
PER_AREA = 0.25  # things that stand per square metre
SAME = 0.4  # a way is the same if it stays within so much of the last one [m]
SPACING = 0.1  # of points on a way [m]
SETTINGS = {"speed": 1.4, "margin": 0.03, "max_time": 60.0, "vertices": 400}
KINDS = ("switch", "renamed", "wavers")  # of changes of the favourite, in rooms of the usual size
HEADER = [
    *("room", "runs", "goal", "time [s]", "obstacles", "switches", "renamed", "wavers"),
    *("map [ms]", "99 %", "plan [ms]"),
]


def room(side: float, seed: int) -> Page:
    """Grow a room with posts and walls."""
    rng = np.random.default_rng([seed, round(side)])
    start, goal = (0.7, 0.5 * side), (side - 0.8, 0.5 * side, 0.5)
    placed: list[tuple[float, float, float]] = []
    elements = []
    for i in range(round(PER_AREA * side * side)):
        half = rng.uniform(0.1, 0.3 if i % 2 else 0.9)  # a post's radius, or half the length of a wall
        x, y = rng.uniform(half, side - half, 2).tolist()
        far = all(np.hypot(x - a, y - b) > half + c + GAP for a, b, c in (*placed, (*start, 0.3), goal))
        if not far:
            continue
        placed.append((x, y, half))
        across = (half, 0.08) if rng.random() < 0.5 else (0.08, half)
        elements.append(drum(f"post {i}", x, y, half) if i % 2 else wall(f"wall {i}", x, y, across))
    return Page(
        name=f"room {seed}", about="A random room.", why="Grown from a seed.", size=(side, side), start=start,
        goal=goal, elements=elements, settings=SETTINGS,
    )  # fmt: skip


def wall(name: str, x: float, y: float, half: tuple[float, float]) -> str:
    """A wall with half its length and thickness [m]."""
    return box(name, (x - half[0], x + half[0]), (y - half[1], y + half[1]))


class Run(NamedTuple):
    """A run to make."""

    side: float
    seed: int
    known: bool

    def scenario(self) -> Scenario:
        """Prepare it."""
        given = {} if self.known else {"sense": "lidar"}
        x, y = 0.7, 0.5 * self.side
        text = room(self.side, self.seed).text()
        return prepared("scene", text, robot="jackal", seed=self.seed, start=(x, y, 0.0), **given)


def way(frame: Any) -> Array | None:
    """Return the favourite's way in a plan, (k, 2) [m]; None: it has none."""
    found = dict(zip(frame.plan.ids, frame.plan.references, strict=True)).get(frame.plan.favourite)
    if found is None:
        return None
    corners = found.trajectory.points[:, :2]
    return even(corners, 2 + int(lengths(corners)[-1] / SPACING))


def apart(one: Array, other: Array) -> float:
    """Return how far points of a way are from another one at most [m]."""
    return float(np.hypot(*np.moveaxis(one[:, None] - other, -1, 0)).min(axis=1).max())


def named(plan: Any, count: int) -> tuple[int, ...]:
    """Return the turns of a plan's favourite about so many obstacles."""
    turns = [int(turn) for turn in (plan.favourite or "").split(",") if turn.lstrip("-").isdigit()]
    return (*turns, *(0 for _ in range(count - len(turns))))


def changed(last: Any, now: Any) -> str:
    """Judge the favourites of two frames: "" if it is the same, "renamed" if only its name is not, else "changed"."""
    before, after = way(last), way(now)
    if before is None or after is None or "other" in (last.plan.favourite, now.plan.favourite):
        return ""
    count = max(len(named(last.plan, 0)), len(named(now.plan, 0)))
    if named(last.plan, count) == named(now.plan, count):
        return ""
    return "renamed" if apart(after, before) <= SAME else "changed"


def driven(run: Run, blind: int | None = None) -> Iterator[tuple[Any, Any]]:
    """Drive; yield the driver and each frame. The plan of number `blind` goes without the scans before it."""
    scenario = run.scenario()
    driver = scenario.driver(scenario.grown_tree())
    for number, frame in enumerate(scenario.drive(scenario.plant(), driver), start=1):
        yield driver, frame
        if blind is not None:
            driver.see = (lambda scan: None) if number == blind else type(driver).see.__get__(driver)


def explained(run: Run, number: int, last: Any) -> str:
    """Judge a change after a last frame by the plan of the same number without its scans: "switch" or "wavers"."""
    if run.known:
        return "wavers"
    _, frame = next(islice(driven(run, number), number, None))
    return "wavers" if changed(last, frame) else "switch"


def figures(run: Run) -> dict[str, Any]:
    """Drive once."""
    try:
        updates = list[float]()
        changes = list[str]()
        last = None
        for number, (driver, frame) in enumerate(driven(run)):
            updates.append(0.0 if run.known else 1e3 * driver.believed.seconds)
            kind = "" if last is None or run.side != ROOM else changed(last, frame)
            changes.append(explained(run, number, last) if kind == "changed" else kind)
            last = frame
    except (NoReference, SceneError) as error:
        return {**run._asdict(), "outcome": f"no path: {error}"}
    assert last is not None
    m = last.metrics
    counts = {kind: changes.count(kind) for kind in KINDS}
    return {
        **run._asdict(), "outcome": m.outcome, "time": m.time, "obstacles": len(last.plan.space.scene.obstacles),
        "map_ms": updates, "plan_ms": [1e3 * s for s in m.plan_seconds], **counts,
    }  # fmt: skip


def row(name: str, found: list[dict[str, Any]]) -> list[str]:
    """A row of the table."""
    done = [one for one in found if "time" in one]
    arrived = [one["time"] for one in done if one["outcome"] == "goal"]
    maps = [ms for one in done for ms in one["map_ms"][1:] if ms > 0.0] or [np.nan]
    plans = [ms for one in done for ms in one["plan_ms"][1:]] or [np.nan]
    return [
        name, str(len(found)), str(len(arrived)), f"{np.mean(arrived or [np.nan]):.1f}",
        f"{np.mean([one['obstacles'] for one in done] or [np.nan]):.0f}",
        *(str(sum(one[kind] for one in done)) if found[0]["side"] == ROOM else "-" for kind in KINDS),
        f"{np.median(maps):.0f}", f"{np.percentile(maps, 99):.0f}", f"{np.median(plans):.0f}",
    ]  # fmt: skip


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    rooms = range(options.first_seed, options.first_seed + (options.scenes or ROOMS))
    jobs = [Run(ROOM, seed, options.known) for seed in rooms]
    jobs += [Run(side, options.first_seed, options.known) for side in SIDES if side != ROOM]
    found = list(spread(figures, jobs, options.workers, "runs"))
    table = [row(f"{side:g} m", some) for side in SIDES if (some := [one for one in found if one["side"] == side])]
    return HEADER, table, found
