"""Importance-sampled path integrals: the value, the control and the class weights at a state (paper, III and IV-C).

With S samples drawn around H references, psi = E_P[W]. The paper averages H estimators, each weighing its samples
by dP/dQ_h. The balance heuristic weighs every sample by dP / (1/S sum_g N_g dQ_g) instead: with finitely many
samples the plain average is too high by up to lambda ln H, since samples around one reference practically never
visit the classes of the others. Only the estimate of psi is unbiased, for the chain that is sampled, and only where
numbers of samples were fixed beforehand; u is a ratio and v a logarithm, which are consistent. Within a step walls are
flat: what that biases shrinks with the steps, which are split near walls and goal.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.threads import mapped
from pirrht.estimation.estimate import Estimate, Rollouts, log_weights, weigh
from pirrht.estimation.replay import Replay
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.arena import Arena
from pirrht.geometry.field import clearance, set_back
from pirrht.geometry.traffic import Traffic, traffic_clearance
from pirrht.guidance.any_guides import AnyGuidance
from pirrht.guidance.leads import Batch, Climb, Lead, Proposal, Tape
from pirrht.guidance.tracking import Guidance
from pirrht.guidance.walls import Push, Scales, trust, window
from pirrht.guidance.ways import NODES, way_of
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.rollouts.backend import kernels_for
from pirrht.rollouts.records import FINER, LAW, Kernels, Leads, MovingSetup, Origin, Setup, empty_paths
from pirrht.rollouts.ways import no_ways
from pirrht.steering.in_time import homology_of
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.homology import Homology
from pirrht.topology.in_time import TimedHomology
from pirrht.topology.marks import NO_MARKS, Marks

LEAST = 1.0 / 300.0  # of a step that is split near walls and goal remains at least
SMALL = 0.01  # among bodies that move no step is split over which noise carries a point by so many radii of the robot
UNSURE = 3.0  # by so many nats a shortfall may change before it is found anew
HOPELESS = 16.0  # classes that promise so many nats less than another are worth only a few samples
BEHIND = 0.5826  # deviations of a step; minus zeta(1/2) / sqrt(2 pi)
SMALLEST = 0.2  # of the goal's disc is left of it at least
STRAIGHT = 0.01  # bends of a way that are less are none [m]
TAIL = 40.0  # paths longer than the cheapest reference plus so many lambda are cut: they weigh exp(-40)


class PathIntegral:
    """Draws and weighs samples around references; the problem and its scene stay fixed.

    Args:
        beyond: costs (k,) [cost] of going on from states (k, n) at the end of the grid; None: a path that has not
            arrived by then weighs nothing.
        homology: of the problem's paths; None: where bodies move, with bases at the best speed.
    """

    def __init__(
        self,
        problem: Problem,
        space: FreeSpace,
        sampling: Sampling,
        *,
        beyond: Callable[[Array], Array] | None = None,
        homology: Homology | TimedHomology | None = None,
    ) -> None:
        self.problem, self.space, self.sampling, self.beyond = problem, space, sampling, beyond
        self.temperature = problem.temperature
        self.kernels: Kernels = kernels_for(problem)
        self.moving = bool(problem.scene.movers)
        found = homology_of(problem, space) if homology is None else homology
        self.homology = found if isinstance(found, TimedHomology) else None
        self.setup = _setup(problem, space, sampling.exit == "bridge")
        self.guidance: Guidance | AnyGuidance | None = None
        if sampling.guide == "feedback" and self.moving:
            self.guidance = AnyGuidance(problem, self.setup, sways=sampling.fitted, homology=self.homology)
        elif sampling.guide == "feedback" and Guidance.suits(problem):
            assert isinstance(self.setup, Setup)
            self.guidance = Guidance(problem, self.setup, sways=sampling.fitted)
        elif sampling.guide == "feedback" and AnyGuidance.suits(problem):
            self.guidance = AnyGuidance(problem, self.setup, sways=sampling.fitted)
        self.replay = Replay(self.kernels, self.setup)
        constant = problem.dynamics.constant and not callable(problem.R)
        start = problem.dynamics.state_of(problem.scene.start)
        self._everywhere = Scales.of(problem, start) if constant else None
        self._beyond, self._soft = self._set_back(start)
        self._last: tuple[Batch | None, Leads | None] = None, None  # what was packed last
        self.threads = sampling.threads or len(os.sched_getaffinity(0))

    def _set_back(self, x: Array) -> tuple[float, Arena]:
        """How far behind walls psi vanishes where exits are judged at the ends of steps [m], and an arena without them.

        A path that is looked at every dt meets a wall like one that is always looked at meets a wall 0.5826 deviations
        of a step behind it (Broadie, Glasserman and Kou, Mathematical Finance 1997); so it does the goal's rim.
        """
        arena = self.setup.arena
        if self.sampling.exit == "bridge" or not self.climbs:
            return 0.0, arena
        distance = BEHIND * math.sqrt(self._scales(x).noise * self.sampling.dt)
        radius = max(arena.radius - distance, SMALLEST * arena.radius)
        return distance, Arena(set_back(arena.field, distance), arena.goal, radius)

    def foresee(self, traffic: Traffic, homology: TimedHomology) -> None:
        """From now on bodies are taken to move otherwise, as `homology` of the same motions has them.

        Both are on the clock that times of batches and guides are told on.
        """
        assert isinstance(self.setup, MovingSetup)
        self.setup, self.homology = self.setup._replace(traffic=traffic), homology
        if isinstance(self.guidance, AnyGuidance):
            self.guidance.setup, self.guidance.homology = self.setup, homology

    def warm_up(self) -> None:
        """Compile what sampling, weighing and tracing need, so that the first plan takes no longer than the others."""
        d = self.problem.dynamics
        x = d.state_of(self.problem.scene.start)
        if self.guidance is not None:
            self.guidance.warm_up(x)
        times = np.arange(3.0)
        proposal = Proposal(lead=Tape(times, np.zeros((2, d.m))), count=1)
        rollouts = self.rollout(Batch(state=x, times=times, proposals=(proposal,)), 0)
        self.weighed([replace(rollouts, log_weight=np.zeros(1))])  # whatever became of the sample
        self.replay.tapes(rollouts, [np.ones(1, dtype=np.bool_)])
        self.replay.trace(rollouts, np.zeros(1, dtype=np.int64))
        clearance(self.space.field, x[0], x[1])

    def grid(self, reference_cost: float) -> Array:
        """Ends of the rollout steps (T+1,) [s], up to T_max = (c_ref + 40 lambda) / q_min where a path weighs nothing.

        A control read off the first step is the mean over that step. Where the plan is made anew more often than
        every dt, the first dt is cut finer (`Sampling.leading`), since near a wall the mean over dt is much weaker than
        the control now.
        """
        return self.steps((reference_cost + TAIL * self.temperature) / self.problem.least_rate)

    def steps(self, horizon: float) -> Array:
        """Ends of the rollout steps (T+1,) [s] up to a horizon [s], the first dt cut finer where it is to be."""
        dt = self.sampling.dt
        steps = max(1, int(np.ceil(horizon / dt)))
        parts = max(1, round(dt / self.sampling.leading))
        fine = np.arange(parts) * (dt / parts)
        return np.concatenate([fine, np.arange(1, steps + 1) * dt])

    @property
    def climbs(self) -> bool:
        """Whether samples climb the desirability of references' ways, pushed off walls, instead of following tapes."""
        return self.sampling.guide == "feedback" and self.problem.dynamics.even and not self.moving

    @property
    def pointlike(self) -> bool:
        """Whether samples are led by feedback and it is positions that controls move."""
        d = self.problem.dynamics
        return self.sampling.guide == "feedback" and d.n == d.m == 2

    @property
    def leads_itself(self) -> bool:
        """Whether what samples follow is made here, so that references need no controls."""
        return self.guidance is not None or self.climbs

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
        return -self._scales(x).decay * trajectory.length

    def climbing(self, x: Array, line: Array, time: float = 0.0) -> Climb:
        """Climbing the desirability of the way from x (n,) over the corners of a line (k, 2) [m] to the goal point.

        Args:
            time: now, on the clock of what moves [s].
        """
        scales = self._scales(x)
        push = self._push(scales.reach, self.sampling.leading, time=time)
        return Climb(way_of(self._soft, line, x, scales.decay), push.gain(x), push)

    def beside(self, x: Array, trajectory: Trajectory, time: float) -> Climb | None:
        """What samples of a point may follow besides a guide among bodies that move; None of other systems.

        Walls that stand bend psi more than a law that is linear around one trajectory tells, and a way knows how. It
        knows nothing of bodies, but those that are near push.
        """
        if not (self.moving and self.pointlike and self.problem.dynamics.even):
            return None
        line = np.vstack([trajectory.path.tails[:, :2], self.space.scene.goal.center])
        return self.climbing(x, _bends(line)[1:], time)

    def rollout(self, batch: Batch, seed: int) -> Rollouts:
        """Sample the paths of a batch from its state (n,) (paper, III-B); equal seeds give equal paths."""
        leads = self._packed(batch)
        first, H = leads.first, len(batch.proposals)
        S = int(first[-1])
        paths, log_weight = empty_paths(S, H, self.problem.dynamics.m), np.empty(S)
        origin = Origin(np.ascontiguousarray(batch.state, dtype=float), np.uint64(seed), float(batch.time))

        def work(part: tuple[int, int]) -> None:
            self.kernels.sample(self.setup, leads, origin, part[0], part[1], paths)
            log_weight[slice(*part)] = log_weights(self.problem, self.sampling.weights, paths, first, part)

        _in_parallel(work, S, self.threads if self.kernels.alone < S else 1)
        rollouts = Rollouts(origin=origin, leads=leads, paths=paths, log_weight=log_weight, setup=self.setup)
        return rollouts if self.beyond is None else self._completed(rollouts, self.beyond)

    def _completed(self, rollouts: Rollouts, beyond: Callable[[Array], Array]) -> Rollouts:
        """The same, with paths that are under way at the end of the grid charged what the rest costs."""
        paths = rollouts.paths
        under_way = np.flatnonzero(paths.outcome == Outcome.TIMEOUT)
        if len(under_way) == 0:
            return rollouts
        work, outcome = paths.work.copy(), paths.outcome.copy()
        work[under_way] += beyond(self.replay.trace(rollouts, under_way)[0][:, -1])
        outcome[under_way] = Outcome.GOAL
        arrived = paths._replace(work=work, outcome=outcome)
        return replace(
            rollouts, log_weight=log_weights(self.problem, self.sampling.weights, arrived, rollouts.leads.first)
        )

    def estimate(self, rollouts: Rollouts, classes: Mapping[int, str] | None = None) -> Estimate:
        """Weigh the samples: v [cost], u (m,); `classes` maps additive class keys to names of references' classes.

        Raises:
            NoSurvivingSample: no sample has any weight.
        """
        return self.weighed([rollouts], classes)

    def weighed(self, parts: Sequence[Rollouts], classes: Mapping[int, str] | None = None) -> Estimate:
        """Weigh the samples of several batches from one state (n,) together: v [cost], u (m,) and their errors.

        Raises:
            NoSurvivingSample: no sample has any weight.
        """
        return weigh(
            self.problem, parts, self.push(parts[0].leads, parts[0].x0, parts[0].origin.time)(parts[0].x0), classes
        )

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

    def _push(self, reach: float, step: float, slack: float = 0.0, time: float = 0.0) -> Push:
        traffic = self.setup.traffic if isinstance(self.setup, MovingSetup) else None
        return Push(
            problem=self.problem, field=self.space.field, reach=reach, step=step, beyond=self._beyond, slack=slack,
            traffic=traffic, time=time,
        )  # fmt: skip

    def _scales(self, x: Array) -> Scales:
        """Those at x (n,), which are the same everywhere if G, B and R are."""
        return Scales.of(self.problem, x) if self._everywhere is None else self._everywhere

    def _packed(self, batch: Batch) -> Leads:
        """The tables that kernels read; those of the last batch if only the numbers of samples differ."""
        known, leads = self._last
        first = np.concatenate([[0], np.cumsum(batch.counts)]).astype(np.int64)
        if leads is None or not _alike(known, batch):
            leads = self._tables(batch)
        self._last = batch, leads
        return leads._replace(first=first)

    def _tables(self, batch: Batch) -> Leads:
        """The same of a batch."""
        x, times, m = batch.state, batch.times, self.problem.dynamics.m
        H, T = len(batch.proposals), len(times) - 1
        C = max([1, *(proposal.lead.sections for proposal in batch.proposals)])
        longest, scales = self.sampling.window, self._scales(x)
        bridge, end = self.sampling.exit == "bridge", self.problem.least_rate * float(times[-1])
        near = self._nearest(x, batch.time) if self.pointlike else np.inf
        leads = Leads(
            control=np.zeros((H, T, m)),
            drift=np.zeros((H, T, m)),
            times=np.ascontiguousarray(times, dtype=float),
            active=np.zeros(H, dtype=np.int64),
            first=np.zeros(H + 1, dtype=np.int64),
            ways=no_ways(H, C, NODES, scales.decay),
            reach=self._reach(scales),
            beyond=self._beyond,
            least=self._least(scales) if self.sampling.fitted else np.inf,
            weighed=bridge and self.problem.phi > end,
            window=window(scales.noise, near, times, longest) if self.pointlike else 1,
            mirrored=self.sampling.draws == "antithetic",
            law=self._laws(H, T),
            led=np.zeros(H, np.int64),
            marks=NO_MARKS if self.homology is None else Marks.of(self.homology, x, times + batch.time),
            trust=trust(scales.noise, near) if self.pointlike and self.moving else 1.0,
        )
        for h, proposal in enumerate(batch.proposals):
            proposal.lead.pack(leads, h)
        busy = np.any(leads.control != 0.0, axis=2)
        leads.active[:] = np.where(busy.any(axis=1), T - np.argmax(busy[:, ::-1], axis=1), 0)
        leads.drift[:] = leads.control @ self.setup.gain.T
        return leads

    def _least(self, scales: Scales) -> float:
        """No step near walls is shorter than this [s]."""
        least = LEAST * self.sampling.dt
        if not self.moving or not self.problem.dynamics.noisy_position:
            return least
        return max(least, (SMALL * self.problem.scene.robot_radius) ** 2 / scales.noise)

    def _nearest(self, x: Array, time: float) -> float:
        """Distance of x (n,) from the nearest wall or the goal's disc at a time [s], [m]."""
        arena = self.setup.arena
        near = float(np.hypot(*(x[:2] - np.array(arena.goal)))) - arena.radius
        near = min(float(clearance(arena.field, x[0], x[1])), near)
        if isinstance(self.setup, MovingSetup):
            near = min(near, float(traffic_clearance(self.setup.traffic, x[0], x[1], time)))
        return near

    def _reach(self, scales: Scales) -> float:
        """Of walls that push (`Leads.reach`) [m]; 0: they do not."""
        pushing = self.climbs or (isinstance(self.guidance, AnyGuidance) and self.guidance.gated)
        return scales.reach if pushing else 0.0

    def _laws(self, H: int, T: int) -> Array:
        """Room for the laws of H references over T steps."""
        if isinstance(self.guidance, AnyGuidance):
            return np.zeros((H, T * FINER, self.guidance.law_width))
        return np.zeros((H, T, LAW))


