"""Importance-sampled path integrals: the value, the control and the class weights at a state (paper, III and IV-C).

With S samples drawn around H references, psi = E_P[W]. The paper averages H estimators, each weighing its samples
by dP/dQ_h. The balance heuristic weighs every sample by dP / (1/S sum_g N_g dQ_g) instead: with finitely many
samples the plain average is too high by up to lambda ln H, since samples around one reference practically never
visit the classes of the others. Within a step walls are flat: that bias shrinks with the steps, which are split near
walls and goal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate, Rollouts, weigh
from pirrht.estimation.replay import Replay
from pirrht.estimation.sampling import Sampling
from pirrht.estimation.tuning import TUNING, EstimationTuning
from pirrht.estimation.weights import log_weights
from pirrht.jit.threads import over_ranges
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.rollouts.backend import Backend
from pirrht.rollouts.tables import Origin, Paths, ProposalTables, Setup, Snapshot

if TYPE_CHECKING:  # built elsewhere (`assembly`): the estimator knows their interface only
    from pirrht.estimation.factory import ProposalFactory
    from pirrht.freespace import FreeSpace
    from pirrht.geometry.world import Moving
    from pirrht.topology.homology import Homology


class PathIntegral:
    """Draws and weighs samples around references; the problem and its scene stay fixed.

    `assembly.path_integral` makes one for a problem and its free space.

    Args:
        proposals: makes controls of samples.
        pack: writes a batch into the tables that the backend reads.
        backend: simulates paths.
        threads: that weigh samples and make guides.
        beyond: terminal costs (k,) [cost] of states (k, n) at the end of the grid; None: a path that has not arrived
            by then weighs nothing.
    """

    def __init__(
        self, problem: Problem, sampling: Sampling, proposals: ProposalFactory,
        pack: Callable[[Batch], ProposalTables], backend: Backend, *, threads: int = 1,
        beyond: Callable[[Array], Array] | None = None, tuning: EstimationTuning = TUNING,
    ) -> None:  # fmt: skip
        self.problem, self.sampling, self.proposals, self.pack, self.backend = (
            problem,
            sampling,
            proposals,
            pack,
            backend,
        )
        self.threads, self.beyond, self.tuning = threads, beyond, tuning
        self.temperature, self.guidance = problem.temperature, proposals.guidance

    @property
    def space(self) -> FreeSpace:
        """The free space."""
        return self.proposals.space

    @property
    def setup(self) -> Setup:
        """Scene and problem as rollouts need them, under the current prediction."""
        return self.proposals.world.setup

    @property
    def homology(self) -> Homology:
        """Classes of paths under the current prediction."""
        return self.proposals.world.homology

    @property
    def moving(self) -> bool:
        """Check for moving obstacles."""
        return self.proposals.world.moving

    @property
    def replay(self) -> Replay:
        """Replay of samples."""
        return Replay(self.backend)

    def set_prediction(self, moving: Moving, homology: Homology) -> None:
        """Replace the prediction of moving obstacles and its classes, on the clock of batches and guides."""
        self.proposals.world.snapshot = Snapshot(
            self.setup._replace(world=self.setup.world._replace(moving=moving)), homology
        )

    def warm_up(self) -> None:
        """Compile the kernels of guides and samples, so that the first plan takes no longer than the others."""
        self.proposals.warm_up()
        self.warm_up_samples()

    def warm_up_samples(self) -> None:
        """Compile the kernels of sampling, weighing and tracing."""
        d = self.problem.dynamics
        x, times = d.state_of(self.problem.scene.start), np.arange(3.0)
        proposal = Proposal(lead=Tape(times, np.zeros((2, d.m))), count=1)
        rollouts = self.rollout(Batch(state=x, times=times, proposals=(proposal,)), 0)
        self.weighed([replace(rollouts, log_weight=np.zeros(1))])  # whatever the outcome of the sample
        self.replay.tapes(rollouts, [np.ones(1, dtype=np.bool_)])
        self.replay.trace(rollouts, np.zeros(1, dtype=np.int64))

    def grid(self, reference_cost: float) -> Array:
        """Return the ends of the rollout steps (T+1,) [s] up to T_max = (c_ref + tail lambda) / q_min."""
        return self.steps((reference_cost + self.tuning.tail * self.temperature) / self.problem.least_rate)

    def steps(self, horizon: float) -> Array:
        """Return the ends of the rollout steps (T+1,) [s] up to a horizon [s].

        The control of the first step is the mean over that step, near a wall much weaker than the control now. Where
        plans follow each other more often than every dt, the first dt is therefore split (`Sampling.first_dt`).
        """
        dt = self.sampling.dt
        steps = max(1, int(np.ceil(horizon / dt)))
        parts = max(1, round(dt / self.sampling.first_dt))
        fine = np.arange(parts) * (dt / parts)
        return np.concatenate([fine, np.arange(1, steps + 1) * dt])

    def prepare(self, batch: Batch) -> None:
        """Make the tables of a batch, for any numbers of samples."""
        self.pack(batch)

    def rollout(self, batch: Batch, seed: int) -> Rollouts:
        """Sample the paths of a batch from its state (n,) (paper, III-B); equal seeds give equal paths."""
        setup, leads, x = self.setup, self.pack(batch), batch.state
        origin = Origin(np.ascontiguousarray(x, dtype=float), np.uint64(seed), float(batch.time))
        paths = self.backend.sample(setup, leads, origin)
        rollouts = Rollouts(
            setup=setup, origin=origin, leads=leads, paths=paths, log_weight=np.empty(len(paths.work)),
            rise=np.zeros((len(batch.proposals), self.problem.dynamics.m)),
        )  # fmt: skip
        if self.guidance is not None:
            rise = [leads.trust * (one.lead(x, 0.0) - one.lead.held(x)) for one in batch.proposals]
            rollouts = replace(rollouts, rise=np.array(rise))
        ended = paths if self.beyond is None else self._completed(rollouts, self.beyond)

        def work(start: int, stop: int) -> None:
            part = slice(start, stop)
            rollouts.log_weight[part] = log_weights(self.problem, self.sampling.weights, ended, leads.first, part)

        over_ranges(work, rollouts.size, self.threads if rollouts.size >= self.tuning.parallel else 1)
        return rollouts

    def _completed(self, rollouts: Rollouts, beyond: Callable[[Array], Array]) -> Paths:
        """Charge paths that are under way at the end of the grid their terminal cost, as if they had arrived."""
        paths = rollouts.paths
        under_way = np.flatnonzero(paths.outcome == Outcome.TIMEOUT)
        if len(under_way) == 0:
            return paths
        work, outcome = paths.work.copy(), paths.outcome.copy()
        work[under_way] += beyond(self.replay.trace(rollouts, under_way)[0][:, -1])
        outcome[under_way] = Outcome.GOAL
        return paths._replace(work=work, outcome=outcome)

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
        return weigh(self.problem, parts, self.proposals.near_walls(first.leads, first.x0, first.origin.time), classes)
