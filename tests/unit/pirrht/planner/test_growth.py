"""The tree grows while the robot drives: by counts, so that a seed still means a result."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pirrht.planner.tree import HomologyTree
from sim.cli import main
from sim.drive import episode
from sim.scenario import Scenario, prepare

FEW = {"vertices": 60, "samples": 20, "noise": 0.2}


@pytest.fixture(scope="module")
def small() -> Scenario:
    return prepare("slit", given=FEW)


@pytest.fixture(scope="module")
def car() -> Scenario:
    return prepare("clutter", given={"vertices": 60})


def drive(scenario: Scenario, grow: int) -> list[episode.Frame]:
    controller = scenario.controller(scenario.grown_tree())
    rng = scenario.plant_rng()
    return list(episode.run(scenario.plant(), controller, scenario.start, rng, max_time=0.2, grow=grow))


def assert_equal_trees(one: HomologyTree, other: HomologyTree) -> None:
    assert (one.size, one.node_count, one.draws) == (other.size, other.node_count, other.draws)
    np.testing.assert_array_equal(one.states[: one.size], other.states[: other.size])
    for x in one.states[: one.size : 7]:
        assert one.lengths(x) == other.lengths(x)


@pytest.mark.parametrize("robot", ["small", "car"])
def test_growing_k_times_is_growing_once(robot: str, request: pytest.FixtureRequest):
    scenario: Scenario = request.getfixturevalue(robot)
    once, often = scenario.grown_tree(), scenario.grown_tree()
    once.grow(once.size + 60)
    for _ in range(12):
        often.grow(often.size + 5)
    assert_equal_trees(once, often)


@pytest.mark.parametrize("robot", ["small", "car"])
def test_draws_dealt_with_together_make_the_tree_that_they_make_one_by_one(robot: str, request: pytest.FixtureRequest):
    scenario: Scenario = request.getfixturevalue(robot)
    together, one_by_one = scenario.empty_tree(), scenario.empty_tree()
    draws = together.steering.draws(together.space, together.rng, 300, goal_share=0.05)
    together.extend_by(draws)
    for x in draws:
        one_by_one.extend(x)
    assert_equal_trees(together, one_by_one)
    for v in range(together.size):
        count = int(together.graph.nodes[v])
        for name in ("cost", "key", "parent"):
            one, other = getattr(together.graph, name), getattr(one_by_one.graph, name)
            np.testing.assert_array_equal(one[v, :count], other[v, :count])
    assert together.graph.pruned[0] == one_by_one.graph.pruned[0]


def test_equal_seeds_grow_and_drive_alike(small: Scenario):
    one, other = drive(small, 4), drive(small, 4)
    assert [frame.vertices for frame in one] == [60 + 4 * k for k in range(len(one))]
    for first, second in zip(one, other, strict=True):
        assert first.vertices == second.vertices
        np.testing.assert_array_equal(first.advance.states, second.advance.states)
        assert [r.cost for r in first.plan.references] == [r.cost for r in second.plan.references]


def test_the_command_line_grows_while_it_drives(tmp_path, capsys):
    file = tmp_path / "run.json"
    words = ["run", "slit", "--vertices", "60", "--samples", "20", "--max-time", "0.05", "--json", str(file)]
    assert main([*words, "--grow", "3"]) == 1
    result = json.loads(file.read_text())
    assert (result["grow"], result["vertices"]) == (3, 60 + 4 * 3)


def test_what_cannot_grow_is_refused(capsys):
    assert main(["run", "slit", "--grow", "-1"]) == 2
    assert main(["run", "slit", "--grow", "5", "--method", "passive"]) == 2
    message = capsys.readouterr().err
    assert "--grow is -1" in message
    assert "--method passive has no tree" in message
