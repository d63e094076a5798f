"""Find where the tree of a robot with corners ends: the narrow place that its inscribed disc passes and it does not."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import PirrhtError
from pirrht.freespace import FreeSpace
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.polyline import interpolated, lengths
from pirrht.steering.straight_line import StraightLine

VERTICES = 400  # of the tree of the inscribed disc, at least


class NarrowPlace(NamedTuple):
    """A place where a robot with corners does not get through or around, wide enough for its inscribed disc."""

    at: tuple[float, float]  # [m]
    width: float  # between the two nearest walls [m]
    next_to: str  # name of the nearest obstacle

    def says(self, footprint: Footprint) -> str:
        """Return a sentence for a person."""
        x, y = self.at
        return (
            f"its {footprint} does not get through or around at ({x:.3g}, {y:.3g}), {self.width:.2g} m wide next to "
            f'"{self.next_to}": it needs {2.0 * footprint.inscribed:.3g} m there at best, headed along it, and room to '
            "turn before and after"
        )


def narrow_place(tree: Any, x: Array) -> NarrowPlace | None:
    """Return where a tree (`HomologyTree`) without a path from a state x (n,) ends; None for a disc, or if unknown."""
    scene = tree.space.scene
    footprint = scene.footprint
    if footprint.is_disc:
        return None
    disc = Footprint.disc(footprint.inscribed, height=footprint.height)
    try:
        space = FreeSpace.of(replace(scene, footprint=disc, robot_radius=disc.radius))
        bends = tree.steering.drives  # what it cannot drive is no reason
        easy = type(tree)(
            space, tree.steering if bends else StraightLine(), limit=tree.limit, classes=1, rng=np.random.default_rng(0)
        )
        easy.grow(max(tree.size, VERTICES) if bends else VERTICES)
        line = easy.references(x if bends else x[:2])[0].trajectory.points
    except PirrhtError:
        return None
    along = lengths(line)
    at = np.linspace(0.0, along[-1], 2 + int(2.0 * along[-1] / footprint.inscribed))
    points = interpolated(line[:, :2], along, at)

    away = np.hypot(*np.moveaxis(points[:, None] - tree.states[: tree.size, :2], -1, 0)).min(axis=1)
    missed = np.flatnonzero(away > footprint.reach)
    end = at[missed[-1]] if len(missed) else at[0]
    near = np.flatnonzero(np.abs(at - end) <= footprint.reach)
    found = space.collision.nearest_walls(points[near], range(len(scene.obstacles)), 1e3)
    k = int(np.argmin(found.first))
    if found.which[k] < 0:
        return None
    px, py = points[near[k]].tolist()
    return NarrowPlace((px, py), float(found.first[k] + found.second[k]), scene.obstacles[found.which[k]].name)
