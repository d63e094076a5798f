"""The execution phase, Algorithm 4: references for every class, samples around all of them, one control."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.threads import mapped
from pirrht.control.best_class import CONSISTENCY, alone, best_class
from pirrht.control.feedback import Law, Memory, leads_of
from pirrht.control.methods import METHODS, SAMPLING, TREELESS
from pirrht.control.plan import Plan
from pirrht.errors import NoReference, NoSurvivingSample, OptionError
from pirrht.estimation.allocation import Allocation
from pirrht.estimation.batches import sample
from pirrht.estimation.sampler import Estimate, PathIntegral, Sampling
from pirrht.freespace import FreeSpace
from pirrht.guidance.tracking import FEW, Guide
from pirrht.problem import Problem
from pirrht.steering.trajectory import Trajectory, running_cost
from pirrht.topology.driven import Driven
from pirrht.topology.homology import class_id, integers
from pirrht.tree.homology_tree import HomologyTree, Reference

__all__ = ["BETWEEN", "METHODS", "TREELESS", "Controller"]

BETWEEN = ("classes", "hold")

Proposals = tuple[
    Array, list[int] | None, list[Array] | None, list[Guide | None] | None
]  # tapes, counts, corners, guides


class Controller:
    """Receding-horizon path integral control with topology-guided sampling.

    Args:
        tree: grown beforehand; None only for the method "passive".
        method: one of `methods.SAMPLING`.
        rng: source of one seed per plan.
        polished: shorten references inside their class.
        consistency: share of its value that the class followed so far counts under the method "best-class".
        between: until the next plan follow the state by "classes", or "hold" the control (paper).
    """

    def __init__(
        self,
        problem: Problem,
        space: FreeSpace,
        tree: HomologyTree | None,
        sampling: Sampling,
        *,
        method: str = "pi-rrht",
        polished: bool = True,
        consistency: float = CONSISTENCY,
        between: str = "classes",
        rng: np.random.Generator,
    ) -> None:
        if between not in BETWEEN:
            raise OptionError(f"unknown feedback {between!r} between plans; known are {', '.join(BETWEEN)}")
        if method not in SAMPLING:
            raise OptionError(f"unknown method {method!r}; known here are {', '.join(SAMPLING)}")
        self.method = SAMPLING[method]
        if tree is None and self.method.most != 0:
            raise OptionError(f"the method {method!r} needs a tree")
        self.problem, self.space, self.tree, self.consistency = problem, space, tree, consistency
        self.path_integral = PathIntegral(problem, space, sampling)
        self.polished, self.rng, self.between = polished, rng, between
        shared = self.method.mixes and sampling.allocation == "contribution" and self.path_integral.guidance is None
        self.allocation = Allocation(sampling.samples) if shared else None
        self.memory = Memory(problem) if between == "classes" else None
        self.begin(problem.scene.start[: problem.dynamics.n])

    def begin(self, x: Array) -> None:
        """Forget the drive so far; a new one starts at x (n,)."""
        self._driven = Driven(self.space.homology, x)
        self._previous: Plan | None = None
        self._followed: str | None = None  # class, where only one is
        self._since = self._unpooled = 0.0  # since the last plan, and since the last one with an estimate [s]
        if self.memory is not None:
            self.memory.forget()
        if self.allocation is not None:
            self.allocation.forget()
        self._guides: dict[tuple[int, ...], Guide] = {}  # by class of driven path and guide together
        self._strong: set[tuple[int, ...]] = set()  # classes of those that were worth all N samples

    def observe(self, states: Array, duration: float) -> None:
        """Take note of the states (k, n) just driven through and the time it took [s]."""
        self._driven.observe(states)
        self._since += duration
        self._unpooled += duration

    def expect(self, states: Array, duration: float) -> None:
        """Suppose that the robot will drive through the states (k, n) next; `duration` [s] since the last plan's start.

        The next plan is made for the end of them. What is observed afterwards takes their place, at no duration.
        """
        self._driven.expect(states)
        self._since += duration
        self._unpooled += duration

    def driven_class(self) -> tuple[int, ...]:
        """Class of the driven path, completed by the straight line to the goal point."""
        return self._driven.winding()

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,).

        Args:
            left: time left for sampling [s]; samples are drawn until it is up.

        Raises:
            NoReference: no class reaches the goal, and there is no earlier plan to go on with.
        """
        x = np.asarray(x, dtype=float)
        try:
            references = self._references(x)
        except NoReference:
            if self._previous is None:
                raise
            references = self._kept(x, set())
            if not references:
                return self._previous.rest(x, self._since)
        plan = self._around(x, references, left)
        self._previous, self._since = plan, 0.0
        return plan

    def _around(self, x: Array, references: list[Reference], left: Callable[[], float] | None) -> Plan:
        """The plan at x (n,) that samples around references make."""
        ids = tuple(class_id(whole) for whole in self._from_start(references))
        trajectories = [reference.trajectory for reference in references]
        times = self.path_integral.grid(self._least_cost(x, trajectories))
        tapes = np.array([t.tape(times) for t in trajectories] or [np.zeros((len(times) - 1, self.problem.dynamics.m))])
        guides, counts = self._lead(x, times, references)
        proposals = (tapes, counts, self._corners(trajectories), guides)
        estimate = self._estimate(x, times, references, ids, proposals, left)
        law = None if estimate is None else self._law(estimate, ids, guides)
        return Plan(
            state=x,
            times=times,
            references=tuple(references),
            ids=ids,
            estimate=estimate,
            fallback="no survivor" if estimate is None else None,
            instead=self._instead(tapes, guides, ids) if estimate is None else None,
            law=law,
            span=self.path_integral.sampling.dt,
            shares=None if law is None else law.weights(x, 0.0),
            followed=self._followed,
        )

    def _estimate(
        self,
        x: Array,
        times: Array,
        references: list[Reference],
        ids: tuple[str, ...],
        proposals: Proposals,
        left: Callable[[], float] | None,
    ) -> Estimate | None:
        """What samples say; None if none survives."""
        tapes, counts, corners, guides = proposals
        if self.allocation is not None and ids:
            counts = self.allocation.counts(ids)
        names = {self.space.homology.key(r.winding): name for r, name in zip(references, ids, strict=True)}
        seed = int(self.rng.integers(2**63))
        try:
            estimate = sample(
                self.path_integral, x, times, tapes, seed, counts=counts, corners=corners, guides=guides, classes=names,
                left=left,
            )  # fmt: skip
        except NoSurvivingSample:
            return None
        if self.allocation is not None:
            self.allocation.learn(ids, estimate)
        if self.method.alone and ids:
            estimate = self._alone(estimate, ids, names)
        return None if guides is not None and estimate.survivors == 0 else estimate

    def _alone(self, estimate: Estimate, ids: tuple[str, ...], names: dict[int, str]) -> Estimate:
        """What the samples of the best class say; what earlier ones said of another class is forgotten."""
        best = best_class(estimate, ids, self._followed, consistency=self.consistency)
        if self._followed != ids[best] and self.memory is not None:
            self.memory.forget()
        self._followed = ids[best]
        return alone(estimate, best, {key: name for key, name in names.items() if name == ids[best]})

    def _law(self, estimate: Estimate, ids: tuple[str, ...], guides: list[Guide | None] | None) -> Law | None:
        """Feedback until the next plan; None if the control is held."""
        if self.memory is None:
            return None
        steered = estimate.rollouts.guides
        leads = leads_of(ids, steered, guides)
        elapsed, self._unpooled = self._unpooled, 0.0
        source = estimate.source
        return self.memory.law(estimate, leads, lambda x, s: source.push(x, steered), elapsed)

    def _references(self, x: Array) -> list[Reference]:
        if self.tree is None or self.method.most == 0:
            return []
        found = self.tree.references(x, polished=self.polished)
        kept = [] if self.method.most is not None else self._kept(x, set(self._from_start(found)))
        return self.method.around(found, kept)

    def _kept(self, x: Array, known: set[tuple[int, ...]]) -> list[Reference]:
        """The last guides of classes that the tree, close to a wall, has no curve for from x (n,)."""
        homology = self.space.homology
        driven = np.array(self.driven_class())
        references = []
        for whole, guide in self._guides.items():
            if whole in known or whole not in self._strong:
                continue
            rest = guide.rest(self._since, self.space.scene.goal.center)
            if rest is None:
                continue
            winding = integers(np.asarray(whole) - driven)
            signature = homology.signature(x, winding)
            if self.tree is not None and np.all(np.abs(signature - 1.0) <= self.tree.limit):
                references.append(Reference(winding=winding, signature=signature, trajectory=rest))
        return references

    def _lead(
        self, x: Array, times: Array, references: list[Reference]
    ) -> tuple[list[Guide | None] | None, list[int] | None]:
        """Guides of a car, each from what is left of the last one of its class, and samples around each."""
        guidance = self.path_integral.guidance
        if guidance is None or not references:
            return None, None
        classes = self._from_start(references)

        def improve(which: tuple[Reference, tuple[int, ...]]) -> Guide | None:
            reference, whole = which
            key, last = self.space.homology.key(reference.winding), self._guides.get(whole)
            return guidance.improve(x, times, key, reference.trajectory, last, self._since)

        guides = mapped(improve, zip(references, classes, strict=True), self.path_integral.threads)
        counts = guidance.counts(guides, self.path_integral.sampling.samples)
        self._guides = {
            whole: guide for whole, guide in zip(classes, guides, strict=True) if guide is not None and guide.valid
        }
        self._strong = {whole for whole, count in zip(classes, counts, strict=True) if count > FEW}
        return guides, counts

    def _instead(self, tapes: Array, guides: list[Guide | None] | None, ids: tuple[str, ...]) -> Array:
        """What to follow without an estimate, (T, m): the guide of the last favourite or the cheapest, or a tape."""
        led = {name: guide for name, guide in zip(ids, guides or (), strict=False) if guide is not None}
        if not led:
            return np.asarray(tapes[0])
        last = None if self._previous is None else self._previous.favourite
        guide = led[last] if last in led else min(led.values(), key=lambda guide: guide.priced)
        return guide.control[:, None]

    def _corners(self, trajectories: list[Trajectory]) -> list[Array] | None:
        """What samples head for: the corners of each reference, and the goal point as the last."""
        goal = self.space.scene.goal.center[None, :]
        return [np.vstack([t.path.start[1:, :2], goal]) for t in trajectories] or None

    def _from_start(self, references: list[Reference]) -> list[tuple[int, ...]]:
        """Classes of the driven path and each reference together."""
        driven = np.array(self.driven_class())
        return [integers(driven + np.asarray(reference.winding)) for reference in references]

    def _least_cost(self, x: Array, trajectories: list[Trajectory]) -> float:
        """Least cost of the references under q + u'Ru/2; without references that of the straight line."""
        if not trajectories:
            return 4.0 * self.problem.least_rate * float(np.hypot(*(x[:2] - self.space.scene.goal.center)))
        return min(running_cost(self.problem, x, trajectory) for trajectory in trajectories)
