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

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import BLOCKED, FREE, certify_segment
from pirrht.geometry.field import Field, clearance, two_walls
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Goal
from pirrht.jit.jit import inlined

WALL = 5  # numbers of a moving wall: clearance [m], unit vector (x, y) away, velocity there (x, y) [m/s]
NEVER = 2.0  # share of a step at which nothing is met


class MovingKernels(NamedTuple):
    """Kernels that rollouts, proposals and edges call among moving obstacles; all take their numbers (`Moving`) first.

    `watch` is scratch of one path after another; only the kernels know its fields. Rows of walls are clearance [m],
    unit vector (x, y) away, zero inside, and velocity there (x, y) [m/s]. Places are (x, y) [m], times in [s].
    """

    watch: Any  # (moving): allocate scratch
    begin: Any  # (watch): begin another path
    # (moving, watch, x, y, t, within, out (J, WALL)): write the walls nearer than `within` [m] to rows; return how
    # many, and until when they keep their velocities and no obstacle is suddenly elsewhere.
    walls: Any
    # (moving, watch, (x, y, mx, my), t, dt, cov, (line, weighed), state, out (J, WALL)): judge a noisy step of a
    # covariance (xx, xy, yy) [m^2], whether noise acts along a line, whether survival is weighed. Return the next state
    # of the random sequence, the share at which one is met, its wall being row 0, or NEVER, and log survival [nats].
    bridge: Any
    # (moving, watch, (x, y, mx, my, turn), t, dt, stop): share at which a step without position noise, an arc that
    # turns [rad], meets one, or NEVER; a share `stop` is judged.
    sweep: Any
    clearance: Any  # (moving, x, y, t): clearance from the nearest [m]
    certify: Any  # (moving, (ax, ay, s, bx, by, t)): FREE, BLOCKED or UNSURE for a straight step from a at s to b at t


@inlined
def unwatched(moving):  # type: ignore[no-untyped-def]
    """Note nothing where nothing moves."""
    return 0


NOTHING_MOVES: Any = MovingKernels(unwatched, *[None] * 6)  # what kernels name in place of None, and never call


class Moving(Protocol):
    """J moving obstacles as a `World` queries them, lengths in [m] and times in [s].

    Kernels take it as a NamedTuple of numbers. Among them are J and `speed`, the greatest of any point [m/s].
    """

    @property
    def J(self) -> int:
        """Count the obstacles."""

    @property
    def kernels(self) -> MovingKernels | None:
        """Return the kernels that answer for them; None where nothing moves."""

    def clearance(self, x: float, y: float, t: float) -> float:
        """Return the clearance of the robot's centre from the nearest [m]."""

    def walls(self, x: float, y: float, t: float, within: float) -> Array:
        """Return clearance, unit vector away and velocity there of those `within` [m], (k, 5)."""

    def certify(self, ax: float, ay: float, bx: float, by: float, s: float, t: float) -> int:
        """Return FREE, UNSURE or BLOCKED for a straight step from (ax, ay) at s to (bx, by) at t."""

    def distance(self, place: Array, t: float) -> float:
        """Return FCL's clearance of the robot's centre at a place (2,)."""

    def meets(self, a: Array, s: float, b: Array, t: float) -> bool:
        """Return whether a straight step from a (2,) at s to b (2,) at t meets one, by FCL where in doubt."""

    def with_motions(self, movers: Sequence[Mover]) -> Moving:
        """Return the obstacles on other motions; one thread at a time may query either."""


class NoMoving(NamedTuple):
    """Moving obstacles of a static world: none."""

    J: int = 0
    speed: float = 0.0

    @property
    def kernels(self) -> None:
        """Kernels that are compiled leave moving obstacles out."""

    def clearance(self, x: float, y: float, t: float) -> float:
        """Nothing is near."""
        return np.inf

    def walls(self, x: float, y: float, t: float, within: float) -> Array:
        """Return no rows, (0, 5)."""
        return np.empty((0, WALL))

    def certify(self, ax: float, ay: float, bx: float, by: float, s: float, t: float) -> int:
        """Certify any step."""
        return FREE

    def distance(self, place: Array, t: float) -> float:
        """Nothing is near."""
        return np.inf

    def meets(self, a: Array, s: float, b: Array, t: float) -> bool:
        """No step meets anything."""
        return False

    def with_motions(self, movers: Sequence[Mover]) -> NoMoving:
        """Nothing moves."""
        return self


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

    def off_walls(self, x: Array, t: float, gap: float) -> Array:
        """Return the nearest state to x (n,) from which plans can begin at t [s], `gap` [m] off walls.

        It is x itself unless noise has carried the robot into the safety margin.
        """
        for _ in range(4):  # a second wall may be near
            if self.clearance(x[0], x[1], t) > 0.0:
                break
            c, nx, ny, *_ = self.walls(x[0], x[1], t)[0]
            x = np.concatenate([x[:2] + (gap - c) * np.array([nx, ny]), x[2:]])
        return x

    def certify(self, ax: float, ay: float, bx: float, by: float, s: float = 0.0, t: float = 0.0) -> int:
        """Return FREE, UNSURE or BLOCKED for a straight step from (ax, ay) [m] at s [s] to (bx, by) at t."""
        static = int(certify_segment(self.field, ax, ay, bx, by))
        return static if static == BLOCKED else min(static, self.moving.certify(ax, ay, bx, by, s, t))

    def leaves(self, ax: float, ay: float, bx: float, by: float, s: float = 0.0, t: float = 0.0) -> bool:
        """Return whether a straight step is not certified to stay in the free space."""
        return self.certify(ax, ay, bx, by, s, t) != FREE


@inlined
def with_walls(walls, near, count, widest):  # type: ignore[no-untyped-def]
    """Return the two nearest of two static walls and `count` rows of `near` (J, WALL); none nearer than `widest`."""
    c, nx, ny, d, mx, my = walls
    for k in range(count):
        e = np.float32(max(near[k, 0], widest))
        ex = np.float32(near[k, 1])
        ey = np.float32(near[k, 2])

        if e < c:
            d, mx, my = c, nx, ny
            c, nx, ny = e, ex, ey
        elif e < d:
            d, mx, my = e, ex, ey
    return c, nx, ny, d, mx, my
