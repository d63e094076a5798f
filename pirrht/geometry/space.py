"""State which places and poses of a robot are free of what is static: the interface of a footprint, and its kernels.

A member is a file of `geometry/`: a NamedTuple of numbers (`Space`), whose `kernels` read it. Kernels take a *pose*, a
tuple of the states that the member reads: the position, of 2 or 3 numbers [m], and if it `turns` the heading [rad] that
follows. A *direction* is a gradient of clearance in these numbers, (k,), with a part [m/rad] for the heading. A
*covariance* is that of a pose, its upper triangle by rows: (xx, xy, yy) of two numbers, (xx, xy, xt, yy, yt, tt) of
three. A *world* is a `geometry.world.World`: the numbers are its `static`, next to the goal.

Examples:
    >>> from pirrht import FreeSpace, Scene
    >>> from pirrht.geometry.space import FREE
    >>> room = {"lower": (0, 0), "upper": (4, 3), "start": (0.6, 1.4), "goal": (3.4, 1.5, 0.3)}
    >>> static = FreeSpace.of(Scene.from_boxes([[1.6, 1.1, 2.4, 1.9]], robot_radius=0.2, **room)).static
    >>> static.kernels.position, static.kernels.turns
    (2, False)
    >>> nearest, away, *_ = static.kernels.walls(static, (1.2, 1.5))
    >>> round(float(nearest), 3), tuple(round(float(part), 3) for part in away)
    (0.2, (-1.0, 0.0))
    >>> static.kernels.certify(static, (1.2, 1.5)) == FREE
    True
"""

from functools import cache
from typing import Any, NamedTuple, Protocol

from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import as_tuple, inlined, kernel, part
from pirrht.outcome import Outcome

FREE, UNSURE, BLOCKED = 1, 0, -1
LEAST_STEP = TUNING.least_step
INSIDE, GOAL, COLLISION = map(int, Outcome)  # INSIDE: no exit in this step, out of time after the last one
NEVER = 2.0  # share of a step at which nothing is met


class SpaceKernels(NamedTuple):
    """Kernels of one member, resolved when their callers compile; `static` are the member's numbers.

    Clearances are lower bounds [m], at most 0 where the pose may not be, and 1-Lipschitz in the position.
    """

    position: int  # numbers of a position, 2 or 3
    turns: bool  # whether a heading follows them in a pose
    isotropic: bool  # whether the fast path of points serves: a planar disc in a `Field`
    near_most: int  # rows that `near` may write

    clearance: Any  # (static, pose): clearance, border included
    place: Any  # (static, place): clearance at a position, whatever the heading
    # (static, pose): the two nearest walls as clearance, direction away, clearance, direction away; in single precision
    walls: Any
    known_walls: Any  # (static, pose, known): `walls` where `distances` are known
    # (static, pose, within, out (near_most, 1 + k or more)): write the walls nearer than `within` [m], clearance and
    # direction away; return how many.
    near: Any
    # (world, pose): clearance from obstacles, from the border, distance to the goal's rim [m], and what else the member
    # keeps for `facing` and `bridge`
    distances: Any
    # (static, pose, known, cov): clearance over the share of noise along a line that a wall faces [m]; `known` are the
    # distances there.
    facing: Any
    spread: Any  # (static, cov, line): most variance of a clearance [m^2]; `line`: of noise along a line
    extent: Any  # (static, change): how far a change of pose moves any point of the footprint at most [m]
    # (world, pose, moved, turn, clear): how a step without noise on the position ends, whose position takes an arc that
    # turns [rad] and whose heading changes evenly; no wall is nearer to its start than `clear` [m]. Return INSIDE, GOAL
    # or COLLISION, the share of the step until then, and the clearance at its end as far as is known.
    sweep: Any
    # (world, pose, moved, before, after, cov, weighed, state, line): judge a noisy step of a covariance, `distances`
    # before and after it; whether survival is weighed, and whether noise keeps to a line. Return the next state of the
    # random sequence, INSIDE, GOAL or COLLISION, the share until then, and log survival [nats].
    bridge: Any
    end: Any  # (world, pose): INSIDE, GOAL or COLLISION at the end of a step, by the pose alone
    exit: Any  # (world, pose, outcome): for points, distance [m] to the rim (GOAL) or wall, and direction towards it
    # (world, pose, cov): direction of noise along a line, distance along it to the goal's rim [m], and whether it keeps
    # to that line.
    rim: Any
    certify: Any  # (static, pose): FREE, BLOCKED or UNSURE
    certify_place: Any  # (static, place): FREE at any heading, BLOCKED at all of them, or UNSURE
    # (static, (ax, ay), (bx, by), patient): FREE, BLOCKED or UNSURE for a straight piece, headed along it; without
    # `patient` what is not FREE may be either of the others.
    certify_piece: Any
    # (static, start (3,), curvature (P,), length (P,), patient): a curve of `Curves`, headed along it
    certify_curve: Any
    certify_turn: Any = None  # (static, pose, turn, patient): a turn [rad] on the spot; None without a heading


class Space(Protocol):
    """Numbers of a member: a NamedTuple that kernels take."""

    @property
    def spacing(self) -> float:
        """Grain of its clearances [m]: a march advances by a share of it where they are unsure."""

    @property
    def kernels(self) -> SpaceKernels:
        """Return the kernels that read it."""


class StateKernels(NamedTuple):
    """Kernels of one member at states (n,), whose position, and heading if it turns, lie at some indices."""

    position: int  # numbers of a state's position, which come first
    pose: Any  # (x (n,)): the pose of a state; without a heading the place
    clearance: Any  # (static, x (n,)): clearance [m]
    certify: Any  # (static, x (n,)): FREE, BLOCKED or UNSURE


@cache
def pose_at(reads: tuple[int, ...]) -> Any:
    """Build the kernel (x (n,)) that takes the numbers at some indices, two or three, out of a state."""
    i, j, k = (*reads, 0)[:3]
    return part(lambda x: (x[i], x[j])) if len(reads) == 2 else part(lambda x: (x[i], x[j], x[k]))


@cache
def at_states(kernels: SpaceKernels, reads: tuple[int, ...]) -> StateKernels:
    """Build kernels of states of which these indices are read: of poses, or of places if a heading is missing."""
    pose = pose_at(reads)
    whole = len(reads) == kernels.position + kernels.turns
    clearance_of, certify_of = kernels.clearance, kernels.certify
    if not whole:
        clearance_of, certify_of = kernels.place, kernels.certify_place
    return StateKernels(
        kernels.position,
        pose,
        inlined(lambda static, x: clearance_of(static, pose(x))),
        inlined(lambda static, x: certify_of(static, pose(x))),
    )


@cache
def clearances_of(space: SpaceKernels) -> Any:
    """Build the kernel (static, points (k, d), out (k,)) that writes clearances [m]."""
    clearance, d = space.clearance, space.position

    @kernel
    def clearances(static, points, out):  # type: ignore[no-untyped-def]
        for k in range(len(points)):
            out[k] = clearance(static, as_tuple(points[k], d))

    return clearances
