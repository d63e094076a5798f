"""References of a run, one path per class from its tree, and proposals of a plan: local optima of each, and samples."""

import math
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from numbers import Integral
from time import perf_counter
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.baselines import follow_best
from pirrht.control.held import HeldLaw
from pirrht.control.plan import Law, Plan, controls_followed, pooled
from pirrht.control.policy import ClassFromStart, RunState, from_start
from pirrht.control.prediction import favourite_path
from pirrht.control.settings import ControlSettings, ControlTuning, TimeBudget
from pirrht.errors import NoReference, NoSurvivingSample, OptionError
from pirrht.estimation.estimate import Estimate, all_samples
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import mapped
from pirrht.outcome import Outcome
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.fitted_law import LawFit, chosen
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.proposals.tuning import TUNING
from pirrht.rollouts.backend import Backend
from pirrht.steering.motion import SPACING, Trajectory, running_cost
from pirrht.topology.signature import integers


def refuse_misfits(sampling: Any, propose: Any, backend: Any, rng: Any) -> None:
    """Refuse arguments of a controller by an OptionError that says what each must be."""
    functions = isinstance(propose, Sequence) and all(map(callable, propose))
    for name, value, fits, rule in (
        ("sampling", sampling, isinstance(sampling, Sampling), "a Sampling"),
        ("propose", propose, functions, "a sequence of functions (x, default) that return a proposal or None"),
        ("backend", backend, backend is None or isinstance(backend, Backend),
         "None, or have the methods sample, trace, controls and replay of a Backend"),
        ("rng", rng, isinstance(rng, np.random.Generator), "a generator, such as np.random.default_rng(0)"),
    ):  # fmt: skip
        if not fits:
            raise OptionError(f"{name} is {reprlib.repr(value)}; it must be {rule}")


def validate(tree: HomologyTree | None, problem: Problem, sampling: Sampling, settings: ControlSettings) -> None:
    """Check that a tree serves a method, is of a problem's kind of system, and has times where obstacles move.

    An OptionError is raised if not, or if its references have no controls that samples could follow.
    """
    if tree is None:
        if settings.use.most != 0:
            raise OptionError(f"the method {settings.method!r} needs a tree")
        return
    steering, dynamics = type(tree.steering).__name__, type(problem.dynamics).__name__
    if problem.scene.movers and not tree.steering.timed:
        raise OptionError(
            f"{steering} knows no times, and obstacles move in the scene; grow the tree with InTime.of(problem)"
        )
    if len(tree.steering.vertex_of(tree.at(np.zeros(problem.dynamics.n), 0.0))) != tree.steering.n:
        raise OptionError(
            f"{steering} connects states of {tree.steering.n} numbers and {dynamics} has {problem.dynamics.n}; grow "
            f"the tree with a Steering for {dynamics}"
        )
    if not (tree.steering.drives or sampling.guide == "feedback" or DDPGuidance.suits(problem)):
        raise OptionError(
            f"{dynamics} has no steering of its own, and its references no controls that samples could follow: guide "
            'them by "feedback", not "open-loop"'
        )


def regrow(tree: HomologyTree | None, x: Array, time: float, tuning: ControlTuning) -> None:
    """Grow a tree in space and time for a run from x (n,) at a time [s], unless it was grown for that."""
    if tree is None or not tree.steering.timed:
        return
    scene, here = tree.space.scene, tree.at(x, time)
    origin = np.array([*scene.start[:2], 0.0]) if tree.origin is None else tree.origin
    if np.hypot(*(here[:2] - origin[:2])) > scene.robot_radius or abs(here[2] - origin[2]) > tuning.elsewhen:
        tree.aim(here)
        tree.grow(tree.size + tuning.regrowth)


