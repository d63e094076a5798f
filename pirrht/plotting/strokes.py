"""Lines of pictures: polylines cut anew, strokes side by side, and outlines of solids seen from above."""

from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial import ConvexHull, KDTree

from pirrht.arrays import Array
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Kind, Mover, Obstacle
from pirrht.geometry.polyline import even, lengths
from pirrht.plotting.tuning import TUNING


def side_by_side(lines: Sequence[Array], width: float) -> list[Array]:
    """Move polylines (k, 2) [m] sideways where they coincide, so that strokes of a width [m] all show."""
    fine = [even(line, 2 + int(2.0 * lengths(line)[-1] / width)) for line in lines]
    trees = [KDTree(line) for line in fine]
    moved = list[Array]()

    for place, line in enumerate(fine):
        near = np.array([tree.query(line, distance_upper_bound=width)[0] < width for tree in trees])
        count = near.sum(axis=0)
        lane = (near[:place].sum(axis=0) - 0.5 * (count - 1)) * np.minimum(1.0, TUNING.bundle / count)
        along = np.gradient(line, axis=0)
        normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), 1e-12)[:, None]
        moved.append(line + width * uniform_filter1d(lane[:, None] * normal, TUNING.smooth, axis=0, mode="nearest"))
    return moved


def fading(mover: Mover, time: float) -> list[tuple[float, float]]:
    """Return times after a time [s] at which to outline a moving obstacle, and opacities; none after it stops."""
    last = [after for after in TUNING.moments if time + after - TUNING.moments[0] < mover.motion.last]
    return [(after, 1.0 - 0.8 * after / (TUNING.moments[-1] + TUNING.moments[0])) for after in last]


def rings(footprint: Footprint, poses: Array) -> Array:
    """Return the outlines of a footprint at poses (k, 3), closed, (k, c + 1, 2) [m]."""
    found = footprint.at(poses)
    return np.concatenate([found, found[:, :1]], axis=1)


def outline(obstacle: Obstacle, seen: tuple[int, int] = (0, 1)) -> Array:
    """Return the corners (k, 2) of an obstacle's convex outline as two axes show it, counterclockwise [m]."""
    size, up = obstacle.size, np.array([0.0, 0.0, obstacle.size[1]])
    angle = np.linspace(0, 2 * np.pi, TUNING.corners, endpoint=False)
    latitude = np.linspace(-np.pi / 2, np.pi / 2, TUNING.corners // 2 + 1)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(TUNING.corners)])
    ball = np.vstack([np.cos(a) * ring + [0.0, 0.0, np.sin(a)] for a in latitude])
    points = {
        Kind.BOX: np.array(list(product((-1, 1), repeat=3))) * size,
        Kind.CYLINDER: np.vstack([size[0] * ring - up, size[0] * ring + up]),
        Kind.CAPSULE: np.vstack([size[0] * ball - up, size[0] * ball + up]),
        Kind.ELLIPSOID: ball * size,
        Kind.SPHERE: ball * size[0],
        Kind.MESH: obstacle.vertices,
    }
    corners = (points[obstacle.kind] @ obstacle.rotation.T + obstacle.position)[:, list(seen)]
    return np.asarray(corners[ConvexHull(corners).vertices])
