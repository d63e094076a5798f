"""Decision of a controller at one state: a control now, open-loop controls for later, and their reasons."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.settings import TUNING
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import Replay
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.planner.references import Reference


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Decision at one state, made by `Controller.plan`, `Mppi.plan` or `Optimal.plan`.

    Attributes:
        state: where it was made, (n,).
        times: ends of the control sequence's steps, from 0, (T+1,) [s].
        references: best known path of every class, cheapest first; empty for methods that have none.
        ids: class of each reference, relative to the start of the run.
        estimate: of psi, v and u by samples; None in a fallback, and for methods without samples.
        fallback: why the robot is blocked and brakes: "no reference" or "no survivor"; None if it is not.
        stops: whether the robot can; one that cannot takes the longest free path where it is blocked.
        replay: simulates samples again for the control sequence and for pictures.
        instead: controls of a fallback without noise, (T, m) [control].
        law: control (m,) [control] at a state (n,) and a time since the plan [s]; None: the control sequence is held.
        push: wall drift (m,) [control] of a held control, at a state (n,) and a time since the plan [s].
        shares: weight of every class under the law, from 0 to 1.
        followed: the one class that the control follows; None: all.
        classes: names of the references' classes by additive key.
        time: of the run, at which the plan starts [s].
        exact: v at the state [cost], where it is known without samples.
        space: the free space, for pictures.
        movers: moving obstacles as predicted, on the run's clock.

    Examples:
        The control now is `plan.control` (m,), a little later it is `plan.at(x, s)`:

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
        if self.estimate is not None:
            value = f"v {self.estimate.value:.4g} +- {self.estimate.value_error:.2g}"
        else:
            value = f"blocked, {self.fallback}" if self.fallback else f"v {self.exact or np.nan:.4g}"
        which = f", {len(self.ids)} classes" if len(self.ids) != 1 else ", 1 class"
        weight = self.weights().get(favourite := self.favourite or "")
        most = f", most weight {formatting.turns(favourite)} ({formatting.share(weight)})" if weight is not None else ""
        return (
            f"Plan(at {formatting.vector(self.state)}: control {formatting.vector(self.control)}, {value}{which}{most})"
        )

    def _repr_html_(self) -> str:
        by, estimate, rows = self.weights(), self.estimate, []
        for id, reference in zip(self.ids, self.references, strict=False):
            ess = "" if estimate is None or id not in estimate.class_ess else f"{estimate.class_ess[id]:.1f}"
            weight = formatting.share(by[id]) if id in by else ""
            rows.append([formatting.turns(id), f"{reference.cost:.4g}", f"{reference.length:.3g}", weight, ess])
        return formatting.table(repr(self), ["class", "cost", "length [m]", "weight", "ESS"], rows)

    def weights(self) -> dict[str, float]:
        """Return the weight of every class under the law, else in the estimate; empty without either."""
        return {**({} if self.estimate is None else self.estimate.class_weights), **(self.shares or {})}

    def plot(self, *, samples: int = 60, axes: Any = None) -> Any:
        """Draw the state, the reference of every class, samples and the control on a map of the scene.

        Args:
            samples: number of the heaviest that arrived, and of those that died, in a lighter grey.
            axes: of matplotlib; None: those of a new figure.

        Returns:
            the axes.

        Raises:
            OptionError: matplotlib is not installed, or the plan does not know its scene.
        """
        return import_module("sim.plotting.prompt").plan(self, samples, axes)

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
        """Return the control (m,) at state x (n,), s [s] after the plan; a held one still has the wall drift at x."""
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
        return max(weights, key=lambda name: weights[name], default=None)

    @property
    def decided(self) -> str | None:
        """The favourite, if it has at least `ControlTuning.decided` of the weight or is followed alone; else None."""
        favourite = self.favourite
        if self.estimate is None or self.followed is not None or favourite is None:
            return favourite
        return favourite if (self.shares or self.estimate.class_weights)[favourite] >= TUNING.decided else None
