"""What is done with simulated paths: all of them weighed, some looked at again.

A path is a function of the seed and its number alone, so that what was not kept is simulated once more.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from pirrht.compiled.jit import kernel
from pirrht.rollouts.general.path import Kept
from pirrht.rollouts.records import Kernels

KEPT: Any = Kept


@cache
def loops(one_path: Any, scratch_of: Any, m: int) -> Kernels:
    """Kernels around one that simulates a path, with `m` controls, in scratch that another makes."""

    @kernel
    def sample(setup, leads, origin, start, stop, paths):  # type: ignore[no-untyped-def]
        """Fill `paths` for the samples from `start` to `stop`."""
        nothing, scratch = np.empty((0, 1)), scratch_of(setup, leads)
        window, times = leads.window, leads.times
        applied, led_by, base = np.empty((window, m)), np.empty((window, m)), np.empty(m)
        h = 0
        for s in range(start, stop):
            while s >= leads.first[h + 1]:
                h += 1
            keep = KEPT(paths.log_ratio[s], nothing, applied, led_by, base)
            work, key, outcome, steps, last, lasting = one_path(setup, leads, origin, h, s, keep, scratch)
            paths.work[s], paths.key[s], paths.outcome[s], paths.steps[s] = work, key, outcome, steps
            paths.lasting[s] = lasting
            for j in range(m):
                paths.led[s, j] = base[j]
            for i in range(min(steps, window)):
                dt = times[i + 1] - times[i]
                alive = last if i == steps - 1 else dt
                paths.span[s] += alive
                for j in range(m):
                    paths.now[s, j] += dt * (applied[i, j] - led_by[i, j]) + alive * base[j]

    @kernel
    def control(setup, leads, origin, chosen, total, alive):  # type: ignore[no-untyped-def]
        """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
        nothing, ratio, scratch = np.empty((0, 1)), np.empty(0), scratch_of(setup, leads)
        applied, base = np.zeros((leads.control.shape[1], m)), np.empty(m)
        number, group, weight = chosen
        keep, h = KEPT(ratio, nothing, applied, nothing, base), 0
        for c in range(number.shape[0]):
            s, g = number[c], group[c]
            while s >= leads.first[h + 1]:
                h += 1
            _, _, _, steps, _, _ = one_path(setup, leads, origin, h, s, keep, scratch)
            for i in range(steps):
                alive[g, i] += weight[c]
                for j in range(m):
                    total[g, i, j] += weight[c] * applied[i, j]

    @kernel
    def trace(setup, leads, origin, number, states, steps):  # type: ignore[no-untyped-def]
        """Write states (c, T+1, n) and numbers of steps (c,) of chosen samples."""
        nothing, ratio, base, scratch = np.empty((0, 1)), np.empty(0), np.empty(m), scratch_of(setup, leads)
        for c in range(number.shape[0]):
            keep = KEPT(ratio, states[c], nothing, nothing, base)
            h = np.searchsorted(leads.first, number[c], side="right") - 1
            _, _, _, steps[c], _, _ = one_path(setup, leads, origin, h, number[c], keep, scratch)

    return Kernels(sample, control, trace)
