"""Worlds of the DynaBARN benchmark (Nair et al., SSRR 2022) as scenes: upright cylinders that move by keyframes.

A file holds worlds by number: {"0": {"obstacles": [{"name", "radius", "keys": [[t, x, y], ...]}, ...]}, ...}, lengths
in metres and times in seconds. The arena is the benchmark's: walls at x = -10 and y = -10, 10 and none at x = 10; the
robot starts outside at (11, 0), heads to -x, and its goal is the disc of 1 m around (-9, 0). A motion starts over
after its last key, where Gazebo's cylinders jump back to their first.

Between keys Gazebo's PoseAnimation takes the share of the time as the parameter of a cubic whose tangents are those of
Ogre's SimpleSpline: half the difference of the neighbours' places, at either end half that of the only neighbour, and
where the last place is the first one half that of its neighbours around the joint. This is a Catmull-Rom spline that
is uniform in the number of the key: unequal times between keys change the speed at a key at once, and not the curve.
"""

import json
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.solids import Solid, World, distinct, text, transform
from sim.mjcf.library import FARTHEST, FINEST, content_of, listed, refused

SUFFIXES = (".json",)
FORM = '{"0": {"obstacles": [{"name": "a", "radius": 0.5, "keys": [[0, x, y], [t, x, y]]}]}}'

START = (11.0, 0.0, np.pi)
GOAL = (-9.0, 0.0, 1.0)
ARENA = (-10.0, 12.0, -10.0, 10.0)

HALF_HEIGHT = 0.5  # of cylinders and walls [m]
OPTIONS = {  # the benchmark's robot drives at most 2 m/s; its circumscribed radius is 0.33 m
    **{"robot": "puck", "radius": "0.33", "noise": "0.05", "speed": "2", "margin": "0.1", "period": "0.1", "dt": "0.1"},
    **{"samples": "300", "limit": "0.8", "vertices": "2000", "classes": "8", "max_time": "100"},
}
WALLS = {"west": (-10, 0, (0.25, 10.25)), "south": (0, -10, (10, 0.25)), "north": (0, 10, (10, 0.25))}  # and half sizes
DEVIATION = 0.005  # of straight lines between rows from the spline, at the same time, at most [m]
FINE = 256  # moments evaluated between two keys
SPARE = 2e-4  # of the deviation is kept for what happens between those moments and for rounding [m]


def read(source: Path, number: str | None = None) -> World:
    """Read the cylinders of one world of a file, of its only one if none is named, and the arena."""
    must = f"give a file like {FORM}; if it is a world or a map, leave out --motion"
    with refused(f"{source}: this is no JSON (", f"); {must}", ValueError, RecursionError):  # or no UTF-8
        worlds = json.loads(content_of(source, "the JSON file of a set of motions"))
    if not isinstance(worlds, dict) or not worlds:
        raise SceneError(f"{source}: it holds no worlds by number; write {FORM}")
    number = next(iter(worlds)) if number is None and len(worlds) == 1 else number
    if number is None or number not in worlds:
        why = "holds several worlds" if number is None else f"has no world {number}"
        raise SceneError(f"{source}: it {why}; give --world with one of {listed([*worlds], 20)}")
    where = f"{source}: world {number}"
    world = worlds[number]
    obstacles = world.get("obstacles") if isinstance(world, dict) else None
    if not isinstance(obstacles, list) or not obstacles:
        raise SceneError(f'{where} has no list "obstacles" with something in it; write {FORM}')
    found = [_cylinder(f"{where}, obstacle {i}", one) for i, one in enumerate(obstacles, start=1)]
    names = distinct((name for name, _, _ in found), {"floor", "world", *(f"{side} wall" for side in WALLS)})
    motions = []
    bodies = []

    for name, (_, radius, keys) in zip(names, found, strict=True):
        path = rows(keys)
        label = quoteattr(name)
        motion = quoteattr(f"pirrht_motion_{name}")

        numbers = "  ".join(text(*row, 0) for row in path)
        motions.append(f'<numeric name={motion} data="{numbers}"/>\n    <text name={motion} data="repeat"/>')
        bodies.append(
            f'<body name={label} mocap="true" pos="{text(*path[0, 1:], HALF_HEIGHT)}">\n      <geom name={label} '
            f'type="cylinder" size="{text(radius, HALF_HEIGHT)}" material="drum"/>\n    </body>'
        )
    walls = tuple(
        Solid(f"{side} wall", "box", np.array([*half, HALF_HEIGHT]), transform(np.array([*at, HALF_HEIGHT, 0, 0, 0])))
        for side, (*at, half) in WALLS.items()
    )
    return World(
        solids=walls, ground=np.array(ARENA), options=OPTIONS, start=START, goal=GOAL, custom=tuple(motions),
        bodies=tuple(bodies),
    )  # fmt: skip


