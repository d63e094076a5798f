"""Controls that depend on the state: the ascent of a class's desirability, and the feedback around a guide."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.proposals.desirability_tube import DesirabilityTube
from pirrht.proposals.guide import DDPGuide
from pirrht.proposals.half_spaces import beyond_linear, without
from pirrht.proposals.proposal import ProposalControl
from pirrht.proposals.wall_drift import WallDrift
from pirrht.rollouts.tables import FINER, DesirabilityTubes, LawRows, ProposalTables, slope_along


@dataclass(frozen=True, slots=True, eq=False)
class DesirabilityAscent(ProposalControl):
    """Ascent of the desirability in a tube, G u = BB' grad log psi, less the wall drift."""

    tube: DesirabilityTube
    gain: Array  # (m, 2) lambda R^-1 G' [m/s per nat/m]
    push: WallDrift
    tubes: DesirabilityTubes = field(init=False, repr=False)  # the tube as the only one

    def __post_init__(self) -> None:
        place, slope, decay, *_ = self.tube
        only = DesirabilityTubes(np.array([self.sections]), place[None], slope[None], decay)
        object.__setattr__(self, "tubes", only)

    @property
    def sections(self) -> int:
        """Number of cross-sections, C."""
        return len(self.tube.place)

    @property
    def promise(self) -> float:
        """Predicted log psi of the class, that of the tube at its start [nats]."""
        return self.tube.log_psi

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at x (n,), s [s] after the plan, which matters where obstacles move."""
        slope = np.zeros(2)
        slope_along(self.tubes, 0, self.tube.goal, x[0], x[1], self.push.walls(x, s), slope)
        return np.asarray(self.gain @ slope) - self.push(x, s)

    def pack(self, leads: ProposalTables, h: int) -> None:
        """Write the tube to the first C cross-sections of the row in `ProposalTables.ways`, and their number."""
        count = leads.ways.count[h] = len(self.tube.place)
        leads.ways.place[h, :count], leads.ways.slope[h, :count] = self.tube.place, self.tube.slope


@dataclass(frozen=True, slots=True, eq=False)
class LinearFeedback(ProposalControl):
    """Feedback around the guide of any system."""

    guide: DDPGuide

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) of the guide at s [s] plus its gains times the deviation of the state x (n,)."""
        guide, d = self.guide, self.guide.dynamics
        i = min(int(np.searchsorted(guide.times, s + 1e-9, side="right")) - 1, len(guide.modes) - 1)
        share = min(1.0, (s - guide.times[i]) / (guide.times[i + 1] - guide.times[i]))
        off = d.difference(x, guide.states[i] + share * d.difference(guide.states[i + 1], guide.states[i]))
        a = self._law(x, i, min(i * FINER + round(share * FINER), len(guide.modes) * FINER - 1), off)
        mean, sway = a[: d.m], a[d.m :]
        return d.input_of(x, mean + 2.0 * math.sqrt(3.0) * (share - 0.5) * sway if len(sway) else mean)

    def held(self, x: Array) -> Array:
        """Return the mean control (m,) of the guide over its first step from x (n,)."""
        guide, d = self.guide, self.guide.dynamics
        return d.input_of(x, self._law(x, 0, 0, d.difference(x, guide.states[0]))[: d.m])

    def _law(self, x: Array, i: int, row: int, off: Array) -> Array:
        """Evaluate the law of step i (modes,), with its row of constraints and drift, `off` (n,) from the guide."""
        guide = self.guide
        modes, gains, more = guide.modes[i], guide.gains[i], np.zeros(guide.modes.shape[1])
        if guide.walls_ahead is not None:
            half_spaces, drift, bend = guide.walls_ahead
            B = guide.dynamics.B_c(x)
            modes, gains = modes - drift[row] @ B, gains - B.T @ bend[row]
            more = beyond_linear(half_spaces[row], B, gains, off)
        return np.asarray(np.clip(modes + gains @ off + more, -guide.steep, guide.steep))

    def pack(self, leads: ProposalTables, h: int) -> None:
        """Write `LawRows` of `ProposalTables.law` (H, T FINER, law_width), and the number of its rows."""
        guide = self.guide
        leads.law_length[h] = guide.length * FINER
        (T, modes), n = guide.modes.shape, guide.states.shape[1]
        row, law = np.arange(T * FINER), LawRows.of(leads, h, n, modes)
        i, share = row // FINER, (row % FINER / FINER)[:, None]
        then = np.maximum(np.minimum(i + 1, guide.length - 1), i)
        mean = (1.0 - share) * guide.modes[i] + share * guide.modes[then]
        gains = (1.0 - share[:, :, None]) * guide.gains[i] + share[:, :, None] * guide.gains[then]
        if guide.walls_ahead is not None:
            half_spaces, drift, bend = guide.walls_ahead
            B = guide.dynamics.B_c(guide.states[0])
            mean, gains = mean - drift @ B, np.ascontiguousarray(gains - np.einsum("ij,kil->kjl", B, bend))
            mean, gains, ahead = without(half_spaces, B, mean, gains)
            leads.law[h, :, -ahead[0].size :] = ahead.reshape(len(row), -1)
        law.mean[:], law.gains[:], law.state[:] = mean, np.swapaxes(gains, 1, 2), self._states(i, share)
        law.deviation[:], law.inverse[:] = np.swapaxes(guide.share, 1, 2)[i], np.swapaxes(guide.inverse, 1, 2)[i]
        law.log_det[:], law.steepest[:], law.metric[:] = guide.volume[i], guide.steep, guide.metric

    def _states(self, i: IntArray, share: Array) -> Array:
        """Return states (k, n) at shares (k, 1) of steps i (k,): linear, but for positions, whose velocity is."""
        guide = self.guide
        states: Array = (1.0 - share) * guide.states[i] + share * guide.states[i + 1]
        pace = np.gradient(guide.states[: guide.length + 1, :2], guide.times[: guide.length + 1], axis=0)
        pace = np.vstack([pace, np.repeat(pace[-1:], len(guide.states) - len(pace), axis=0)])
        dt = np.diff(guide.times)[i][:, None]
        states[:, :2] += 0.5 * share * (1.0 - share) * dt * (pace[i] - pace[i + 1])
        return states
