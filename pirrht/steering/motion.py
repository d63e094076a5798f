"""Define motions between two states, which the tree queries of an edge, and trajectories, the controls that drive them.

Arcs and straight pieces at one speed are the motions of planar curves."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import TWO_PI, Curves, along, entry_of_curve, truncate
from pirrht.geometry.space import Space, SpaceKernels
from pirrht.geometry.world import Moving
from pirrht.jit.jit import inlined, kernel, part
from pirrht.problem import Problem
from pirrht.topology.signature import Signature, SignatureKernels, Table

SPACING = 0.05  # distance of points on drawn arcs [m]


class Legs(NamedTuple):
    """k straight motions in space and time at a constant speed, one row each; a leg of no length waits."""

    path: Array  # (k, 2d + 2): place (d,) [m], t [s] of both ends
    cost: Array  # (k,) integral of q + (r/2) |v|^2 [cost]; infinite where there is no such motion
    tails: Array  # (k, n) first states, place [m], t [s]
    heads: Array  # (k, n) last states; an open time is not a number

    @property
    def d(self) -> int:
        """Count the numbers of a place."""
        return int(self.path.shape[1] // 2 - 1)

    @property
    def knots(self) -> Array:
        """Begins of consecutive legs and the end of the last one, place and time, (k + 1, d + 1) [m, s]."""
        return np.vstack([self.path[:, : self.d + 1], self.path[-1:, self.d + 1 :]])

    @property
    def start(self) -> Array:
        """Begin and heading of each, x, y [m], heading [rad], (k, 3), or in space place and direction, (k, 6).

        Waiting ones have the next heading; if none moves it is 0, or upward.
        """
        span = self.path[:, self.d + 1 : -1] - self.path[:, : self.d]
        length = np.hypot.reduce(span, axis=1)
        moves = np.flatnonzero(length > 0.0)
        i = np.minimum(np.searchsorted(moves, np.arange(len(span))), max(len(moves) - 1, 0))
        ways = np.arctan2(span[:, 1], span[:, 0]) if self.d == 2 else span / np.maximum(length, 1e-300)[:, None]
        still = np.zeros(len(span)) if self.d == 2 else np.tile(np.eye(3)[-1], (len(span), 1))
        return np.column_stack([self.path[:, : self.d], ways[moves[i]] if len(moves) else still])

    def points(self, spacing: float) -> list[Array]:
        """Return both ends of each motion, (2, d) [m], and no points in between, whatever the `spacing`."""
        return [*self.path.reshape(len(self.path), 2, -1)[:, :, : self.d]]

    def places(self, times: Array) -> Array:
        """Place a path of consecutive legs at times (l,) [s], (l, d) [m]; it stays where it begins and ends."""
        *places, at = self.knots.T
        return np.column_stack([np.interp(times, at, axis) for axis in places])


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A deterministic path with the controls that drive it, piecewise constant in time."""

    controls: Array  # (l, m) control of each piece
    durations: Array  # (l,) [s]
    path: Any  # consecutive motions (`Motions`): along arcs, `Curves`
    cost: float  # steering cost [cost]
    length: float  # [m]
    slack: float | None = None  # where controls are not known but only the path: time to get under way at most [s]
    between: Any = None  # kernel of its motions, as in `MotionKernels`
    reads: tuple[int, ...] = (0, 1, 2)  # indices of a vertex' numbers that are a pose

    def __repr__(self) -> str:
        seconds = float(self.durations.sum())
        return f"Trajectory({self.length:.3g} m, {seconds:.3g} s, cost {self.cost:.4g})"

    @cached_property
    def points(self) -> Array:
        """The path as a polyline (k, 2), for pictures [m]; points on arcs are SPACING apart."""
        lines = self.path.points(SPACING)
        return np.vstack([lines[0], *(line[1:] for line in lines[1:])])

    def poses(self, count: int) -> Array:
        """Poses at equal distances along the path, (count, 3) [m, m, rad], for pictures; none of vertices without."""
        n = 0 if self.between is None else self.path.tails.shape[1]
        states = np.empty((count, n))
        if n <= max(self.reads):
            return np.empty((0, 3))
        passed = np.cumsum([0.0, *(np.hypot(*np.diff(line, axis=0).T).sum() for line in self.path.points(SPACING))])
        for state, at in zip(states, np.linspace(0.0, passed[-1], count), strict=True):
            i = min(int(np.searchsorted(passed, at, side="right")) - 1, len(self.path.tails) - 1)
            if not self.between(self.path, i, (at - passed[i]) / max(passed[i + 1] - passed[i], 1e-9), state):
                return np.empty((0, 3))
        return states[:, self.reads]

    def faster(self, times: float) -> "Trajectory":
        """Drive the path so many times as fast, for a system that controls move."""
        return replace(self, controls=times * self.controls, durations=self.durations / times)

    def tape(self, times: Array) -> Array:
        """Mean control of each step of a grid (T+1,) [s], (T, m); zero after the end (the paper's footnote)."""
        return step_means(self.controls, self.durations, np.append(0.0, np.cumsum(self.durations)), times)


