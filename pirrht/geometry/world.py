"""State what is free at a place x and a time t.

A `World` is one snapshot: the free space of the footprint among what is static, the goal's disc, and J moving obstacles
on a clock on which 0 is now. Sampler, proposals, replay and feedback law share it, so a new map or a new prediction is
one assignment of a new snapshot. In a static world J = 0.

Examples:
    >>> import numpy as np
    >>> from pirrht import FreeSpace, Scene
    >>> room = {"lower": (0, 0), "upper": (4, 3), "start": (0.6, 1.4), "goal": (3.4, 1.5, 0.3)}
    >>> world = FreeSpace.of(Scene.from_boxes([[1.6, 1.1, 2.4, 1.9]], robot_radius=0.2, **room)).world
    >>> world.moving.J
    0
    >>> round(world.clearance((1.2, 1.5)), 3)  # the box is 0.4 m away from the centre of a robot of 0.2 m [m]
    0.2
    >>> world.off_walls(np.array([1.45, 1.5]), (0, 1), 0.0, 0.01).round(2).tolist()
    [1.39, 1.5]
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Goal
from pirrht.geometry.space import Space
from pirrht.jit.jit import inlined

Pose = tuple[float, ...]
# Numbers of a moving wall: clearance [m], direction away (x, y, heading; in space x, y, z), velocity there (x, y; z too
# in space) [m/s].
WALL = 7


class MovingKernels(NamedTuple):
    """Kernels that rollouts, proposals and edges call among moving obstacles; all take their numbers (`Moving`) first.

    `watch` is scratch of one path after another; only the kernels know its fields. Rows of walls are clearance [m],
    direction away (x, y, heading), zero inside, and velocity there (x, y) [m/s]. Poses are those of the footprint's
    member (`geometry.space`), without a heading where that does not matter; times are in [s].
    """

    watch: Any  # (moving): allocate scratch
    begin: Any  # (watch): begin another path
    # (moving, watch, pose, t, within, out (J, WALL)): write the walls nearer than `within` [m] to rows; return how
    # many, and until when they keep their velocities and no obstacle is suddenly elsewhere.
    walls: Any
    # (moving, watch, (pose, moved), t, dt, cov, (most, weighed), state, out (J, WALL)): judge a noisy step of a
    # covariance (xx, xy, xt, yy, yt, tt), the most variance of a clearance [m^2], whether survival is weighed. Return
    # the next state of the random sequence, the share at which one is met, its wall being row 0, or NEVER, and log
    # survival [nats].
    bridge: Any
    # (moving, watch, (pose, moved, turn), t, dt, stop): share at which a step without position noise, an arc that
    # turns [rad], meets one, or NEVER; a share `stop` is judged.
    sweep: Any
    clearance: Any  # (moving, pose, t): clearance from the nearest [m]
    # (moving, (ax, ay, s, bx, by, t), heading): FREE, BLOCKED or UNSURE for a straight step from a at s to b at t; with
    # az and bz in space
    certify: Any
    certify_turn: Any  # (moving, pose, angle, t): the same for a turn on the spot at a time; None without a heading


@inlined
def unwatched(moving):  # type: ignore[no-untyped-def]
    """Note nothing where nothing moves."""
    return 0


NOTHING_MOVES: Any = MovingKernels(unwatched, *[None] * 7)  # what kernels name in place of None, and never call


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

    def clearance(self, pose: Pose, t: float) -> float:
        """Return the clearance of a pose from the nearest [m]."""

    def walls(self, pose: Pose, t: float, within: float) -> Array:
        """Return clearance, direction away and velocity there of those `within` [m], (k, WALL)."""

    def distance(self, pose: Array, t: float) -> float:
        """Return the exact clearance of a pose (2,) or (3,)."""

    def meets(self, a: Array, s: float, b: Array, t: float) -> bool:
        """Return whether a straight step between poses, from a at s to b at t, meets one, exactly where in doubt."""

    def with_motions(self, movers: Sequence[Mover]) -> "Moving":
        """Return the obstacles on other motions; one thread at a time may query either."""


class NoMoving(NamedTuple):
    """Moving obstacles of a static world: none."""

    J: int = 0
    speed: float = 0.0

    @property
    def kernels(self) -> None:
        """Kernels that are compiled leave moving obstacles out."""

    def clearance(self, pose: Pose, t: float) -> float:
        """Nothing is near."""
        return np.inf

    def walls(self, pose: Pose, t: float, within: float) -> Array:
        """Return no rows, (0, WALL)."""
        return np.empty((0, WALL))

    def distance(self, pose: Array, t: float) -> float:
        """Nothing is near."""
        return np.inf

    def meets(self, a: Array, s: float, b: Array, t: float) -> bool:
        """No step meets anything."""
        return False

    def with_motions(self, movers: Sequence[Mover]) -> "NoMoving":
        """Nothing moves."""
        return self


class World(NamedTuple):
    """A snapshot of what is free at (x, t), as numbers and addresses that kernels take cheaply."""

    static: Any  # of static obstacles and border, for one footprint (`Space`)
    goal: tuple[float, ...]  # centre of the goal's disc, or in space ball [m]
    radius: float  # of it [m]
    moving: Any  # J moving obstacles (`Moving`)

    @classmethod
    def of(cls, static: Space, goal: Goal, moving: Moving) -> "World":
        """Take a snapshot of a static space, a goal of centre (d,) [m] and moving obstacles."""
        return cls(static, tuple(goal.center.tolist()), float(goal.radius), moving)

    def clearance(self, pose: Pose, t: float = 0.0) -> float:
        """Return a lower bound of the clearance of a pose from all walls at t [s], [m]."""
        return min(float(self.static.kernels.clearance(self.static, pose)), float(self.moving.clearance(pose, t)))

    def off_walls(self, x: Array, reads: Sequence[int], t: float, gap: float) -> Array:
        """Return the nearest state to x (n,) where plans can begin at t [s], `gap` [m] off walls; it `reads` its pose.

        It is x itself unless noise has carried the robot into the safety margin.
        """
        at = list(reads)
        for _ in range(4):  # a second wall may be near
            pose = tuple(x[at].tolist())
            if self.clearance(pose, t) > 0.0:
                break
            nearest, direction, *_ = self.static.kernels.walls(self.static, pose)
            c = float(nearest)
            away = np.array(direction, dtype=float)
            for row in self.moving.walls(pose, t, c):
                if row[0] < c:
                    c = row[0]
                    away[:] = row[1 : 1 + len(away)]
            x = x.copy()
            x[at] += (gap - c) * steepest(away)
        return x


def steepest(direction: Array) -> Array:
    """Return the change of pose (k,) along a direction, a gradient of clearance, that raises clearance by 1 m."""
    return direction if len(direction) == 2 else direction / max(float(direction @ direction), 1e-12)


@cache
def merging(numbers: int) -> Any:
    """Build the kernel (walls, near, count, widest) that returns the two nearest walls of static and moving ones.

    `walls` are two static ones of poses of so many `numbers`; `count` rows of `near` (J, WALL) move, and are no nearer
    than `widest` [m].
    """

    direction = inlined(lambda near, k: (np.float32(near[k, 1]), np.float32(near[k, 2])))
    if numbers == 3:
        direction = inlined(lambda near, k: (np.float32(near[k, 1]), np.float32(near[k, 2]), np.float32(near[k, 3])))

    @inlined
    def merged(walls, near, count, widest):  # type: ignore[no-untyped-def]
        c, n, d, m = walls
        for k in range(count):
            e = np.float32(max(near[k, 0], widest))
            if e < c:
                d, m = c, n
                c, n = e, direction(near, k)
            elif e < d:
                d, m = e, direction(near, k)
        return c, n, d, m

    return merged
