"""Maps: workspace, static and moving obstacles seen from above, start and goal."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from pirrht.arrays import Array
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Kind, Obstacle, Scene

FLOOR, BORDER, WALL, GOAL, GOAL_EDGE, INK = "#f7f7f5", "#777777", "#4d5866", "#8fd19e", "#3c8f52", "#222222"
MOVER = "#80609e"
ROUND = 64  # corners of what is round
MOMENTS = (0.5, 1.0, 1.5, 2.0, 2.5)  # after which predicted moving obstacles are outlined [s]


def draw(axes: Any, scene: Scene, time: float = 0.0) -> None:
    """Draw a scene to scale, with moving obstacles at a time [s]."""
    from matplotlib.patches import Circle, Rectangle

    axes.add_patch(Rectangle(tuple(scene.lower), *(scene.upper - scene.lower), fc=FLOOR, ec=BORDER, lw=1, zorder=0))
    solids(axes, scene.obstacles, fc=WALL, ec="none", zorder=3)
    bodies(axes, scene.movers, time)
    axes.add_patch(Circle(tuple(scene.goal.center), scene.goal.radius, fc=GOAL, ec=GOAL_EDGE, lw=1, zorder=1))
    axes.add_patch(Circle(tuple(scene.start[:2]), scene.robot_radius, fc="none", ec=INK, lw=1.2, zorder=5))
    margin = 0.02 * float((scene.upper - scene.lower).max())
    (left, low), (right, high) = scene.lower - margin, scene.upper + margin
    axes.set(aspect="equal", xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]")


def solids(axes: Any, shown: Sequence[Obstacle], **look: Any) -> None:
    """Draw solids seen from above, with the look of a patch."""
    from matplotlib.patches import Polygon

    for solid in shown:
        axes.add_patch(Polygon(outline(solid), closed=True, **look))


def bodies(axes: Any, movers: Sequence[Mover], time: float, *, zorder: float = 3.0) -> None:
    """Draw moving obstacles at a time [s]."""
    for mover in movers:
        solids(axes, mover.at(time), fc=MOVER, ec="none", alpha=0.7, zorder=zorder)


def predicted(axes: Any, movers: Sequence[Mover], time: float, *, zorder: float = 2.9) -> None:
    """Outline moving obstacles soon after a time [s], the paler the later."""
    for mover in movers:
        outlined(axes, mover, [(time + after, strength) for after, strength in fading(mover, time)], zorder=zorder)


def outlined(axes: Any, mover: Mover, moments: Sequence[tuple[float, float]], *, zorder: float) -> None:
    """Outline a moving obstacle at times [s], each with its opacity."""
    for time, alpha in moments:
        solids(axes, mover.at(time), fill=False, ec=MOVER, lw=0.9, alpha=alpha, zorder=zorder)


def fading(mover: Mover, time: float) -> list[tuple[float, float]]:
    """Return times after a time [s] at which to outline a moving obstacle, and opacities; none after it stops."""
    last = [after for after in MOMENTS if time + after - MOMENTS[0] < mover.motion.last]
    return [(after, 1.0 - 0.8 * after / (MOMENTS[-1] + MOMENTS[0])) for after in last]


def outline(obstacle: Obstacle) -> Array:
    """Return the corners (k, 2) of an obstacle's convex outline seen from above, counterclockwise [m]."""
    body = surface(obstacle.kind, obstacle.size) if obstacle.vertices is None else obstacle.vertices
    points = (body @ obstacle.rotation.T + obstacle.position)[:, :2]
    return np.asarray(points[ConvexHull(points).vertices])


def surface(kind: Kind, size: Array) -> Array:
    """Return points (k, 3) [m] whose convex hull is a primitive in its own frame, or close to a round one."""
    angle, latitude = (
        np.linspace(0, 2 * np.pi, ROUND, endpoint=False),
        np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2 + 1),
    )
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(ROUND)])
    ball = np.vstack([np.cos(a) * ring + [0.0, 0.0, np.sin(a)] for a in latitude])
    up = np.array([0.0, 0.0, size[1]])
    points = {
        Kind.BOX: np.array(list(product((-1, 1), repeat=3))) * size,
        Kind.CYLINDER: np.vstack([size[0] * ring - up, size[0] * ring + up]),
        Kind.CAPSULE: np.vstack([size[0] * ball - up, size[0] * ball + up]),
        Kind.ELLIPSOID: ball * size,
        Kind.SPHERE: ball * size[0],
    }
    return np.asarray(points[kind])
