"""Proposal controls of samples around references, their wall drift, and the tables of a batch for the kernels."""

import math
import operator
from collections.abc import MutableMapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.sampling import TUNING, EstimationTuning, Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.world import World
from pirrht.problem import Problem
from pirrht.proposals import wall_drift
from pirrht.proposals.desirability_grid import DesirabilityGrid, GridAscent
from pirrht.proposals.desirability_tube import DesirabilityAscent
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide
from pirrht.proposals.proposal import Batch, ProposalControl, Tape
from pirrht.proposals.tuning import TUNING as PROPOSALS
from pirrht.proposals.wall_drift import FlatWalls, NearWalls, Scales, WallDrift
from pirrht.rollouts.tables import FINER, PredictedWorld, ProposalTables, no_tubes
from pirrht.steering.motion import Trajectory
from pirrht.traits import Traits


class ProposalFactory:
    """Makes proposal controls for one problem and sampling, and writes batches of them into tables.

    Attributes:
        world: the predicted world, shared with sampler and guides.
        guidance: makes guides that samples follow; None: there are none.
        gated: whether walls push on top of the law of guides.
        pointlike: whether samples follow feedback and controls move positions.
        climbs: whether samples climb the desirability of their class instead of following control sequences.
        climbs_too: whether some samples climb next to others that follow guides: of a point among moving obstacles.
        set_back: distance behind walls at which psi vanishes [m].
        is_martingale: whether the optimal control is a martingale (`Traits.is_martingale`).
    """

    def __init__(
        self, problem: Problem, space: FreeSpace, sampling: Sampling, world: PredictedWorld,
        tuning: EstimationTuning = TUNING,
    ) -> None:  # fmt: skip
        self.problem = problem
        self.space = space
        self.sampling = sampling
        self.world = world
        self.tuning = tuning

        feedback = sampling.guide == "feedback"
        start = problem.dynamics.state_of(problem.scene.start)
        self.traits = traits = Traits.of(problem)
        self.is_martingale = traits.is_martingale(world.setup.world.moving.kernels is not None)
        self.guidance = (
            DDPGuidance(problem, world, sways=sampling.fitted) if feedback and DDPGuidance.suits(problem) else None
        )
        self.gated = self.guidance is not None and self.guidance.gated
        self.pointlike = feedback and traits.point
        self.climbs = feedback and traits.climbs(world.moving)
        self.in_space = len(problem.dynamics.position) == 3
        self.climbs_too = world.moving and feedback and traits.isotropic_point and not self.in_space
        self._everywhere = Scales.of(problem, start) if traits.constant_blocks and not callable(problem.R) else None
        self.set_back, self._soft = self._set_back(start)
        self._last: tuple[tuple[Any, ...], float, ProposalTables | None] = (), 0.0, None

    @cached_property
    def nominal(self) -> DDPGuidance:
        """Optimiser of trajectories whose nominal controls open-loop samples follow along tracked references."""
        return self.guidance or DDPGuidance(self.problem, self.world, sways=False)

    def warm_up(self, *, optima: bool = True) -> None:
        """Compile the kernels of guides, also of the optimisation of trajectories if `optima`."""
        x = self.problem.dynamics.state_of(self.problem.scene.start)
        if optima and self.guidance is not None:
            self.guidance.warm_up(x)
        if self.climbs or self.climbs_too:
            line = np.array([self.problem.dynamics.place(x), self.problem.scene.goal.center])
            self._climbed(x, [line], 0, {})(x, 0.0)
        self.world.setup.world.clearance(self._pose(x))

    def controls(
        self, x: Array, times: Array, trajectories: Sequence[Trajectory], *, drops: bool,
        grids: MutableMapping[int, DesirabilityGrid] | None = None,
    ) -> list[ProposalControl]:  # fmt: skip
        """Return proposal controls from x (n,): ascents of desirability if it `climbs`, else control sequences.

        `times` (T+1,) [s] are ends of the steps, `trajectories` (H,) the references, cheapest first. If it `drops`,
        classes of less than exp(-hopeless) of another's predicted psi get control sequences. In space the grids of
        references that are known, by number, are used again, and others are added.
        """
        found: list[ProposalControl] = []
        most, decay = -math.inf, self.scales(x).decay
        known = {} if grids is None else grids
        lines = [self._line(trajectory) for trajectory in trajectories] if self.climbs else []
        for k, trajectory in enumerate(trajectories):
            least = most - self.tuning.hopeless if drops else -math.inf
            control: DesirabilityAscent | GridAscent | None = None
            if self.climbs and -decay * trajectory.length >= least:  # log psi without walls
                control = self._climbed(x, lines, k, known)
            promise = -math.inf if control is None else control.promise
            worth = control is not None and promise >= least
            found.append(control if worth and control else Tape(times, trajectory.tape(times), promise))
            most = max(most, promise)
        return found

    def climbing(self, x: Array, line: Array, time: float = 0.0) -> DesirabilityAscent:
        """Return the ascent from x (n,) over the corners of a line (k, 2) [m] to the goal point, at a time [s]."""
        scales = self.scales(x)
        return DesirabilityAscent.of(
            self._soft, line, x, scales.decay, self.wall_drift(scales.wall_offset, self.sampling.first_dt, time=time)
        )

    def defensive(self, x: Array, trajectory: Trajectory, time: float) -> DesirabilityAscent | None:
        """Return the ascent of a point next to its guide among moving obstacles; None of other systems.

        Static walls bend psi more than a law that is linear around one trajectory, and a tube knows how. It ignores
        moving obstacles, but those nearby add to the wall drift.
        """
        if not self.climbs_too:
            return None
        return self.climbing(x, _bends(self._line(trajectory), self.tuning.bend)[1:], time)

    def _line(self, trajectory: Trajectory) -> Array:
        """Return the corners of a reference and the goal point, (k, d) [m]."""
        goal = self.space.scene.goal.center
        return np.vstack([trajectory.path.tails[:, : len(goal)], goal])

    def _climbed(
        self, x: Array, lines: Sequence[Array], own: int, grids: MutableMapping[int, DesirabilityGrid]
    ) -> DesirabilityAscent | GridAscent:
        """Return the ascent from x (n,) of the class of one of some lines (k, d) [m] to the goal point.

        In space it is over the grid of that number, which is added if it is not known.
        """
        if not self.in_space:
            return self.climbing(x, lines[own][1:])
        scales = self.scales(x)
        if own not in grids:
            grids[own] = DesirabilityGrid.of(self.space, self._soft, lines, own, scales.decay, scales.wall_offset)
        return GridAscent.of(grids[own], x, self.wall_drift(scales.wall_offset, self.sampling.first_dt))

    def push(self, tables: ProposalTables, x: Array, time: float = 0.0) -> WallDrift:
        """Return the wall drift (m,), for any state (n,), near samples of these tables from x (n,) and a time on."""
        offset, slack = tables.wall_offset, 0.0
        static = self.space.static
        if offset > 0.0 and (known := float(static.kernels.clearance(static, self._pose(x)))) < offset:
            slack = max(0.0, self.space.clearance(np.array(self._pose(x))) - known)
        return self.wall_drift(offset, float(tables.times[1]), slack, time)

    def near_walls(self, tables: ProposalTables, x: Array, time: float) -> NearWalls:
        """Return wall drift at x (n,) and a time [s], and its effect on the control of samples of these tables."""
        push = self.push(tables, x, time)
        if not (self.is_martingale and tables.wall_offset > 0.0):
            return NearWalls.of(push, x)
        return NearWalls.of(push, x, FlatWalls(push, x, float(tables.times[tables.window])))

    def wall_drift(self, offset: float, step: float, slack: float = 0.0, time: float = 0.0) -> WallDrift:
        """Return the wall drift for an offset [m] and steps [s], where clearance is `slack` [m] too low."""
        return WallDrift(
            problem=self.problem, static=self.space.static, offset=offset, step=step, behind=self.set_back, slack=slack,
            moving=self.world.setup.world.moving, time=time,
        )  # fmt: skip

    def scales(self, x: Array) -> Scales:
        """Return the scales at x (n,), which are constant if G, B and R are."""
        return Scales.of(self.problem, x) if self._everywhere is None else self._everywhere

    def _pose(self, x: Array) -> tuple[float, ...]:
        """Take the pose of a state (n,) that the space reads."""
        return tuple(x[list(self.problem.dynamics.reads(self.space.static.kernels.turns))].tolist())

    def _from_goal(self, places: Array) -> Array:
        """Return the distances of places (..., d) [m] from the goal's disc or ball, (...) [m], negative inside."""
        away = places - np.array(self.world.setup.world.goal)
        return np.asarray(np.hypot.reduce(away, axis=-1) - self.world.setup.world.radius)

    def _set_back(self, x: Array) -> tuple[float, World]:
        """Return how far behind walls psi vanishes where exits are judged at the ends of steps [m], and that arena.

        A path judged every dt meets a wall, or the goal's rim, like one judged always meets one -zeta(1/2) / sqrt(2 pi)
        = 0.5826 deviations of a step behind it (Broadie, Glasserman and Kou, Mathematical Finance 1997).
        """
        arena = self.world.setup.world
        if self.sampling.exit == "bridge" or not self.climbs or self.in_space:
            return 0.0, arena
        distance = 0.5826 * math.sqrt(self.scales(x).noise * self.sampling.dt)
        return distance, arena._replace(
            static=arena.static.set_back(distance), radius=max(arena.radius - distance, self.tuning.rim * arena.radius)
        )

    def tables(self, batch: Batch) -> ProposalTables:
        """Return the tables of a batch in the predicted world; other numbers of samples alone reuse the last ones."""
        key = self.world.snapshot, batch.state, batch.times, *(one.lead for one in batch.proposals)
        before, time, tables = self._last
        alike = len(key) == len(before) and all(map(operator.is_, key, before))
        if tables is None or not alike or time != batch.time:
            tables = self._packed(batch)
        self._last = key, batch.time, tables
        return tables._replace(first=np.concatenate([[0], np.cumsum(batch.counts)]).astype(np.int64))

    def _packed(self, batch: Batch) -> ProposalTables:
        setup, homology = self.world.snapshot
        x = batch.state
        times = batch.times
        d = self.problem.dynamics

        guidance = self.guidance
        drifts = self.climbs or self.gated
        pushed = self.pointlike and (self.world.moving or self.gated)

        H = len(batch.proposals)
        T = len(times) - 1

        C, J = np.max([proposal.lead.shape for proposal in batch.proposals], axis=0).tolist()
        scales, moving = self.scales(x), self.world.moving
        near = np.inf
        if self.pointlike:
            near = min(setup.world.clearance(self._pose(x), batch.time), float(self._from_goal(d.place(x))))
        move = (
            self.tuning.least_move * self.problem.scene.robot_radius if moving and self.traits.noisy_position else 0.0
        )
        least = max(self.tuning.least_step * self.sampling.dt, move**2 / scales.noise)  # shortest steps near walls [s]
        tables = ProposalTables(
            control=np.zeros((H, T, d.m)), drift=np.zeros((H, T, d.m)), times=np.ascontiguousarray(times, dtype=float),
            active=np.zeros(H, dtype=np.int64), first=np.zeros(H + 1, dtype=np.int64),
            ways=no_tubes(H, max(C, 2), max(J, PROPOSALS.nodes), scales.decay),
            wall_offset=scales.wall_offset if drifts else 0.0, set_back=self.set_back,
            least=least if self.sampling.fitted else np.inf,
            weighed=self.sampling.exit == "bridge" and self.problem.phi > self.problem.least_rate * float(times[-1]),
            window=self._window(batch, scales, near) if self.pointlike else 1,
            mirrored=self.sampling.draws == "antithetic",
            law=np.zeros((H, T * FINER, guidance.law_width if guidance else 0)), law_length=np.zeros(H, np.int64),
            classes=homology.table, marks=homology.rays(x, times + batch.time),
            law_weight=wall_drift.linear_law_weight(scales.noise, near) if pushed else 1.0,
        )  # fmt: skip
        for h, proposal in enumerate(batch.proposals):
            proposal.lead.pack(tables, h)
        busy = np.any(tables.control != 0.0, axis=2)
        tables.active[:] = np.where(busy.any(axis=1), T - np.argmax(busy[:, ::-1], axis=1), 0)
        tables.drift[:] = tables.control @ setup.gain.T
        return tables

    def _window(self, batch: Batch, scales: Scales, near: float) -> int:
        """Return the number of leading steps over which a point's control is averaged, before many paths arrive."""
        shortest = PROPOSALS.averaged_moving if self.world.moving else PROPOSALS.averaged
        most = wall_drift.window(scales.noise, near, batch.times, self.sampling.window, shortest)
        if not self.is_martingale:
            return most
        times = batch.times[1 : most + 1]
        for guide in (one.lead.guide for one in batch.proposals if one.lead.guide is not None):
            most = min(most, wall_drift.under_way(scales.noise, self._from_goal(_places(guide, times)), times))
        return max(most, wall_drift.window(scales.noise, 0.0, batch.times, self.sampling.window, shortest))


def _places(guide: DDPGuide, times: Array) -> Array:
    """Return places (k, 2) [m] of a guide at times (k,) [s] since the plan."""
    return np.stack([np.interp(times, guide.times, column) for column in guide.dynamics.place(guide.states).T], axis=1)


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
