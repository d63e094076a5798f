"""Shares of classes where none has them all, beside what the exact grid's paths take.

At most random places one class has all of the weight, and that they agree there says nothing. Asked are the scene's
start and random places and times at which a first plan leaves the favourite less than nine tenths.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from benchmarks.first_plan import first_plan

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.control.settings import TUNING
from pirrht.exact.desirability import Desirability
from sim.scenario import Scenario

MOST, CANDIDATES = 4, 100  # states that are asked for, and how many are looked at in search of them
MANY = 40  # plans that are made at once where the first one tells that a state is contested ...
SURE = 0.01  # ... until the standard error of the likeliest class's share in their samples is less ...
ALL = 600  # ... or there are so many
PATHS = 2400  # of the grid's at each, whose own standard error is 1 point at most


def contested(
    scenario: Scenario,
    truth: Desirability,
    controller: Controller,
    places: Array,
    seed: int,
    *,
    last: float,
    plans: int = MANY,
    most: int = ALL,
) -> list[dict[str, Any]]:
    """Records of states at which classes contend: place, time, shares of the grid's paths and of each plan.

    Args:
        places: random ones (k, 2) [m] in free space.
        last: until when times are drawn [s].
        plans: at each, and again so many until their share of the likeliest class is sure, ...
        most: ... or there are so many.
    """
    found: list[dict[str, Any]] = []
    for x, t in _candidates(scenario, places, seed, last):
        made = _plans(controller, x, t, 1)
        if not made or max(mean_of([plan["shares"] for plan in made]).values()) >= TUNING.decided:
            continue
        made += _plans(controller, x, t, plans - 1)
        state = {"x": x.tolist(), "t": t, "shares": truth.shares(x, PATHS, t=t)}
        state |= _told(made, scenario.problem.temperature)
        while len(made) < most and _error_of(state, likeliest(state)) > SURE:
            made += _plans(controller, x, t, plans)
            state |= _told(made, scenario.problem.temperature)
        found.append(state)
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


def likeliest(state: dict[str, Any]) -> str:
    """The class that most of the grid's paths take."""
    return max(state["shares"], key=lambda name: state["shares"][name])


def in_errors(state: dict[str, Any]) -> float:
    """The difference of the pooled share of the likeliest class, in standard errors of samples and paths together."""
    name = likeliest(state)
    exact, said = state["shares"][name], pooled_of(state).get(name, 0.0)
    return float(abs(said - exact) / np.hypot(np.sqrt(exact * (1.0 - exact) / PATHS), _error_of(state, name)))


def _error_of(state: dict[str, Any], name: str) -> float:
    """The standard error of the pooled share of a class: that of a ratio of means over plans."""
    said = pooled_of(state).get(name, 0.0)
    off = _weights(state) * (np.array([one.get(name, 0.0) for one in state["plans"]]) - said)
    return float(np.sqrt(off @ off / (len(off) * (len(off) - 1))))


def _told(made: list[dict[str, Any]], temperature: float) -> dict[str, Any]:
    """What plans say of shares, and of psi."""
    return {"plans": [plan["shares"] for plan in made], "log_psi": [-plan["v"] / temperature for plan in made]}


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
    made = (first_plan(controller, x, t) for _ in range(count) if controller.space.moving.distance(x, t) > 0.0)
    return [plan for plan in made if plan is not None]
