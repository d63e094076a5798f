"""The receding-horizon loop: plan, drive for a period, observe; in simulated time, or by a clock (Algorithm 4)."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.policy import Policy
from pirrht.exact.desirability import Desirability
from sim.drive import realtime
from sim.drive.executor import Advance, Plant
from sim.drive.metrics import EpisodeMetrics, Frame, TimedPlan
from sim.drive.realtime import Clock

__all__ = ["Frame", "run"]

MOST_VERTICES = 1_000_000  # of a tree that grows during a run: some GiB of memory


def run(
    plant: Plant, policy: Policy, start: Array, rng: np.random.Generator, *, max_time: float, grow: int | None = None,
    clock: Clock | None = None, grid: Desirability | None = None,
) -> Generator[Frame]:  # fmt: skip
    """Drive from start until the goal, a collision or max_time [s].

    Args:
        grow: vertices that the policy's tree gains per period, until it has MOST_VERTICES; None: none, by a clock as
            many as there is time for.
        clock: goes on while plans are made (`realtime`); None: the plant waits for them.
        grid: the exact solution, with which every control is compared.

    Raises:
        NoReference: already the start has no reference.
    """
    plant.reset(start)
    metrics = EpisodeMetrics(policy, plant.state, period=plant.period, max_time=max_time, grid=grid)
    if clock is None:
        periods: Generator[Any] = _in_turn(plant, policy, rng, grow or 0)
    else:
        periods = realtime.periods(plant, policy, rng, clock, grow=grow, max_time=max_time)
    with closing(periods):
        for period in periods:
            frame = metrics.frame(*period)
            yield frame
            if frame.outcome is not None:
                return


def _in_turn(plant: Plant, policy: Policy, rng: np.random.Generator, grow: int) -> Generator[tuple[TimedPlan, Advance]]:
    """Plan and drive by turns."""
    policy.begin(plant.state)
    while True:
        made = TimedPlan.of(policy, plant.state)
        advance = plant.advance(made.plan.at, rng)
        policy.observe(advance.states, advance.time)
        yield made, advance
        if policy.tree is not None and grow:
            policy.tree.grow(min(made.vertices + grow, MOST_VERTICES))
