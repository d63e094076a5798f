"""Maps that grow: the time of an update, and whether classes keep their identity, in random rooms driven with lidar.

A room of a side has posts and walls in random places, wide enough apart for a Jackal, which drives through it without
a map. The favourite class of a plan changes for a reason if the way of the last favourite is shut in the map of now, or
if there is a cheaper one. It is renamed without a reason if the way stays and the name does not; it wavers if the way
changes and the map does not say why. With --known the same rooms are driven with the map given.
"""

import argparse
from typing import Any, NamedTuple

import numpy as np
from benchmarks.moving_text import prepared
from benchmarks.pool import spread
from worlds.page import Page, box, drum

from pirrht.arrays import Array
from pirrht.errors import NoReference, SceneError
from sim.scenario import Scenario

SIDES, ROOM, ROOMS = (5.0, 10.0, 20.0, 40.0), 10.0, 30  # of rooms whose updates are timed, and of those driven [m]
GAP = 0.9  # between what stands [m]
PER_AREA = 0.25  # things that stand per square metre
SAME = 0.4  # a way is the same if it stays within so much of the last one [m]
HIGHER = 1.02  # times the least cost, from which on a cost is higher
SETTINGS = {"speed": 1.4, "margin": 0.03, "max_time": 60.0, "vertices": 400}
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
    return None if found is None else np.vstack(found.trajectory.path.points(0.1))[:, :2]


def apart(one: Array, other: Array) -> float:
    """Return how far points of a way are from another one at most [m]."""
    return float(np.hypot(*np.moveaxis(one[:, None] - other, -1, 0)).min(axis=1).max())


def named(plan: Any, count: int) -> tuple[int, ...]:
    """Return the turns of a plan's favourite about so many obstacles."""
    turns = [int(turn) for turn in (plan.favourite or "").split(",") if turn.lstrip("-").isdigit()]
    return (*turns, *(0 for _ in range(count - len(turns))))


def judged(last: Any, now: Any) -> str:
    """Judge a change of the favourite from one frame to the next: "" for none, "switch", "renamed", "wavers"."""
    before, after = way(last), way(now)
    if before is None or after is None or "other" in (last.plan.favourite, now.plan.favourite):
        return ""
    count = max(len(named(last.plan, 0)), len(named(now.plan, 0)))
    if named(last.plan, count) == named(now.plan, count):
        return ""
    if apart(after, before) <= SAME:
        return "renamed"
    costs = {id: one.cost for id, one in zip(now.plan.ids, now.plan.references, strict=True)}
    old = costs.get(last.plan.favourite, np.inf)
    ahead = before[np.hypot(*(before - now.plan.state[:2]).T).argmin() :]
    shut = len(ahead) > 1 and not now.plan.space.segments_free(ahead)
    return "switch" if shut or old > HIGHER * min(costs.values()) else "wavers"


def figures(run: Run) -> dict[str, Any]:
    """Drive once."""
    try:
        scenario = run.scenario()
        driver = scenario.driver(scenario.grown_tree())
        updates = list[float]()
        changes = list[str]()
        last = None
        for frame in scenario.drive(scenario.plant(), driver):
            updates.append(0.0 if run.known else 1e3 * driver.believed.seconds)
            changes.append("" if last is None else judged(last, frame))
            last = frame
    except (NoReference, SceneError) as error:
        return {**run._asdict(), "outcome": f"no path: {error}"}
    assert last is not None
    m = last.metrics
    counts = {kind: changes.count(kind) for kind in ("switch", "renamed", "wavers")}
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
        *(str(sum(one[kind] for one in done)) for kind in ("switch", "renamed", "wavers")),
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
