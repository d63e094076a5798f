"""Random planar scenes and random states in them; a seed means a scene.

A solid is seen at the robot's height, where it is a convex outline: corners and a rounding. The gap between two of
them is the greatest over directions of the gap between their shadows, so that solids can be set a given distance
apart in closed form, and scenes be judged before anything is loaded.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from benchmarks.moving_text import prepared
from scipy.ndimage import label

from pirrht.arrays import Array, BoolArray
from pirrht.errors import NoReference
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.tree import HomologyTree
from sim.mjcf.robot import read_robot
from sim.scenario import Scenario

SIDE = 5.0  # of the workspace [m]
HIGH = 0.4  # half height of what stands [m]
ROOM = 0.1  # clearance of start and goal at least [m]
APART = 1.5  # start and goal at least [m]
CELL = 0.025  # of the grid on which start and goal are found to be connected [m]
STRATA = ((0.005, 0.1), (0.1, 0.3), (0.3, np.inf))  # clearances of random states, a third each [m]
NARROW = 0.5  # a state whose second nearest obstacle is nearer lies in a passage [m]
BESIDE = 0.05  # states are so far outside of the goal's disc at least [m]
TRIES = 100_000  # of places near the goal
KINDS = ("box", "cylinder", "lying", "standing", "ellipsoid", "prism")
ANGLES = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
DIRECTIONS = np.stack([np.cos(ANGLES), np.sin(ANGLES)])  # (2, 360)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """One solid, and its outline at the robot's height."""

    kind: str  # one of KINDS
    size: tuple[float, ...]  # MuJoCo's [m]; none for a prism
    yaw: float  # [rad]
    corners: Array  # (k, 2) of the outline around its own centre, in its own axes [m]
    rounding: float  # of the outline [m]
    centre: Array  # (2,) [m]

    @property
    def shadow(self) -> Array:
        """How far the outline reaches along every direction, (360,) [m]."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        placed = self.centre + self.corners @ np.array([[c, s], [-s, c]])
        reach: Array = (placed @ DIRECTIONS).max(axis=0) + self.rounding
        return reach

    def beside(self, other: Solid, angle: float, gap: float) -> Solid:
        """This solid moved along an angle [rad] from another's centre until the gap [m] is between them."""
        moved = replace(self, centre=other.centre)
        along = np.array([np.cos(angle), np.sin(angle)]) @ DIRECTIONS
        ahead = along > 1e-3
        need = gap + other.shadow + np.roll(moved.shadow, len(ANGLES) // 2)
        way = float(np.min(need[ahead] / along[ahead]))
        return replace(self, centre=other.centre + way * np.array([np.cos(angle), np.sin(angle)]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layout:
    """What stands where, the robot's radius [m], and start and goal, 2 x (2,) [m], with the goal's radius [m]."""

    solids: tuple[Solid, ...]
    radius: float
    start: Array
    goal: Array
    reach: float

    def text(self, name: str) -> str:
        """MJCF by the conventions of `sim.mjcf`."""
        meshes = "".join(_mesh(i, s) for i, s in enumerate(self.solids) if s.kind == "prism")
        geoms = "\n".join("    " + _geom(i, s, self.radius) for i, s in enumerate(self.solids))
        half = f"{SIDE / 2:g} {SIDE / 2:g} 0.5"
        return f"""<mujoco model="{name}">
  <compiler angle="degree"/>
  <custom>
    <numeric name="pirrht_radius" data="{self.radius:.3f}"/>
    <numeric name="pirrht_limit" data="0.8"/>
  </custom>
  <asset>{meshes}</asset>
  <worldbody>
{geoms}
    <site name="workspace" type="box" pos="{half}" size="{half}"/>
    <site name="start" pos="{_text(*self.start)} 0"/>
    <site name="goal" type="cylinder" pos="{_text(*self.goal)} 0" size="{self.reach:.3f} 0.01"/>
  </worldbody>
</mujoco>
"""


def random_scene(seed: int, most: int = 8, least: float = 0.0) -> str:
    """MJCF text of a scene of 5 x 5 m with 2 to `most` solids for a robot of a radius [m] of at least so much.

    Start and goal are connected.
    """
    rng = np.random.default_rng([seed, 52])
    while True:
        layout = _task(_solids(rng, most), rng)
        if layout is not None and layout.radius >= least:
            return layout.text(f"random{seed}")


def scene_of(seed: int) -> Scene:
    """A random scene as plain values."""
    return scenario_of(seed, {}).loaded.scene


def scenario_of(seed: int, given: Mapping[str, Any], *, most: int = 8, **task: Any) -> Scenario:
    """A random scene ready to be planned in, under settings by name; `task` may name robot and radius [m].

    A robot that is named has room for what collides of it in its footprint.
    """
    robot = task.get("robot")
    least = 0.0 if robot is None or task.get("radius") else read_robot(robot, None).footprint.radius
    margin = 0.0 if given.get("risk") is None else None
    return prepared(f"random{seed}", random_scene(seed, most, least), given=given, margin=margin, **task)


def random_states(space: FreeSpace, count: int, seed: int) -> Array:
    """Free positions (count, 2) [m], connected with the goal: a third of each of STRATA, near ones half in passages.

    Where a scene has no room for some of them, others take their place.
    """
    rng, scene = np.random.default_rng([seed, 53]), space.scene
    reached, second = _reached(space), space.field.held["second"]
    chosen: list[Array] = []
    for i in range(count):
        low, high = STRATA[i % len(STRATA)]
        passage = i % len(STRATA) < 2 and (i // len(STRATA)) % 2 == 0
        for attempt in range(6000):
            x = scene.lower + rng.random(2) * (scene.upper - scene.lower)
            cell = _cell(space, x)
            far = np.hypot(*(x - scene.goal.center)) > scene.goal.radius + BESIDE
            if not far or not reached[cell] or (passage and attempt < 2000 and second[cell] > NARROW):
                continue
            free_by = space.clearance(x)
            if free_by > STRATA[0][0] and (attempt >= 4000 or low <= free_by < high):
                chosen.append(x)
                break
    return np.array(chosen).reshape(-1, 2)


def states_near_goal(space: FreeSpace, count: int, seed: int, most: float) -> Array:
    """Free positions (count, 2) [m], connected with the goal, up to `most` [m] outside of its disc, at any of these
    distances alike.
    """
    rng, scene, reached = np.random.default_rng([seed, 57]), space.scene, _reached(space)
    chosen: list[Array] = []
    for _ in range(TRIES):
        if len(chosen) == count:
            break
        angle, r = rng.uniform(-np.pi, np.pi), scene.goal.radius + rng.uniform(0.0, most)
        x = scene.goal.center + r * np.array([np.cos(angle), np.sin(angle)])
        if not np.all((x > scene.lower) & (x < scene.upper)):
            continue
        if reached[_cell(space, x)] and space.clearance(x) > STRATA[0][0]:
            chosen.append(x)
    if len(chosen) < count:
        raise SystemExit(f"{scene.name}: no room for {count} places up to {most:g} m outside of the goal's disc")
    return np.array(chosen)


def places_of(space: FreeSpace, count: int, seed: int, near_goal: float | None) -> Array:
    """`states_near_goal`, or where no distance is given `random_states`, (count, 2) [m]."""
    if near_goal is None:
        return random_states(space, count, seed)
    return states_near_goal(space, count, seed, near_goal)


def with_references(tree: HomologyTree, states: Iterable[Array], count: int) -> list[Array]:
    """The first states (n,) from which there is a way, `count` at most."""
    found = list[Array]()
    for x in states:
        try:
            tree.references(x)
        except NoReference:
            continue
        found.append(x)
        if len(found) == count:
            break
    return found


def _cell(space: FreeSpace, x: Array) -> tuple[int, ...]:
    """The point of the field's grid that is nearest to x (2,) [m]."""
    return tuple(np.rint((x - space.scene.lower) / space.field.spacing).astype(int))


def _reached(space: FreeSpace) -> BoolArray:
    """Which points of the field's grid are free and connected with the goal, (nx, ny)."""
    pieces, _ = label(space.field.held["nearest"] > 0.0)
    reached: BoolArray = pieces == pieces[_cell(space, space.scene.goal.center)]
    return reached


def _solids(rng: np.random.Generator, most: int) -> tuple[tuple[Solid, ...], float]:
    """2 to `most` solids and a robot's radius [m]: some face another across a passage, or touch it, or overlap it."""
    radius = float(np.round(rng.uniform(0.08, 0.25), 3))
    number = int(rng.integers(2, most + 1))
    solids = [_solid(rng)]
    while len(solids) < number:
        new, other, fate = _solid(rng), solids[rng.integers(len(solids))], rng.random()
        if fate < 0.5:
            new = new.beside(other, rng.uniform(0, 2 * np.pi), 2.0 * radius * rng.uniform(1.2, 4.0))
        elif fate < 0.65:
            new = new.beside(other, rng.uniform(0, 2 * np.pi), -rng.choice([0.0, 0.02, 0.1]))
        if np.all(new.centre > 0.0) and np.all(new.centre < SIDE):
            solids.append(new)
    return tuple(solids), radius


def _solid(rng: np.random.Generator) -> Solid:
    kind = str(rng.choice(KINDS))
    a, b = rng.uniform(0.1, 0.6), rng.uniform(0.1, 0.6)
    corners, rounding, size = np.zeros((1, 2)), 0.0, (a, b, HIGH)
    if kind == "box":
        a, b = rng.uniform(0.2, 0.9), rng.uniform(0.05, 0.4)
        corners, size = np.array([[a, b], [-a, b], [-a, -b], [a, -b]]), (a, b, HIGH)
    elif kind == "lying":
        a, b = rng.uniform(0.07, 0.25), rng.uniform(0.2, 0.8)
        corners, rounding, size = np.array([[-b, 0.0], [b, 0.0]]), a, (a, b)
    elif kind == "ellipsoid":
        corners, size = DIRECTIONS[:, ::6].T * [a, b], (a, b, 0.3)
    elif kind == "prism":
        angles = np.cumsum(rng.uniform(0.5, 1.5, size=rng.integers(3, 7)))
        angles *= 2.0 * np.pi / angles[-1]
        corners, size = rng.uniform(0.25, 0.7) * np.stack([np.cos(angles), np.sin(angles)], axis=1), ()
    else:
        rounding, size = a, (a, HIGH)
    centre, yaw = rng.uniform(0.5, SIDE - 0.5, size=2), rng.uniform(-np.pi, np.pi)
    return Solid(kind=kind, size=size, yaw=yaw, corners=corners, rounding=rounding, centre=centre)


def _task(drawn: tuple[tuple[Solid, ...], float], rng: np.random.Generator) -> Layout | None:
    """Start and goal, connected; none if there is no room."""
    solids, radius = drawn
    axis = np.arange(CELL, SIDE, CELL)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    along = points.reshape(-1, 2) @ DIRECTIONS[:, ::2]
    free_by = np.minimum(points, SIDE - points).min(axis=-1)
    for solid in solids:
        outside = (along - solid.shadow[::2]).max(axis=1).reshape(free_by.shape)
        free_by = np.minimum(free_by, outside - radius)
    pieces, _ = label(free_by > CELL)
    roomy = np.argwhere(free_by > ROOM)
    if not len(roomy):
        return None
    goal = roomy[rng.integers(len(roomy))]
    far = np.hypot(*(roomy - goal).T) * CELL > APART
    starts = roomy[far & (pieces[tuple(roomy.T)] == pieces[tuple(goal)])]
    if not len(starts):
        return None
    start = starts[rng.integers(len(starts))]
    reach = float(np.round(rng.uniform(0.15, 0.3), 2))
    return Layout(solids=solids, radius=radius, start=points[tuple(start)], goal=points[tuple(goal)], reach=reach)


def _mesh(i: int, solid: Solid) -> str:
    vertices = [_text(*corner, z) for z in (0.0, 2.0 * HIGH) for corner in solid.corners]
    return f'<mesh name="prism{i}" vertex="{"  ".join(vertices)}"/>'


def _geom(i: int, solid: Solid, radius: float) -> str:
    height = {"lying": radius, "ellipsoid": radius, "prism": 0.0}.get(solid.kind, HIGH)
    place = f'pos="{_text(*solid.centre, height)}"'
    if solid.kind == "prism":
        return f'<geom name="prism{i}" type="mesh" mesh="prism{i}" {place} euler="0 0 {np.degrees(solid.yaw):.6f}"/>'
    if solid.kind == "lying":
        turned = f'zaxis="{_text(np.cos(solid.yaw), np.sin(solid.yaw), 0.0)}"'
        return f'<geom name="lying{i}" type="capsule" size="{_text(*solid.size)}" {place} {turned}/>'
    shape = "capsule" if solid.kind == "standing" else solid.kind
    turned = f'euler="0 0 {np.degrees(solid.yaw):.6f}"'
    return f'<geom name="{solid.kind}{i}" type="{shape}" size="{_text(*solid.size)}" {place} {turned}/>'


def _text(*values: float) -> str:
    return " ".join(f"{value:.6f}" for value in values)
