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
        made = _plans(controller, x, t, LOOKS)
        if not made or max(mean_of([plan["shares"] for plan in made]).values()) >= DECIDED:
            continue
        made += _plans(controller, x, t, plans - LOOKS)
        log_psi = [-plan["v"] / scenario.problem.temperature for plan in made]
        found.append(
            {
                "x": x.tolist(),
                "t": t,
                "shares": truth.shares(x, PATHS, t=t),
                "plans": [plan["shares"] for plan in made],
                "log_psi": log_psi,
            }
        )
        if len(found) == MOST:
            break
    return found


def mean_of(shares: list[dict[str, float]]) -> dict[str, float]:
    """The mean share of every class that any plan has."""
    return {name: float(np.mean([one.get(name, 0.0) for one in shares])) for name in set().union(*shares)}


def pooled_of(state: dict[str, Any]) -> dict[str, float]:
    """Shares of all plans' samples together, which psi is the mean of: one plan's own are a ratio of few samples."""
    weights = _weights(state)
    return {
        name: float(np.mean(weights * [one.get(name, 0.0) for one in state["plans"]]))
        for name in set().union(*state["plans"])
    }


def apart(said: dict[str, float], exact: dict[str, float]) -> float:
    """The greatest difference between shares that samples give a class and that the grid's paths do."""
    return max(abs(said.get(name, 0.0) - exact.get(name, 0.0)) for name in {*said, *exact})


def in_errors(state: dict[str, Any]) -> float:
    """The difference of the pooled share of the class most of the grid's paths take, in standard errors of both."""
    name = max(state["shares"], key=lambda one: state["shares"][one])
    exact, said = state["shares"][name], pooled_of(state).get(name, 0.0)
    off = _weights(state) * (np.array([one.get(name, 0.0) for one in state["plans"]]) - said)
    variance = exact * (1.0 - exact) / PATHS + off @ off / (len(off) * (len(off) - 1))
    return float(abs(said - exact) / np.sqrt(variance))


def _weights(state: dict[str, Any]) -> Array:
    """psi of every plan over their mean, (plans,)."""
    psi = np.exp(np.subtract(state["log_psi"], max(state["log_psi"])))
    return np.asarray(psi / psi.mean())


def _candidates(scenario: Scenario, places: Array, seed: int, last: float) -> Iterator[tuple[Array, float]]:
    rng = np.random.default_rng([seed, 56])
    yield scenario.start[:2], 0.0
    for x in places:
        yield x, float(rng.uniform(0.0, last))


def _plans(controller: Controller, x: Array, t: float, count: int) -> list[dict[str, Any]]:
    """Plans that know nothing from before; none inside a body."""
    made = (first_plan(controller, x, t) for _ in range(count) if controller.space.crowd.clearance(x, t) > 0.0)
    return [plan for plan in made if plan is not None]
