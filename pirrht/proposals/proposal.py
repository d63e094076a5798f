"""Proposals of importance sampling: the control that samples around one reference follow, and how many do.

A proposal control u(x, s) has two homes: `__call__` for one state, and a row of `ProposalTables` for kernels. Weights
divide by the likelihood of the control that was followed, so any control leaves psi of the sampled chain unbiased.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pirrht.arrays import Array

if TYPE_CHECKING:  # records of kernels: their homes need geometry, a proposal does not
    from pirrht.rollouts.tables import ProposalTables


class ProposalControl(ABC):
    """A control u(x, s), (m,), that samples follow, and the density of their noise.

    To add a proposal, write one class with two methods, or derive it from `Wrapped` to change another one. `__call__`
    tells the control at a state. `pack` writes row h of the tables from which kernels draw noise, and by which they
    evaluate its density: a control sequence (any system), a tube of desirability (a point among static obstacles), or
    a law with mean, feedback and covariance by step (`LawRows`; all other systems, and a point among moving
    obstacles). Every proposal's density enters the denominator of every weight (`weights.log_weights`), so psi stays
    unbiased. `Controller(..., propose=[...])` adds it to the mixture of each class.

    Examples:
        Wider noise around a guide, for a system whose position no noise acts on:

        >>> import numpy as np
        >>> from pirrht.rollouts.tables import LawRows
        >>> class Wider(Wrapped):
        ...     def pack(self, tables, h):
        ...         super().pack(tables, h)
        ...         modes, n = self.lead.guide.modes.shape[1], len(self.lead.guide.metric)
        ...         law = LawRows.of(tables, h, n, modes)
        ...         law.deviation[:] *= 1.1
        ...         law.inverse[:] /= 1.1
        ...         law.log_det[:] += modes * np.log(1.1)
    """

    follows = True  # whether it depends on the state
    guide: Any = None  # the `DDPGuide` that it follows, if there is one

    @property
    def shape(self) -> tuple[int, int]:
        """Cross-sections of a tube, and nodes of each (C, J)."""
        return 1, 1

    @property
    def promise(self) -> float:
        """Predicted log psi of the class [nats]; minus infinity if unknown."""
        return -math.inf

    @abstractmethod
    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""

    def held(self, x: Array) -> Array:
        """Return the mean control (m,) over the first step from x (n,), of a path that stays on the reference."""
        return self(x, 0.0)

    @abstractmethod
    def pack(self, leads: "ProposalTables", h: int) -> None:
        """Write row h of the tables (H, ...); they are zero before."""


class Wrapped(ProposalControl):
    """Another proposal control, to be changed in a derived class."""

    def __init__(self, lead: ProposalControl) -> None:
        self.lead, self.follows, self.guide = lead, lead.follows, lead.guide

    @property
    def shape(self) -> tuple[int, int]:
        """Cross-sections of a tube, and nodes of each (C, J)."""
        return self.lead.shape

    @property
    def promise(self) -> float:
        """Predicted log psi of the class [nats]."""
        return self.lead.promise

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        return self.lead(x, s)

    def held(self, x: Array) -> Array:
        """Return the mean control (m,) over the first step from x (n,)."""
        return self.lead.held(x)

    def pack(self, leads: "ProposalTables", h: int) -> None:
        """Write row h of the tables."""
        self.lead.pack(leads, h)


@dataclass(frozen=True, slots=True, eq=False)
class Tape(ProposalControl):
    """Open-loop controls (the paper's reference)."""

    times: Array  # (T+1,) ends of the steps [s]
    controls: Array  # (T, m)
    promise: float = -math.inf  # predicted log psi of the class, where its tube is hopeless [nats]

    follows = False

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) of the step under way at s [s]; zero after the end."""
        i = int(np.searchsorted(self.times, s + 1e-9, side="right")) - 1
        return np.asarray(self.controls[i]) if i < len(self.controls) else np.zeros(self.controls.shape[1])

    def pack(self, leads: "ProposalTables", h: int) -> None:
        """Write the control sequence to `ProposalTables.control` (H, T, m)."""
        leads.control[h] = self.controls


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """Samples to be drawn around one reference."""

    lead: ProposalControl
    count: int  # N_h of them
    name: str = ""  # of the reference's class, from the start of the run; empty without a reference
    key: int | None = None  # the class as an additive key
    surcharge: float = 0.0  # what samples of its class pay besides their cost [cost]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Samples to be drawn from one state around H references."""

    state: Array  # (n,)
    times: Array  # (T+1,) ends of the steps, from 0 [s]
    proposals: tuple[Proposal, ...]  # (H,)
    time: float = 0.0  # now, on the clock of moving obstacles [s]
    others: Mapping[int, str] = field(default_factory=dict)  # names of classes of earlier references, by key

    @property
    def counts(self) -> list[int]:
        """Samples around each reference, (H,)."""
        return [proposal.count for proposal in self.proposals]

    @property
    def classes(self) -> Mapping[int, str]:
        """Names of the references' classes by additive key."""
        return {proposal.key: proposal.name for proposal in self.proposals if proposal.key is not None}

    @property
    def named(self) -> Mapping[int, str]:
        """Names of classes by additive key, those of earlier references included."""
        return {**self.classes, **self.others}

    def counting(self, counts: Sequence[int]) -> "Batch":
        """Return the batch with other numbers of samples (H,)."""
        pairs = zip(self.proposals, counts, strict=True)
        return replace(self, proposals=tuple(replace(proposal, count=int(count)) for proposal, count in pairs))
