"""The command `pirrht plan`: the tree and its classes."""

from __future__ import annotations

import argparse
from pathlib import Path

from pirrht.control.settings import TREELESS
from pirrht.files import path_text
from pirrht.planner import file as tree_file
from pirrht.planner.tree import HomologyTree
from sim.cli import tables, warm
from sim.cli.shared import check_outputs, planned, progress_bar, scenario_of
from sim.files import write_json
from sim.result import passages_json, plan_json
from sim.scenario import Scenario
from sim.scenario.convergence import Convergence
from sim.text import say, width


def plan(arguments: argparse.Namespace) -> int:
    """Grow the tree and print one row per class."""
    check_outputs(arguments, "json", "png", "convergence", "output")
    for option in ("png", "convergence"):
        path: Path | None = getattr(arguments, option)
        if path is not None:
            from sim.figures import draw

            draw.check(path, f"--{option}")
    scenario = scenario_of(arguments)
    if scenario.settings.method in TREELESS:
        say(f"--method {scenario.settings.method} plans without a tree: this is what pi-rrht plans with")
    clock = warm.notice().clock
    began = clock()
    convergence = None
    if arguments.convergence:
        tree, convergence = _watched(scenario)
        references = scenario.references(tree)
    else:
        tree, references = planned(scenario)
    seconds = clock() - began
    warm.finish("plan")
    passages = passages_json(tree, references)
    print(tables.class_table(references, width(), scenario.homology))
    say(f"{tree.size} vertices, {tree.node_count} nodes, {scenario.space.collision.calls} FCL calls, {seconds:.2f} s")
    radius = getattr(tree.steering, "radius", 0.0)  # that of curves whose curvature is bounded [m]
    say(tables.passages_line(passages, 2 * (radius + scenario.loaded.scene.robot_radius) if radius else 0.0))
    if arguments.output:
        tree_file.save(tree, arguments.output)
        print(f"tree: {path_text(arguments.output)}")
    if arguments.json:
        write_json(arguments.json, plan_json(scenario, tree, references, passages, seconds, convergence))
    if arguments.png:
        draw.draw_plan(arguments.png, scenario, tree, references)
    if convergence is not None:
        draw.draw_convergence(arguments.convergence, scenario.loaded.scene.name, convergence, references)
    return 0


def _watched(scenario: Scenario) -> tuple[HomologyTree, Convergence]:
    """The grown tree, and the lengths of the best path per class from the start while it grew."""
    from sim.scenario.convergence import grow

    tree, vertices = scenario.empty_tree(), scenario.settings.vertices
    with progress_bar("plan", vertices, " vertices") as bar:
        convergence = grow(
            tree,
            scenario.start,
            vertices,
            every=max(1, vertices // 200),
            progress=lambda size: bar.update(size - bar.n),
        )
    return tree, convergence
