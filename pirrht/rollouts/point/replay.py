"""Simulate chosen samples of a point once more, with their steps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.rollouts.point.block import RECORDED, Run, block
from pirrht.rollouts.point.stages import LANES, scratch_of
from pirrht.rollouts.records import Chosen, Origin, empty_paths


def control(setup: Any, leads: Any, origin: Origin, chosen: Chosen, total: Array, alive: Array) -> None:
    """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
    for _, at, steps, taken in _recorded(setup, leads, origin, chosen.number):
        _carried(leads.times, setup.inverse, taken, steps, chosen.group[at], chosen.weight[at], total, alive)


def trace(
    setup: Any, leads: Any, origin: Origin, number: NDArray[np.int64], states: Array, out: NDArray[np.int64]
) -> None:
    """Write states (c, T+1, 2) and number of steps (c,) of chosen samples."""
    states[:, 0] = origin.x
    for _, at, steps, taken in _recorded(setup, leads, origin, number):
        out[at] = steps
        under_way = np.arange(taken.shape[1]) < steps[:, None]
        states[at, 1:] = np.where(under_way[:, :, None], taken[:, :, :2], 0.0)


def _recorded(
    setup: Any, leads: Any, origin: Origin, chosen: NDArray[np.int64]
) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]]:
    """Yield reference, places in `chosen`, numbers of steps and steps (., T, RECORDED), block by block."""
    H, T, m = leads.control.shape
    order = np.argsort(chosen, kind="stable")
    listed = np.ascontiguousarray(chosen[order])
    edges = np.searchsorted(listed, leads.first)
    scratch, taken = scratch_of(H), np.zeros((LANES, T, RECORDED), np.float32)
    paths = empty_paths(len(listed), H, m)
    for h, (first, end) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        for start in range(first, end, LANES):
            stop = min(start + LANES, end)
            taken[:] = 0.0
            block(setup, leads, origin, Run(h, start, stop, listed), paths, taken, scratch)
            yield h, order[start:stop], paths.steps[start:stop], taken[: stop - start]


@kernel
def _carried(times, inverse, taken, steps, group, weight, total, alive):  # type: ignore[no-untyped-def]
    """Add the controls of recorded steps (c, T, RECORDED), as `control` says."""
    for c in range(steps.shape[0]):
        g, w = group[c], weight[c]
        for i in range(steps[c]):
            dt, y0, y1 = times[i + 1] - times[i], taken[c, i, 2], taken[c, i, 3]
            alive[g, i] += w
            for j in range(2):
                total[g, i, j] += w * (inverse[j, 0] * y0 + inverse[j, 1] * y1) / dt
