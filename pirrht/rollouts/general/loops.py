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
    def simulate(setup, leads, origin, start, stop, paths, chosen, total, alive, states, steps):  # type: ignore[no-untyped-def]
        """Fill `paths` for the samples from `start` to `stop`; if there are none, simulate chosen samples once more.

        Those give what `control` and `trace` take; what is not asked for is empty.
        """
        number, group, weight = chosen
        again, drawn, window, times = start == stop, states.shape[0] > 0, leads.window, leads.times
        nothing, ratio, scratch = np.empty((0, 1)), np.empty(0), scratch_of(setup, leads)
        applied, base = np.zeros((alive.shape[1] if again else window, m)), np.empty(m)
        led_by, h = np.empty((0 if again else window, m)), 0
        for c in range(number.shape[0] if again else stop - start):
            s = number[c] if again else start + c
            while s >= leads.first[h + 1]:
                h += 1
            while s < leads.first[h]:
                h -= 1
            log_ratio = ratio if again else paths.log_ratio[s]
            keep = KEPT(log_ratio, states[c] if drawn else nothing, applied, led_by, base)
            work, key, outcome, taken, last, lasting = one_path(setup, leads, origin, h, s, keep, scratch)
            if again:
                if drawn:
                    steps[c] = taken
                for i in range(taken if alive.shape[0] > 0 else 0):
                    alive[group[c], i] += weight[c]
                    for j in range(m):
                        total[group[c], i, j] += weight[c] * applied[i, j]
                continue
            paths.work[s], paths.key[s], paths.outcome[s], paths.steps[s] = work, key, outcome, taken
            paths.lasting[s] = lasting
            for j in range(m):
                paths.led[s, j] = base[j]
            for i in range(min(taken, window)):
                dt = times[i + 1] - times[i]
                under_way = last if i == taken - 1 else dt
                paths.span[s] += under_way
                for j in range(m):
                    paths.now[s, j] += dt * (applied[i, j] - led_by[i, j]) + under_way * base[j]

    def sample(setup: Any, leads: Any, origin: Any, start: int, stop: int, paths: Any) -> None:
        """Fill `paths` for the samples from `start` to `stop`."""
        if stop > start:
            simulate(setup, leads, origin, start, stop, paths, NONE_CHOSEN, *NO_CONTROLS, *NO_STATES)

    def control(setup: Any, leads: Any, origin: Any, chosen: Chosen, total: Array, alive: Array) -> None:
        """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
        simulate(setup, leads, origin, 0, 0, no_paths, chosen, total, alive, *NO_STATES)

    def trace(setup: Any, leads: Any, origin: Any, number: IntArray, states: Array, steps: IntArray) -> None:
        """Write states (c, T+1, n) and numbers of steps (c,) of chosen samples."""
        simulate(setup, leads, origin, 0, 0, no_paths, Chosen(number, *NO_GROUPS), *NO_CONTROLS, states, steps)

    return Kernels(sample, control, trace)
