"""Connect poses by a turn, a straight line and a turn: references of robots with corners that have no steering.

A robot that is no disc is free in some headings only, so the tree of its references has poses for vertices. Along a
line the robot is headed forwards, or backwards if it can reverse and then turns less. At its ends it turns on the spot,
over all headings in between: what drives the reference later may turn on an arc near there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import TWO_PI, Curves, backwards, turns_of, wrapped
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.geometry.space import SpaceKernels
from pirrht.geometry.world import NoMoving
from pirrht.jit.jit import inlined, kernel, part
from pirrht.problem import Problem
from pirrht.steering.legs import free_turning, is_free_turning
from pirrht.steering.motion import ARCS, MotionKernels, MotionKind, Surroundings, Trajectory
from pirrht.steering.straight_line import Tracked, connect_lines, velocity_at
from pirrht.steering.tuning import TUNING


class Turned(NamedTuple):
    """k straight lines with turns at both ends, one row each; `Curves` with what they cost."""

    start: Array  # (k, 3) x, y [m], heading of travel [rad]
    curvature: Array  # (k, 1) 0
    length: Array  # (k, 1) [m]
    cost: Array  # (k,) [cost]
    tails: Array  # (k, 3) first poses
    heads: Array  # (k, 3) last poses
    price: Array  # (k, 2) cost per meter and per radian

    def points(self, spacing: float) -> list[Array]:
        """Each line as its ends (2, 2) [m]."""
        return Curves(*self[:6]).points(spacing)


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    dx = head[0] - tail[0]
    dy = head[1] - tail[1]
    least = math.sqrt(dx * dx + dy * dy) * numbers[0]
    if least >= limit:
        return np.inf
    way = math.atan2(dy, dx) if least > 0.0 else tail[2]
    turn = turns_of(way, tail[2], head[2])
    if numbers[2] > 0.0:
        turn = min(turn, turns_of(way + math.pi, tail[2], head[2]))
    return least + numbers[1] * turn


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair; the numbers are the costs per meter and radian, and 1 for a robot that reverses, else 0."""
    lines = connect_lines(tails, heads, numbers)
    price = np.empty((len(tails), 2))
    for i in range(len(tails)):
        if lines.length[i, 0] == 0.0:
            lines.start[i, 2] = tails[i, 2]
        way = lines.start[i, 2]
        price[i, 0] = numbers[0]
        price[i, 1] = numbers[1]

        heading = way + math.pi if backwards(way, tails[i, 2], heads[i, 2], numbers[2] > 0.0) else way
        lines.cost[i] += numbers[1] * turns_of(heading, tails[i, 2], heads[i, 2])
    return Turned(lines.start, lines.curvature, lines.length, lines.cost, tails, heads.copy(), price)


@cache
def lines_with_turns(reverses: bool) -> MotionKind:
    """Return the kind of motions, of robots that reverse or do not."""

    @inlined
    def heading_along(motions, i):  # type: ignore[no-untyped-def]
        way = motions.start[i, 2]
        back = backwards(way, motions.tails[i, 2], motions.heads[i, 2], reverses)
        return wrapped(way + math.pi) if back else way, back

    @inlined
    def as_leg(motions, i):  # type: ignore[no-untyped-def]
        """Return it as `legs.free_turning` takes it, without times."""
        length = motions.length[i, 0]
        x, y = motions.start[i, 0], motions.start[i, 1]
        way = motions.start[i, 2]
        heading, back = heading_along(motions, i)
        leg = x, y, 0.0, x + length * math.cos(way), y + length * math.sin(way), 0.0

        return leg, (motions.tails[i, 2], heading, motions.heads[i, 2]), back

    @part
    def cut(motions, i, s):  # type: ignore[no-untyped-def]
        """End a motion at s [m], as it is headed there: it has arrived."""
        heading, _ = heading_along(motions, i)
        motions.heads[i, 2] = heading
        motions.length[i, 0] = min(motions.length[i, 0], s)
        turn = abs(wrapped(heading - motions.tails[i, 2]))
        motions.cost[i] = motions.price[i, 0] * motions.length[i, 0] + motions.price[i, 1] * turn

    @kernel
    def between(motions, i, share, out):  # type: ignore[no-untyped-def]
        length = share * motions.length[i, 0]
        way = motions.start[i, 2]
        out[0] = motions.start[i, 0] + length * math.cos(way)
        out[1] = motions.start[i, 1] + length * math.sin(way)
        out[2], _ = heading_along(motions, i)
        return length >= 0.0  # numba hands no literal to Python

    @cache
    def certify_for(space: SpaceKernels) -> Any:
        judged = free_turning(space, None)
        return inlined(lambda motions, i, around, patient: judged(around, *as_leg(motions, i), patient))

    def kernels(around: Surroundings) -> MotionKernels:
        curves = ARCS.kernels(around)
        certify = certify_for(around.static.kernels)

        return MotionKernels(curves.entry, cut, certify, curves.pairs, curves.most, between)

    def free(motions: Turned, i: int, space: FreeSpace) -> bool:
        return is_free_turning(space.collision, NoMoving(), *as_leg(motions, i))

    def trajectory(steering: Any, path: Turned) -> Trajectory:
        return replace(ARCS.trajectory(steering, path), between=between)

    return MotionKind(kernels, free, trajectory)


