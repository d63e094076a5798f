"""The exact solution in a recording: the value as a picture on the floor, the optimal field, and psi class by class."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.topology.signature import class_id
from sim.drawing.colors import mix

OPTIMUM = (150, 235, 60)
VALUE, FIELD = "/world/scene/truth/value", "/world/scene/truth/field"
PIXELS, MOVING_PIXELS = 120, 48  # along the longer side of the floor: drawn once, and time and again
ARROWS = 18  # along it
HEADINGS = 12  # that are tried of a robot that has one
BANDS = 24  # of equal cost
BLOCKED = (24, 27, 32)
SHADES = (44, 62, 110), (92, 105, 138), (150, 150, 140), (226, 208, 150)  # from great values to small ones
DRAWN = 400  # optimal paths that tell how much psi each class has

Picture = NDArray[np.uint8]


def on_floor(grid: Desirability, space: FreeSpace, time: float) -> Iterator[tuple[str, rr.AsComponents]]:
    """Yield pictures for the floor at a time [s], each under its entity."""
    (x0, y0), (x1, y1) = space.scene.lower, space.scene.upper
    paint = painted(grid, space, time, MOVING_PIXELS if grid.moves else PIXELS)
    corners = [(x0, y0, 0.001), (x1, y0, 0.001), (x1, y1, 0.001), (x0, y1, 0.001)]
    floor = {"vertex_texcoords": [(0, 1), (1, 1), (1, 0), (0, 0)], "triangle_indices": [(0, 1, 2), (0, 2, 3)]}
    yield VALUE, rr.Mesh3D(vertex_positions=corners, **floor, albedo_texture=paint)
    points = _lattice(space, ARROWS)
    points = points[space.collision.clearance(points) > 0.0]
    points = points[[not space.scene.goal.contains(p) for p in points]]
    side = float(max(x1 - x0, y1 - y0)) / ARROWS
    field = directions(grid, points, time)
    length = np.linalg.norm(field, axis=1, keepdims=True)
    vectors = 0.8 * side * field / np.maximum(length, max(float(np.quantile(length, 0.9)), 1e-9))
    yield (
        FIELD,
        rr.Arrows3D(
            origins=np.column_stack([points - 0.5 * vectors, np.full(len(points), 0.012)]),
            vectors=np.column_stack([vectors, np.zeros(len(points))]),
            radii=0.025 * side,
            colors=[mix(OPTIMUM, BLOCKED, 0.35)],
        ),
    )


def painted(grid: Desirability, space: FreeSpace, time: float, pixels: int) -> Picture:
    """The value seen from above, north being up, (height, width, 3): pale at the goal, dark where it is great."""
    points = _lattice(space, pixels)
    free = space.collision.clearance(points) > 0.0
    free |= np.array([space.scene.goal.contains(p) for p in points])
    colors = np.tile(np.array(BLOCKED, dtype=np.uint8), (len(points), 1))
    value = values(grid, points[free], time)
    if len(value):
        top = float(np.quantile(value, 0.98))
        bands = np.ceil(np.minimum(value, top) / max(top, 1e-9) * BANDS)
        shade = np.where(bands % 2, 0.75, 0.71)[:, None]  # by which one sees where one band ends
        place = (1.0 - bands / BANDS) * (len(SHADES) - 1)
        hues = np.column_stack([np.interp(place, range(len(SHADES)), channel) for channel in zip(*SHADES, strict=True)])
        colors[free] = (shade * hues).astype(np.uint8)
    width, height = _shape(space, pixels)
    return colors.reshape(height, width, 3)[::-1]


def values(grid: Desirability, points: Array, time: float) -> Array:
    """v at points (k, 2) [m], (k,) [cost]; of a robot with a heading that of the best one."""
    least: Array = np.min([np.asarray(grid.value(states, time)) for states in _states(grid, points)], axis=0)
    return least


def directions(grid: Desirability, points: Array, time: float) -> Array:
    """u* at points (k, 2) [m], (k, 2); of a robot with a heading the best one as a unit vector."""
    states = _states(grid, points)
    if len(states) == 1:
        return np.array([grid.control(x, time) for x in states[0]]).reshape(-1, 2)
    best = np.argmin([np.asarray(grid.value(each, time)) for each in states], axis=0)
    angle = 2.0 * np.pi * best / HEADINGS
    return np.column_stack([np.cos(angle), np.sin(angle)])


def warm_up(grid: Desirability) -> None:
    """Compile what draws optimal paths before a drive would have to wait for it."""
    grid.shares(grid.problem.dynamics.state_of(grid.space.scene.start), samples=1)


def shares_of(grid: Desirability, plan: Plan, time: float) -> dict[str, float]:
    """Share of psi of each class of a plan, by paths drawn under the optimal control from its state.

    Where the grid tells classes apart by moving obstacles and the plan does not, those of one class are added up.
    """
    found = [(name.split(","), share) for name, share in grid.shares(plan.state, samples=DRAWN, t=time).items()]
    shares = {}
    for reference, name in zip(plan.references, plan.ids, strict=True):
        turns = class_id(reference.winding).split(",") if reference.winding else []
        shares[name] = sum(share for whole, share in found if whole[: len(turns)] == turns)
    return shares


def _states(grid: Desirability, points: Array) -> list[Array]:
    """States at points (k, 2), one set for each heading that the robot may have."""
    if not grid.problem.dynamics.angles:
        return [np.ascontiguousarray(points)]
    turns = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
    return [np.column_stack([points, np.full(len(points), turn)]) for turn in turns]


def _shape(space: FreeSpace, pixels: int) -> tuple[int, int]:
    extent = space.scene.upper - space.scene.lower
    width, height = np.maximum(1, np.rint(pixels * extent / extent.max())).astype(int)
    return int(width), int(height)


def _lattice(space: FreeSpace, pixels: int) -> Array:
    """Middles of pixels (height * width, 2) [m], row by row from the south."""
    width, height = _shape(space, pixels)
    lower, extent = space.scene.lower, space.scene.upper - space.scene.lower
    x = lower[0] + extent[0] * (np.arange(width) + 0.5) / width
    y = lower[1] + extent[1] * (np.arange(height) + 0.5) / height
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
