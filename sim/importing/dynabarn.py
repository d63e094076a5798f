"""Worlds of the DynaBARN benchmark (Nair et al., SSRR 2022) as scenes: upright cylinders that move by keyframes.

A file holds worlds by number: {"0": {"obstacles": [{"name", "radius", "keys": [[t, x, y], ...]}, ...]}, ...}, lengths
in metres and times in seconds. The arena is the benchmark's: walls at x = -10 and y = -10, 10 and none at x = 10; the
robot starts outside at (11, 0), heads to -x, and its goal is the disc of 1 m around (-9, 0). A motion starts over
after its last key, where Gazebo's cylinders jump back to their first.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing import keyframes
from sim.importing.limits import FARTHEST, FINEST, content_of
from sim.importing.target import (
    BORDER,
    GOAL,
    START,
    Imported,
    check_borders,
    check_target,
    draft,
    loaded,
    numbers_of,
    scene_text,
    text,
)

SUFFIXES = (".json",)
OTHERS = (".world", ".sdf", ".yaml", ".yml")  # names of what else can be imported
FORM = '{"0": {"obstacles": [{"name": "a", "radius": 0.5, "keys": [[0, x, y], [t, x, y]]}]}}'
PLACE, DISC, ARENA = (11.0, 0.0, np.pi), (-9.0, 0.0, 1.0), (-10.0, 12.0, -10.0, 10.0)
HALF_HEIGHT = 0.5  # of cylinders and walls [m]
CUSTOM = (
    '<text name="pirrht_robot" data="puck"/>',
    "<!-- The benchmark's robot drives at most 2 m/s; its circumscribed radius is 0.33 m. -->",
    '<numeric name="pirrht_radius" data="0.33"/>',
    '<numeric name="pirrht_noise" data="0.05"/>',
    '<numeric name="pirrht_speed" data="2"/>',
    '<numeric name="pirrht_margin" data="0.1"/>',
    '<numeric name="pirrht_period" data="0.1"/>',
    '<numeric name="pirrht_dt" data="0.1"/>',
    '<numeric name="pirrht_samples" data="300"/>',
    '<numeric name="pirrht_limit" data="0.8"/>',
    '<numeric name="pirrht_vertices" data="2000"/>',
    '<numeric name="pirrht_classes" data="8"/>',
    '<numeric name="pirrht_max_time" data="100"/>',
)
WALLS = tuple(
    f'<geom name="{name} wall" type="box" material="crate" pos="{at} {HALF_HEIGHT}" size="{size} {HALF_HEIGHT}"/>'
    for name, at, size in (("west", "-10 0", "0.25 10.25"), ("south", "0 -10", "10 0.25"), ("north", "0 10", "10 0.25"))
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """One cylinder and its keyframes."""

    name: str
    radius: float  # [m]
    keys: Array  # (k, 3) t [s], x, y [m]


def import_motions(
    source: Path,
    target: Path,
    *,
    number: str | None = None,
    start: Sequence[float] | None = None,
    goal: Sequence[float] | None = None,
    workspace: Sequence[float] | None = None,
) -> Imported:
    """Write one of a file's worlds as a scene; start, goal and workspace are the benchmark's unless they are given.

    Raises:
        SceneError: the file or the world cannot be taken over, or the target cannot be written. It is then as it was.
    """
    check_target(source, target)
    tracks = read(source, number)
    place = numbers_of(source, START, PLACE if start is None else start, (2, 3))
    disc = numbers_of(source, GOAL, DISC if goal is None else goal, (3,))
    bounds = numbers_of(source, BORDER, ARENA if workspace is None else workspace, (4,))
    check_borders(source, bounds)
    motions, bodies = zip(*(_elements(track) for track in tracks), strict=True)
    scene = scene_text(target.stem, (*CUSTOM, *motions), (*WALLS, *bodies), place, disc, bounds)
    with draft(scene, target) as new:
        found = loaded(new, source).scene
        new.replace(target)
    return Imported(
        path=target, geoms=len(WALLS) + len(tracks), obstacles=len(found.obstacles), movers=len(found.movers)
    )


def read(source: Path, number: str | None = None) -> tuple[Track, ...]:
    """The cylinders of one world of a file; of its only one if none is named.

    Raises:
        SceneError: unreadable, no such world, or one with a part that is missing or none; names it.
    """
    worlds = _worlds(source)
    if number is None and len(worlds) == 1:
        number = next(iter(worlds))
    if number is None or number not in worlds:
        told = "holds several worlds" if number is None else f"has no world {number}"
        raise SceneError(f"{source}: it {told}; give --world with one of {_listed(worlds)}")
    where = f"{source}: world {number}"
    world = worlds[number]
    obstacles = world.get("obstacles") if isinstance(world, dict) else None
    if not isinstance(obstacles, list) or not obstacles:
        raise SceneError(f'{where} has no list "obstacles" with something in it; write {FORM}')
    return tuple(_named(_track(f"{where}, obstacle {i}", o) for i, o in enumerate(obstacles, start=1)))


def _worlds(source: Path) -> dict[str, Any]:
    data = content_of(source, "the JSON file of a set of motions")
    try:
        worlds = json.loads(data)
    except (ValueError, RecursionError) as error:  # ValueError: no JSON, or no UTF-8
        if data.lstrip()[:1] == b"<" or source.suffix.lower() in OTHERS:
            raise SceneError(
                f"{source}: this is no file of motions, which is JSON; if it is a world or a map, leave out --motion"
            ) from None
        reason = " ".join(str(error).split())
        raise SceneError(f"{source}: this is no JSON ({reason}); give a file like {FORM}") from None
    if not isinstance(worlds, dict) or not worlds:
        raise SceneError(f"{source}: it holds no worlds by number; write {FORM}")
    return worlds


def _listed(worlds: dict[str, Any], most: int = 20) -> str:
    names = [" ".join(name.split())[:20] for name in worlds]
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _track(where: str, obstacle: Any) -> Track:
    if not isinstance(obstacle, dict):
        raise SceneError(f"{where} is no object; write {FORM}")
    missing = [key for key in ("name", "radius", "keys") if key not in obstacle]
    if missing:
        raise SceneError(f'{where} has no "{missing[0]}"; write {FORM}')
    name = " ".join(str(obstacle["name"]).split())
    if not name:
        raise SceneError(f"{where} has an empty name; give it one")
    where = f'{where} ("{name[:40]}")'
    radius = _number(obstacle["radius"])
    if not FINEST <= radius <= FARTHEST:
        raise SceneError(f"{where}: its radius is {obstacle['radius']!r}; write metres, {FINEST:g} to {FARTHEST:g}")
    return Track(name=name, radius=radius, keys=_keys(where, obstacle["keys"]))


def _keys(where: str, keys: Any) -> Array:
    if not isinstance(keys, list) or len(keys) < 2:
        raise SceneError(f"{where}: its keys are not two or more; write [[0, x, y], [t, x, y], ...]")
    found = np.empty((len(keys), 3))
    for k, key in enumerate(keys):
        numbers = [_number(v) for v in key] if isinstance(key, list) else []
        if len(numbers) != 3 or not np.all(np.abs(numbers) <= FARTHEST):
            raise SceneError(f"{where}: key {k + 1} is not three finite numbers up to {FARTHEST:g}; write [t, x, y]")
        found[k] = numbers
    if found[0, 0] != 0.0:
        raise SceneError(f"{where}: its first key is at {found[0, 0]:g} s; it must be at 0")
    late = np.flatnonzero(np.diff(found[:, 0]) <= 0.0)
    if len(late):
        k = int(late[0]) + 1
        times = f"{found[k, 0]:g} s after one at {found[k - 1, 0]:g} s"
        raise SceneError(f"{where}: key {k + 1} is at {times}; times must increase")
    return found


def _number(value: Any) -> float:
    """A number of JSON; NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return float("nan")
    return float(value) if abs(value) <= FARTHEST else float("inf")


def _named(tracks: Iterator[Track]) -> Iterator[Track]:
    """The same with a number after names that are taken."""
    taken: set[str] = {"floor", "world", "west wall", "south wall", "north wall"}
    for track in tracks:
        name, count = track.name, 1
        while name in taken:
            count += 1
            name = f"{track.name} {count}"
        taken.add(name)
        yield Track(name=name, radius=track.radius, keys=track.keys)


def _elements(track: Track) -> tuple[str, str]:
    """Its motion for <custom>, and its body."""
    way = keyframes.rows(track.keys)
    lines = "  ".join(f"{text(*row)} 0" for row in way)
    label, motion = quoteattr(track.name), quoteattr(f"pirrht_motion_{track.name}")
    return (
        f'<numeric name={motion} data="{lines}"/>\n    <text name={motion} data="repeat"/>',
        f'<body name={label} mocap="true" pos="{text(*way[0, 1:])} {HALF_HEIGHT}">\n'
        f'      <geom name={label} type="cylinder" size="{text(track.radius)} {HALF_HEIGHT}" material="drum"/>\n'
        "    </body>",
    )
