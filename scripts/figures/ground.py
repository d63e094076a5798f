"""What every map of the paper's figures has in common: workspace, obstacles, goal and robot."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from figures import style
from pirrht.arrays import Array
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Scene
from pirrht.plotting import maps
from pirrht.plotting.strokes import outline


def draw(axes: Any, scene: Scene, time: float = 0.0, foreseen: Sequence[Mover] = ()) -> None:
    """Obstacles, goal and the border of the workspace, seen from above, to scale; what moves as it is at a time [s].

    Args:
        foreseen: bodies that are outlined where they are taken to be soon.
    """
    from matplotlib.patches import Circle, Rectangle

    size = scene.upper - scene.lower
    axes.add_patch(Rectangle(tuple(scene.lower), *size, fc=style.FLOOR, ec=style.BORDER, lw=0.6, zorder=0))
    maps.solids(axes, scene.obstacles, fc=style.WALL, ec="none", zorder=6)
    maps.bodies(axes, scene.movers, time, zorder=6)
    maps.predicted(axes, foreseen, time, zorder=5.9)
    goal = tuple(scene.goal.center)
    axes.add_patch(Circle(goal, scene.goal.radius, fc=style.GOAL, ec=style.GOAL_EDGE, lw=0.7, zorder=1))
    axes.set_aspect("equal")


def robot(axes: Any, scene: Scene, state: Array) -> None:
    """The robot's footprint at a state (n,), with its heading if it has one."""
    from matplotlib.patches import Circle

    axes.add_patch(Circle(tuple(state[:2]), scene.robot_radius, fc=style.ROBOT, ec=style.INK, lw=0.6, zorder=9))
    if len(state) > 2:
        nose = state[:2] + 2.2 * scene.robot_radius * np.array([np.cos(state[2]), np.sin(state[2])])
        axes.annotate(
            "", nose, state[:2], zorder=10, arrowprops={"arrowstyle": "-|>", "lw": 0.9, "color": style.INK,
            "mutation_scale": 6, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip


def frame(axes: Any, low: Array, high: Array) -> None:
    """Limits of a map [m]."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def around(lines: Sequence[Array], scene: Scene, margin: float) -> tuple[Array, Array]:
    """Corners of the part of the workspace that holds lines (k, 2), the obstacles and the goal [m]."""
    goal = np.array([scene.goal.center - scene.goal.radius, scene.goal.center + scene.goal.radius])
    points = np.vstack([*lines, goal, *(outline(obstacle) for obstacle in scene.obstacles)])
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return np.maximum(low, scene.lower - 0.02), np.minimum(high, scene.upper + 0.02)


def dots(axes: Any, line: Array, color: Any, *, width: float = 1.3, count: int = 14, zorder: float = 5) -> None:
    """A reference (k, 2): a line with small circles at equal distances, as the paper draws it."""
    from pirrht.plotting.strokes import even

    axes.plot(line[:, 0], line[:, 1], color=color, lw=width, zorder=zorder, solid_capstyle="round")
    beads = even(line, count)[1:-1]
    axes.plot(beads[:, 0], beads[:, 1], "o", ms=2.2, mfc="white", mec=color, mew=0.7, zorder=zorder + 0.1)
