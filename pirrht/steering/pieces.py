"""Connect points in space by straight pieces: the optimum of a ball without inertia, and references of other systems.

What `straight_line` does in the plane, with vertices of three numbers; a piece is known by its two ends.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages
from pirrht.geometry.pieces import D, Pieces, apart, share_into_ball
from pirrht.geometry.scene import Scene
from pirrht.geometry.space import SpaceKernels
from pirrht.jit.jit import inlined, kernel
from pirrht.steering.motion import MotionKernels, MotionKind, Surroundings, Trajectory
from pirrht.steering.straight_line import StraightLine, Tracked
from pirrht.steering.tuning import TUNING
from pirrht.topology.signature import SignatureKernels


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    return apart(tail, head) * numbers[0]


@kernel
def connect_pieces(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by one straight piece; the number is the cost per meter."""
    k = tails.shape[0]
    found = Pieces(np.empty((k, 2 * D)), np.empty(k), tails, heads)
    for i in range(k):
        found.path[i, :D] = tails[i]
        found.path[i, D:] = heads[i]
        found.cost[i] = apart(tails[i], heads[i]) * numbers[0]
    return found


@inlined
def _ends(pieces, i):  # type: ignore[no-untyped-def]
    p = pieces.path
    return (p[i, 0], p[i, 1], p[i, 2]), (p[i, 3], p[i, 4], p[i, 5])


@inlined
def _entry(pieces, i, around):  # type: ignore[no-untyped-def]
    a, b = _ends(pieces, i)
    return share_into_ball(a, b, around.goal, around.goal_radius)


@inlined
def _cut(pieces, i, share):  # type: ignore[no-untyped-def]
    for k in range(D):
        pieces.path[i, D + k] = pieces.path[i, k] + share * (pieces.path[i, D + k] - pieces.path[i, k])
    pieces.cost[i] *= share


@inlined
def _between(pieces, i, share, out):  # type: ignore[no-untyped-def]
    """Write a place on a piece, which is the whole state of a vertex."""
    for k in range(D):
        out[k] = pieces.path[i, k] + share * (pieces.path[i, D + k] - pieces.path[i, k])
    return True


@cache
def _pairs_of(classes: SignatureKernels) -> Any:
    """Build the kernel that counts the turns of pieces, by kernels of a signature."""
    crossings = classes.crossings

    @kernel
    def pairs(pieces, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
        a, b = _ends(pieces, i)
        return crossings(around.classes, (*a, 0.0), (*b, 0.0), to_goal, marker, turn, count)

    return pairs


@cache
def _certify_for(space: SpaceKernels) -> Any:
    """Build the kernel that certifies pieces, by kernels of a footprint."""
    certify_piece = space.certify_piece

    @kernel
    def certify(pieces, i, around, patient):  # type: ignore[no-untyped-def]
        a, b = _ends(pieces, i)
        return certify_piece(around.static, a, b, patient)

    return certify


def _free(pieces: Pieces, i: int, space: FreeSpace) -> bool:
    """Ask FCL for one swept sphere."""
    a, b = pieces.path[i].reshape(2, 1, D)
    return bool(space.collision.segments_free(a, b)[0])


def _trajectory(steering: Any, path: Pieces) -> Trajectory:
    """Make one control for each piece, the velocity along it."""
    step = path.path[:, D:] - path.path[:, :D]
    length = np.linalg.norm(step, axis=1)
    moves = length > 0.0
    return Trajectory(
        controls=steering.pace * step[moves] / length[moves, None], durations=length[moves] / steering.pace, path=path,
        cost=float(path.cost.sum()), length=float(length.sum()),
    )  # fmt: skip


_most = inlined(lambda pieces: 1)


def _kernels(around: Surroundings) -> MotionKernels:
    certify = _certify_for(around.static.kernels)
    return MotionKernels(_entry, _cut, certify, _pairs_of(around.classes.kernels), _most, _between)


PIECES = MotionKind(_kernels, _free, _trajectory)


def in_ball(radius: float, chances: Array) -> Array:
    """Return places (k, 3) in a ball of a radius [m] around 0, uniform as chances (k, 3) are."""
    depth = radius * chances[:, 0] ** (1.0 / D)
    height = 2.0 * chances[:, 1] - 1.0
    angle = 2.0 * np.pi * chances[:, 2]
    level = np.sqrt(1.0 - height**2)
    return np.asarray(depth[:, None] * np.column_stack([level * np.cos(angle), level * np.sin(angle), height]))


STEPS = np.arange(TUNING.fan + 1) / TUNING.fan
SHARES = np.array([(s * (1.0 - t), s * t) for s in STEPS for t in STEPS])  # of both sides of a triangle


class InSpace:
    """Draw places, and connect them by pieces, as lines in space do and those in the plane do not."""

    n = D
    motion = PIECES
    cost = _cost
    optimum = connect_pieces

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """Draw a place (3,) [m], uniform in the workspace."""
        return np.asarray(rng.uniform(scene.lower, scene.upper))

    def draws(
        self, space: FreeSpace, rng: np.random.Generator, count: int, origin: Array | None = None,
        goal_share: float = 0.0,
    ) -> Array:  # fmt: skip
        """Draw places (count, 3) [m] for a tree, uniform ones; a `goal_share` of them is moved into the goal's ball."""
        scene, goal = space.scene, space.scene.goal
        chances = rng.random((count, 2 * D + 1))  # a row for each: equal in parts and at once
        drawn = scene.lower + (scene.upper - scene.lower) * chances[:, :D]
        inside = chances[:, D] < goal_share

        drawn[inside] = (goal.center + in_ball(goal.radius, chances[:, D + 1 :]))[inside]
        return drawn

    def offers(self, passages: Passages, space: FreeSpace, origin: Array | None = None) -> Array:
        """Return places (l, 3) [m] that a tree draws first: where each loop of obstacles leaves most room, and around.

        Random draws hardly find a window that is little larger than the robot.
        """
        found = [np.empty((0, D))]
        for loop in space.homology.static.loops:  # type: ignore[attr-defined]  # classes in space are about loops
            middle = loop.mean(axis=0)
            sides = zip(loop, np.roll(loop, -1, axis=0), strict=True)
            fan = np.vstack([middle + SHARES @ np.array([one - middle, other - middle]) for one, other in sides])
            inside = np.all((fan > space.scene.lower) & (fan < space.scene.upper), axis=1)
            if not inside.any():
                continue
            widest = fan[inside][np.argmax(space.collision.clearance(fan[inside]))]
            normal = np.linalg.svd(loop - middle)[2][-1]
            around = widest + space.scene.robot_radius * np.outer(TUNING.loop_places, normal)
            found.append(around[[space.free(place) for place in around]])
        return np.vstack(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpaceLine(InSpace, StraightLine):
    """The optimum of a single integrator in space: a straight line at the speed that balances q against u'Ru/2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackedInSpace(InSpace, Tracked):
    """Straight lines at one pace between places in space, for systems that move otherwise."""

    several = True

    position: tuple[int, ...] = (0, 1, 2)
