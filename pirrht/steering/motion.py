"""Define motions between two states: the interface that the tree queries of an edge."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import Field
from pirrht.jit.jit import inlined
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.crossings import Cuts, straight_turns


class Surroundings(NamedTuple):
    """A scene as kernels that judge or shorten motions take it."""

    field: Field
    cuts: Cuts
    markers: Array  # (M, 2) [m]
    weights: NDArray[np.int64]  # (M,) additive keys of one turn around each marker
    goal_x: float  # goal point [m]
    goal_y: float
    reach: float  # radius of the goal's disc [m]
    radius: float  # least turning radius of what is shortened [m]

    @classmethod
    def of(cls, space: FreeSpace, radius: float = 0.0) -> Surroundings:
        """Take those of an examined scene, for paths that turn no tighter than `radius` [m]."""
        goal, homology = space.scene.goal, space.homology.static
        numbers = (float(v) for v in (*goal.center, goal.radius, radius))
        return cls(space.field, homology.cuts, homology.markers, homology.hash_weights, *numbers)


class Motions(Protocol):
    """k motions between two states each, as steering methods propose them; the rest is up to their kind."""

    @property
    def cost(self) -> Array:
        """Steering cost, (k,) [cost]; it need not be proportional to length."""

    @property
    def tails(self) -> Array:
        """First states, (k, n), x and y first [m]."""

    @property
    def heads(self) -> Array:
        """Last states, (k, n), x and y first [m]."""

    def points(self, spacing: float) -> list[Array]:
        """Each as a polyline (l, 2) [m], whose points lie at most `spacing` m apart where it turns."""


@inlined
def write_straight(around, x, out):  # type: ignore[no-untyped-def]
    """Write H of the straight line from a state x (n,) to the goal point to `out` (M,) [turns]."""
    markers = around.markers
    for k in range(out.shape[0]):
        out[k] = straight_turns(x[0], x[1], markers[k, 0], markers[k, 1], around.goal_x, around.goal_y)


class MotionKernels(NamedTuple):
    """Kernels for a record of motions, into which nothing else looks."""

    # (motions, into_goal (k,), around, status (k,), enters (k,)): FREE, BLOCKED or UNSURE by the clearance field, and
    # whether a motion enters the goal's disc; one that does is cut there and so is its cost, or BLOCKED if not
    # `into_goal`. How many are unsure.
    judge: Callable[..., int]
    # (motions, i, around, to_goal, marker, turn, count): append the pairs of whole turns that it adds to the class of
    # its head, or of the straight line from its end to the goal point; the number of pairs. A marker may recur.
    pairs: Callable[..., int]
    most: Callable[..., int]  # (motions): how often a marker can come up in the pairs of one motion
    straight: Callable[..., None] = write_straight  # (around, x (n,), out (M,)): H of the base from a state [turns]


class Motion(NamedTuple):
    """A kind of motions: how the tree judges `Motions` of it, and makes references of them."""

    kernels: MotionKernels
    record: Callable[[Any], Any]  # Motions as the record of arrays that the kernels take, which they may change
    ask: Callable[[Any, int, FreeSpace], bool]  # FCL's own word on motion i of a record
    until_goal: Callable[[Any, Any], Any]  # a path (consecutive motions) that ends where it enters the disc
    trajectory: Callable[[Any, Any], Trajectory]  # (steering, path): the controls that drive a path, and their times
    # (path, i, shares (l,)): states (l, n) that motion i passes after shares of it; (0, n) where that cannot be told
    between: Callable[[Any, int, Array], Array]