def extract_references(
    tree: HomologyTree | None, x: Array, run: RunState, budget: TimeBudget, settings: ControlSettings, threads: int
) -> list[Reference]:
    """Return the references at x (n,), cheapest first: those of the tree (Algorithm 5), and those left from guides."""
    method, memory = settings.use, run.memory
    if tree is None or method.most == 0:
        return []
    driven = run.path.winding()
    before = {integers(np.subtract(whole, driven)): path for whole, path in memory.paths.items()}
    try:
        found = tree.references(
            tree.at(x, run.now), shortened=settings.shortened, before=before, over_budget=budget.short,
            threads=threads, most=run.most,
        )  # fmt: skip
    except NoReference:
        if rest := _remaining_guides(tree, x, run):
            return rest
        if not run.planned and tree.too_fast(x):
            raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit, hasty=True) from None
        raise
    classes, left_out = from_start(run, found), {} if run.most is None else memory.paths
    memory.paths = left_out | {one: reference.path for one, reference in zip(classes, found, strict=True)}
    if method.most is not None:
        return found[: method.most][: run.most]
    found += _remaining_guides(tree, x, run, classes)
    return sorted(found, key=lambda reference: reference.cost)[: run.most]


def _remaining_guides(
    tree: HomologyTree, x: Array, run: RunState, known: Sequence[ClassFromStart] = ()
) -> list[Reference]:
    """Return what is left of guides from x (n,), of classes that are not `known`; close to walls trees lack curves."""
    references, named = list[Reference](), run.homology.named
    for whole, (guide, *_) in run.memory.optima.items():
        if whole not in run.memory.sampled or whole in known:
            continue
        rest = guide.rest(run.since_plan, tree.space.scene.goal.center)
        winding = integers(np.subtract(whole, run.path.winding()))
        signature = run.homology.signature(run.homology.at(x, run.now), winding)
        if rest is not None and np.all(np.abs(signature - 1.0) <= tree.limit):
            references.append(Reference(winding=winding, signature=signature, trajectory=rest, named=named))
    return references


def renewed(
    problem: Problem, space: FreeSpace, tree: HomologyTree | None, scene: Scene, vertices: int | None
) -> tuple[Problem, FreeSpace, HomologyTree | None] | None:
    """Return problem, free space and tree of so many vertices in another scene, or None; see `Controller.update`."""
    if not isinstance(scene, Scene):
        raise OptionError(f"an update is to a Scene, and {reprlib.repr(scene)} is none; Scene.from_boxes makes one")
    if vertices is not None and not (isinstance(vertices, Integral) and vertices >= 1):
        raise OptionError(f"vertices is {reprlib.repr(vertices)}; it must be a whole number of at least 1, or None")
    before, goal = space.scene, problem.scene.goal
    if not _same(goal, scene.goal):
        raise OptionError(f"an update keeps the goal, {goal}; for {scene.goal} make another Controller")
    if before.movers or scene.movers:
        raise OptionError(
            f"an update changes static obstacles, and {len(scene.movers or before.movers)} move here; make another "
            "Controller"
        )
    parts = "lower", "upper", "robot_radius", "robot_height"
    alike = all(np.array_equal(getattr(before, part), getattr(scene, part)) for part in parts)
    if alike and len(before.obstacles) == len(scene.obstacles) and all(map(_same, before.obstacles, scene.obstacles)):
        return None
    now = space.updated(replace(scene, waivers=before.waivers))
    grown = None
    if tree is not None:
        grown = HomologyTree(now, tree.steering, limit=tree.limit, classes=tree.classes, rng=tree.rng)
        grown.grow(tree.size if vertices is None else vertices)
    return replace(problem, scene=scene), now, grown


def continue_among(space: FreeSpace, run: RunState) -> None:
    """Continue a run among other static obstacles; classes keep their names, and memory while their paths are free."""
    path, memory, before, goal = run.path, run.memory, run.homology, space.scene.goal.center
    path.enter(space.homology)
    rests = {whole: guide.rest(run.since_plan, goal) for whole, (guide, *_) in memory.optima.items()}
    lines = {whole: np.vstack(one.points(SPACING)) for whole, one in memory.paths.items()}
    lines |= {whole: rest.points for whole, rest in rests.items() if rest is not None}
    free = [whole for whole, line in lines.items() if space.segments_free(line)]
    ahead = [space.homology.winding(np.vstack([path.here, lines[whole]])) for whole in free]
    heirs = {whole: integers(np.add(path.winding(), one)) for whole, one in zip(free, ahead, strict=True)}
    names = {before.name(then): space.homology.name(now) for then, now in heirs.items()}
    run.homology, run.memory = space.homology, memory.renamed(heirs, names)


