"""The command `pirrht estimate`: what samples say at one state, and what is exact."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError, SceneError
from pirrht.estimation.estimate import Estimate
from pirrht.planner.references import Reference
from sim.cli import tables, warm
from sim.cli.shared import check_outputs, planned, scenario_of, solving, unforeseen
from sim.drive.truth import Truth
from sim.files import write_json
from sim.result import estimate_json
from sim.scenario import Scenario
from sim.systems import POSE, SPEED, VELOCITIES, typed
from sim.text import counted, say, width

TOUCHING = 1e-4  # free distance below which paths end at once [m]


def estimate(arguments: argparse.Namespace) -> int:
    """Estimate value and control at one state, repeated with independent samples."""
    check_outputs(arguments, "json")
    scenario = scenario_of(arguments)
    if scenario.settings.method == "optimal":
        raise OptionError("--method optimal draws no samples to estimate from; add --truth to another method")
    x = _state(arguments.at, scenario)
    _check_bodies(scenario, x, arguments.time)
    truth = _truth(scenario, x, arguments.time) if arguments.truth else None
    tree, _ = (None, []) if scenario.settings.method in TREELESS else planned(scenario, x)
    controller = scenario.driver(tree)
    controller.begin(x, arguments.time)
    estimates: list[Estimate | None] = []
    references: tuple[Reference, ...] = ()
    for _ in range(arguments.repeat):
        decision = controller.plan(x)
        references = decision.references
        estimates.append(decision.estimate)
    warm.finish("sample")
    print(tables.estimate_table(estimates, [r.id for r in references], truth, width()))
    if any(e is None for e in estimates):
        dead = sum(e is None for e in estimates)
        remedy = "start slower" if _too_fast(scenario, controller, x) else "try more --samples"
        say(f"{dead} of {len(estimates)} repeats: no sample reached the goal; {touching(scenario, x) or remedy}")
    if truth is not None:
        unforeseen(scenario)
    for line in tables.doubts(estimates, references, scenario.problem.temperature, scenario.settings.target_error):
        say(line)
    if scenario.settings.weights == "biased":
        say("--weights biased leaves the likelihood ratio out: v and shares are no estimates, however many samples")
    if arguments.json:
        write_json(arguments.json, estimate_json(scenario, references, estimates, truth))
    return 0


def touching(scenario: Scenario, x: Array) -> str | None:
    """Suggest what to do at x (n,) where every path ends at once; None elsewhere."""
    room = scenario.space.clearance(x[:2])
    return (
        f"the free distance there is {max(room, 0.0):.1g} m, so paths end at once: ask elsewhere"
        if room < TOUCHING
        else None
    )


def _truth(scenario: Scenario, x: Array, time: float) -> Truth:
    """The grid's value and control at x (n,) at a time [s]."""
    with solving() as progress:
        return Truth.at(scenario.truth(progress), x, time)


def _check_bodies(scenario: Scenario, x: Array, time: float) -> None:
    """Refuse a time where nothing moves, and a place where a body is then."""
    if time > 0.0 and not scenario.moving:
        raise OptionError(f"--time is {time:g}, and nothing moves in this scene; leave it out")
    if scenario.space.moving.distance(x[:2], time) <= 0.0:
        raise OptionError(
            f"--at {x[0]:g} {x[1]:g}: a body that moves is there at {time:g} s; ask elsewhere or at another --time"
        )


def _state(at: list[float], scenario: Scenario) -> Array:
    system = scenario.system
    bare = set(system.states) <= set(POSE)  # then a heading is taken, and left where there is none
    whole, place = (POSE, POSE) if bare else (system.states, system.joints)
    if not 2 <= len(at) <= len(whole) or not np.all(np.isfinite(at)):
        found = (
            f"has {counted(len(at), 'number')}" if np.all(np.isfinite(at)) else f"is {' '.join(f'{v:g}' for v in at)}"
        )
        raise OptionError(f"--at {found}; it must be X Y or the first few of {typed(whole)}, all finite")
    rest = [0.0] * (len(whole) - len(at))
    x = scenario.problem.dynamics.state_of(np.array([*at, 0.0])) if len(at) <= len(place) else np.array([*at, *rest])
    where = f"--at {' '.join(f'{v:g}' for v in at)}"
    if scenario.space.clearance(x) <= 0.0:
        raise SceneError(f"{where}: this state is in collision or outside the workspace; choose another")
    if scenario.loaded.scene.goal.contains(x[:2]):
        raise SceneError(f"{where}: this state is already in the goal; choose another")
    return x


def _too_fast(scenario: Scenario, controller: Any, x: Array) -> bool:
    """Return whether samples reach the goal from the same place at rest, but not from x (n,) with its speed."""
    rest = x.copy()
    rest[[i for i, name in enumerate(scenario.system.states) if name in (*VELOCITIES, *SPEED)]] = 0.0
    if np.array_equal(rest, x):
        return False
    controller.begin(rest)
    return controller.plan(rest).estimate is not None
