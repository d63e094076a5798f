"""The lead of a guide of any system, and which lead a guide is followed by."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.guidance.any_guide import AnyGuide
from pirrht.guidance.gates import beyond_linear, without
from pirrht.guidance.leads import Along, Lead
from pirrht.guidance.tracking import Guide
from pirrht.rollouts.records import FINER, Leads
from pirrht.systems.dynamics import Dynamics


@dataclass(frozen=True, slots=True, eq=False)
class Follow(Lead):
    """The feedback around the guide of any system."""

    guide: AnyGuide

    def __call__(self, x: Array, s: float) -> Array:
        """Control (m,) of the guide at s [s] plus its gains times what the state x (n,) is off."""
        guide, d = self.guide, self.guide.dynamics
        i = min(int(np.searchsorted(guide.times, s + 1e-9, side="right")) - 1, len(guide.modes) - 1)
        share = min(1.0, (s - guide.times[i]) / (guide.times[i + 1] - guide.times[i]))
        off = d.difference(x, guide.states[i] + share * d.difference(guide.states[i + 1], guide.states[i]))
        a = self._bounded(self._gated(x, i, min(i * FINER + round(share * FINER), len(guide.modes) * FINER - 1), off))
        mean, sway = a[: d.m], a[d.m :]
        return guide.input_of(x, mean + 2.0 * math.sqrt(3.0) * (share - 0.5) * sway if len(sway) else mean)

    def held(self, x: Array) -> Array:
        """Control (m,) of the guide over its first step from x (n,), without what it rises or falls."""
        guide, d = self.guide, self.guide.dynamics
        a = self._bounded(self._gated(x, 0, 0, d.difference(x, guide.states[0])))
        return guide.input_of(x, a[: d.m])

    def _gated(self, x: Array, i: int, row: int, off: Array) -> Array:
        """The law of step i (modes,), its row of gates and pushes, `off` (n,) from the guide."""
        guide = self.guide
        modes, gains = guide.modes[i], guide.gains[i]
        if guide.gates is None or guide.pushes is None:
            return np.asarray(modes + gains @ off)
        B = guide.dynamics.B_c(x)
        modes, gains = modes - guide.pushes[0][row] @ B, gains - B.T @ guide.pushes[1][row]
        return np.asarray(modes + gains @ off + beyond_linear(guide.gates[row], B, gains, off))

    def pack(self, leads: Leads, h: int) -> None:
        """The law, to `Leads.law` (H, T FINER, law_width(n, modes)), and the number of its rows that lead."""
        guide = self.guide
        leads.led[h] = guide.length * FINER
        T = len(guide.modes)
        row = np.arange(T * FINER)
        i, share = row // FINER, (row % FINER / FINER)[:, None]
        then = np.maximum(np.minimum(i + 1, guide.length - 1), i)
        parts = [(1.0 - share) * part[i] + share * part[then] for part in (guide.modes, guide.gains.reshape(T, -1))]
        parts.append(self._states(i, share))
        parts += [np.swapaxes(part, 1, 2)[i].reshape(len(row), -1) for part in (guide.share, guide.inverse)]
        parts.append(guide.volume[i, None])
        if guide.gates is not None:
            d = guide.dynamics
            gains = parts[1].reshape(-1, d.m, d.n)
            if guide.pushes is not None:
                B = d.B_c(guide.states[0])
                parts[0] = parts[0] - guide.pushes[0] @ B
                gains = gains - np.einsum("ij,kil->kjl", B, guide.pushes[1])
            modes, gains, gates = without(guide.gates, d.B_c(guide.states[0]), parts[0], gains)
            parts[:2] = [modes, gains.reshape(len(row), -1)]
            leads.law[h, :, -gates[0].size :] = gates.reshape(len(row), -1)
        parts[1] = np.swapaxes(parts[1].reshape(len(row), -1, guide.dynamics.n), 1, 2).reshape(len(row), -1)
        table = np.hstack(parts)
        width, n = table.shape[1], len(guide.metric)
        leads.law[h, :, :width], leads.law[h, :, width], leads.law[h, :, width + 1 : width + 1 + n] = (
            table,
            guide.steep,
            guide.metric,
        )

    def _states(self, i: IntArray, share: Array) -> Array:
        """States (k, n) at shares (k, 1) of steps i (k,): straight lines, but for positions, which go on smoothly."""
        guide = self.guide
        states: Array = (1.0 - share) * guide.states[i] + share * guide.states[i + 1]
        pace = np.gradient(guide.states[: guide.length + 1, :2], guide.times[: guide.length + 1], axis=0)
        pace = np.vstack([pace, np.repeat(pace[-1:], len(guide.states) - len(pace), axis=0)])
        dt = np.diff(guide.times)[i][:, None]
        states[:, :2] += 0.5 * share * (1.0 - share) * dt * (pace[i] - pace[i + 1])
        return states

    def _bounded(self, a: Array) -> Array:
        return np.clip(a, -self.guide.steep, self.guide.steep)


def lead_of(guide: Guide | AnyGuide, dynamics: Dynamics) -> Along | Follow:
    """What samples around a guide follow."""
    return Follow(guide) if isinstance(guide, AnyGuide) else Along(guide, dynamics)
