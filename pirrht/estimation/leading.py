"""What samples around references follow, and how hard walls push them: tapes, or climbing the desirability of a way."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.arena import Arena
from pirrht.geometry.field import clearance, set_back
from pirrht.geometry.traffic import Traffic, traffic_clearance
from pirrht.guidance.leads import Climb, Lead, Tape
from pirrht.guidance.near_walls import NearWalls, NearWallsOfMeans
from pirrht.guidance.walls import NEAREST, Push, Scales
from pirrht.guidance.ways import way_of
from pirrht.problem import Problem
from pirrht.rollouts.backend import kind_of
from pirrht.rollouts.general.kind import is_steady
from pirrht.rollouts.records import Leads
from pirrht.steering.trajectory import Trajectory

UNSURE = 3.0  # by so many nats a shortfall may change before it is found anew
HOPELESS = 16.0  # classes that promise so many nats less than another are worth only a few samples
BEHIND = 0.5826  # deviations of a step; minus zeta(1/2) / sqrt(2 pi)
SMALLEST = 0.2  # of the goal's disc is left of it at least
STRAIGHT = 1e-3  # bends of a way that are less are none: a way that cuts corners by more leads into them [m]


class Leading:
    """Leads for one problem, sampled in one manner.

    Attributes:
        arena: what rollouts judge exits by.
        traffic: what is taken to move, on the clock of plans; None: nothing does.
        beyond: how far behind walls psi vanishes [m].
        steady: whether the optimal control is a martingale (`is_steady`).
    """

    def __init__(
        self, problem: Problem, space: FreeSpace, sampling: Sampling, arena: Arena, traffic: Traffic | None
    ) -> None:
        self.problem, self.space, self.sampling, self.arena, self.traffic = problem, space, sampling, arena, traffic
        constant = problem.dynamics.constant and not callable(problem.R)
        start = problem.dynamics.state_of(problem.scene.start)
        self._everywhere = Scales.of(problem, start) if constant else None
        self.beyond, self._soft = self._set_back(start)
        self.steady = is_steady(kind_of(problem))

    @property
    def climbs(self) -> bool:
        """Whether samples climb the desirability of references' ways, pushed off walls, instead of following tapes."""
        return self.sampling.guide == "feedback" and self.problem.dynamics.even and self.traffic is None

    @property
    def climbs_too(self) -> bool:
        """Whether some samples climb beside others that follow guides: those of a point among bodies that move."""
        return self.traffic is not None and self.pointlike and self.problem.dynamics.even

    @property
    def pointlike(self) -> bool:
        """Whether samples are led by feedback and it is positions that controls move."""
        d = self.problem.dynamics
        return self.sampling.guide == "feedback" and d.n == d.m == 2

    def leads(
        self, x: Array, times: Array, trajectories: Sequence[Trajectory], shortfalls: Sequence[float] | None = None
    ) -> Sequence[Lead]:
        """What samples from x (n,) follow: ways of references if it `climbs`, else tapes over the steps (T+1,) [s].

        Args:
            trajectories: the references, (H,), cheapest first.
            shortfalls: how much less than without walls they are expected to promise, (H,) [nats]; if given, those
                that promise less than exp(-HOPELESS) of another's psi hold their tapes.
        """
        found: list[Lead] = []
        goal, most = self.space.scene.goal, -math.inf
        for h, trajectory in enumerate(trajectories):
            foretold, lead = -math.inf, None
            expected = math.inf
            if shortfalls is not None:
                expected = self.bound(x, trajectory) - max(0.0, shortfalls[h] - UNSURE)
            if self.climbs and expected >= most - HOPELESS:
                lead = self.climbing(x, np.vstack([trajectory.path.start[1:, :2], goal.center]))
                foretold = lead.promise
            if lead is None or (shortfalls is not None and foretold < most - HOPELESS):
                found.append(Tape(times, trajectory.tape(times), foretold))
            else:
                found.append(lead)
            most = max(most, foretold)
        return found

    def bound(self, x: Array, trajectory: Trajectory) -> float:
        """About the most that log psi of a reference's class can be from x (n,) [nats]: what it is without walls."""
        return -self.scales(x).decay * trajectory.length

    def climbing(self, x: Array, line: Array, time: float = 0.0) -> Climb:
        """Climbing the desirability of the way from x (n,) over the corners of a line (k, 2) [m] to the goal point.

        Args:
            time: now, on the clock of what moves [s].
        """
        scales = self.scales(x)
        push = self._push(scales.reach, self.sampling.leading, time=time)
        return Climb(way_of(self._soft, line, x, scales.decay), push.gain(x), push)

    def beside(self, x: Array, trajectory: Trajectory, time: float) -> Climb | None:
        """What samples of a point may follow besides a guide among bodies that move; None of other systems.

        Walls that stand bend psi more than a law that is linear around one trajectory tells, and a way knows how. It
        knows nothing of bodies, but those that are near push.
        """
        if not self.climbs_too:
            return None
        line = np.vstack([trajectory.path.tails[:, :2], self.space.scene.goal.center])
        return self.climbing(x, _bends(line)[1:], time)

    def push(self, leads: Leads, x: Array | None = None, time: float = 0.0) -> Push:
        """What the nearest walls add to the control (m,) near samples that followed these leads, for any state (n,).

        Args:
            x: the state (n,) that they start from; close to it FCL's clearance is used, not the field's lower bound.
            time: when they do, on the clock of what moves [s].
        """
        slack = 0.0
        if x is not None and leads.reach > 0.0:
            known = float(clearance(self.space.field, x[0], x[1]))
            slack = (
                max(0.0, float(self.space.collision.clearance(x[None, :2])[0]) - known) if known < leads.reach else 0.0
            )
        return self._push(leads.reach, float(leads.times[1]), slack, time)

    def near_walls(self, leads: Leads, x: Array, time: float) -> NearWalls:
        """What the nearest walls do at x (n,) to the control now of samples that followed these leads.

        Args:
            time: when they start, on the clock of what moves [s].
        """
        push = self.push(leads, x, time)
        if self.steady and leads.reach > 0.0:
            return NearWallsOfMeans.of(push, x, float(leads.times[leads.window]), leads.counted)
        pushed = push(x)
        return NearWalls(push=pushed, held_back=push(x, closest=NEAREST) - pushed)

    def _push(self, reach: float, step: float, slack: float = 0.0, time: float = 0.0) -> Push:
        return Push(
            problem=self.problem, field=self.space.field, reach=reach, step=step, beyond=self.beyond, slack=slack,
            traffic=self.traffic, time=time,
        )  # fmt: skip

    def scales(self, x: Array) -> Scales:
        """Those at x (n,), which are the same everywhere if G, B and R are."""
        return Scales.of(self.problem, x) if self._everywhere is None else self._everywhere

    def nearest(self, x: Array, time: float) -> float:
        """Distance of x (n,) from the nearest wall or the goal's disc at a time [s], [m]."""
        return min(self.room(x, time), float(self.from_goal(x)))

    def room(self, x: Array, time: float) -> float:
        """Distance of x (n,) from the nearest wall at a time [s], [m]."""
        near = float(clearance(self.arena.field, x[0], x[1]))
        if self.traffic is None:
            return near
        return min(near, float(traffic_clearance(self.traffic, x[0], x[1], time)))

    def from_goal(self, x: Array) -> Array:
        """Distances of x (..., n) from the goal's disc, (...) [m], negative inside."""
        gx, gy = self.arena.goal
        return np.asarray(np.hypot(x[..., 0] - gx, x[..., 1] - gy) - self.arena.radius)

    def _set_back(self, x: Array) -> tuple[float, Arena]:
        """How far behind walls psi vanishes where exits are judged at the ends of steps [m], and an arena without them.

        A path that is looked at every dt meets a wall like one that is always looked at meets a wall 0.5826 deviations
        of a step behind it (Broadie, Glasserman and Kou, Mathematical Finance 1997); so it does the goal's rim.
        """
        arena = self.arena
        if self.sampling.exit == "bridge" or not self.climbs:
            return 0.0, arena
        distance = BEHIND * math.sqrt(self.scales(x).noise * self.sampling.dt)
        radius = max(arena.radius - distance, SMALLEST * arena.radius)
        return distance, Arena(set_back(arena.field, distance), arena.goal, radius)


def _bends(line: Array) -> Array:
    """Corners (j, 2) of a line (k, 2) [m] that is off them by STRAIGHT at most [m]."""
    if len(line) < 3:
        return line
    along = line[-1] - line[0]
    away = line[1:-1] - line[0]
    off = np.abs(along[0] * away[:, 1] - along[1] * away[:, 0]) / max(float(np.hypot(*along)), STRAIGHT)
    i = int(np.argmax(off)) + 1
    return line[[0, -1]] if off[i - 1] <= STRAIGHT else np.vstack([_bends(line[: i + 1])[:-1], _bends(line[i:])])
