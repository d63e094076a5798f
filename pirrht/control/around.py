"""What the samples of a plan go around: a guide or a tape per reference, what else a class has, and how many each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.aside import Aside
from pirrht.control.guides import Guides, Wanted, Whole, kept
from pirrht.estimation.allocation import Allocation
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.guidance.leads import Batch, Lead, Proposal, Tape, lead_of
from pirrht.guidance.tracking import FEW
from pirrht.problem import Problem
from pirrht.steering.trajectory import Trajectory, running_cost
from pirrht.topology.homology import Homology
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.reference import Reference


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
