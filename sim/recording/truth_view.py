"""The exact solution in a recording: the value as a picture on the floor, and psi class by class."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.topology.signature import class_id

OPTIMUM = (150, 235, 60)
VALUE = "/world/scene/truth/value"
PIXELS, MOVING_PIXELS = 120, 48  # along the longer side of the floor: drawn once, and time and again
HEADINGS = 12  # that are tried of a robot that has one
BANDS = 24  # of equal cost
BLOCKED = (24, 27, 32)
SHADES = (44, 62, 110), (92, 105, 138), (150, 150, 140), (226, 208, 150)  # from great values to small ones
DRAWN = 400  # optimal paths that tell how much psi each class has


def on_floor(grid: Desirability, space: FreeSpace, time: float) -> rr.AsComponents:
    """Lay the value at a time [s] on the floor."""
    (x0, y0), (x1, y1) = space.scene.lower, space.scene.upper
    return rr.Mesh3D(
        vertex_positions=[(x0, y0, 0.001), (x1, y0, 0.001), (x1, y1, 0.001), (x0, y1, 0.001)],
        vertex_texcoords=[(0, 1), (1, 1), (1, 0), (0, 0)],
        triangle_indices=[(0, 1, 2), (0, 2, 3)],
        albedo_texture=painted(grid, space, time, MOVING_PIXELS if grid.moves else PIXELS),
    )


def painted(grid: Desirability, space: FreeSpace, time: float, pixels: int) -> NDArray[np.uint8]:
    """The value seen from above, north being up, (height, width, 3): pale at the goal, in bands darker with the value.

    Of a robot with a heading it is that of the best heading.
    """
    scene, extent = space.scene, space.scene.upper - space.scene.lower
    shape = np.maximum(1, np.rint(pixels * extent / extent.max())).astype(int)
    middles = [low + size * (np.arange(n) + 0.5) / n for low, size, n in zip(scene.lower, extent, shape, strict=True)]
    points = np.stack(np.meshgrid(*middles), axis=-1).reshape(-1, 2)
    free = space.collision.clearance(points) > 0.0
    free |= scene.goal.contains(points)
    colors = np.tile(np.array(BLOCKED, dtype=np.uint8), (len(points), 1))
    if free.any():
        value = values(grid, points[free], time)
        top = max(float(np.quantile(value, 0.98)), 1e-9)
        place = (1.0 - np.ceil(np.minimum(value / top, 1.0) * BANDS) / BANDS) * (len(SHADES) - 1)
        colors[free] = np.column_stack([np.interp(place, range(len(SHADES)), c) for c in zip(*SHADES, strict=True)])
    return colors.reshape(shape[1], shape[0], 3)[::-1]


def values(grid: Desirability, points: Array, time: float) -> Array:
    """v at points (k, 2) [m], (k,) [cost]; of a robot with a heading that of the best one."""
    turns = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS if grid.problem.dynamics.angles else None
    states = [points] if turns is None else [np.column_stack([points, np.full(len(points), turn)]) for turn in turns]
    least: Array = np.min([np.asarray(grid.value(np.ascontiguousarray(x), time)) for x in states], axis=0)
    return least


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
