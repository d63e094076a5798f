"""Prediction of moving obstacles whose motions are unknown.

A robot sees poses and velocities; it predicts constant velocities and turn rates. A prediction holds until an
observation contradicts it: then it is updated, with a new tree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.freespace import FreeSpace
from pirrht.geometry.motion import Motion, Mover
from pirrht.geometry.passages import Passages
from pirrht.planner.tree import HomologyTree
from pirrht.steering.legs import Legs
from pirrht.steering.in_time import InTime
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.in_time import TimedHomology

OFF = 0.005  # an obstacle that is farther from its prediction contradicts it [m]
SOON = 1.0  # as does one that by its velocity will be ten times as far off after this time [s]
AHEAD = 2.0  # horizon, in times to cross the workspace at the best speed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """A prediction, on a clock of its own."""

    space: FreeSpace
    homology: TimedHomology
    tree: HomologyTree | None  # None: none is required
    since: float  # when its clock starts, on that of the drive [s]


class Predictor(Protocol):
    """Predicts moving obstacles."""

    def begin(self) -> None:
        """Forget the last prediction; a new drive begins."""

    def at(self, x: Array, seen: float, enough: Callable[[int], bool] | None = None) -> Prediction:
        """Return the prediction of a robot that has seen all until `seen` [s] and plans at x (n,).

        Args:
            enough: whether time is too short to grow a tree of so many vertices further; None: it never is.
        """


class ConstantVelocity:
    """Predicts constant velocities.

    Args:
        space: the scene, whose obstacles are queried for poses and velocities, and for nothing else.
        steering: of trees.
        grown: a tree that has its roots only, for a space; None: there are no trees.
        vertices: of each tree.
    """

    def __init__(
        self, space: FreeSpace, steering: InTime, grown: Callable[[FreeSpace], HomologyTree] | None, *, vertices: int
    ) -> None:
        self.space, self.steering, self.grown, self.vertices = space, steering, grown, vertices
        self.horizon = AHEAD * float(np.hypot(*(space.scene.upper - space.scene.lower))) / steering.pace
        self._passages: Passages | None = None
        self._shapes: FreeSpace | None = None
        self._last: Prediction | None = None

    def begin(self) -> None:
        """Forget the last prediction; a new drive begins."""
        self._last = None

    def at(self, x: Array, seen: float, enough: Callable[[int], bool] | None = None) -> Prediction:
        """Return the prediction of a robot that has seen all until `seen` [s] and plans at x (n,)."""
        if self._last is None or not self._holds(self._last, seen):
            self._last = self._foretold(x, seen, enough)
        return self._last

    def _holds(self, last: Prediction, seen: float) -> bool:
        """Check that obstacles move as predicted."""
        for actual, foretold in zip(self.space.scene.movers, last.space.scene.movers, strict=True):
            then = seen - last.since
            off = actual.motion.pose(seen) - foretold.motion.pose(then)
            faster = actual.motion.velocity(seen) - foretold.motion.velocity(then)
            if np.linalg.norm(off) > OFF or np.linalg.norm(faster) * SOON > 10.0 * OFF:
                return False
        return True

    def _foretold(self, x: Array, seen: float, enough: Callable[[int], bool] | None) -> Prediction:
        movers = [straight_on(mover, seen, self.horizon) for mover in self.space.scene.movers]
        start = np.array([x[0], x[1], self.space.scene.start[2]])
        if self._shapes is None:
            self._shapes = self.space.among(movers)  # FCL's of its own: a drive queries those of the scene meanwhile
        space = replace(self._shapes, scene=replace(self.space.scene, start=start)).foretold(movers)
        homology, tree = self.steering.homology(space), self._tree(space, enough)
        return Prediction(space=space, homology=homology, tree=tree, since=seen)

    def _tree(self, space: FreeSpace, enough: Callable[[int], bool] | None) -> HomologyTree | None:
        if self.grown is None:
            return None
        tree = self.grown(space)
        if self._passages is None:
            self._passages = tree.passages
        tree.passages = self._passages  # static
        tree.grow(self.vertices, enough=enough)
        return tree


def straight_on(mover: Mover, time: float, horizon: float) -> Mover:
    """Return an obstacle of constant velocity from a time on, up to the horizon [s], on a clock that starts then."""
    pose, velocity = np.array(mover.motion.pose_at(time)), mover.motion.velocity(time)
    rows = np.array([[0.0, *pose], [horizon, *(pose + horizon * velocity)]])
    return replace(mover, motion=Motion(rows=rows))


@dataclass(slots=True)
class FavouritePath:
    """Path of the last plan's favourite, by which classes are identified under another prediction."""

    rows: Array | None = None  # (k, 3) [m, m, s] on the drive's clock

    def note(self, plan: Plan) -> None:
        """Record the path of a plan's favourite."""
        chosen = dict(zip(plan.ids, plan.references, strict=True)).get(plan.favourite or "")
        if chosen is not None:
            self.rows = _timed(chosen.trajectory, plan.time)

    def left(self, x: Array, time: float) -> Array | None:
        """Return the path ahead of x (n,) at a time [s], (k, 3) [m, m, s]."""
        if self.rows is None:
            return None
        return np.vstack([[*x[:2], time], self.rows[self.rows[:, 2] > time]])


def _timed(way: Trajectory, begin: float) -> Array:
    """Return places and times of a path that begins at a time [s], its end included, (k, 3) [m, m, s]."""
    if isinstance(way.path, Legs):
        knots = way.path.knots
        shift = np.array([0.0, 0.0, begin - knots[0, 2]])
        return np.asarray(knots + shift)
    places = np.vstack([way.path.tails[:, :2], way.path.heads[-1:, :2]])
    times = begin + np.concatenate([[0.0], np.cumsum(way.durations)])
    return np.column_stack([places, times])
