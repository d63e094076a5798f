"""Prediction of moving obstacles whose motions are unknown.

A robot sees poses and velocities; it predicts constant velocities and turn rates. A prediction holds until an
observation contradicts it: then it is updated, with a new tree.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.settings import TUNING, ControlTuning
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.passages import Passages
from pirrht.planner.tree import HomologyTree
from pirrht.steering.in_time import InTime
from pirrht.topology.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Predict moving obstacles on a clock of its own: one snapshot for sampler, proposals, tree and feedback."""

    space: FreeSpace
    homology: Signature
    tree: HomologyTree | None  # None: none is required
    since: float  # when its clock starts, on that of the run [s]


class ConstantVelocity:
    """Predicts constant velocities of a scene's obstacles, which are queried for poses and velocities only.

    Trees, if `grown` makes one with roots only for a space, have so many `vertices` by `steering`; `tuning` says how
    far obstacles may deviate from a prediction, and its horizon.
    """

    def __init__(
        self, space: FreeSpace, steering: InTime, grown: Callable[[FreeSpace], HomologyTree] | None, *, vertices: int,
        tuning: ControlTuning = TUNING,
    ) -> None:  # fmt: skip
        self.space = space
        self.steering = steering
        self.grown = grown
        self.vertices = vertices
        self.tuning = tuning

        self.horizon = tuning.crossings * float(np.hypot.reduce(space.scene.upper - space.scene.lower)) / steering.pace
        self._passages: Passages | None = None
        self._shapes: FreeSpace | None = None
        self._last: Prediction | None = None

    def begin(self) -> None:
        """Forget the last prediction; a new run begins."""
        self._last = None

    def at(self, x: Array, seen: float, enough: Callable[[int], bool] | None = None) -> Prediction:
        """Return the prediction for a robot at x (n,) that has seen all until `seen` [s]; trees grow until `enough`."""
        if self._last is None or not self._holds(self._last, seen):
            movers = [straight_on(mover, seen, self.horizon) for mover in self.space.scene.movers]
            place = x[: self.space.scene.dimension]
            start = np.append(place, self.space.scene.start[len(place) :])
            if self._shapes is None:
                self._shapes = self.space.with_movers(movers)  # FCL's of its own: a run queries the scene's
            space = replace(self._shapes, scene=replace(self.space.scene, start=start)).with_prediction(movers)
            self._last = Prediction(
                space=space, homology=self.steering.homology(space), tree=self._tree(space, enough), since=seen
            )
        return self._last

    def _holds(self, last: Prediction, seen: float) -> bool:
        """Check that obstacles move as predicted."""
        for actual, predicted in zip(self.space.scene.movers, last.space.scene.movers, strict=True):
            off = actual.motion.pose(seen) - predicted.motion.pose(seen - last.since)
            faster = actual.motion.velocity(seen) - predicted.motion.velocity(seen - last.since)
            later = np.linalg.norm(faster) * self.tuning.deviation_ahead
            if max(np.linalg.norm(off), 0.1 * later) > self.tuning.deviation:
                return False
        return True

    def _tree(self, space: FreeSpace, enough: Callable[[int], bool] | None) -> HomologyTree | None:
        if self.grown is None:
            return None
        tree = self.grown(space)
        if self._passages is None:
            self._passages = tree.passages
        tree.passages = self._passages  # those of static obstacles, which no prediction changes
        tree.grow(self.vertices, enough=enough)
        return tree


def straight_on(mover: Mover, time: float, horizon: float) -> Mover:
    """Return an obstacle of constant velocity from a time on, up to the horizon [s], on a clock that starts then."""
    return replace(mover, motion=mover.motion.straight_on(time, horizon))


def favourite_path(plan: Plan) -> Array | None:
    """Return the path of a plan's favourite, (k, d + 1) [m, s] on the clock of the run; None if it has none."""
    chosen = dict(zip(plan.ids, plan.references, strict=True)).get(plan.favourite or "")
    if chosen is None:
        return None
    path, times = chosen.trajectory.path, plan.time + np.append(0.0, np.cumsum(chosen.trajectory.durations))
    d = chosen.trajectory.points.shape[1]
    return np.column_stack([np.vstack([path.tails[:, :d], path.heads[-1:, :d]]), times])