def _cylinder(where: str, obstacle: Any) -> tuple[str, float, Array]:
    """Read name, radius [m] and keys (k, 3) t [s], x, y [m]."""
    if not isinstance(obstacle, dict):
        raise SceneError(f"{where} is no object; write {FORM}")
    name = " ".join(str(obstacle.get("name", "")).split())
    radius = _number(obstacle.get("radius"))
    where = f'{where} ("{name[:40]}")'
    keys = obstacle.get("keys")

    if not name or not radius >= FINEST or not isinstance(keys, list) or len(keys) < 2:
        must = f'a "name", a "radius" of {FINEST:g} to {FARTHEST:g} m and two or more "keys"; write {FORM}'
        raise SceneError(f"{where} needs {must}")
    last = -1.0
    for k, key in enumerate(keys, start=1):
        numbers = [_number(value) for value in key] if isinstance(key, list) else []
        if len(numbers) != 3 or np.isnan(numbers).any() or numbers[0] <= last or (k == 1 and numbers[0] != 0.0):
            must = f"three finite numbers up to {FARTHEST:g}, [t, x, y], whose times begin at 0 and increase"
            raise SceneError(f"{where}: key {k} must be {must}")
        last = numbers[0]
    return name, radius, np.array(keys, dtype=float)


def _number(value: Any) -> float:
    """Read a number of JSON; NaN for anything else, or beyond `FARTHEST`."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FARTHEST
    return float(value) if number else float("nan")


def place(keys: Array, times: Array) -> Array:
    """Places (..., 2) [m] at times (...) [s] on the spline through keys (k, 3) t [s], x, y [m]."""
    points = keys[:, 1:]
    number = np.arange(len(keys))
    padded = np.vstack([points[:1], points, points[-1:]])
    if np.array_equal(points[0], points[-1]):
        padded[0] = points[-2]
        padded[-1] = points[1]
    spline = CubicHermiteSpline(number, points, 0.5 * (padded[2:] - padded[:-2]))
    return np.asarray(spline(np.interp(times, keys[:, 0], number)))


def rows(keys: Array) -> Array:
    """Rows (l, 3) t [s], x, y [m] on the spline, few, with straight lines between that leave it by so little [m]."""
    shares = np.arange(FINE) / FINE
    times = np.append((keys[:-1, :1] + shares * np.diff(keys[:, :1], axis=0)).ravel(), keys[-1, 0])
    path = np.column_stack([times, place(keys, times)])
    path[::FINE] = keys
    return thinned(path, DEVIATION - SPARE)


def thinned(path: Array, deviation: float) -> Array:
    """Keep few of rows (k, 1 + c) of times and places, with straight lines between that leave it by so little."""
    kept = [0]

    def close(end: int) -> bool:
        piece = path[kept[-1] : end + 1] - path[kept[-1]]
        off = piece[:, 1:] - piece[:, :1] / piece[-1, 0] * piece[-1, 1:]
        return end < len(path) and bool(np.linalg.norm(off, axis=1).max() <= deviation)

    while kept[-1] < len(path) - 1:
        good, step = kept[-1] + 1, 1
        while close(good + step):
            good = good + step
            step = 2 * step
        while step := step // 2:
            good += step * close(good + step)
        kept.append(good)
    return path[kept]
