"""Proposals of a plan: a guide or a tape per class, an alternative where a class has one, and samples around each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.allocation import Allocation, DefensiveComponent
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.jit.threads import mapped
from pirrht.planner.references import Reference
from pirrht.problem import Problem
from pirrht.proposals.any_guide import DDPGuide
from pirrht.proposals.any_guides import DDPGuidance
from pirrht.proposals.leads import lead_of
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.proposals.tracking import FEW
from pirrht.steering.trajectory import Trajectory, running_cost
from pirrht.topology.homology import Homology

THOROUGH = 4  # cheapest classes for whose first guides all ways to begin are looked at

Whole = tuple[int, ...]  # class of the driven path and the path ahead together
K = TypeVar("K")
V = TypeVar("V")


def kept(known: Mapping[K, V], heirs: Mapping[K, K]) -> dict[K, V]:
    """Rename classes to what they are now; of several that became one, keep the first."""
    return {heirs[one]: value for one, value in reversed([*known.items()]) if one in heirs}


@dataclass(frozen=True, slots=True, kw_only=True)
class GuideRequest:
    """A class that a guide is required of."""

    whole: Whole
    key: int  # additive, of the path ahead
    reference: Reference


@dataclass(slots=True)
class Guides:
    """The guides of the last plan, for the next one."""

    last: dict[Whole, Any] = field(default_factory=dict)
    rivals: dict[Whole, DDPGuide] = field(default_factory=dict)  # alternative optima
    strong: set[Whole] = field(default_factory=set)  # classes that were given all N samples

    def improve(
        self, guidance: Any, x: Array, times: Array, wanted: Sequence[GuideRequest], moment: PlanContext, *,
        samples: int,
        threads: int, **clock: float,
    ) -> tuple[list[Any], list[int]]:  # fmt: skip
        """Improve guides from x (n,), None where there is none, and `rivals`; return them and samples around each.

        The first guides of a drive start in several ways. If time is short, new classes get none, except the
        cheapest, which is improved as long as there is time.

        Args:
            times: ends of the steps (T+1,) [s].
            clock: `time` now, where obstacles move [s].
        """
        pressed = moment.pressed
        anew = isinstance(guidance, DDPGuidance) and not self.last and not pressed()
        thorough = {one.whole for one in wanted[:THOROUGH]} if anew else set()
        backwards = moment.reversed() if anew else {}
        elapsed = moment.elapsed

        def improved(one: GuideRequest) -> Any:
            last, rival, reference = self.last.get(one.whole), self.rivals.get(one.whole), one.reference
            if one.whole in thorough and (one is wanted[0] or not pressed()):
                turned = backwards.get(reference.winding)
                also = [*reference.others, *([] if turned is None else [turned])]
                return guidance.first(x, times, one.key, reference.trajectory, also, pressed=pressed, **clock)
            if last is None and one is not wanted[0] and pressed():
                return None, None  # a new one takes ten times as long
            guide = guidance.improve(x, times, one.key, reference.trajectory, last, elapsed, pressed=pressed, **clock)
            if rival is None:
                return guide, None
            rival = guidance.onward(x, times, one.key, rival, elapsed, **clock)
            if _cheaper(rival, guide):
                guide, rival = rival, guide
            return guide, guidance.rival(guide, [rival])

        both = mapped(improved, wanted, threads)
        guides = [guide for guide, _ in both]
        self.rivals = {one.whole: rival for one, (_, rival) in zip(wanted, both, strict=True) if rival is not None}
        counts: list[int] = guidance.counts(guides, samples)
        self.last = {one.whole: guide for one, guide in zip(wanted, guides, strict=True) if guide and guide.valid}
        self.strong = {one.whole for one, count in zip(wanted, counts, strict=True) if count > FEW}
        return guides, counts

    def lines(self, elapsed: float, goal: Array) -> dict[Whole, Array]:
        """Return the paths left after a time [s], (k, 2) [m] each, of those that have not arrived."""
        rests = {whole: guide.rest(elapsed, goal) for whole, guide in self.last.items()}
        return {whole: rest.points for whole, rest in rests.items() if rest is not None}

    def inherit(self, before: Guides, heirs: Mapping[Whole, Whole]) -> None:
        """Take over earlier guides under the present classes."""
        self.last, self.rivals = kept(before.last, heirs), kept(before.rivals, heirs)
        self.strong = {heirs[whole] for whole in before.strong if whole in heirs}

    def left(self, elapsed: float, goal: Array) -> Iterator[tuple[Whole, Trajectory]]:
        """Return the strong guides left after a time [s], of those that have not arrived."""
        for whole, guide in self.last.items():
            rest = guide.rest(elapsed, goal) if whole in self.strong else None
            if rest is not None:
                yield whole, rest


def _cheaper(one: DDPGuide | None, other: DDPGuide | None) -> bool:
    """Check that a guide is valid, and that another is not or costs more."""
    return one is not None and one.valid and (other is None or not other.valid or one.priced < other.priced)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanContext:
    """Times of a plan, and reversed paths for the first one of a drive."""

    now: float  # on the clock of moving obstacles [s]
    elapsed: float  # since the last plan [s]
    pressed: Callable[[], bool]  # whether time is short
    reversed: Callable[[], Mapping[tuple[int, ...], Trajectory]]  # paths driven backwards, by winding


class ProposalBuilder:
    """Chooses leads and numbers of samples, and learns from plan to plan.

    Args:
        mixes: whether samples of all classes are weighed together; else nothing is learnt from their weights.
    """

    def __init__(self, problem: Problem, integral: PathIntegral, homology: Homology, *, mixes: bool) -> None:
        self.problem, self.integral, self.homology, self.mixes = problem, integral, homology, mixes
        sampling = integral.sampling
        shared = mixes and sampling.allocation == "contribution" and integral.shares
        self.allocation = Allocation(sampling.samples) if shared else None
        self.begin()

    def begin(self) -> None:
        """Forget the drive so far."""
        if self.allocation is not None:
            self.allocation.forget()
        self.guides, self.aside = Guides(), DefensiveComponent()

    def inherit(self, before: ProposalBuilder, heirs: Mapping[Whole, Whole], names: Mapping[str, str]) -> None:
        """Take over the memory of an earlier one.

        Args:
            heirs: present classes of guides that are kept.
            names: present names of classes that are kept.
        """
        self.guides.inherit(before.guides, heirs)
        self.aside.shares = kept(before.aside.shares, names)
        if self.allocation is not None and before.allocation is not None:
            self.allocation.inherit(before.allocation, names)

    def batch(self, x: Array, references: Sequence[Reference], classes: Sequence[Whole], moment: PlanContext) -> Batch:
        """Return what a plan at x (n,) samples: around references, or passive dynamics if there is none.

        Args:
            classes: of the driven path and each reference together.
        """
        integral, N = self.integral, self.integral.sampling.samples
        trajectories = [reference.trajectory for reference in references]
        times = integral.grid(self.least_cost(x, trajectories))
        if not references:
            still = Tape(times, np.zeros((len(times) - 1, self.problem.dynamics.m)))
            return Batch(state=x, times=times, proposals=(Proposal(lead=still, count=N),), time=moment.now)
        names = [self.homology.name(whole) for whole in classes]
        pairs = zip(classes, references, strict=True)
        wanted = [GuideRequest(whole=whole, key=self.homology.key(one.winding), reference=one) for whole, one in pairs]
        leads, counts = self._leads(x, times, wanted, names, moment)
        proposals = [
            Proposal(lead=lead, count=count, name=name, key=one.key)
            for lead, count, name, one in zip(leads, counts, names, wanted, strict=True)
        ]

        def beside(k: int) -> ProposalControl | None:
            """Return an alternative optimum of the k-th class, or the way that a point climbs."""
            if (rival := self.guides.rivals.get(classes[k])) is not None:
                return lead_of(rival, self.problem.dynamics)
            return integral.leading.beside(x, trajectories[k], moment.now)

        if self.mixes:
            proposals = self.aside.split(proposals, beside)
        return Batch(state=x, times=times, proposals=tuple(proposals), time=moment.now)

    def learn(self, batch: Batch, estimate: Estimate) -> None:
        """Learn from the weights of a plan's samples."""
        if self.allocation is not None:
            self.allocation.learn([one.name for one in batch.proposals], estimate)
        if self.mixes:
            self.aside.learn(batch, estimate)

    def least_cost(self, x: Array, trajectories: Sequence[Trajectory]) -> float:
        """Return the least cost of references under q + u'Ru/2; without any, that of the straight line."""
        if not trajectories:
            goal = self.problem.scene.goal.center
            return 4.0 * self.problem.least_rate * float(np.hypot(*(x[:2] - goal)))
        return min(running_cost(self.problem, x, trajectory) for trajectory in trajectories)

    def _leads(
        self, x: Array, times: Array, wanted: Sequence[GuideRequest], names: Sequence[str], moment: PlanContext
    ) -> tuple[list[ProposalControl], list[int]]:
        """Return what samples around each reference follow, and how many there are."""
        integral, shared = self.integral, self.allocation
        trajectories = [one.reference.trajectory for one in wanted]
        known = None if shared is None or integral.guidance is not None else shared.shortfalls(names)
        leads = integral.leading.leads(x, times, trajectories, known)
        if integral.guidance is not None:
            clock = {"time": moment.now} if integral.moving else {}
            guides, counts = self.guides.improve(
                integral.guidance, x, times, wanted, moment, samples=integral.sampling.samples,
                threads=integral.threads, **clock,
            )  # fmt: skip
            if shared is not None:  # prices of guides are too inaccurate to allocate by
                counts = shared.counts(names, [0.0] * len(names), [count > FEW for count in counts])
            d = self.problem.dynamics
            led = [one if guide is None else lead_of(guide, d) for one, guide in zip(leads, guides, strict=True)]
            return led, counts
        if shared is None:
            return list(leads), [integral.sampling.samples] * len(leads)
        promised = [lead.promise for lead in leads]
        rows = zip(trajectories, promised, strict=True)
        shared.note(names, [integral.leading.bound(x, trajectory) - promise for trajectory, promise in rows])
        return list(leads), shared.counts(names, promised, [lead.follows for lead in leads])
