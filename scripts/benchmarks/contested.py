"""Shares of classes where none has them all, beside what the exact grid's paths take.

At most random places one class has all of the weight, and that they agree there says nothing. Asked are the scene's
start and random places and times at which a first plan leaves the favourite less than nine tenths.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from benchmarks.first_plan import first_plan

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.control.plan import DECIDED
from pirrht.exact.desirability import Desirability
from sim.scenario import Scenario

MOST, CANDIDATES = 4, 100  # states that are asked for, and how many are looked at in search of them
LOOKS, MANY = 1, 40  # plans by which one sees whether a state is contested, and plans that are made if it is
PATHS = 600  # of the grid's at each, whose own standard error is 2 points at most


def contested(
    scenario: Scenario,
    truth: Desirability,
    controller: Controller,
    places: Array,
    seed: int,
    *,
    last: float,
    plans: int = MANY,
) -> list[dict[str, Any]]:
    """Records of states at which classes contend: place, time, shares of the grid's paths and of each plan.

    Args:
        places: random ones (k, 2) [m] in free space.
        last: until when times are drawn [s].
        plans: at each.
    """
    found: list[dict[str, Any]] = []
    for x, t in _candidates(scenario, places, seed, last):
        few = [plan["shares"] for plan in _plans(controller, x, t, LOOKS)]
        if not few or max(mean_of(few).values()) >= DECIDED:
            continue
        said = few + [plan["shares"] for plan in _plans(controller, x, t, plans - LOOKS)]
        found.append({"x": x.tolist(), "t": t, "shares": truth.shares(x, PATHS, t=t), "plans": said})
        if len(found) == MOST:
            break
    return found


def mean_of(shares: list[dict[str, float]]) -> dict[str, float]:
    """The mean share of every class that any plan has."""
    return {name: float(np.mean([one.get(name, 0.0) for one in shares])) for name in set().union(*shares)}


def apart(state: dict[str, Any]) -> float:
    """The greatest difference between a class' share of the grid's paths and its mean share of the plans' samples."""
    said, exact = mean_of(state["plans"]), state["shares"]
    return max(abs(said.get(name, 0.0) - exact.get(name, 0.0)) for name in {*said, *exact})


def in_errors(state: dict[str, Any]) -> float:
    """The difference of the share that most of the grid's paths have, in standard errors of both."""
    name = max(state["shares"], key=lambda one: state["shares"][one])
    exact, said = state["shares"][name], np.array([one.get(name, 0.0) for one in state["plans"]])
    variance = exact * (1.0 - exact) / PATHS + said.var(ddof=1) / len(said)
    return float(abs(said.mean() - exact) / np.sqrt(variance))


def _candidates(scenario: Scenario, places: Array, seed: int, last: float) -> Iterator[tuple[Array, float]]:
    rng = np.random.default_rng([seed, 56])
    yield scenario.start[:2], 0.0
    for x in places:
        yield x, float(rng.uniform(0.0, last))


def _plans(controller: Controller, x: Array, t: float, count: int) -> list[dict[str, Any]]:
    made = (first_plan(controller, x, t) for _ in range(count) if controller.space.crowd.clearance(x, t) > 0.0)
    return [plan for plan in made if plan is not None]
