"""Chosen samples of a point, simulated once more with their steps: what `rollout_loops` does path by path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.rollouts.point.block import RECORDED, block
from pirrht.rollouts.point.stages import LANES, room
from pirrht.rollouts.records import empty_paths


def control(
    world: Any, leads: Any, x0: Array, seed: np.uint64, chosen: NDArray[np.int64], group: NDArray[np.int64],
    weight: Array, total: Array, alive: Array,
) -> None:  # fmt: skip
    """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
    for _, at, steps, taken in _recorded(world, leads, x0, seed, chosen):
        _carried(leads.times, world.inverse, taken, steps, group[at], weight[at], total, alive)


def trace(
    world: Any,
    leads: Any,
    x0: Array,
    seed: np.uint64,
    chosen: NDArray[np.int64],
    states: Array,
    out: NDArray[np.int64],
) -> None:
    """Write states (c, T+1, 2) and number of steps (c,) of each."""
    states[:, 0] = x0
    for _, at, steps, taken in _recorded(world, leads, x0, seed, chosen):
        out[at] = steps
        under_way = np.arange(taken.shape[1]) < steps[:, None]
        states[at, 1:] = np.where(under_way[:, :, None], taken[:, :, :2], 0.0)


def _recorded(
    world: Any, leads: Any, x0: Array, seed: np.uint64, chosen: NDArray[np.int64]
) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]]:
    """Reference, places in `chosen`, numbers of steps and steps (., T, RECORDED) of the samples, block by block."""
    H, T, m = leads.control.shape
    order = np.argsort(chosen, kind="stable")
    listed = np.ascontiguousarray(chosen[order])
    edges = np.searchsorted(listed, leads.first)
    scratch, taken = room(H), np.zeros((LANES, T, RECORDED), np.float32)
    paths = empty_paths(len(listed), H, m)
    for h, (first, end) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        for start in range(first, end, LANES):
            stop = min(start + LANES, end)
            block(world, leads, h, x0, seed, listed, start, stop, paths, taken, scratch)
            yield h, order[start:stop], paths.steps[start:stop], taken[: stop - start]


@kernel
def _carried(times, inverse, taken, steps, group, weight, total, alive):  # type: ignore[no-untyped-def]
    for c in range(steps.shape[0]):
        g, w = group[c], weight[c]
        for i in range(steps[c]):
            dt, y0, y1 = times[i + 1] - times[i], taken[c, i, 2], taken[c, i, 3]
            alive[g, i] += w
            for j in range(2):
                total[g, i, j] += w * (inverse[j, 0] * y0 + inverse[j, 1] * y1) / dt