def _alike(one: Batch | None, other: Batch) -> bool:
    """Whether two batches differ in nothing but numbers of samples."""
    if one is None or one.state is not other.state or one.times is not other.times or one.time != other.time:
        return False
    pairs = zip(one.proposals, other.proposals, strict=False)
    return len(one.proposals) == len(other.proposals) and all(a.lead is b.lead for a, b in pairs)


def _bends(line: Array) -> Array:
    """Corners (j, 2) of a line (k, 2) [m] that is off them by STRAIGHT at most [m]."""
    if len(line) < 3:
        return line
    along = line[-1] - line[0]
    away = line[1:-1] - line[0]
    off = np.abs(along[0] * away[:, 1] - along[1] * away[:, 0]) / max(float(np.hypot(*along)), STRAIGHT)
    i = int(np.argmax(off)) + 1
    return line[[0, -1]] if off[i - 1] <= STRAIGHT else np.vstack([_bends(line[: i + 1])[:-1], _bends(line[i:])])


def _setup(problem: Problem, space: FreeSpace, bridge: bool) -> Setup | MovingSetup:
    d = problem.dynamics
    x = np.zeros(d.n)
    constant, told = d.constant, d.constant or d.input_form
    setup = Setup(
        arena=space.arena,
        cuts=space.homology.cuts,
        parameters=np.asarray(d.parameters, dtype=float),
        inverse=d.control_gain(x) if told else np.zeros((d.m, d.m)),
        gain=d.noise_gain(x) if told else np.zeros((d.m, d.m)),
        diffusion=np.asarray(d.B_c(x)) if constant else np.zeros((d.rows, d.m)),
        rate=0.0 if callable(problem.q) else float(problem.q),
        bridge=bridge,
        pace=problem.least_rate / problem.temperature,
    )
    return MovingSetup.of(setup, space.traffic) if problem.scene.movers else setup


def _in_parallel(work, count: int, threads: int) -> None:  # type: ignore[no-untyped-def]
    """Split a range of samples over threads; what a sample is does not depend on the split."""
    if threads == 1:
        work((0, count))
        return
    edges = np.linspace(0, count, 2 * threads + 1).astype(int)
    mapped(work, zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True), threads)
