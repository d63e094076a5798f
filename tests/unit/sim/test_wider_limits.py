"""A robot's own limit of |1 - H_i| gives way where no class reaches the goal within it; another stays."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pirrht.errors import NoReference
from sim.scenario import Scenario, prepare
from sim.scenario.scenario import WIDER
from sim.sweeps.runs import pack, unpack

CLOSED = """<mujoco><worldbody><site name="workspace" type="box" size="4 3 1" pos="2 0 .5"/>
<geom name="wall" type="box" size=".1 9 .5" pos="2 0 .5"/><site name="start" pos="0 0 0"/>
<site name="goal" type="cylinder" size=".3 .01" pos="4 0 0"/></worldbody></mujoco>"""
NARROW = 1e-3  # less than any way past a wall winds


def narrow(limit: float = NARROW) -> Scenario:
    """`slit` for a robot of which no class is within its own limit, and which asks for `limit`."""
    scenario = prepare("slit", given={"vertices": 300})
    system = replace(scenario.system, defaults={**scenario.system.defaults, "limit": NARROW})
    return (
        replace(scenario, system=system).with_settings(limit=limit)
        if limit != NARROW
        else replace(scenario, system=system, settings=replace(scenario.settings, limit=NARROW))
    )


def test_the_tree_is_grown_within_the_next_limit_that_lets_a_class_reach_the_goal():
    scenario = narrow()
    tree, asked = scenario.grown_tree(), scenario.with_settings(limit=WIDER[0]).grown_tree()
    assert tree.limit == WIDER[0]
    assert [found.cost for found in scenario.references(tree)] == [found.cost for found in scenario.references(asked)]
    assert unpack(scenario, pack(tree)).limit == WIDER[0]


def test_a_limit_that_was_asked_for_stays_and_its_refusal_names_it():
    scenario = narrow(limit=2.0 * NARROW)
    tree = scenario.grown_tree()
    assert tree.limit == 2.0 * NARROW
    with pytest.raises(NoReference, match=r"<= 0\.002"):
        scenario.references(tree)


def test_where_nothing_helps_the_refusal_names_the_robots_own_limit(tmp_path):
    (tmp_path / "closed.xml").write_text(CLOSED)
    scenario = prepare(tmp_path / "closed.xml", given={"vertices": 100})
    with pytest.raises(NoReference, match=r"<= 0\.6"):
        scenario.references(scenario.grown_tree())
