"""Importance-sampled path integrals: the value, the control and the class weights at a state (paper, III and IV-C).

With S samples drawn around H references, psi = E_P[W]. The paper averages H estimators, each weighing its samples
by dP/dQ_h. The balance heuristic weighs every sample by dP / (1/S sum_g N_g dQ_g) instead: with finitely many
samples the plain average is too high by up to lambda ln H, since samples around one reference practically never
visit the classes of the others. Within a step walls are flat: that bias shrinks with the steps, which are split near
walls and goal.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate, Rollouts, weigh
from pirrht.estimation.leading import ProposalFactory
from pirrht.estimation.replay import Replay
from pirrht.estimation.sampling import Sampling
from pirrht.estimation.tables import Tables
from pirrht.estimation.weights import log_weights
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import clearance
from pirrht.jit.threads import mapped
from pirrht.moving.obstacles import Traffic
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.rollouts.backend import kernels_for, setup_of
from pirrht.rollouts.records import Kernels, Origin, Setup, Snapshot, empty_paths
from pirrht.steering.in_time import homology_of
from pirrht.topology.homology import Homology

TAIL = 40.0  # paths longer than the cheapest reference plus so many lambda are cut: they weigh exp(-40)


class PathIntegral:
    """Draws and weighs samples around references; the problem and its scene stay fixed.

    Args:
        beyond: terminal costs (k,) [cost] of states (k, n) at the end of the grid; None: a path that has not arrived
            by then weighs nothing.
        homology: of the problem's paths; None: where obstacles move, with bases at the best speed.
    """

    def __init__(
        self, problem: Problem, space: FreeSpace, sampling: Sampling, *,
        beyond: Callable[[Array], Array] | None = None, homology: Homology | None = None,
    ) -> None:  # fmt: skip
        self.problem, self.space, self.sampling, self.beyond = problem, space, sampling, beyond
        self.temperature = problem.temperature
        self.kernels: Kernels = kernels_for(problem)
        self.moving = bool(problem.scene.movers)
        setup = setup_of(problem, space, bridge=sampling.exit == "bridge")
        self.snapshot = Snapshot(setup, homology_of(problem, space) if homology is None else homology)
        self.guidance: DDPGuidance | None = None
        if sampling.guide == "feedback" and DDPGuidance.suits(problem):
            self.guidance = DDPGuidance(problem, self.snapshot, sways=sampling.fitted)
        self.replay = Replay(self.kernels)
        self.leading = ProposalFactory(problem, space, sampling, self.snapshot)
        self.tables = Tables(self.leading, self.guidance)
        self.threads = sampling.threads or len(os.sched_getaffinity(0))

    @property
    def setup(self) -> Setup:
        """Scene and problem as rollouts need them."""
        return self.snapshot.setup

    @property
    def homology(self) -> Homology:
        """Classes of paths, on the clock of plans."""
        return self.snapshot.homology

    def set_prediction(self, traffic: Traffic, homology: Homology) -> None:
        """Replace the predicted moving obstacles and the homology, for samples, proposals and guides."""
        self.snapshot.setup, self.snapshot.homology = self.setup._replace(traffic=traffic), homology

    def warm_up(self) -> None:
        """Compile the kernels of guides and samples, so that the first plan takes no longer than the others."""
        self.warm_up_guides()
        self.warm_up_samples()

    def warm_up_guides(self) -> None:
        """Compile the kernels of guides."""
        x = self.problem.dynamics.state_of(self.problem.scene.start)
        if self.guidance is not None:
            self.guidance.warm_up(x)
        if self.leading.climbs_too:
            self.leading.climbing(x, self.problem.scene.goal.center[None])(x, 0.0)

    def warm_up_samples(self) -> None:
        """Compile the kernels of sampling, weighing and tracing."""
        d = self.problem.dynamics
        x, times = d.state_of(self.problem.scene.start), np.arange(3.0)
        proposal = Proposal(lead=Tape(times, np.zeros((2, d.m))), count=1)
        rollouts = self.rollout(Batch(state=x, times=times, proposals=(proposal,)), 0)
        self.weighed([replace(rollouts, log_weight=np.zeros(1))])  # whatever the outcome of the sample
        self.replay.tapes(rollouts, [np.ones(1, dtype=np.bool_)])
        self.replay.trace(rollouts, np.zeros(1, dtype=np.int64))
        clearance(self.space.field, x[0], x[1])

    def grid(self, reference_cost: float) -> Array:
        """Return the ends of the rollout steps (T+1,) [s] up to T_max = (c_ref + 40 lambda) / q_min."""
        return self.steps((reference_cost + TAIL * self.temperature) / self.problem.least_rate)

    def steps(self, horizon: float) -> Array:
        """Return the ends of the rollout steps (T+1,) [s] up to a horizon [s].

        The control of the first step is the mean over that step, near a wall much weaker than the control now. Where
        plans follow each other more often than every dt, the first dt is therefore split (`Sampling.leading`).
        """
        dt = self.sampling.dt
        steps = max(1, int(np.ceil(horizon / dt)))
        parts = max(1, round(dt / self.sampling.leading))
        fine = np.arange(parts) * (dt / parts)
        return np.concatenate([fine, np.arange(1, steps + 1) * dt])

    @property
    def leads_itself(self) -> bool:
        """Check whether samples follow guides or climbs, so that references need no controls."""
        return self.guidance is not None or self.leading.climbs

    def prepare(self, batch: Batch) -> None:
        """Make the tables of a batch, for any numbers of samples."""
        self.tables.of(batch, self.setup, self.homology)

    def rollout(self, batch: Batch, seed: int) -> Rollouts:
        """Sample the paths of a batch from its state (n,) (paper, III-B); equal seeds give equal paths."""
        leads = self.tables.of(batch, self.setup, self.homology)
        first, H = leads.first, len(batch.proposals)
        S = int(first[-1])
        paths, log_weight = empty_paths(S, H, self.problem.dynamics.m), np.empty(S)
        origin = Origin(np.ascontiguousarray(batch.state, dtype=float), np.uint64(seed), float(batch.time))

        def work(part: tuple[int, int]) -> None:
            self.kernels.sample(self.setup, leads, origin, part[0], part[1], paths)
            log_weight[slice(*part)] = log_weights(self.problem, self.sampling.weights, paths, first, part)

        _in_parallel(work, S, self.threads if self.kernels.alone < S else 1)
        rise = None
        if self.guidance is not None:
            x = batch.state
            rise = np.array([leads.trust * (one.lead(x, 0.0) - one.lead.held(x)) for one in batch.proposals])
        rollouts = Rollouts(origin=origin, leads=leads, paths=paths, log_weight=log_weight, setup=self.setup, rise=rise)
        return rollouts if self.beyond is None else self._completed(rollouts, self.beyond)

    def _completed(self, rollouts: Rollouts, beyond: Callable[[Array], Array]) -> Rollouts:
        """Charge paths that are under way at the end of the grid their terminal cost."""
        paths = rollouts.paths
        under_way = np.flatnonzero(paths.outcome == Outcome.TIMEOUT)
        if len(under_way) == 0:
            return rollouts
        work, outcome = paths.work.copy(), paths.outcome.copy()
        work[under_way] += beyond(self.replay.trace(rollouts, under_way)[0][:, -1])
        outcome[under_way] = Outcome.GOAL
        arrived, first = paths._replace(work=work, outcome=outcome), rollouts.leads.first
        return replace(rollouts, log_weight=log_weights(self.problem, self.sampling.weights, arrived, first))

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
        first = parts[0]
        return weigh(self.problem, parts, self.leading.near_walls(first.leads, first.x0, first.origin.time), classes)


def _in_parallel(work, count: int, threads: int) -> None:  # type: ignore[no-untyped-def]
    """Split a range of samples over threads; samples do not depend on the split."""
    if threads == 1:
        work((0, count))
        return
    edges = np.linspace(0, count, 2 * threads + 1).astype(int)
    mapped(work, zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True), threads)