def step_means(controls: Array, durations: Array, ends: Array, times: Array) -> Array:
    """Means (T, m) of controls (k, m), held for durations (k,) between `ends` (k+1,), over a grid (T+1,), all [s]."""
    sums = np.vstack([np.zeros(controls.shape[1]), np.cumsum(controls * durations[:, None], axis=0)])
    done = np.column_stack([np.interp(times, ends, each) for each in sums.T])
    return np.asarray(np.diff(done, axis=0) / np.diff(times)[:, None])


def running_cost(problem: Problem, x: Array, trajectory: Trajectory) -> float:
    """Integral of q + u'Ru/2 along a trajectory from x (n,) [cost]; without controls the steering's cost."""
    if trajectory.slack is not None:
        return trajectory.cost + 2.0 * problem.least_rate * trajectory.slack
    effort = 0.5 * np.einsum("lm,mk,lk->l", trajectory.controls, problem.control_cost(x), trajectory.controls)
    rate = problem.rate(x)
    if callable(problem.q):
        tail = x[2:]
        rate = float(np.mean([problem.rate(np.concatenate([p, tail])) for p in trajectory.points]))
    return float(np.sum((rate + effort) * trajectory.durations))


class Surroundings(NamedTuple):
    """A scene as kernels that judge or shorten motions take it; nothing in it moves for motions without times."""

    static: Space  # of the robot's footprint
    classes: Table  # of the signature
    weights: NDArray[np.int64]  # (M,) additive keys of one turn around each marker, moving ones last
    goal: tuple[float, ...]  # goal point (d,) [m]
    goal_radius: float  # radius of the goal's disc or ball [m]
    traffic: Moving  # J obstacles

    @classmethod
    def of(cls, space: FreeSpace, homology: Signature) -> "Surroundings":
        """Take an examined scene and the classes of paths in it."""
        goal = space.scene.goal
        return cls(
            static=space.static, classes=homology.table, weights=homology.hash_weights,
            goal=tuple(map(float, goal.center)), goal_radius=float(goal.radius), traffic=space.moving,
        )  # fmt: skip


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


_unknown = inlined(lambda motions, i, share, out: False)


class MotionKernels(NamedTuple):
    """Kernels of one kind of motions. Places on a motion are numbers of a measure of its own: [m], [s] or a share."""

    entry: Callable[..., float]  # (motions, i, around): where motion i enters the goal's disc; infinity if it does not
    cut: Callable[..., None]  # (motions, i, s): end motion i at s, and its cost
    # (motions, i, around, patient): FREE, BLOCKED or UNSURE by certified clearances; without `patient` what is not FREE
    # may be either of the others.
    certify: Callable[..., int]
    # (motions, i, around, to_goal, marker, turn, count): append the pairs of whole turns that it adds to the class of
    # its head, or of the straight line from its end to the goal point; the number of pairs. A marker may recur.
    pairs: Callable[..., int]
    most: Callable[..., int]  # (motions): how often a marker can come up in the pairs of one motion
    # (motions, i, share, out (n,)): write the state after a share of it, if that is known
    between: Callable[..., bool] = _unknown


class MotionKind(NamedTuple):
    """A kind of motions: how the tree judges `Motions` of it, and makes references of them."""

    kernels: Callable[[Any], MotionKernels]  # (surroundings): by kernels of their footprint and classes
    free: Callable[[Any, int, FreeSpace], bool]  # FCL's verdict on motion i
    trajectory: Callable[[Any, Any], Trajectory]  # (steering, path): the controls that drive a path, and their times


