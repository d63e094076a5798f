"""The receding-horizon loop: plan, drive for a period, observe; in simulated time, or by a clock (Algorithm 4)."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import closing

import numpy as np

from pirrht.arrays import Array
from pirrht.control.policy import Policy
from sim.drive import realtime
from sim.drive.clock import Clock
from sim.drive.metrics import EpisodeMetrics, Frame, Period
from sim.drive.plant import Plant

__all__ = ["Frame", "run"]

MOST_VERTICES = 1_000_000  # of a tree that grows during a run: some GiB of memory


def run(
    plant: Plant, policy: Policy, start: Array, rng: np.random.Generator, *, max_time: float, grow: int | None = None,
    clock: Clock | None = None,
) -> Generator[Frame]:  # fmt: skip
    """Drive from start until the goal, a collision or max_time [s].

    Args:
        grow: vertices that the policy's tree gains per period, until it has MOST_VERTICES; None: none, by a clock as
            many as there is time for.
        clock: goes on while plans are made (`realtime`); None: the plant waits for them.

    Raises:
        NoReference: already the start has no reference.
    """
    plant.reset(start)
    metrics = EpisodeMetrics(policy, plant.state, period=plant.period, max_time=max_time)
    if clock is None:
        periods = _in_turn(plant, policy, rng, grow or 0)
    else:
        periods = realtime.periods(plant, policy, rng, clock, grow=grow, max_time=max_time)
    with closing(periods):
        for period in periods:
            frame = metrics.frame(period)
            yield frame
            if frame.outcome is not None:
                return


def _in_turn(plant: Plant, policy: Policy, rng: np.random.Generator, grow: int) -> Generator[Period]:
    """Plan and drive by turns."""
    policy.begin(plant.state)
    while True:
        began = time.perf_counter()
        plan = policy.plan(plant.state)
        seconds, tree = time.perf_counter() - began, policy.tree
        vertices = 0 if tree is None else tree.size
        advance = plant.advance(plan.at, rng)
        policy.observe(advance.states, advance.time)
        yield Period(plan=plan, advance=advance, plan_seconds=seconds, vertices=vertices, run=policy.run)
        if policy.tree is not None and grow:
            policy.tree.grow(min(vertices + grow, MOST_VERTICES))
