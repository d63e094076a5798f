"""Define motions between two states: the interface that the tree queries of an edge."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import Field
from pirrht.geometry.world import Moving
from pirrht.jit.jit import inlined
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.crossings import Cuts
from pirrht.topology.homology import Homology
from pirrht.topology.moving_crossings import BaseCache
from pirrht.topology.tracks import MarkerTrajectories


class Surroundings(NamedTuple):
    """A scene as kernels that judge or shorten motions take it; nothing in it moves for motions without times."""

    field: Field
    cuts: Cuts
    markers: Array  # (M - J, 2) of static obstacles [m]
    weights: NDArray[np.int64]  # (M,) additive keys of one turn around each marker, moving ones last
    goal_x: float  # goal point [m]
    goal_y: float
    goal_radius: float  # radius of the goal's disc [m]
    traffic: Moving  # J obstacles
    tracks: MarkerTrajectories  # of J moving markers
    speed: float  # of bases [m/s]
    bases: BaseCache  # kept ones

    @classmethod
    def of(cls, space: FreeSpace, homology: Homology) -> Surroundings:
        """Take an examined scene and the classes of paths in it."""
        x, y = space.scene.goal.center.tolist()
        return cls(
            field=space.field, cuts=homology.cuts, markers=homology.markers, weights=homology.hash_weights, goal_x=x,
            goal_y=y, goal_radius=float(space.scene.goal.radius), traffic=space.moving, tracks=homology.tracks,
            speed=homology.speed, bases=BaseCache.empty(homology.J, 0),
        )  # fmt: skip

    def caching(self) -> Surroundings:
        """Add room for the bases of a growing graph's vertices; for one thread at a time."""
        return self._replace(bases=BaseCache.empty(self.tracks.J)) if self.tracks.J else self


class Motions(Protocol):
    """k motions between two states each: a NamedTuple of arrays with k rows, which kernels take."""

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
def unprepared(motions, around):  # type: ignore[no-untyped-def]
    """Prepare nothing for `certify`."""
    return 0


class MotionKernels(NamedTuple):
    """Kernels of one kind of motions. Places on a motion are numbers of a measure of its own: [m], [s] or a share."""

    entry: Callable[..., float]  # (motions, i, around): where motion i enters the goal's disc; infinity if it does not
    cut: Callable[..., None]  # (motions, i, s): end motion i at s, and its cost
    certify: Callable[..., int]  # (motions, i, around, prepared): FREE, BLOCKED or UNSURE by the clearance field
    sure: Callable[..., bool]  # (motions, i, around): whether that is FREE; it need not tell blocked from unsure
    # (motions, i, around, to_goal, marker, turn, count): append the pairs of whole turns that it adds to the class of
    # its head, or of the straight line from its end to the goal point; the number of pairs. A marker may recur.
    pairs: Callable[..., int]
    most: Callable[..., int]  # (motions): how often a marker can come up in the pairs of one motion
    between: Callable[..., bool]  # (motions, i, share, out (n,)): write the state after a share of it, if that is known
    prepare: Callable[..., Any] = unprepared  # (motions, around): for `certify`, once for all motions


class Motion(NamedTuple):
    """A kind of motions: how the tree judges `Motions` of it, and makes references of them."""

    kernels: MotionKernels
    free: Callable[[Any, int, FreeSpace], bool]  # FCL's verdict on motion i
    trajectory: Callable[[Any, Any], Trajectory]  # (steering, path): the controls that drive a path, and their times


def copied(motions: Any) -> Any:
    """Copy motions, so that kernels may cut them."""
    return type(motions)(*(np.array(part, dtype=float, order="C") for part in motions))
