"""What a controller decides at one state: a control now, open-loop controls for later, and why."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.replay import Replay
from pirrht.tree.homology_tree import Reference


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What was decided at one state."""

    state: Array  # (n,)
    times: Array  # (T+1,) ends of those steps, from 0 [s]
    references: tuple[Reference, ...]  # cheapest first; empty for methods that have none
    ids: tuple[str, ...]  # class of each reference, relative to the start of the drive
    estimate: Estimate | None  # None in a fallback
    fallback: str | None  # why the estimate is missing: "no reference", "no survivor"
    replay: Replay | None = None  # what makes the tape of an estimate
    instead: Array | None = None  # (T, m) the tape that is followed in a fallback
    law: Callable[[Array, float], Array] | None = None  # control (m,) at state (n,), s after the plan [s]
    push: Callable[[Array], Array] | None = None  # what the nearest walls add to a control that is held, (m,)
    span: float = np.inf  # how long the law is followed [s]; then the tape
    shares: dict[str, float] | None = None  # weight of every class under the law
    followed: str | None = None  # the class that the control is of, where it is of one alone
    classes: Mapping[int, str] = field(default_factory=dict)  # names of the references' classes by additive key
    time: float = 0.0  # of the drive when it was made, or for which [s]
    exact: float | None = None  # v at the state [cost], where it is known without samples

    @property
    def tape(self) -> Array:
        """Open-loop controls, one per rollout step, (T, m) (paper, end of IV-C)."""
        return self.instead if self.instead is not None else self._replayed[0]

    @property
    def alive(self) -> Array:
        """Weight of the samples still under way at each step, (T,); 1 without samples."""
        return np.ones(len(self.tape)) if self.instead is not None else self._replayed[1]

    @cached_property
    def _replayed(self) -> tuple[Array, Array]:
        assert self.estimate is not None
        assert self.replay is not None
        return self.replay.tape(self.estimate.parts)

    @property
    def control(self) -> Array:
        """The control now, (m,)."""
        if self.law is not None:
            return self.law(self.state, 0.0)
        return self.tape[0] if self.estimate is None else self.estimate.control

    def at(self, x: Array, s: float) -> Array:
        """Control (m,) at time s [s] after the plan was made, at state x (n,).

        With feedback between plans the control follows the state for a while. Where it is held, under feedback
        guidance the part that the nearest wall accounts for still follows the state.
        """
        if self.law is not None and s + 1e-9 < self.span:
            return self.law(x, s)
        if s + 1e-9 < self.times[1]:
            return self.control + (0.0 if self.push is None else self.push(x) - self.push(self.state))
        i = int(np.searchsorted(self.times, s + 1e-9, side="right")) - 1
        return self.tape[i] if i < len(self.tape) else np.zeros(self.tape.shape[1])

    def rest(self, x: Array, s: float) -> Plan:
        """What is left of the tape s [s] later, at state x (n,), for lack of anything newer."""
        passed = int(np.searchsorted(self.times, s + 1e-9, side="right")) - 1
        left = slice(min(passed, len(self.tape) - 1), None)
        times = np.maximum(self.times[left] - s, 0.0)
        tape = self.tape[left] if passed < len(self.tape) else np.zeros_like(self.tape[-1:])
        return Plan(state=x, times=times, references=(), ids=(), estimate=None, fallback="no reference", instead=tape)

    @property
    def favourite(self) -> str | None:
        """Class of greatest weight, or that of the one reference that is followed."""
        if self.estimate is None:
            return self.ids[0] if self.ids else None
        if self.followed is not None:
            return self.followed
        weights = self.shares or self.estimate.class_weights
        return max(weights, key=lambda name: weights[name]) if weights else None


def shifted(times: Array, tape: Array, then: Array) -> Array:
    """Means (T, m) of a tape (k, m) with step ends `times` (k+1,) over the steps that end at `then` (T+1,) [s]."""
    whole = np.vstack([np.zeros(tape.shape[1]), np.cumsum(tape * np.diff(times)[:, None], axis=0)])
    at = np.column_stack([np.interp(then, times, column) for column in whole.T])
    return np.asarray(np.diff(at, axis=0) / np.diff(then)[:, None])
