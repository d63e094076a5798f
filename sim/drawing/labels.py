"""Places for labels on the map: near what they belong to, off walls, off lines, off each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.scene import Scene
from sim.drawing.strokes import interpolated, parted
from sim.plotting.ground import outline

LETTER, PADDING, HEIGHT = 6.3, 14.0, 23.0  # of labels as Rerun's viewer draws them [px]
BELOW = 3.0  # from the point that bears a label down to the label [px]
CELL = 6.0  # spacing of the points by which walls, lines and labels are seen [px]
WALL, LINE, LABEL, FAINT = 30.0, 10.0, 60.0, 0.5  # cost of covering such a point, as a distance [px]
MOVED = 0.4  # cost of leaving the place of the picture before, over the distance
OFFSETS = np.array([(x, y) for y in (-2.4, -1.2, 0.0, 1.2, 2.4) for x in (-1.2, -0.6, 0.0, 0.6, 1.2)])  # in half sizes


class Labels:
    """Labels of a map, each of which stays where it was unless something comes in its way.

    Args:
        scale: of the map [px/m].
    """

    def __init__(self, scene: Scene, scale: float) -> None:
        self._scale, self._lower, self._upper = scale, scene.lower, scene.upper
        walls = [inside(outline(solid), CELL / scale) for solid in scene.obstacles]
        self._walls = np.vstack([np.zeros((0, 2)), *walls])
        self._fixed = np.zeros((0, 2))
        self._before: dict[str, Array] = {}

    def place(
        self, texts: Mapping[str, str], near: Mapping[str, Array], drawn: Iterable[Array], faint: Array, *,
        stay: bool = False,
    ) -> list[Array]:  # fmt: skip
        """Return the points (2,) [m] that bear labels, by name, the first ones first.

        Args:
            near: points (k, 2) [m] that each label belongs to.
            drawn: polylines (k, 2) [m] to keep off.
            faint: points (k, 2) [m] to cover if need be.
            stay: whether the labels keep their places from now on; they may lie on walls.
        """
        lines = np.vstack([np.zeros((0, 2)), *(dense(line, CELL / self._scale) for line in drawn)])
        crowd = np.vstack([self._walls[: 0 if stay else None], lines, faint, self._fixed])
        counts = [0 if stay else len(self._walls), len(lines), len(faint), len(self._fixed)]
        cost, found = np.repeat([WALL, LINE, FAINT, LABEL], counts), []
        for name, text in texts.items():
            half = 0.5 * np.array([LETTER * len(text) + PADDING, HEIGHT]) / self._scale
            middles = (near[name][:, None] + OFFSETS * half).reshape(-1, 2)
            middles = np.clip(middles, self._lower + half, np.maximum(self._upper - half, self._lower + half))
            covered = np.all(np.abs(crowd - middles[:, None]) < half, axis=2) @ cost
            away = self._scale * np.linalg.norm(near[name] - middles[:, None], axis=2).min(axis=1)
            moved = np.linalg.norm(middles - self._before.get(name, middles), axis=1) * self._scale
            best = middles[int(np.argmin(covered + away + MOVED * moved))]
            self._before[name] = best
            box = best + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
            own = inside(box, CELL / self._scale)
            crowd, cost = np.vstack([crowd, own]), np.append(cost, np.full(len(own), LABEL))
            self._fixed = np.vstack([self._fixed, own]) if stay else self._fixed
            found.append(best + np.array([0.0, half[1] + BELOW / self._scale]))
        return found


def dense(line: Array, spacing: float) -> Array:
    """Return points on a polyline (k, 2), no farther from each other than a spacing."""
    steps = np.maximum(1, np.ceil(np.linalg.norm(np.diff(line, axis=0), axis=1) / spacing)).astype(int)
    return interpolated(line, np.arange(float(len(line))), parted(steps))


def inside(corners: Array, spacing: float) -> Array:
    """Return points of a grid in a convex outline (c, 2), counterclockwise, and on its edge."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    grid = np.stack(np.meshgrid(*(np.arange(a, b, spacing) for a, b in zip(low, high, strict=True))), axis=-1)
    points, edge = grid.reshape(-1, 2), np.roll(corners, -1, axis=0) - corners
    off = points[:, None] - corners
    within = np.all(edge[:, 0] * off[..., 1] - edge[:, 1] * off[..., 0] >= 0.0, axis=1)
    return np.vstack([points[within], dense(np.vstack([corners, corners[:1]]), spacing)])
