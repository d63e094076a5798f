"""Proposals of a plan: local optima of each class, laws fitted to earlier samples, and samples around all of them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import count

import numpy as np

from pirrht.arrays import Array
from pirrht.control.baselines import follow_best
from pirrht.control.held import HeldLaw
from pirrht.control.plan import Law, Plan, controls_followed, pooled
from pirrht.control.prediction import favourite_path
from pirrht.control.run_state import ClassFromStart, RunState, from_start
from pirrht.control.settings import ControlSettings, TimeBudget
from pirrht.errors import NoSurvivingSample
from pirrht.estimation.estimate import Estimate, all_samples
from pirrht.estimation.sampler import PathIntegral, round_seed
from pirrht.estimation.sampling import ONCE, Effort
from pirrht.jit.jit import mapped
from pirrht.outcome import Outcome
from pirrht.planner.references import Reference
from pirrht.planner.tuning import TUNING as PLANNER
from pirrht.problem import Problem
from pirrht.proposals.fitted_law import LawFit, chosen
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.proposals.tuning import TUNING
from pirrht.steering.motion import Trajectory, running_cost
from pirrht.topology.signature import integers

Propose = Callable[[Array, ProposalControl], ProposalControl | None]  # state (n,), the default of a class
Surcharge = Callable[[Reference], float]  # what samples of a reference's class pay besides their cost [cost]


@dataclass(frozen=True, slots=True, kw_only=True)
class Draft:
    """A plan's batch before laws are fitted: one proposal per class, and the others of each."""

    batch: Batch  # one proposal per class, with all samples of the class
    classes: Sequence[ClassFromStart] = ()  # (H,) of the proposals, from the start of the run
    others: Callable[[int], list[ProposalControl]] | None = None  # of the k-th class; None: one proposal per class


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalBuilder:
    """Builds the proposals of plans; all that it learns is in the state of the run."""

    integral: PathIntegral
    settings: ControlSettings
    propose: Sequence[Propose] = ()  # further proposals of each class, by its default
    surcharge: Surcharge | None = None

    @property
    def learns(self) -> bool:
        """Check whether laws are fitted to samples."""
        guidance, constant = self.integral.guidance, self.integral.proposals.traits.constant_gain
        return guidance is not None and not guidance.gated and constant and self.settings.use.mixes

    def draft(self, x: Array, references: Sequence[Reference], run: RunState, budget: TimeBudget) -> Draft:
        """Return what a plan at x (n,) samples around references, or passive dynamics if there is none."""
        integral, starts = self.integral, run.starts
        times = integral.grid(least_cost(integral.problem, x, [one.trajectory for one in references]))
        classes = from_start(run, references)
        driven, homology = run.route.path.winding(), run.route.homology
        others = {homology.key(integers(np.subtract(one, driven))): homology.name(one) for one in starts.paths}
        if not references:
            still = Tape(times, np.zeros((len(times) - 1, integral.problem.dynamics.m)))
            passive = Proposal(lead=still, count=integral.sampling.samples)
            return Draft(batch=Batch(state=x, times=times, proposals=(passive,), time=run.now, others=others))
        leads = self._leads(x, times, references, run, budget)
        proposals = tuple(
            Proposal(
                lead=lead,
                count=count,
                name=homology.name(one),
                key=homology.key(reference.winding),
                surcharge=0.0 if self.surcharge is None else self.surcharge(reference),
            )
            for (lead, count), one, reference in zip(leads, classes, references, strict=True)
        )

        @cache
        def others_of(k: int) -> list[ProposalControl]:
            """Return the other local optima of the k-th class, or the ascent of psi of a point, and the user's own."""
            found: list[ProposalControl | None] = []
            found += (self._followed(guide, times) for guide in starts.optima.get(classes[k], [])[1:])
            found = found or [integral.proposals.defensive(x, references[k].trajectory, run.now)]
            found += (propose(x, proposals[k].lead) for propose in self.propose)
            return [one for one in found if one is not None]

        batch = Batch(state=x, times=times, proposals=proposals, time=run.now, others=others)
        return Draft(batch=batch, classes=classes, others=others_of if self.settings.use.mixes else None)

    def _leads(
        self, x: Array, times: Array, references: Sequence[Reference], run: RunState, budget: TimeBudget
    ) -> list[tuple[ProposalControl, int]]:
        """Return the default proposal of each class from x (n,), and its number of samples."""
        guidance, samples = self.integral.guidance, self.integral.sampling.samples
        allocates = self.settings.use.mixes and self.integral.sampling.allocation == "contribution"
        trajectories = [one.trajectory for one in references]
        classes = from_start(run, references)
        grids = {k: run.starts.grids[one] for k, one in enumerate(classes) if one in run.starts.grids}
        drops = allocates and guidance is None
        controls = self.integral.proposals.controls(x, times, trajectories, drops=drops, grids=grids)
        run.starts.grids |= {classes[k]: grid for k, grid in grids.items()}
        predicted = [one.promise for one in controls]
        worth = [one.follows for one in controls]
        counts = [samples] * len(classes)

        if guidance is not None or any(one.slack is not None for one in trajectories):
            guides = self._guides(x, times, references, run, budget)
            pairs = zip(controls, guides, strict=True)
            controls = [one if guide is None else self._followed(guide, times) for one, guide in pairs]
        if guidance is not None:
            counts = guidance.counts(guides, samples)
            predicted = [0.0] * len(counts)  # costs are too rough
            worth = [count > TUNING.few for count in counts]
            run.starts.sampled = {one for one, enough in zip(classes, worth, strict=True) if enough}
        if allocates:  # by contributions in earlier plans
            counts = run.shares.allocation.counts([*map(run.route.homology.name, classes)], predicted, worth, samples)
        return [*zip(controls, counts, strict=True)]

    def _followed(self, guide: DDPGuide, times: Array) -> ProposalControl:
        """Follow a guide with its feedback, or its nominal controls, the last of which leads on into the goal."""
        if self.integral.guidance is not None:
            return LinearFeedback(guide)
        nominal, end = guide.tape, guide.length
        nominal[end : end + TUNING.onward] = nominal[end - 1]
        return Tape(times, nominal)

    def mixture(self, draft: Draft, run: RunState) -> Batch:
        """Return the batch of a draft, with the samples of a class divided between its proposals and its fitted law."""
        others = draft.others
        if others is None:
            return draft.batch

        def added(k: int) -> list[ProposalControl]:
            fitted = run.starts.fitted(draft.classes[k], run.clock.since_plan, timed=self.integral.moving)
            return [*([] if fitted is None else [LinearFeedback(fitted)]), *others(k)]

        return replace(draft.batch, proposals=tuple(run.shares.allocation.split(draft.batch.proposals, added)))

    def estimate(self, draft: Draft, seed: int, run: RunState, budget: TimeBudget) -> tuple[Batch, Estimate | None]:
        """Sample and weigh a draft, and learn from it; return the batch that was weighed, None if no sample survives.

        A plan with too few effective samples fits its laws to those it has and draws again, twice as many each time, up
        to one round more than has enough. It is weighed by the last round alone, whose laws were known before it.
        """
        integral = self.integral
        effort = self._effort(run, budget)
        batch = self.mixture(draft, run)
        integral.proposals.tables(batch)
        run.effort.most = budget.most_classes(len(batch.classes))
        if self.learns:
            batch, estimate, drawn = self._rounds(draft, batch, seed, run, budget, effort)
        else:
            estimate = self._round(batch, seed, run, budget, effort)
            drawn = 0.0 if estimate is None else sum(part.size for part in estimate.parts) / sum(batch.counts)
        if run.effort.most is not None:  # a class is no better for being cheap
            run.effort.most = max(run.effort.most, classes_with_weight(batch, estimate))
        if not run.clock.first and effort.least > 0.0:
            run.effort.spend(None if estimate is None else drawn)
        if estimate is None:
            return batch, None
        if self.settings.use.alone and batch.classes:
            estimate = follow_best(integral.problem, estimate, batch, run.shares, self.settings.consistency)
        lost = integral.guidance is not None and batch.classes and estimate.survivors == 0
        return batch, None if lost else estimate

    def _rounds(
        self, draft: Draft, batch: Batch, seed: int, run: RunState, budget: TimeBudget, effort: Effort
    ) -> tuple[Batch, Estimate | None, float]:
        """Draw rounds of a draft, each twice as large as all before, up to one more than has enough effective samples.

        A later plan of a run whose first round has enough draws no more. Return the last round: its batch, its
        estimate, and what was drawn in all, in multiples of the batch.
        """
        multiple = 1.0
        drawn = 0.0
        last = effort.least <= 0.0
        for number in count():
            batch = batch.counting([round(multiple * one) for one in batch.counts])
            estimate = self._round(batch, round_seed(seed, number), run, budget, ONCE)
            drawn += multiple
            enough = estimate is not None and estimate.ess >= effort.least
            if last or (enough and not run.clock.first) or 2.0 * drawn > effort.multiple:
                break
            last = enough
            batch = self.mixture(draft, run)
            multiple = drawn
        return batch, estimate, drawn

    def _effort(self, run: RunState, budget: TimeBudget) -> Effort:
        """Return what a plan draws; later plans save for weak ones."""
        integral, tuning = self.integral, self.integral.tuning
        least = integral.sampling.least if budget.left is None else 0.0
        if run.clock.first:
            return Effort(least, tuning.first_plan)
        saved = run.effort.save(tuning.saved, tuning.later_plan - 1.0)
        return Effort(min(least, tuning.few), 1.0 + saved)

    def _round(self, batch: Batch, seed: int, run: RunState, budget: TimeBudget, effort: Effort) -> Estimate | None:
        """Sample and weigh a batch, and learn from it; None if no sample has any weight."""
        left = None if budget.left is None else budget.less(run.effort.fitting)
        try:
            estimate = self.integral.sample(batch, seed, left=left, effort=effort)
        except NoSurvivingSample:
            return None
        run.effort.weak = estimate.ess < TUNING.fit_enough
        for name, weight in estimate.class_weights.items():
            if weight >= TUNING.fit_weight:
                run.retries.due.pop(name, None)  # it is tried at the next plan
        if self.settings.use.mixes:
            run.shares.allocation.learn(batch, estimate)
        if self.learns:
            begun = budget.spent
            self._learn(batch, estimate, run)
            run.effort.fitting = budget.spent - begun
        return estimate

    def _learn(self, batch: Batch, estimate: Estimate, run: RunState) -> None:
        """Fit the laws of classes that have weight to the samples of a plan, for the next one."""
        integral, starts, driven = self.integral, run.starts, run.route.path.winding()
        paths, log_weight, _ = all_samples(estimate.parts)
        multiple = len(log_weight) / (integral.sampling.samples * max(1, len(batch.classes)))
        enough = estimate.ess >= TUNING.fit_enough * max(1.0, multiple)
        most = TUNING.fit_most * max(1.0, multiple)
        fits = dict[ClassFromStart, LawFit]()

        for one, (guide, *_) in starts.optima.items():
            name = run.route.homology.name(one)
            key = run.route.homology.key(integers(np.subtract(one, driven)))
            weight = estimate.class_weights.get(name, 0.0)
            fit = starts.fits.get(one)
            of_class = [h for h, proposal in enumerate(batch.proposals) if proposal.name == name]
            own = np.flatnonzero((paths.key == key) & (paths.outcome == Outcome.GOAL))
            if fit is not None and fit.guide is guide:
                fits[one] = fit
            if enough or weight < TUNING.fit_weight or not of_class or len(own) < 2:
                continue
            fit = fits.setdefault(one, LawFit.of(guide))
            h = max(of_class, key=lambda h: batch.proposals[h].lead.guide is fit.followed)
            mixture = paths.log_survival[own] - paths.work[own] / integral.temperature - log_weight[own]
            log_share = paths.log_ratio[own, h] - mixture
            fit.fade()
            found, counts = chosen(log_weight[own] - log_share, log_share, math.ceil(weight * most))
            for part, number, worth in estimate.split(own[found], counts):
                applied = integral.replay.applied(part, number)
                fit.learn(applied, worth, batch.proposals[h].lead.guide, timed=integral.moving)
        starts.fits = fits

    def _guides(
        self, x: Array, times: Array, references: Sequence[Reference], run: RunState, budget: TimeBudget
    ) -> list[DDPGuide | None]:
        """Return the best guide of every class from x (n,), None where there is none; remember all local optima.

        The first guides of a run are improved from all initialisations. If time is short, new classes get none,
        except the cheapest, which is improved as long as there is time. Hopeless classes get none.
        """
        guidance, starts = self.integral.proposals.nominal, run.starts
        classes = from_start(run, references)
        anew = not starts.optima and not budget.short() and not budget.addition
        names = [*map(run.route.homology.name, classes)]
        some = guidance.tuning.later_paces
        turn = run.retries.count() % len(some)  # counted whether or not it is of use
        paces = some[turn] if run.effort.weak else ()
        known: list[float] = []  # costs of valid guides

        def short() -> bool:
            return budget.short(0.0 if known else budget.addition)

        def improved(k: int) -> list[DDPGuide]:
            one = references[k]
            last = starts.optima.get(classes[k], [])
            late = k > 0 and short()

            waits = k > 0 and run.retries.waits(names[k])
            saving = PLANNER.saving if one.trajectory.slack is None else 0.0  # tracked paths cost less than what tracks
            hopeless = k > 0 and (1.0 - saving) * one.cost > bound
            if hopeless or (not last and (late or waits)):
                return []  # new ones take ten times as long
            query = guidance.query(x, times, run.route.homology.key(one.winding), run.now)
            thorough = anew and k < self.settings.tuning.thorough and not late
            return guidance.optima(
                query,
                one.trajectory,
                last,
                run.clock.since_plan,
                alternatives=one.alternatives if thorough else (),
                thorough=thorough,
                paces=paces if classes[k] in starts.sampled else (),
                short=None if budget.left is None else short,
            )

        found = [] if starts.optima else [improved(0)]
        known += [some[0].penalised for some in [*starts.optima.values(), *found] if some and some[0].valid]
        bound = guidance.hopeless(min(known, default=np.inf))
        found += mapped(improved, range(len(found), len(references)), self.integral.threads)
        starts.keep_optima(dict(zip(classes, found, strict=True)))
        # Moving obstacles that a lidar tracks make no classes, in which a robot could wait for a way to open.
        tracked = self.integral.space.scene.dimension == 2 and self.integral.homology.J == 0
        waits_for_none = not self.integral.moving or tracked
        for name, one in zip(names[1:], classes[1:], strict=True):
            if waits_for_none and one not in starts.optima:
                run.retries.postpone(name, guidance.tuning.again)
        return [some[0] if some else None for some in found]


