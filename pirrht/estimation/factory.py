"""Proposal controls of samples around references, and their wall drift."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.sampling import Sampling
from pirrht.estimation.tuning import TUNING, EstimationTuning
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import clearance, set_back
from pirrht.geometry.world import World
from pirrht.problem import Problem
from pirrht.proposals.controls import DesirabilityAscent
from pirrht.proposals.desirability_tube import way_of
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.near_walls import NearWalls, NearWallsOfMeans
from pirrht.proposals.proposal import ProposalControl, Tape
from pirrht.proposals.tuning import TUNING as PROPOSALS
from pirrht.proposals.wall_drift import Scales, WallDrift
from pirrht.rollouts.cpu import kind_of
from pirrht.rollouts.general.kind import is_steady
from pirrht.rollouts.tables import PredictedWorld, ProposalTables
from pirrht.steering.trajectory import Trajectory


class ProposalFactory:
    """Makes proposal controls for one problem and sampling.

    Attributes:
        world: the predicted world, shared with sampler and guides.
        guidance: makes guides that samples follow; None: there are none.
        beyond: distance behind walls at which psi vanishes [m].
        steady: whether the optimal control is a martingale (`is_steady`).
    """

    def __init__(
        self, problem: Problem, space: FreeSpace, sampling: Sampling, world: PredictedWorld,
        guidance: DDPGuidance | None, tuning: EstimationTuning = TUNING,
    ) -> None:  # fmt: skip
        self.problem, self.space, self.sampling, self.world = problem, space, sampling, world
        self.guidance, self.tuning = guidance, tuning
        constant = problem.dynamics.constant and not callable(problem.R)
        start = problem.dynamics.state_of(problem.scene.start)
        self._everywhere = Scales.of(problem, start) if constant else None
        self.beyond, self._soft = self._set_back(start)
        self.steady = is_steady(kind_of(problem))

    @property
    def arena(self) -> World:
        """What is free at (x, t)."""
        return self.world.setup.world

    @property
    def climbs(self) -> bool:
        """Check whether samples climb the desirability of their class instead of following control sequences."""
        return self.sampling.guide == "feedback" and self.problem.dynamics.even and not self.world.moving

    @property
    def climbs_too(self) -> bool:
        """Check whether some samples climb next to others that follow guides: of a point among moving obstacles."""
        return self.world.moving and self.pointlike and self.problem.dynamics.even

    @property
    def pointlike(self) -> bool:
        """Check whether samples follow feedback and controls move positions."""
        d = self.problem.dynamics
        return self.sampling.guide == "feedback" and d.n == d.m == 2

    @property
    def closed_loop(self) -> bool:
        """Check whether samples follow feedback, so that references need no controls."""
        return self.guidance is not None or self.climbs

    def warm_up(self) -> None:
        """Compile the kernels of guides."""
        x = self.problem.dynamics.state_of(self.problem.scene.start)
        if self.guidance is not None:
            self.guidance.warm_up(x)
        if self.climbs_too:
            self.climbing(x, self.problem.scene.goal.center[None])(x, 0.0)
        clearance(self.space.field, x[0], x[1])

    def leads(
        self, x: Array, times: Array, trajectories: Sequence[Trajectory], *, drops: bool
    ) -> list[ProposalControl]:  # fmt: skip
        """Return proposal controls from x (n,): ascents of desirability if it `climbs`, else control sequences.

        Args:
            times: ends of the steps (T+1,) [s].
            trajectories: the references, (H,), cheapest first.
            drops: whether classes of less than exp(-hopeless) of another's predicted psi get control sequences.
        """
        found: list[ProposalControl] = []
        goal, most = self.space.scene.goal, -math.inf
        for trajectory in trajectories:
            lead: ProposalControl | None = None
            bound = -self.scales(x).decay * trajectory.length  # log psi without walls
            if self.climbs and not (drops and bound < most - self.tuning.hopeless):
                lead = self.climbing(x, np.vstack([trajectory.path.start[1:, :2], goal.center]))
            predicted = -math.inf if lead is None else lead.promise
            if lead is None or (drops and predicted < most - self.tuning.hopeless):
                lead = Tape(times, trajectory.tape(times), predicted)
            found.append(lead)
            most = max(most, predicted)
        return found

    def climbing(self, x: Array, line: Array, time: float = 0.0) -> DesirabilityAscent:
        """Return the climb from x (n,) over the corners of a line (k, 2) [m] to the goal point, at a time [s]."""
        scales = self.scales(x)
        push = self._push(scales.reach, self.sampling.first_dt, time=time)
        return DesirabilityAscent(way_of(self._soft, line, x, scales.decay), push.gain(x), push)

    def beside(self, x: Array, trajectory: Trajectory, time: float) -> DesirabilityAscent | None:
        """Return the climb of a point next to its guide among moving obstacles; None of other systems.

        Static walls bend psi more than a law that is linear around one trajectory, and a way knows how. It ignores
        moving obstacles, but those nearby add to the wall drift.
        """
        if not self.climbs_too:
            return None
        line = np.vstack([trajectory.path.tails[:, :2], self.space.scene.goal.center])
        return self.climbing(x, _bends(line, self.tuning.bend)[1:], time)

    def push(self, leads: ProposalTables, x: Array | None = None, time: float = 0.0) -> WallDrift:
        """Return the wall drift (m,) near samples that followed these leads, for any state (n,).

        Args:
            x: the state (n,) that they start from; close to it FCL's clearance is used, not the field's lower bound.
            time: when they start, on the clock of moving obstacles [s].
        """
        slack = 0.0
        if x is not None and leads.reach > 0.0:
            known = float(clearance(self.space.field, x[0], x[1]))
            if known < leads.reach:
                slack = max(0.0, float(self.space.collision.clearance(x[None, :2])[0]) - known)
        return self._push(leads.reach, float(leads.times[1]), slack, time)

    def near_walls(self, leads: ProposalTables, x: Array, time: float) -> NearWalls:
        """Return wall drift at x (n,) and a time [s], and its effect on the control of samples of these leads."""
        push = self.push(leads, x, time)
        if self.steady and leads.reach > 0.0:
            return NearWallsOfMeans.of(push, x, float(leads.times[leads.window]), leads.counted)
        pushed = push(x)
        return NearWalls(push=pushed, held_back=push(x, closest=PROPOSALS.least_gap) - pushed)

    def _push(self, reach: float, step: float, slack: float = 0.0, time: float = 0.0) -> WallDrift:
        return WallDrift(
            problem=self.problem, field=self.space.field, reach=reach, step=step, beyond=self.beyond, slack=slack,
            moving=self.arena.moving if self.world.moving else None, time=time,
        )  # fmt: skip

    def scales(self, x: Array) -> Scales:
        """Return the scales at x (n,), which are constant if G, B and R are."""
        return Scales.of(self.problem, x) if self._everywhere is None else self._everywhere

    def nearest(self, x: Array, time: float) -> float:
        """Return the distance of x (n,) from the nearest wall or the goal's disc at a time [s], [m]."""
        return min(self.room(x, time), float(self.from_goal(x)))

    def room(self, x: Array, time: float) -> float:
        """Return the distance of x (n,) from the nearest wall at a time [s], [m]."""
        if not self.world.moving:
            return float(clearance(self.arena.field, x[0], x[1]))
        return self.arena.clearance(x[0], x[1], time)

    def from_goal(self, x: Array) -> Array:
        """Return the distances of x (..., n) from the goal's disc, (...) [m], negative inside."""
        gx, gy = self.arena.goal
        return np.asarray(np.hypot(x[..., 0] - gx, x[..., 1] - gy) - self.arena.radius)

    def _set_back(self, x: Array) -> tuple[float, World]:
        """Return how far behind walls psi vanishes where exits are judged at the ends of steps [m], and that arena.

        A path judged every dt meets a wall like one judged always meets a wall -zeta(1/2) / sqrt(2 pi) = 0.5826
        deviations of a step behind it (Broadie, Glasserman and Kou, Mathematical Finance 1997); so it does the goal's
        rim.
        """
        arena = self.arena
        if self.sampling.exit == "bridge" or not self.climbs:
            return 0.0, arena
        distance = 0.5826 * math.sqrt(self.scales(x).noise * self.sampling.dt)
        radius = max(arena.radius - distance, self.tuning.rim * arena.radius)
        return distance, arena._replace(field=set_back(arena.field, distance), radius=radius)


def _bends(line: Array, most: float) -> Array:
    """Simplify a line (k, 2) [m] to corners (j, 2) that it is off by `most` [m] at most."""
    if len(line) < 3:
        return line
    along = line[-1] - line[0]
    away = line[1:-1] - line[0]
    off = np.abs(along[0] * away[:, 1] - along[1] * away[:, 0]) / max(float(np.hypot(*along)), most)
    i = int(np.argmax(off)) + 1
    return (
        line[[0, -1]] if off[i - 1] <= most else np.vstack([_bends(line[: i + 1], most)[:-1], _bends(line[i:], most)])
    )
