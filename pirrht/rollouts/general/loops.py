"""What is done with simulated paths: all of them weighed, some looked at again.

A path is a function of the seed and its number alone, so that what was not kept is simulated once more.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.compiled.jit import kernel
from pirrht.rollouts.general.path import Kept
from pirrht.rollouts.records import Chosen, Kernels, empty_paths

KEPT: Any = Kept
NO_STATES = np.empty((0, 0, 0)), np.empty(0, np.int64)
NO_GROUPS = np.empty(0, np.int64), np.empty(0)
NO_CONTROLS = np.empty((0, 0, 0)), np.empty((0, 0))
NONE_CHOSEN = Chosen(np.empty(0, np.int64), *NO_GROUPS)


@cache
def loops(one_path: Any, scratch_of: Any, m: int) -> Kernels:
    """Kernels around one that simulates a path, with `m` controls, in scratch that another makes."""
    no_paths = empty_paths(0, 0, m)

    @kernel
    def fill(setup, leads, origin, start, stop, paths):  # type: ignore[no-untyped-def]
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
    def again(setup, leads, origin, chosen, total, alive, states, steps):  # type: ignore[no-untyped-def]
        """Simulate chosen samples once more, with what `control` and `trace` take; what is not asked for is empty."""
        nothing, ratio, scratch = np.empty((0, 1)), np.empty(0), scratch_of(setup, leads)
        applied, base = np.zeros((alive.shape[1], m)), np.empty(m)
        number, group, weight = chosen
        drawn, h = states.shape[0] > 0, 0
        for c in range(number.shape[0]):
            s = number[c]
            while s >= leads.first[h + 1]:
                h += 1
            while s < leads.first[h]:
                h -= 1
            keep = KEPT(ratio, states[c] if drawn else nothing, applied, nothing, base)
            _, _, _, taken, _, _ = one_path(setup, leads, origin, h, s, keep, scratch)
            if drawn:
                steps[c] = taken
            for i in range(taken if alive.shape[0] > 0 else 0):
                alive[group[c], i] += weight[c]
                for j in range(m):
                    total[group[c], i, j] += weight[c] * applied[i, j]

    @kernel
    def either(setup, leads, origin, start, stop, paths, chosen, total, alive, states, steps):  # type: ignore[no-untyped-def]
        """Both in one, since most of either is the path, which takes seconds to compile."""
        if stop > start:
            fill(setup, leads, origin, start, stop, paths)
        else:
            again(setup, leads, origin, chosen, total, alive, states, steps)

    def sample(setup: Any, leads: Any, origin: Any, start: int, stop: int, paths: Any) -> None:
        """Fill `paths` for the samples from `start` to `stop`."""
        if stop > start:
            either(setup, leads, origin, start, stop, paths, NONE_CHOSEN, *NO_CONTROLS, *NO_STATES)

    def control(setup: Any, leads: Any, origin: Any, chosen: Chosen, total: Array, alive: Array) -> None:
        """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
        either(setup, leads, origin, 0, 0, no_paths, chosen, total, alive, *NO_STATES)

    def trace(setup: Any, leads: Any, origin: Any, number: IntArray, states: Array, steps: IntArray) -> None:
        """Write states (c, T+1, n) and numbers of steps (c,) of chosen samples."""
        either(setup, leads, origin, 0, 0, no_paths, Chosen(number, *NO_GROUPS), *NO_CONTROLS, states, steps)

    return Kernels(sample, control, trace)