def copied(motions: Any) -> Any:
    """Copy motions, so that kernels may cut them."""
    return type(motions)(*(np.array(part, dtype=float, order="C") for part in motions))


@part
def _length(curves, i):  # type: ignore[no-untyped-def]
    length = 0.0
    for p in range(curves.length.shape[1]):
        length += curves.length[i, p]
    return length


@part
def _entry(curves, i, around):  # type: ignore[no-untyped-def]
    start = curves.start[i]
    x, y = around.goal
    radius = around.goal_radius

    if math.hypot(start[0] - x, start[1] - y) > 1.001 * (radius + _length(curves, i)):
        return np.inf
    return entry_of_curve(start, curves.curvature[i], curves.length[i], x, y, radius)


@part
def _cut(curves, i, s):  # type: ignore[no-untyped-def]
    whole = _length(curves, i)
    truncate(curves.length[i], s, curves.length[i])
    curves.cost[i] *= _length(curves, i) / max(whole, 1e-300)  # a curve of no length costs nothing


@cache
def _pairs_of(classes: SignatureKernels) -> Any:
    """Build the kernel that counts the turns of curves, by kernels of a signature."""
    add = classes.arcs

    @part
    def pairs(curves, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
        curve = (curves.start[i], curves.curvature[i], curves.length[i])

        return add(around.classes, curve, to_goal, (curves.heads[i, 0], curves.heads[i, 1]), marker, turn, count)

    return pairs


@kernel
def _between(curves, i, share, out):  # type: ignore[no-untyped-def]
    """Write a position, or a pose of a system of three states whose third is the heading."""
    n = out.shape[0]
    length = curves.length[i]
    left = share * _length(curves, i)

    x = curves.start[i, 0]
    y = curves.start[i, 1]
    theta = curves.start[i, 2]

    if n > 3 or (n == 3 and abs(math.sin(0.5 * (curves.tails[i, 2] - theta))) > 1e-6):  # the third is no heading
        return False
    for p in range(length.shape[0]):
        x, y, theta = along(x, y, theta, curves.curvature[i, p], min(left, length[p]))
        left = max(0.0, left - length[p])
    out[:2] = (x, y)
    if n == 3:
        out[2] = theta - TWO_PI * math.floor((theta + math.pi) / TWO_PI)
    return True


def _free(curves: Curves, i: int, space: FreeSpace) -> bool:
    """Ask FCL: one swept capsule where a curve is straight, bisection where it turns."""
    collision = space.collision
    length = curves.length[i]
    pose = tuple(curves.start[i].tolist())

    for kappa, total in zip(curves.curvature[i].tolist(), length.tolist(), strict=True):
        if total <= 0 and not np.all(length <= 0):
            continue
        end = along(*pose, kappa, total)
        if kappa == 0:
            free = bool(collision.segments_free(np.array([pose[:2]]), np.array([end[:2]]))[0])
        else:
            free = collision.arc_free(pose, kappa, total)
        if not free:
            return False
        pose = end
    return True


def _trajectory(steering: Any, path: Curves) -> Trajectory:
    """Make piecewise constant controls along a path whose rows are consecutive curves."""
    turned = path.curvature * path.length
    heading = path.start[:, 2:] + np.cumsum(turned, axis=1) - turned
    length = path.length.ravel()
    keep = path.length.ravel() > 0
    total = float(length.sum())
    return Trajectory(
        controls=steering.controls(heading.ravel()[keep], path.curvature.ravel()[keep]),
        durations=length[keep] / steering.speed, path=path, cost=total * steering.cost_per_meter, length=total,
        between=_between,
    )  # fmt: skip


_most = inlined(lambda curves: curves.length.shape[1])


@cache
def _certify_for(space: SpaceKernels) -> Any:
    """Build the kernel that certifies curves, by kernels of a footprint."""
    certify_curve = space.certify_curve
    return part(
        lambda curves, i, around, patient: certify_curve(
            around.static, curves.start[i], curves.curvature[i], curves.length[i], patient
        )
    )


def _kernels(around: Surroundings) -> MotionKernels:
    return MotionKernels(
        _entry, _cut, _certify_for(around.static.kernels), _pairs_of(around.classes.kernels), _most, _between
    )


ARCS = MotionKind(_kernels, _free, _trajectory)
