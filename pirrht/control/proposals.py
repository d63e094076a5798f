"""Proposals of a plan: a guide or a tape per class, an alternative where a class has one, and samples around each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.threads import mapped
from pirrht.estimation.allocation import Allocation, Aside
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.guidance.any_guide import AnyGuide
from pirrht.guidance.any_guides import AnyGuidance
from pirrht.guidance.leads import Batch, Lead, Proposal, Tape, lead_of
from pirrht.guidance.tracking import FEW
from pirrht.problem import Problem
from pirrht.steering.trajectory import Trajectory, running_cost
from pirrht.topology.homology import Homology
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.reference import Reference

THOROUGH = 4  # cheapest classes for whose first guides all ways to begin are looked at

Whole = tuple[int, ...]  # class of the driven path and the rest together
K = TypeVar("K")
V = TypeVar("V")


def kept(known: Mapping[K, V], heirs: Mapping[K, K]) -> dict[K, V]:
    """Return what is known of classes by what each is now; of several that became one, what came first."""
    return {heirs[one]: value for one, value in reversed([*known.items()]) if one in heirs}


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A class that a guide is wanted of."""

    whole: Whole
    key: int  # of the rest alone, as kernels carry it
    winding: tuple[int, ...]  # the same
    trajectory: Trajectory  # its reference
    others: tuple[Trajectory, ...]  # of other valleys


@dataclass(slots=True)
class Guides:
    """The guides of the last plan, for the next one."""

    last: dict[Whole, Any] = field(default_factory=dict)
    rivals: dict[Whole, AnyGuide] = field(default_factory=dict)  # of another valley of the same class
    strong: set[Whole] = field(default_factory=set)  # classes that were worth all N samples

    def improve(
        self,
        guidance: Any,
        x: Array,
        times: Array,
        wanted: Sequence[Wanted],
        *,
        samples: int,
        elapsed: float,
        pressed: Callable[[], bool],
        reversed: Callable[[], Mapping[tuple[int, ...], Trajectory]],
        threads: int,
        **clock: float,
    ) -> tuple[list[Any], list[int]]:
        """Guides from x (n,), None where there is none, and samples around each; what else to sample is in `rivals`.

        The first of a drive are looked for thoroughly. If time is short there are none of new classes, the
        first aside, which is improved as long as there is time.

        Args:
            times: ends of the steps (T+1,) [s].
            elapsed: since the last plan [s].
            pressed: whether time is short.
            reversed: paths that are driven backwards, by winding; asked where a drive begins.
            clock: `time` now, where that matters [s].
        """

        anew = isinstance(guidance, AnyGuidance) and not self.last and not pressed()
        thorough = {one.whole for one in wanted[:THOROUGH]} if anew else set()
        backwards = reversed() if anew else {}

        def improved(one: Wanted) -> tuple[Any, Any]:
            last, rival = self.last.get(one.whole), self.rivals.get(one.whole)
            if one.whole in thorough and (one is wanted[0] or not pressed()):
                also = [*one.others, *([backwards[one.winding]] if one.winding in backwards else [])]
                found: tuple[Any, Any] = guidance.first(
                    x, times, one.key, one.trajectory, also, pressed=pressed, **clock
                )
                return found
            if last is None and one is not wanted[0] and pressed():
                return None, None  # made from nothing it takes ten times as long
            guide = guidance.improve(x, times, one.key, one.trajectory, last, elapsed, pressed=pressed, **clock)
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
        """Return what is left of paths after a time [s], (k, 2) [m] each, of those that have not arrived."""
        rests = {whole: guide.rest(elapsed, goal) for whole, guide in self.last.items()}
        return {whole: rest.points for whole, rest in rests.items() if rest is not None}

    def inherit(self, before: Guides, heirs: Mapping[Whole, Whole]) -> None:
        """Take over earlier guides, by the classes that theirs are now."""
        self.last, self.rivals = kept(before.last, heirs), kept(before.rivals, heirs)
        self.strong = {heirs[whole] for whole in before.strong if whole in heirs}

    def left(self, elapsed: float, goal: Array) -> Iterator[tuple[Whole, Trajectory]]:
        """What is left of the strong ones after a time [s], for those that have not arrived."""
        for whole, guide in self.last.items():
            rest = guide.rest(elapsed, goal) if whole in self.strong else None
            if rest is not None:
                yield whole, rest


def _cheaper(one: AnyGuide | None, other: AnyGuide | None) -> bool:
    """Whether a guide is sound, and another is not or is dearer."""
    if one is None or not one.valid:
        return False
    return other is None or not other.valid or one.priced < other.priced


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """When a plan is made.

    Attributes:
        now: on the clock of bodies that move [s].
        elapsed: since the last plan [s].
        pressed: whether time is short.
        reversed: paths that are driven backwards, by winding; asked where a drive begins.
    """

    now: float
    elapsed: float
    pressed: Callable[[], bool]
    reversed: Callable[[], Mapping[tuple[int, ...], Trajectory]]