def _same(one: Any, other: Any) -> bool:
    """Compare two records by value."""
    pairs = ((getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    return one is other or all(np.array_equal(mine, its) for mine, its in pairs)


Propose = Callable[[Array, ProposalControl], ProposalControl | None]  # state (n,), the default of a class


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalBuilder:
    """Builds the proposals of plans; all that it learns is in the memory of the run."""

    integral: PathIntegral
    settings: ControlSettings
    propose: Sequence[Propose] = ()  # further proposals of each class, by its default

    def batch(self, x: Array, references: Sequence[Reference], run: RunState, budget: TimeBudget) -> Batch:
        """Return what a plan at x (n,) samples: around references, or passive dynamics if there is none."""
        integral, memory, samples = self.integral, run.memory, self.integral.sampling.samples
        trajectories, guidance = [reference.trajectory for reference in references], self.integral.guidance
        times, classes = integral.grid(least_cost(integral.problem, x, trajectories)), from_start(run, references)
        driven, homology = run.path.winding(), run.homology
        others = {homology.key(integers(np.subtract(one, driven))): homology.name(one) for one in memory.paths}
        if not references:
            still = Proposal(lead=Tape(times, np.zeros((len(times) - 1, integral.problem.dynamics.m))), count=samples)
            return Batch(state=x, times=times, proposals=(still,), time=run.now, others=others)
        allocates = self.settings.use.mixes and integral.sampling.allocation == "contribution"
        names, keys = [*map(homology.name, classes)], [homology.key(one.winding) for one in references]
        controls = integral.proposals.controls(x, times, trajectories, drops=allocates and guidance is None)
        predicted, worth = [one.promise for one in controls], [one.follows for one in controls]
        counts = [samples] * len(classes)

        def followed(guide: DDPGuide) -> ProposalControl:
            """Follow a guide with its feedback, or its nominal controls, the last of which leads on into the goal."""
            if guidance is not None:
                return LinearFeedback(guide)
            nominal, end = guide.tape, guide.length
            nominal[end : end + TUNING.onward] = nominal[end - 1]
            return Tape(times, nominal)

        if guidance is not None or any(one.slack is not None for one in trajectories):
            guides = self._guides(x, times, references, run, budget)
            pairs = zip(controls, guides, strict=True)
            controls = [one if guide is None else followed(guide) for one, guide in pairs]
        if guidance is not None:
            counts = guidance.counts(guides, samples)
            predicted, worth = [0.0] * len(counts), [count > TUNING.few for count in counts]  # costs are too rough
            memory.sampled = {one for one, enough in zip(classes, worth, strict=True) if enough}
        if allocates:  # by contributions in earlier plans
            counts = memory.allocation.counts(names, predicted, worth, samples)
        rows = zip(controls, counts, names, keys, strict=True)
        proposals = [Proposal(lead=one, count=count, name=name, key=key) for one, count, name, key in rows]

        def added(k: int) -> list[ProposalControl]:
            """Return the other local optimum of the k-th class, or the ascent of psi of a point, and the user's own."""
            optima = memory.optima.get(classes[k], [])[1:]
            second = followed(optima[0]) if optima else integral.proposals.defensive(x, trajectories[k], run.now)
            found = [
                self._fitted(classes[k], run),
                second,
                *(propose(x, proposals[k].lead) for propose in self.propose),
            ]
            return [one for one in found if one is not None]

        if self.settings.use.mixes:
            proposals = memory.allocation.split(proposals, added)
        return Batch(state=x, times=times, proposals=tuple(proposals), time=run.now, others=others)

    def estimate(self, batch: Batch, seed: int, run: RunState, budget: TimeBudget) -> Estimate | None:
        """Sample and weigh a batch, and learn from it; None if no sample survives."""
        integral = self.integral
        integral.proposals.tables(batch)
        run.most = budget.most_classes(len(batch.classes))
        memory, least, multiple = run.memory, integral.sampling.least if budget.left is None else 0.0, None
        if run.time > run.begun:
            memory.saved = min(memory.saved + integral.tuning.saved, integral.tuning.later_plan - 1.0)
            follows = integral.guidance is not None and not integral.proposals.pointlike
            least, multiple = min(least, integral.tuning.few) if follows else 0.0, 1.0 + memory.saved
        try:
            left = None if budget.left is None else budget.less(run.fitting)
            estimate = integral.sample(batch, seed, left=left, least=least, multiple=multiple)
        except NoSurvivingSample:
            memory.saved = 0.0 if least > 0.0 else memory.saved
            return None
        if multiple is not None and least > 0.0:
            drawn = sum(part.size for part in estimate.parts) / max(sum(batch.counts), 1)
            memory.saved = max(0.0, memory.saved + 1.0 - drawn)
        if self.settings.use.mixes:
            memory.allocation.learn(batch, estimate)
            begun = perf_counter()
            self._learn(batch, estimate, run)
            run.fitting = perf_counter() - begun
        if self.settings.use.alone and batch.classes:
            estimate = follow_best(integral.problem, estimate, batch, run.memory, self.settings.consistency)
        guided = integral.guidance is not None and batch.classes
        return None if guided and estimate.survivors == 0 else estimate

    def _fitted(self, one: ClassFromStart, run: RunState) -> LinearFeedback | None:
        """Return the law around the guide of a class that samples of earlier plans suggest, if there are any."""
        fits, optima = run.memory.fits, run.memory.optima
        if one not in fits or one not in optima:
            return None
        fits[one] = fits[one].carried(optima[one][0], run.since_plan, timed=self.integral.moving)
        return LinearFeedback(fits[one].followed)

    def _learn(self, batch: Batch, estimate: Estimate, run: RunState) -> None:
        """Fit the laws of classes that have weight to the samples of a plan, for the next one."""
        integral, memory, driven, d = self.integral, run.memory, run.path.winding(), self.integral.problem.dynamics
        if integral.guidance is None or integral.guidance.gated or not (d.constant or d.input_form):
            return
        enough, (paths, log_weight, _) = estimate.ess >= TUNING.fit_enough, all_samples(estimate.parts)
        most, fits = TUNING.fit_most * len(log_weight) / sum(batch.counts), dict[ClassFromStart, LawFit]()
        for one, (guide, *_) in memory.optima.items():
            name, key = run.homology.name(one), run.homology.key(integers(np.subtract(one, driven)))
            weight, fit = estimate.class_weights.get(name, 0.0), memory.fits.get(one)
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
            for part, number, count in estimate.split(own[found], counts):
                applied = integral.replay.applied(part, number)
                fit.learn(applied, count, batch.proposals[h].lead.guide, timed=integral.moving)
        memory.fits = fits

    def _guides(
        self, x: Array, times: Array, references: Sequence[Reference], run: RunState, budget: TimeBudget
    ) -> list[DDPGuide | None]:
        """Return the best guide of every class from x (n,), None where there is none; remember all local optima.

        The first guides of a run are improved from all initialisations. If time is short, new classes get none,
        except the cheapest, which is improved as long as there is time. Hopeless classes of tracked paths get none.
        """
        guidance, memory, short = self.integral.proposals.nominal, run.memory, budget.short
        classes, anew = from_start(run, references), not memory.optima and not short()

        def improved(k: int) -> list[DDPGuide]:
            one, last, late = references[k], memory.optima.get(classes[k], []), k > 0 and short()
            if (k > 0 and one.trajectory.slack is not None and one.cost > bound) or (not last and late):
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
    straight = 4.0 * problem.least_rate * float(np.hypot(*(x[:2] - problem.scene.goal.center)))
    return min((running_cost(problem, x, trajectory) for trajectory in trajectories), default=straight)


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
    mixture, run.halt = memory.mixture, None
    law: Law | None = mixture
    if mixture is not None and settings.held is not None and push.offset > 0.0:
        law = HeldLaw.of(mixture, push, settings.held, x)
    plan = Plan(
        state=x, times=batch.times, references=tuple(references), ids=tuple(batch.classes.values()), estimate=estimate,
        replay=integral.replay, fallback=None, law=law, classes=batch.named, time=run.time, push=push,
        shares=None if mixture is None else mixture.weights(x, 0.0), followed=memory.followed, space=integral.space,
        movers=run.movers,
    )  # fmt: skip
    run.planned, run.since_plan, run.since_estimate = True, 0.0, 0.0
    if run.prediction is not None:
        run.favourite = favourite_path(plan)
    return plan
