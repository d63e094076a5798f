"""Inside the safety margin samples and the exact solution agree, and every robot drives out of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from pirrht.outcome import Outcome
from sim.mjcf import robot_names
from sim.scenario import prepare

SCENE = """<mujoco><worldbody>
<geom name="wall" type="box" size="1.5 0.1 0.3" pos="1.5 0.4 0.3" euler="0 0 10"/>
<geom name="post" type="cylinder" size="0.3 0.3" pos="3 1.8 0.3"/>
<site name="workspace" type="box" size="2.5 1.75 0.5" pos="2.5 1.75 0.5"/>
<site name="start" pos="0.75 0.58 0" euler="0 0 30"/><site name="goal" type="cylinder" size="0.45 0.01" pos="3 2 0"/>
</worldbody></mujoco>"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    file = tmp_path / "room.xml"
    file.write_text(SCENE)
    return file


def test_an_estimate_inside_the_margin_is_the_exact_value(scene: Path) -> None:
    scenario = prepare(scene, margin=0.15, given={"noise": 0.1, "samples": 2000})
    assert len(scenario.space.scene.waivers) == 2  # at the start, and in the free part of the goal
    estimate = scenario.controller(scenario.grown_tree()).plan(scenario.start).estimate
    truth = float(scenario.truth().value(scenario.start))
    assert abs(estimate.value - truth) < 4.0 * estimate.value_error + 0.005


@pytest.mark.parametrize("robot", robot_names())
def test_every_robot_drives_out_of_the_margin_into_a_partly_covered_goal(scene: Path, robot: str) -> None:
    scenario = prepare(scene, robot=robot, margin=0.15, given={"max_time": 15.0})
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    assert frames[-1].outcome is Outcome.GOAL