class Around:
    """Chooses leads and numbers of samples, and remembers from plan to plan what helps the next choice.

    Args:
        mixes: whether samples of all classes are weighed together; else nothing is learnt of how they weigh.
    """

    def __init__(
        self, problem: Problem, integral: PathIntegral, homology: Homology | TimedHomology, *, mixes: bool
    ) -> None:
        self.problem, self.integral, self.homology, self.mixes = problem, integral, homology, mixes
        sampling = integral.sampling
        shared = mixes and sampling.allocation == "contribution" and integral.shares
        self.allocation = Allocation(sampling.samples) if shared else None
        self.begin()

    def begin(self) -> None:
        """Forget the drive so far."""
        if self.allocation is not None:
            self.allocation.forget()
        self.guides, self.aside = Guides(), Aside()

    def inherit(self, before: Around, heirs: Mapping[Whole, Whole], names: Mapping[str, str]) -> None:
        """Take over what an earlier one remembers of classes.

        Args:
            heirs: the class now of each guide that is kept.
            names: the name now of each class that is.
        """
        self.guides.inherit(before.guides, heirs)
        self.aside.shares = kept(before.aside.shares, names)
        if self.allocation is not None and before.allocation is not None:
            self.allocation.inherit(before.allocation, names)

    def batch(self, x: Array, references: Sequence[Reference], classes: Sequence[Whole], moment: Moment) -> Batch:
        """What a plan at x (n,) draws: around references, or of passive dynamics if there is none.

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
        wanted = [
            Wanted(
                whole=whole, key=self.homology.key(one.winding), trajectory=one.trajectory, winding=one.winding,
                others=one.others,
            )
            for whole, one in zip(classes, references, strict=True)
        ]  # fmt: skip
        leads, counts = self._leads(x, times, wanted, names, moment)
        proposals = [
            Proposal(lead=lead, count=count, name=name, key=one.key)
            for lead, count, name, one in zip(leads, counts, names, wanted, strict=True)
        ]

        def beside(k: int) -> Lead | None:
            """Of the k-th class: another valley, or the way that a point climbs."""
            rival = self.guides.rivals.get(classes[k])
            if rival is not None:
                return lead_of(rival, self.problem.dynamics)
            return integral.leading.beside(x, trajectories[k], moment.now)

        if self.mixes:
            proposals = self.aside.split(proposals, beside)
        return Batch(state=x, times=times, proposals=tuple(proposals), time=moment.now)

    def learn(self, batch: Batch, estimate: Estimate) -> None:
        """Take in what the samples of a plan weighed."""
        if self.allocation is not None:
            self.allocation.learn([one.name for one in batch.proposals], estimate)
        if self.mixes:
            self.aside.learn(batch, estimate)

    def least_cost(self, x: Array, trajectories: Sequence[Trajectory]) -> float:
        """Least cost of the references under q + u'Ru/2; without references that of the straight line."""
        if not trajectories:
            goal = self.problem.scene.goal.center
            return 4.0 * self.problem.least_rate * float(np.hypot(*(x[:2] - goal)))
        return min(running_cost(self.problem, x, trajectory) for trajectory in trajectories)

    def _leads(
        self, x: Array, times: Array, wanted: Sequence[Wanted], names: Sequence[str], moment: Moment
    ) -> tuple[list[Lead], list[int]]:
        """What samples around each reference follow, and how many there are; guides start from the last ones."""
        integral, shared = self.integral, self.allocation
        trajectories = [one.trajectory for one in wanted]
        known = None if shared is None or integral.guidance is not None else shared.shortfalls(names)
        leads = integral.leading.leads(x, times, trajectories, known)
        if integral.guidance is not None:
            guides, counts = self._guided(integral.guidance, x, times, wanted, moment)
            if shared is not None:  # prices of guides promise too little to go by
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

    def _guided(
        self, guidance: Any, x: Array, times: Array, wanted: Sequence[Wanted], moment: Moment
    ) -> tuple[list[Any], list[int]]:
        """Guides, each from what is left of the last one of its class, and samples around each."""
        clock = {"time": moment.now} if isinstance(self.homology, TimedHomology) else {}
        return self.guides.improve(
            guidance, x, times, wanted, samples=self.integral.sampling.samples, elapsed=moment.elapsed,
            pressed=moment.pressed, reversed=moment.reversed, threads=self.integral.threads, **clock,
        )  # fmt: skip
