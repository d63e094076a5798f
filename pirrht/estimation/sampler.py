"""Importance-sampled path integrals: the value, the control and the class weights at a state (paper, III and IV-C).

With S samples drawn around H references, psi = E_P[W]. The paper averages H estimators, each weighing its samples
by dP/dQ_h. The balance heuristic weighs every sample by dP / (1/S sum_g N_g dQ_g) instead: with finitely many
samples the plain average is too high by up to lambda ln H, since samples around one reference practically never
visit the classes of the others. Within a step walls are flat: that bias shrinks with the steps, which are split near
walls and goal.

The first batch alone is an unbiased estimate of psi. A number of batches that depends on their samples
(`Sampling.target`) tends to stop before heavy samples are met, so that the estimate is consistent but not unbiased; a
time limit does so as far as the time that samples take depends on their outcome.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.errors import NoSurvivingSample
from pirrht.estimation.estimate import Estimate, Rollouts, weigh
from pirrht.estimation.sampling import ONCE, TUNING, Effort, EstimationTuning
from pirrht.estimation.weights import log_weights, normalised
from pirrht.jit.jit import over_ranges
from pirrht.outcome import Outcome
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.rollouts.backend import Backend
from pirrht.rollouts.tables import Origin, Setup

if TYPE_CHECKING:  # built elsewhere (`assembly`): the estimator knows their interface only
    from pirrht.estimation.factory import ProposalFactory
    from pirrht.geometry.world import Moving
    from pirrht.topology.signature import Signature


class Replay(NamedTuple):
    """Simulates samples of an estimate again: a path is a function of seed and number, so its steps are not kept."""

    backend: Backend

    def trace(self, rollouts: Rollouts, chosen: IntArray) -> tuple[Array, IntArray]:
        """Return states (c, T+1, n) of chosen samples (c,), and the number of steps of each, (c,)."""
        return self._again(rollouts, chosen)[::2]

    def applied(self, rollouts: Rollouts, chosen: IntArray) -> tuple[Array, Array, IntArray]:
        """Return states (c, T+1, n) of chosen samples (c,), the a that steps apply (c, T, m) [1/sqrt(s)], steps (c,).

        The gain of the system is constant.
        """
        states, controls, steps = self._again(rollouts, chosen)
        return states, controls @ rollouts.setup.gain.T, steps

    def tape(self, parts: Sequence[Rollouts]) -> Array:
        """Return open-loop controls (T, m) of all samples (paper, end of IV-C)."""
        top = max(float(part.log_weight.max()) for part in parts)
        share = np.array([float(np.exp(part.log_weight - top).sum()) for part in parts])
        share /= share.sum()
        return np.asarray(sum(w * self.mean_control(part) for w, part in zip(share, parts, strict=True)))

    def mean_control(self, rollouts: Rollouts) -> Array:
        """Return the mean of the controls that samples carry, by their weights, (T, m)."""
        weight, _ = normalised(rollouts.log_weight)
        total = np.zeros(rollouts.tables.control.shape[1:])
        chosen = np.flatnonzero(weight > TUNING.negligible)
        for start in range(0, len(chosen), TUNING.replayed):
            number = chosen[start : start + TUNING.replayed]
            total += np.sum(weight[number, None, None] * self._again(rollouts, number)[1], axis=0)
        return total

    def _again(self, rollouts: Rollouts, chosen: IntArray) -> tuple[Array, Array, IntArray]:
        return self.backend.replay(rollouts.setup, rollouts.tables, rollouts.origin, chosen)


def round_seed(seed: int, number: int) -> int:
    """Return the seed of a round of samples; the first takes that of its plan."""
    if number == 0:
        return seed
    return int(np.random.SeedSequence([seed, number]).generate_state(1, np.uint64)[0] >> np.uint64(1))


class PathIntegral:
    """Draws and weighs samples around references, in threads; `path_integral` makes one for a problem and its space."""

    def __init__(
        self, proposals: "ProposalFactory", backend: Backend, *, threads: int = 1,
        terminal_cost: Callable[[Array], Array] | None = None, tuning: EstimationTuning = TUNING,
    ) -> None:  # fmt: skip
        self.proposals, self.backend, self.replay = proposals, backend, Replay(backend)
        self.threads, self.terminal_cost, self.tuning = threads, terminal_cost, tuning
        self.problem, self.sampling, self.guidance = proposals.problem, proposals.sampling, proposals.guidance
        self.space, self.temperature = proposals.space, proposals.problem.temperature

    @property
    def setup(self) -> Setup:
        """Scene and problem as rollouts need them, under the current prediction."""
        return self.proposals.world.setup

    @property
    def homology(self) -> "Signature":
        """Classes of paths under the current prediction."""
        return self.proposals.world.homology

    @property
    def moving(self) -> bool:
        """Check for moving obstacles."""
        return self.proposals.world.moving

    def set_prediction(self, moving: "Moving", homology: "Signature") -> None:
        """Replace the prediction of moving obstacles and its classes, on the clock of batches and guides."""
        self.proposals.world.snapshot = self.setup._replace(world=self.setup.world._replace(moving=moving)), homology

    def warm_up(self, *, optima: bool = True) -> None:
        """Compile the kernels of guides and samples, so that the first plan takes no longer than the others.

        Args:
            optima: also those of the optimisation of trajectories, which take the longest.
        """
        self.proposals.warm_up(optima=optima)
        d = self.problem.dynamics
        x = d.state_of(self.problem.scene.start)
        times = np.arange(3.0)
        proposal = Proposal(lead=Tape(times, np.zeros((2, d.m))), count=1)
        rollouts = self.rollout(Batch(state=x, times=times, proposals=(proposal,)), 0)
        self.estimate(replace(rollouts, log_weight=np.zeros(1)))  # whatever the outcome of the sample
        self.replay.mean_control(replace(rollouts, log_weight=np.zeros(1)))
        self.replay.trace(rollouts, np.zeros(1, dtype=np.int64))

    def grid(self, reference_cost: float) -> Array:
        """Return the ends of the rollout steps (T+1,) [s] up to T_max = (c_ref + 40 lambda) / q_min."""
        return self.steps((reference_cost + self.tuning.tail * self.temperature) / self.problem.least_rate)

    def steps(self, horizon: float) -> Array:
        """Return the ends of the rollout steps (T+1,) [s] up to a horizon [s].

        The control of the first step is the mean over that step, near a wall much weaker than the control now. Where
        plans follow each other more often than every dt, the first dt is therefore split (`Sampling.first_dt`).
        """
        dt = self.sampling.dt
        steps = max(1, int(np.ceil(horizon / dt)))
        parts = max(1, round(dt / self.sampling.first_dt))

        return np.concatenate([np.arange(parts) * (dt / parts), np.arange(1, steps + 1) * dt])

    def rollout(self, batch: Batch, seed: int) -> Rollouts:
        """Sample the paths of a batch from its state (n,) (paper, III-B); equal seeds give equal paths."""
        setup = self.setup
        x = self.problem.dynamics.checked(batch.state)
        tables = self.proposals.tables(replace(batch, state=x))
        m = self.problem.dynamics.m

        origin = Origin(np.ascontiguousarray(x), np.uint64(seed), float(batch.time))
        paths = self.backend.sample(setup, tables, origin)
        rise = np.zeros((len(batch.proposals), m))
        laws = None
        if self.guidance is not None:
            held = np.array([one.lead.held(x) for one in batch.proposals])
            rise[:] = tables.law_weight * (np.array([one.lead(x, 0.0) for one in batch.proposals]) - held)
            if not self.proposals.pointlike:
                laws = np.where(np.array([one.lead.follows for one in batch.proposals])[:, None], held, np.nan)
        log_weight = np.empty(len(paths.work))
        rollouts = Rollouts(
            setup=setup, origin=origin, tables=tables, paths=paths, log_weight=log_weight, rise=rise, laws=laws
        )
        ended, under_way = paths, np.flatnonzero(paths.outcome == Outcome.TIMEOUT)
        if self.terminal_cost is not None and len(under_way) > 0:  # as if they had arrived
            cost = paths.work.copy()
            outcome = paths.outcome.copy()
            cost[under_way] += self.terminal_cost(self.replay.trace(rollouts, under_way)[0][:, -1])
            outcome[under_way] = Outcome.GOAL
            ended = paths._replace(work=cost, outcome=outcome)

        def work(start: int, stop: int) -> None:
            part = slice(start, stop)
            log_weight[part] = log_weights(self.problem, self.sampling.weights, ended, tables.first, part)

        over_ranges(work, rollouts.size, self.threads if rollouts.size >= self.tuning.parallel else 1)
        for key, surcharge in {one.key: one.surcharge for one in batch.proposals if one.surcharge}.items():
            log_weight[paths.key == key] -= surcharge / self.temperature
        return rollouts

    def estimate(self, *parts: Rollouts, classes: Mapping[int, str] | None = None) -> Estimate:
        """Weigh samples of batches from one state (n,) together (`weigh`); `classes` are names by additive key."""
        walls = self.proposals.near_walls(parts[0].tables, parts[0].origin.x, parts[0].origin.time)
        return weigh(self.problem, parts, walls, classes)

    def sample(
        self, batch: Batch, seed: int, *, left: Callable[[], float] | None = None, effort: Effort = ONCE
    ) -> Estimate:
        """Sample the paths of a batch in one or more rounds, and weigh all (Algorithm 4, line 4).

        Equal seeds of a plan give equal paths. Rounds are drawn until the time `left` [s] is up, and as many as an
        effort allows. NoSurvivingSample: no sample has any weight.
        """
        settings, tuning, number = self.sampling, self.tuning, np.asarray(batch.counts)
        parts: list[Rollouts] = []

        def draw(multiple: float, fewest: int = 0) -> None:
            """Draw a multiple of the batch from a seed of its own; the first round takes the seed of the plan."""
            counts = np.maximum(fewest, np.rint(multiple * number)).astype(np.int64)
            parts.append(self.rollout(batch.counting(counts.tolist()), round_seed(seed, len(parts))))

        most = tuning.most / max(1.0, float(number.sum()))
        changing = self.moving or self.space.grain is not None
        first = tuning.first_round if left is not None and changing else 1.0
        begun = math.inf if left is None else left()
        draw(first, fewest=0 if left is None else 1)
        if left is not None:
            more, drawn, now = first, first, left()
            while drawn < most:
                more = min(2.0 * drawn, most - drawn, tuning.filled * now * more / max(begun - now, 1e-6))
                if more < first:  # as few as that are not worth their overhead
                    break
                draw(more)

                drawn = drawn + more
                begun = now
                now = left()
        drawn, limit = 1.0, 16.0 if settings.budget is None else settings.budget / settings.samples
        found = self._so_far(parts, batch.named)
        while settings.target is not None and drawn < limit:
            if found is not None and found.control_error.max() <= settings.target:
                break
            more = min(drawn, limit - drawn)
            draw(more, fewest=1)
            drawn += more
            found = self._so_far(parts, batch.named)
        most = min(effort.multiple, most)
        enough = 2 if effort.least <= 0.0 or (found is not None and found.ess >= effort.least) else 0
        while enough < 2 and 2.0 * drawn <= most:  # twice: so many may be chance, until a heavy sample comes
            draw(drawn)
            drawn *= 2.0
            found = self._so_far(parts, batch.named)
            enough = enough + 1 if found is not None and found.ess >= effort.least else 0
        return self.estimate(*parts, classes=batch.named) if found is None else found

    def _so_far(self, parts: Sequence[Rollouts], classes: Mapping[int, str] | None) -> Estimate | None:
        """Weigh what has been drawn; None if no sample survives."""
        try:
            return self.estimate(*parts, classes=classes)
        except NoSurvivingSample:
            return None
