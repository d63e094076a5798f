"""Proposals of a plan: for every class the local optima of its paths, and the samples around each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.control.baselines import follow_best
from pirrht.control.mixture import controls_followed, pooled
from pirrht.control.plan import Plan
from pirrht.control.policy import RunState, from_start
from pirrht.control.prediction import favourite_path
from pirrht.control.settings import ControlSettings, TimeBudget
from pirrht.errors import NoSurvivingSample
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.jit.jit import mapped
from pirrht.planner.references import Reference
from pirrht.problem import Problem
from pirrht.proposals.controls import LinearFeedback
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.proposals.tuning import TUNING
from pirrht.steering.motion import Trajectory, running_cost


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalBuilder:
    """Builds the proposals of plans; all that it learns is in the memory of the run.

    Where samples of all classes are not weighed together, nothing is learnt from their weights.
    """

    integral: PathIntegral
    settings: ControlSettings

    @property
    def allocates(self) -> bool:
        """Check whether classes may have unequal numbers of samples, by contributions in earlier plans."""
        return self.settings.use.mixes and self.integral.sampling.allocation == "contribution"

    def batch(self, x: Array, references: Sequence[Reference], run: RunState, budget: TimeBudget) -> Batch:
        """Return what a plan at x (n,) samples: around references, or passive dynamics if there is none."""
        integral, d = self.integral, self.integral.problem.dynamics
        trajectories = [reference.trajectory for reference in references]
        times = integral.grid(least_cost(integral.problem, x, trajectories))
        if not references:
            still = Tape(times, np.zeros((len(times) - 1, d.m)))
            proposals = [Proposal(lead=still, count=integral.sampling.samples)]
            return Batch(state=x, times=times, proposals=tuple(proposals), time=run.now, others=run.memory.others)
        classes = from_start(run, references)
        names, keys = [run.homology.name(one) for one in classes], [run.homology.key(one.winding) for one in references]
        controls = integral.proposals.controls(
            x, times, trajectories, drops=self.allocates and integral.guidance is None
        )
        predicted, worth = [one.promise for one in controls], [one.follows for one in controls]
        counts = [integral.sampling.samples] * len(classes)

        def followed(guide: DDPGuide) -> ProposalControl:
            """Follow a guide with its feedback, or its nominal controls, the last of which leads on into the goal."""
            if integral.guidance is not None:
                return LinearFeedback(guide)
            controls, end = guide.tape, guide.length
            controls[end : end + TUNING.onward] = controls[end - 1]
            return Tape(times, controls)

        if integral.guidance is not None or any(one.slack is not None for one in trajectories):
            guides = self._guides(integral.proposals.nominal, x, times, references, run, budget)
            pairs = zip(controls, guides, strict=True)
            controls = [one if guide is None else followed(guide) for one, guide in pairs]
        if integral.guidance is not None:
            counts = integral.guidance.counts(guides, integral.sampling.samples)
            predicted, worth = [0.0] * len(counts), [count > TUNING.few for count in counts]  # costs are too rough
            run.memory.sampled = {one for one, enough in zip(classes, worth, strict=True) if enough}
        if self.allocates:
            counts = run.memory.allocation.counts(names, predicted, worth, integral.sampling.samples)
        rows = zip(controls, counts, names, keys, strict=True)
        proposals = [Proposal(lead=one, count=count, name=name, key=key) for one, count, name, key in rows]

        def second(k: int) -> ProposalControl | None:
            """Return the other local optimum of the k-th class, or the ascent of psi of a point."""
            other = run.memory.optima.get(classes[k], [])[1:]
            return followed(other[0]) if other else integral.proposals.defensive(x, trajectories[k], run.now)

        if self.settings.use.mixes:
            proposals = run.memory.allocation.split(proposals, second)
        return Batch(state=x, times=times, proposals=tuple(proposals), time=run.now, others=run.memory.others)

    def estimate(self, batch: Batch, seed: int, run: RunState, budget: TimeBudget) -> Estimate | None:
        """Sample and weigh a batch, and learn from it; None if no sample survives."""
        first = budget.left is None and run.time == run.begun
        least = self.integral.sampling.least if first else 0.0
        self.integral.proposals.tables(batch)
        run.recent = budget.noted(len(batch.classes), run.recent)
        try:
            estimate = self.integral.sample(batch, seed, left=budget.left, least=least)
        except NoSurvivingSample:
            return None
        if self.settings.use.mixes:
            run.memory.allocation.learn(batch, estimate)
        if self.settings.use.alone and batch.classes:
            estimate = follow_best(self.integral.problem, estimate, batch, run.memory, self.settings.consistency)
        guided = self.integral.guidance is not None and batch.classes
        return None if guided and estimate.survivors == 0 else estimate

    def _guides(
        self, guidance: DDPGuidance, x: Array, times: Array, references: Sequence[Reference],
        run: RunState, budget: TimeBudget,
    ) -> list[DDPGuide | None]:  # fmt: skip
        """Return the best guide of every class from x (n,), None where there is none; remember all local optima.

        The first guides of a run are improved from all initialisations. If time is short, new classes get none,
        except the cheapest, which is improved as long as there is time. Hopeless classes of tracked paths get none.
        """
        memory, short, classes = run.memory, budget.short, from_start(run, references)
        anew = not memory.optima and not short()

        def improved(k: int) -> list[DDPGuide]:
            one, last, late = references[k], memory.optima.get(classes[k], []), k > 0 and short()
            hopeless = k > 0 and one.trajectory.slack is not None and one.cost > bound
            if hopeless or (not last and late):
                return []  # new ones take ten times as long
            query = guidance.query(x, times, run.homology.key(one.winding), run.now)
            thorough = anew and k < self.settings.tuning.thorough and not late
            return guidance.optima(query, one.trajectory, last, run.since_plan, thorough=thorough, short=short)

        found = [] if memory.optima else [improved(0)]
        known = [some[0].penalised for some in [*memory.optima.values(), *found] if some and some[0].valid]
        bound = guidance.hopeless(min(known, default=np.inf))  # of tracked paths, which cost less than what tracks them
        found += mapped(improved, range(len(found), len(references)), self.integral.threads)
        memory.optima = {one: some for one, some in zip(classes, found, strict=True) if some and some[0].valid}
        return [some[0] if some else None for some in found]


def least_cost(problem: Problem, x: Array, trajectories: Sequence[Trajectory]) -> float:
    """Return the least cost of references under q + u'Ru/2; without any, four times that of the straight line."""
    if not trajectories:
        return 4.0 * problem.least_rate * float(np.hypot(*(x[:2] - problem.scene.goal.center)))
    return min(running_cost(problem, x, trajectory) for trajectory in trajectories)


def plan_of(
    integral: PathIntegral, batch: Batch, references: Sequence[Reference], estimate: Estimate, run: RunState,
    settings: ControlSettings,
) -> Plan:  # fmt: skip
    """Return the plan that an estimate makes, with feedback until the next one unless controls are held."""
    x, memory = batch.state, run.memory
    push = integral.proposals.push(estimate.rollouts.tables, x, run.now)
    if settings.between == "classes":
        followed = controls_followed(batch, estimate)
        memory.mixture = pooled(
            integral.problem, memory.mixture, estimate, followed, push, run.since_estimate, settings.tuning
        )
    law, run.halt = memory.mixture, None
    plan = Plan(
        state=x, times=batch.times, references=tuple(references), ids=tuple(batch.classes.values()), estimate=estimate,
        replay=integral.replay, fallback=None, law=law, classes=batch.named, time=run.time, push=push,
        shares=None if law is None else law.weights(x, 0.0), followed=memory.followed, space=integral.space,
        movers=run.movers,
    )  # fmt: skip
    run.planned, run.since_plan, run.since_estimate = True, 0.0, 0.0
    if run.prediction is not None:
        run.favourite = favourite_path(plan)
    return plan
