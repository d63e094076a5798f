"""State what is free at a place x and a time t.

A `World` is one snapshot: the clearance field of what is static, the goal's disc, and J moving obstacles on a clock on
which 0 is now. Sampler, proposals, replay and feedback law share it, so a new map or a new prediction is one assignment
of a new snapshot. In a static world J = 0.

Examples:
    >>> from pirrht import FreeSpace, Scene
    >>> room = {"lower": (0, 0), "upper": (4, 3), "start": (0.6, 1.4), "goal": (3.4, 1.5, 0.3)}
    >>> world = FreeSpace.of(Scene.from_boxes([[1.6, 1.1, 2.4, 1.9]], robot_radius=0.2, **room)).world
    >>> world.moving.J
    0
    >>> nearest = world.walls(1.2, 1.5)[0]
    >>> round(float(nearest[0]), 3)  # the box is 0.4 m away from the centre of a robot of 0.2 m [m]
    0.2
    >>> nearest[3:].tolist()  # its velocity [m/s]
    [0.0, 0.0]
    >>> world.leaves(1.2, 1.5, 1.2, 0.5)
    False
    >>> world.certify(1.2, 1.5, 2.8, 1.5) == BLOCKED  # through the box
    True
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import BLOCKED, FREE, certify_segment
from pirrht.geometry.field import Field, clearance, two_walls
from pirrht.geometry.scene import Goal
from pirrht.jit.jit import inlined


class Moving(Protocol):
    """J moving obstacles as a `World` queries them, lengths in [m] and times in [s]; kernels read its numbers."""

    @property
    def J(self) -> int:
        """Count the obstacles."""

    def clearance(self, x: float, y: float, t: float) -> float:
        """Return the clearance of the robot's centre from the nearest [m]."""

    def walls(self, x: float, y: float, t: float, within: float) -> Array:
        """Return clearance, unit vector away and velocity there of those `within` [m], (k, 5)."""

    def certify(self, ax: float, ay: float, bx: float, by: float, s: float, t: float) -> int:
        """Return FREE, UNSURE or BLOCKED for a straight step from (ax, ay) at s to (bx, by) at t."""


class World(NamedTuple):
    """A snapshot of what is free at (x, t), as numbers and addresses that kernels take cheaply."""

    field: Field  # of static obstacles and border
    goal: tuple[float, float]  # centre of the goal's disc [m]
    radius: float  # of that disc [m]
    moving: Any  # J moving obstacles (`Moving`)

    @classmethod
    def of(cls, field: Field, goal: Goal, moving: Moving) -> World:
        """Take a snapshot of a field, a goal of centre (2,) [m] and moving obstacles."""
        return cls(field, (float(goal.center[0]), float(goal.center[1])), float(goal.radius), moving)

    def clearance(self, x: float, y: float, t: float = 0.0) -> float:
        """Return a lower bound of the clearance of the robot's centre from all walls [m]."""
        return min(float(clearance(self.field, x, y)), float(self.moving.clearance(x, y, t)))

    def walls(self, x: float, y: float, t: float = 0.0, within: float = np.inf) -> Array:
        """Return clearance [m], unit vector (x, y) away and velocity (x, y) [m/s] of walls `within` [m], nearest first.

        The two nearest static walls are at most two rows of (k, 5); each moving obstacle is one.
        """
        c, nx, ny, d, mx, my = two_walls(self.field, x, y)
        static = np.array([[c, nx, ny, 0.0, 0.0], [d, mx, my, 0.0, 0.0]], dtype=float)
        rows = np.vstack([static[static[:, 0] < within], self.moving.walls(x, y, t, within)])
        return rows[np.argsort(rows[:, 0], kind="stable")]

    def certify(self, ax: float, ay: float, bx: float, by: float, s: float = 0.0, t: float = 0.0) -> int:
        """Return FREE, UNSURE or BLOCKED for a straight step from (ax, ay) [m] at s [s] to (bx, by) at t."""
        static = int(certify_segment(self.field, ax, ay, bx, by))
        return static if static == BLOCKED else min(static, self.moving.certify(ax, ay, bx, by, s, t))

    def leaves(self, ax: float, ay: float, bx: float, by: float, s: float = 0.0, t: float = 0.0) -> bool:
        """Return whether a straight step is not certified to stay in the free space."""
        return self.certify(ax, ay, bx, by, s, t) != FREE


@inlined
def with_wall(walls, e, ex, ey, widest):  # type: ignore[no-untyped-def]
    """Return the two nearest of two walls in order and a third, which counts as no nearer than `widest` [m]."""
    c, nx, ny, d, mx, my = walls
    e, ex, ey = np.float32(max(e, widest)), np.float32(ex), np.float32(ey)
    if e < c:
        return e, ex, ey, c, nx, ny
    if e < d:
        return c, nx, ny, e, ex, ey
    return c, nx, ny, d, mx, my


@inlined
def with_walls(walls, near, count, widest):  # type: ignore[no-untyped-def]
    """Return the two nearest of two static walls and `count` rows of `near` (J, 5); none nearer than `widest`."""
    c, nx, ny, d, mx, my = walls
    for k in range(count):
        c, nx, ny, d, mx, my = with_wall((c, nx, ny, d, mx, my), near[k, 0], near[k, 1], near[k, 2], widest)
    return c, nx, ny, d, mx, my
