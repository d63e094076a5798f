"""Decision of a controller at one state: a control now, open-loop controls for later, and their reasons."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control import plan_view
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.replay import Replay
from pirrht.freespace import FreeSpace
from pirrht.geometry.motion import Mover
from pirrht.tree.reference import Reference

DECIDED = 0.9  # a share this great is a decision: under the exact law shares are martingales, so 1 in 9 is taken back


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What was decided at one state; `Controller.plan` and its kin make it.

    Attributes:
        state: where it was made, (n,).
        times: ends of the tape's steps, from 0, (T+1,) [s].
        references: best known path of every class, cheapest first; empty for methods that have none.
        ids: class of each reference, relative to the start of the drive.
        estimate: what the samples say; None in a fallback, and for methods without samples.
        fallback: why the robot is blocked and brakes: "no reference" or "no survivor"; None if it is not.
        stops: whether the robot can; one that cannot takes the longest free way where it is blocked.
        replay: what makes the tape of an estimate, and paths that are shown.
        instead: what becomes of the control in a fallback if there is no noise, (T, m) [control].
        law: control (m,) [control] at a state (n,) and a time since the plan [s]; None: the tape is held.
        push: what the nearest walls add to a held control, (m,) [control] at a state (n,), so long after [s].
        shares: weight of every class under the law, from 0 to 1.
        followed: the class that the control is of, where it is of one alone.
        classes: names of the references' classes by additive key.
        time: of the drive when it was made, or for which [s].
        exact: v at the state [cost], where it is known without samples.
        space: the free space in which it was made, for pictures.
        movers: bodies as it took them to move, on the drive's clock.

    Examples:
        A plan says what to do now, `plan.control` (m,), and a little later, `plan.at(x, s)`:

        >>> plan = controller.plan(x)  # doctest: +SKIP
        >>> plan  # doctest: +SKIP
        Plan(at (0.5, 2.5): control (0.94, -0.0617), v 10.93 +- 0.015, 3 classes, most weight 0,0 (66 %))
    """

    state: Array
    times: Array
    references: tuple[Reference, ...]
    ids: tuple[str, ...]
    estimate: Estimate | None
    fallback: str | None
    stops: bool = True
    replay: Replay | None = None
    instead: Array | None = None
    law: Callable[[Array, float], Array] | None = None
    push: Callable[[Array, float], Array] | None = None
    shares: dict[str, float] | None = None
    followed: str | None = None
    classes: Mapping[int, str] = field(default_factory=dict)
    time: float = 0.0
    exact: float | None = None
    space: FreeSpace | None = None
    movers: tuple[Mover, ...] = ()

    def __repr__(self) -> str:
        return plan_view.line(self)

    def _repr_html_(self) -> str:
        return plan_view.table(self)

    def plot(self, *, samples: int = 60, axes: Any = None) -> Any:
        """Draw the state, the reference of every class, samples and the control on a map of the scene.

        Args:
            samples: how many that arrived are drawn, the heaviest, and how many that died, in a lighter grey.
            axes: of matplotlib, to draw on; without them a new figure is made.

        Returns:
            the axes.

        Raises:
            OptionError: matplotlib is not installed, or the plan does not know its scene.
        """
        return plan_view.draw(self, samples, axes)

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

        With feedback between plans the control follows the state. Where it is held, under feedback
        guidance the part that the nearest wall accounts for still follows the state.
        """
        if self.law is not None:
            return self.law(x, s)
        if s + 1e-9 < self.times[1]:
            return self.control + (0.0 if self.push is None else self.push(x, s) - self.push(self.state, 0.0))
        i = int(np.searchsorted(self.times, s + 1e-9, side="right")) - 1
        return self.tape[i] if i < len(self.tape) else np.zeros(self.tape.shape[1])

    @property
    def favourite(self) -> str | None:
        """Class of greatest weight, or that of the one reference that is followed."""
        if self.estimate is None:
            return self.ids[0] if self.ids else None
        if self.followed is not None:
            return self.followed
        weights = self.shares or self.estimate.class_weights
        return max(weights, key=lambda name: weights[name]) if weights else None

    @property
    def decided(self) -> str | None:
        """The favourite, if it has at least `DECIDED` of the weight or is followed alone; None if all is still open."""
        favourite = self.favourite
        if self.estimate is None or self.followed is not None or favourite is None:
            return favourite
        return favourite if (self.shares or self.estimate.class_weights)[favourite] >= DECIDED else None


def shifted(times: Array, tape: Array, then: Array) -> Array:
    """Means (T, m) of a tape (k, m) with step ends `times` (k+1,) over the steps that end at `then` (T+1,) [s]."""
    whole = np.vstack([np.zeros(tape.shape[1]), np.cumsum(tape * np.diff(times)[:, None], axis=0)])
    at = np.column_stack([np.interp(then, times, column) for column in whole.T])
    return np.asarray(np.diff(at, axis=0) / np.diff(then)[:, None])
