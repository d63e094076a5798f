"""Worlds and scores of BARN (Perille et al. 2020), by the rules of the challenge of 2026, in MuJoCo.

A course is walled in by cylinders; a Jackal starts at its closed end, and its goal is the disc of 1 m around a point
beyond the open one. The clock starts once the robot has moved 0.1 m; a collision, or 100 s, scores 0. Places are those
of the challenge, moved by `ACROSS`, so that the corner of the workspace is the origin. Grown worlds are by our own
generator after the description of BARN: a field of cells that are full at random, smoothed by their neighbours.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from pirrht.arrays import Array, BoolArray
from pirrht.control.cost_to_go import sweep
from pirrht.errors import OptionError

SIZE = (4.5, 14.5)  # of the workspace [m]
START = (2.25, 3.0, 0.5 * np.pi)
GOAL = (2.25, 13.0, 1.0)
ACROSS = 4.5  # by which x is more than that of the challenge [m]
RADIUS = 0.075  # of the cylinders [m]
FASTEST = 2.0  # speed of the best time [m/s]
MOVED = 0.1  # way until the clock of a run starts [m]
KNOWN = {"max_time": 100.0, "speed": 1.0, "margin": 0.05}  # a mean speed of 1 m/s scores most
SENSED = {**KNOWN, "speed": 1.4, "margin": 0.03}
CELL = 2.0 * RADIUS
CELLS = (97, 30)  # rows and columns
EMPTY, FIELD = 34, 30  # rows before and in the field of a grown world
FULL = (0.1, 0.28)  # least and greatest share of its cells that are full before they are smoothed
CLEAR = 0.36  # that some way through a grown world leaves around the robot's centre [m]
NARROW = 0.25  # that the shortest way of any world does [m]


def score(outcome: str, time: float, best: float) -> float:
    """Return the score of a run that took a time, where the best one is known [s]; at most 0.5."""
    return best / float(np.clip(time, 2.0 * best, 8.0 * best)) if outcome == "goal" else 0.0


def waited(states: Array, step: float, start: Sequence[float] | Array = START) -> float:
    """Return how long states (k, n), a step apart, take to have moved from a start [s]."""
    away = np.hypot(*(states[:, :2] - np.array(start[:2])).T) > MOVED
    return step * float(np.argmax(away) if away.any() else len(away))


def length(posts: Array, clear: float = NARROW) -> float:
    """Return the length of the shortest way among cylinders (k, 2) that leaves so much around it [m]; inf: none."""
    column, row = np.floor(np.add(posts, (ACROSS, 0.0)).T / CELL).astype(int)
    full = np.zeros(CELLS, bool)
    inside = (column >= 0) & (column < CELLS[1]) & (row >= 0) & (row < CELLS[0])
    full[row[inside], column[inside]] = True
    ways = np.full(CELLS, np.inf)
    ways[int(GOAL[1] / CELL), int(GOAL[0] / CELL)] = 0.0
    away = CELL * ndimage.distance_transform_edt(~full) - RADIUS
    ways = np.pad(ways, 1, constant_values=np.inf)
    sweep(ways, np.pad((away > clear) & (ways[1:-1, 1:-1] > 0.0), 1), CELL)
    return float(ways[1 + int(START[1] / CELL), 1 + int(START[0] / CELL)])


def smoothed(field: BoolArray, least: int) -> BoolArray:
    """Return which cells of a field are full: those that were, of so many full neighbours, and any of five."""
    around = ndimage.convolve(field.astype(int), np.ones((3, 3), int), mode="constant") - field
    return np.asarray((field & (around >= least)) | (around >= 5))


def grown(seed: int) -> Array:
    """Return the centres (k, 2) of the cylinders of a world that a seed grows, some way of which is wide enough [m]."""
    rng = np.random.default_rng(seed)
    full = np.zeros((EMPTY + FIELD, CELLS[1]), bool)
    full[:, [0, -1]] = True
    full[0] = True
    while True:
        field = rng.random((FIELD, CELLS[1] - 2)) < rng.uniform(*FULL)
        full[EMPTY:, 1:-1] = smoothed(field, 2)
        posts = np.subtract(CELL * (np.argwhere(full)[:, ::-1] + 0.5), (ACROSS, 0.0))
        if np.isfinite(length(posts, CLEAR)):
            return np.asarray(posts)


def read(file: str | Path) -> Any:
    """Read a JSON file of worlds, centres x, y of cylinders by name, or of their lengths; OptionError: it is none."""
    try:
        return dict(json.loads(Path(file).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise OptionError(f"{file}: no worlds of BARN or their lengths ({error}); write JSON by name") from None


def text(
    name: str, posts: Array, *, size: Sequence[float] = SIZE, goal: Sequence[float] = GOAL, **numbers: float
) -> str:  # fmt: skip
    """Write a world of cylinders with centres (k, 2) [m] as MJCF, with numbers of the scene's options."""
    width, depth = size
    options = "\n".join(f'    <numeric name="pirrht_{key}" data="{value:g}"/>' for key, value in numbers.items())
    geoms = "\n".join(
        f'    <geom name="post {i}" type="cylinder" size="{RADIUS} 0.25" pos="{x + ACROSS:.6g} {y:.6g} 0.25"/>'
        for i, (x, y) in enumerate(posts.tolist())
    )
    return f"""<mujoco model="{name}">
  <option timestep="0.002"/>
  <custom>
    <text name="pirrht_robot" data="jackal"/>
{options}
  </custom>
  <worldbody>
    <geom name="floor" type="plane" pos="{width / 2:g} {depth / 2:g} 0" size="{width / 2:g} {depth / 2:g} 0.1"/>
{geoms}
    <site name="workspace" type="box" pos="{width / 2:g} {depth / 2:g} 0.5" size="{width / 2:g} {depth / 2:g} 0.5"/>
    <site name="start" pos="{START[0]} {START[1]} 0" euler="0 0 90"/>
    <site name="goal" type="cylinder" pos="{goal[0]} {goal[1]} 0" size="{goal[2]} 0.01"/>
  </worldbody>
</mujoco>
"""
