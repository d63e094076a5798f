"""Commands `pirrht plan`, the tree and its classes, and `pirrht estimate`, the value and control at one state."""

from __future__ import annotations

import argparse

import numpy as np

from pirrht.arrays import Array
from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError, SceneError
from pirrht.estimation.estimate import Estimate
from pirrht.planner.references import Reference
from sim import tree_file
from sim.cli import tables
from sim.cli.shared import check_outputs, notice, planned, progress_bar, report_prediction, scenario_of, solving
from sim.drive.truth import Truth
from sim.files import path_text, write_json
from sim.result import convergence_json, estimate_json, plan_json
from sim.scenario import Scenario, convergence
from sim.systems import POSE, typed
from sim.text import counted, say, width


def plan(arguments: argparse.Namespace) -> int:
    """Grow the tree and print one row per class."""
    check_outputs(arguments, "json", "png", "convergence", "output")
    for option in ("png", "convergence"):
        if getattr(arguments, option) is not None:
            from sim import figures

            figures.check(getattr(arguments, option), f"--{option}")
    scenario = scenario_of(arguments)
    if scenario.settings.method in TREELESS:
        say(f"--method {scenario.settings.method} plans without a tree: this is the tree of pi-rrht")
    began, lengths = notice().clock(), None
    if arguments.convergence:
        tree, vertices = scenario.empty_tree(), scenario.settings.vertices
        with progress_bar("plan", vertices, " vertices") as bar:
            lengths = convergence.grow(
                tree, scenario.start, vertices, every=max(1, vertices // 200),
                progress=lambda size: bar.update(size - bar.n),
            )  # fmt: skip
        references = scenario.references(tree)
    else:
        tree, references = planned(scenario)
    seconds = notice().clock() - began
    notice().finish()
    found = plan_json(scenario, tree, references, seconds)
    print(tables.class_table(references, width(), scenario.homology))
    say(f"{tree.size} vertices, {tree.node_count} nodes, {found['fcl_calls']} FCL calls, {seconds:.2f} s")
    say(tables.passages_line(found["passages"]))
    if arguments.output:
        tree_file.save(tree, arguments.output)
        print(f"tree: {path_text(arguments.output)}")
    if arguments.json:
        more = {} if lengths is None else {"convergence": convergence_json(lengths)}
        write_json(arguments.json, {**found, **more})
    if arguments.png:
        figures.draw_plan(arguments.png, scenario, tree, references)
    if lengths is not None:
        figures.draw_convergence(arguments.convergence, scenario.loaded.scene.name, lengths, references)
    return 0


def estimate(arguments: argparse.Namespace) -> int:
    """Estimate value and control at one state, repeated with independent samples."""
    check_outputs(arguments, "json")
    scenario = scenario_of(arguments)
    if scenario.settings.method == "optimal":
        raise OptionError("--method optimal draws no samples to estimate from; add --truth to another method")
    x, time = state_of(arguments.at, scenario), arguments.time
    if time > 0.0 and not scenario.moving:
        raise OptionError(f"--time is {time:g}, and nothing moves in this scene; leave it out")
    if scenario.space.moving.distance(x[:2], time) <= 0.0:
        raise OptionError(
            f"--at {x[0]:g} {x[1]:g}: a moving obstacle is there at {time:g} s; choose another state or --time"
        )
    truth = None
    if arguments.truth:
        with solving() as progress:
            truth = Truth.at(scenario.truth(progress), x, time)
    tree, _ = (None, []) if scenario.settings.method in TREELESS else planned(scenario, x)
    controller = scenario.driver(tree)
    controller.begin(x, time)
    estimates: list[Estimate | None] = []
    references: tuple[Reference, ...] = ()
    for _ in range(arguments.repeat):
        decision = controller.plan(x)
        references = decision.references
        estimates.append(decision.estimate)
    notice().finish()
    print(tables.estimate_table(estimates, [r.id for r in references], truth, width()))
    if dead := sum(e is None for e in estimates):
        say(f"{dead} of {len(estimates)} repeats: no sample reached the goal; try more --samples, or another state")
    if truth is not None:
        report_prediction(scenario, "the exact value is that")
    for line in tables.doubts(estimates, references, scenario.problem.temperature, scenario.settings.target_error):
        say(line)
    if scenario.settings.weights == "biased":
        say("--weights biased leaves the likelihood ratio out: v and shares are no estimates, however many samples")
    if arguments.json:
        write_json(arguments.json, estimate_json(scenario, references, estimates, truth))
    return 0


def state_of(at: list[float], scenario: Scenario) -> Array:
    """The state (n,) that `--at` names; missing numbers are 0, and a heading is left out where there is none.

    Raises:
        OptionError, SceneError: it has too few or too many numbers, or is no free state.
    """
    system, finite = scenario.system, bool(np.all(np.isfinite(at)))
    bare = set(system.states) <= set(POSE)
    whole, place = (POSE, POSE) if bare else (system.states, system.joints)
    where = " ".join(f"{v:g}" for v in at)
    if not 2 <= len(at) <= len(whole) or not finite:
        found = f"has {counted(len(at), 'number')}" if finite else f"is {where}"
        raise OptionError(f"--at {found}; it must be X Y or the first few of {typed(whole)}, all finite")
    if len(at) <= len(place):
        x = scenario.problem.dynamics.state_of(np.array([*at, 0.0]))
    else:
        x = np.array([*at, *[0.0] * (len(whole) - len(at))])
    if scenario.space.clearance(x) <= 0.0:
        raise SceneError(f"--at {where}: this state is in collision or outside the workspace; choose another")
    if scenario.loaded.scene.goal.contains(x[:2]):
        raise SceneError(f"--at {where}: this state is already in the goal; choose another")
    return x