def classes_with_weight(batch: Batch, estimate: Estimate | None) -> int:
    """Return how many of the cheapest classes include the one with most weight; without survivors, twice as many."""
    names = [*batch.classes.values()]
    if estimate is None:
        return 2 * len(names)
    weights = [estimate.class_weights.get(name, 0.0) for name in names]
    return 1 + int(np.argmax(weights)) if weights else 0


def least_cost(problem: Problem, x: Array, trajectories: Sequence[Trajectory]) -> float:
    """Return the least cost of references under q + u'Ru/2; without any, four times that of the straight line."""
    straight = 4.0 * problem.least_rate * float(np.hypot.reduce(problem.dynamics.place(x) - problem.scene.goal.center))
    return min((running_cost(problem, x, trajectory) for trajectory in trajectories), default=straight)


def plan_of(
    integral: PathIntegral, batch: Batch, references: Sequence[Reference], estimate: Estimate, run: RunState,
    settings: ControlSettings,
) -> Plan:  # fmt: skip
    """Return the plan that an estimate makes, with feedback until the next one unless controls are held."""
    x, shares = batch.state, run.shares
    push = integral.proposals.push(estimate.rollouts.tables, x, run.now)
    if settings.between == "classes":
        followed = controls_followed(batch, estimate)
        since = run.clock.since_estimate
        shares.mixture = pooled(integral.problem, shares.mixture, estimate, followed, push, since, settings.tuning)
    mixture = shares.mixture
    law: Law | None = mixture
    if mixture is not None and settings.held is not None and push.offset > 0.0:
        law = HeldLaw.of(mixture, push, settings.held, x)
    plan = Plan(
        state=x, times=batch.times, references=tuple(references), ids=tuple(batch.classes.values()), estimate=estimate,
        replay=integral.replay, fallback=None, law=law, classes=batch.named, time=run.clock.time, push=push,
        shares=None if mixture is None else mixture.weights(x, 0.0), followed=shares.followed, space=integral.space,
        dynamics=integral.problem.dynamics, movers=run.route.movers,
    )  # fmt: skip
    run.plan()
    if run.route.prediction is not None:
        run.route.favourite = favourite_path(plan)
    return plan