@cache
def alignment(clearance: Any, place: Any) -> Any:
    """Build the kernel that turns poses (k, 3), in place, to the heading of most clearance out of some."""

    @kernel
    def align(static, poses, headings):  # type: ignore[no-untyped-def]
        for i in range(poses.shape[0]):
            x, y = poses[i, 0], poses[i, 1]
            if place(static, (x, y)) > 0.0:
                continue
            first, best = poses[i, 2], -np.inf
            for k in range(headings):
                heading = wrapped(first + k * TWO_PI / headings)
                c = clearance(static, (x, y, heading))
                if c > best:
                    best = c
                    poses[i, 2] = heading

    return align


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnAndGo(Tracked):
    """A turn, a straight line at one pace and a turn between poses, for systems with a heading that move otherwise."""

    cost_per_radian: float  # [cost/rad]
    reverses: bool  # whether the system can drive backwards
    read: tuple[int, ...]  # indices of its states that are the position and the heading
    # Controls (m,) that drive forwards at the pace, and that turn on the spot at `turn_rate`; none if a state is more
    # than a pose, or the robot cannot turn on the spot: then guides find out how lines are driven.
    ahead: tuple[float, ...] = ()
    turning: tuple[float, ...] = ()
    turn_rate: float = 1.0  # at which control costs what time does [rad/s]

    n = 3
    heading = 2
    symmetric = False
    cost = _cost
    optimum = _connect

    @classmethod
    def of(cls, problem: Problem, pace: float | None = None) -> TurnAndGo:
        """Take lines for any problem with a heading at a pace [m/s], as `Tracked.of`; a turn costs its widest arc.

        OptionError: the footprint is a disc, which turns anywhere; or as of `Tracked.of`.
        """
        if problem.scene.footprint.is_disc:
            raise OptionError("a disc needs no room to turn; take Tracked.of(problem), or give the scene a footprint")
        lines, d = Tracked.of(problem, pace), problem.dynamics
        kept = {field.name: getattr(lines, field.name) for field in fields(Tracked)}
        return cls(
            **kept, cost_per_radian=lines.cost_per_meter * problem.scene.footprint.reach,
            reverses=velocity_at(problem, -1.0) < 0.0, read=(*d.position, d.angles[0]), **_driving(problem, lines.pace),
        )  # fmt: skip

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the costs per meter and radian, and 1 if it reverses."""
        return self.cost_per_meter, self.cost_per_radian, float(self.reverses)

    def trajectory(self, path: Any) -> Trajectory:
        """Return controls that turn and drive along a path in turn, if they are known, and their durations."""
        found = super(TurnAndGo, self).trajectory(path)
        if not self.ahead:
            return found
        heading = float(path.tails[0, 2])
        pieces = list[tuple[Array, float]]()
        for tail, head, way, length in zip(path.tails, path.heads, path.start[:, 2], path.length[:, 0], strict=True):
            back = backwards(way, tail[2], head[2], self.reverses)
            turn = wrapped(way + (math.pi if back else 0.0) - heading)
            heading += turn
            pieces.append((math.copysign(1.0, turn) * np.array(self.turning), abs(turn) / self.turn_rate))
            pieces.append(((-1.0 if back else 1.0) * np.array(self.ahead), length / self.pace))
        controls, durations = zip(*pieces, strict=True)
        return replace(found, controls=np.array(controls), durations=np.array(durations))

    @property
    def motion(self) -> MotionKind:  # type: ignore[override]
        """Return its kind of motions."""
        return lines_with_turns(self.reverses)

    def vertex_of(self, x: Array) -> Array:
        """The pose (..., 3) of a state (..., n); a pose has no more."""
        return np.ascontiguousarray(x[..., list(self.read)])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """Draw a pose (3,), uniform in the workspace [m] and in heading [rad]."""
        return np.append(rng.uniform(scene.lower, scene.upper), rng.uniform(-np.pi, np.pi))

    def states_along(self, path: Array, scene: Scene) -> Array:
        """Return every pose (k, 3), and its reverse for a robot that does not, headings in [-pi, pi)."""
        both = path if self.reverses else np.concatenate([path, path + np.array([0.0, 0.0, np.pi])])
        states = np.array(both, dtype=float)
        states[:, 2] = wrapped_all(states[:, 2])
        return states

    def draws(
        self, space: FreeSpace, rng: np.random.Generator, count: int, origin: Array | None = None,
        goal_share: float = 0.0,
    ) -> Array:  # fmt: skip
        """Draw poses as `Steering.draws`; where not all headings are free, half of them along the way that is."""
        drawn = np.empty((count, self.n))
        align = alignment(space.static.kernels.clearance, space.static.kernels.place)
        for i in range(count):
            drawn[i] = super(TurnAndGo, self).draws(space, rng, 1, origin, goal_share)[0]
            if rng.random() < TUNING.aligned_share:
                align(space.static, drawn[i : i + 1], TUNING.aligned_headings)
        return drawn

    def offers(self, passages: Passages, space: FreeSpace, origin: Array | None = None) -> Array:
        """Return poses along passages, both ways, and straight ahead of and behind an origin (3,) or the start."""
        first = space.scene.start if origin is None else origin
        found = [self._way_out(space, first, sign) for sign in (1.0, -1.0)[: 1 + self.reverses]]
        return np.vstack([*found, super(TurnAndGo, self).offers(passages, space, origin)])

    def _way_out(self, space: FreeSpace, pose: Array, sign: float) -> Array:
        """Return the first pose with room to turn, or that of most room, straight ahead (1) or behind (-1), (1, 3).

        None, (0, 3), if the robot cannot move that way.
        """
        static, footprint = space.static, space.scene.footprint
        step = sign * TUNING.way_out_step * footprint.radius * np.array([math.cos(pose[2]), math.sin(pose[2])])
        here, room, found = pose[:2], -np.inf, np.empty((0, 3))
        while room <= 0.0 and space.segments_free(np.array([here, here + step])[:: int(sign)]):
            here = here + step
            if (more := static.kernels.place(static, tuple(here))) > room:
                room = more
                found = np.array([[*here, pose[2]]])
        return found

    def roots(self, goal: Array) -> Array:
        """Spread headings evenly at the goal point (2,) [m], (k, 3), over half a turn for a robot that reverses."""
        headings = arrivals(self.reverses)
        return np.column_stack([np.broadcast_to(goal, (len(headings), 2)), headings])


def arrivals(reverses: bool) -> Array:
    """Return headings at the goal point [rad], over half a turn for a robot that reverses."""
    whole = np.pi if reverses else TWO_PI
    return np.arange(TUNING.arrivals) * whole / TUNING.arrivals - 0.5 * whole


def _driving(problem: Problem, pace: float) -> dict[str, Any]:
    """Find what drives a system whose state is a pose, in the frame of its heading; nothing if it moves otherwise."""
    d = problem.dynamics
    x = np.zeros(d.n)
    if d.n != 3 or np.any(d.f(x)):
        return {}
    G = d.whole(d.G_c(x))
    rates = np.zeros((3, 2))  # of the state: ahead, and turning
    rates[d.position[0], 0] = pace
    rates[d.angles[0], 1] = 1.0
    controls = np.linalg.lstsq(G, rates, rcond=None)[0]
    if not np.allclose(G @ controls, rates):
        return {}
    ahead, turning = controls.T
    rate = math.sqrt(2.0 * problem.least_rate / float(turning @ problem.control_cost(x) @ turning))
    return {"ahead": tuple(ahead.tolist()), "turning": tuple((rate * turning).tolist()), "turn_rate": rate}


def wrapped_all(angles: Array) -> Array:
    """Return angles in [-pi, pi)."""
    return np.asarray((angles + np.pi) % TWO_PI - np.pi)
