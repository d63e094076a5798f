"""Runs without a map: what the lidar shows decides, and what is there judges."""

import json

import numpy as np
import pytest

from pirrht import OptionError, Outcome
from pirrht.control.mapped import Mapped
from sim.scenario import prepare

pytestmark = pytest.mark.slow

LIDAR = {"sense": "lidar", "robot": "jackal"}
TRAP = """<mujoco model="trap"><custom><numeric name="pirrht_margin" data="0.03"/></custom><worldbody>
  <geom name="floor of the pocket" type="box" pos="4 2.5 0.3" size="0.1 1.2 0.3"/>
  <geom name="upper side" type="box" pos="3 3.6 0.3" size="1.1 0.1 0.3"/>
  <geom name="lower side" type="box" pos="3 1.4 0.3" size="1.1 0.1 0.3"/>
  <site name="start" pos="0.7 2.5 0"/><site name="goal" type="cylinder" pos="7 2.5 0" size="0.4 0.01"/>
  <site name="workspace" type="box" pos="4 2.5 0.5" size="4 2.5 0.5"/>
</worldbody></mujoco>"""


def driven(scene, **given):
    scenario = prepare(scene, given={**LIDAR, **given})
    driver = scenario.driver(scenario.grown_tree())
    return scenario, driver, list(scenario.drive(scenario.plant(), driver))


def test_a_house_is_crossed_without_its_map_and_clearance_is_that_of_what_is_there():
    scenario, driver, frames = driven("house", seed=1)
    metrics = frames[-1].metrics
    assert frames[-1].outcome is Outcome.GOAL
    assert isinstance(driver, Mapped)
    assert driver.map.occupied.any()
    assert 0.0 < metrics.min_clearance < 0.5
    assert len(scenario.space.scene.obstacles) == 0
    assert scenario.real is not None
    assert len(scenario.real.scene.obstacles) > 5
    json.dumps(metrics.json())


def test_a_pocket_is_left_again_once_its_floor_is_seen(tmp_path):
    file = tmp_path / "trap.xml"
    file.write_text(TRAP)
    for seed in range(2):
        _, _, frames = driven(file, seed=seed, lidar="most=2.5")
        assert frames[-1].outcome is Outcome.GOAL
        assert frames[-1].metrics.class_reversals <= 3


BAY = """<mujoco model="bay"><custom><numeric name="pirrht_margin" data="0.03"/></custom><worldbody>
  <geom name="left side" type="box" pos="6.5 3.4 0.3" size="0.5 0.1 0.3"/>
  <geom name="right side" type="box" pos="6.5 2.6 0.3" size="0.5 0.1 0.3"/>
  <geom name="end" type="box" pos="7.1 3 0.3" size="0.1 0.5 0.3"/>
  {post}
  <site name="start" pos="{start} 3 0"/><site name="goal" type="cylinder" pos="1 3 0" size="0.4 0.01"/>
  <site name="workspace" type="box" pos="4 3 0.5" size="4 3 0.5"/>
</worldbody></mujoco>"""
POST = '<geom name="post" type="cylinder" pos="3.5 3 0.25" size="0.1 0.25"/>'


@pytest.mark.parametrize(("start", "post", "most"), [(6.5, "", 15.0), (5.0, POST, 12.0)])
def test_a_robot_whose_goal_is_behind_it_looks_or_backs_out_slowly_and_arrives_without_dithering(
    tmp_path, start, post, most
):
    """In the bay it has no room to turn; from the other start it would reverse into a post that it cannot see."""
    file = tmp_path / "bay.xml"
    file.write_text(BAY.format(start=start, post=post))
    for seed in range(2):
        _, _, frames = driven(file, seed=seed, max_time=most)
        assert frames[-1].outcome is Outcome.GOAL


def test_equal_seeds_give_equal_runs_and_a_wrong_pose_another_one():
    states = []
    for options in ({}, {}, {"sense_pose": 0.02}):
        _, _, frames = driven("house", seed=2, max_time=2.0, **options)
        states.append(np.vstack([frame.advance.states for frame in frames]))
    np.testing.assert_array_equal(states[0], states[1])
    assert not np.array_equal(states[0], states[2])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"plant": "sde"}, "--sense lidar needs a plant in MuJoCo"),
        ({"method": "optimal"}, "--sense lidar needs a plant in MuJoCo and a method that replans"),
        ({"sense": "map", "unknown": 1.0}, "go with --sense lidar"),
        ({"lidar": "beams=3"}, "a lidar has no .beams."),
        ({"risk": 0.01}, "--risk is the risk among known obstacles"),
        ({"sense": "map", "cell": 0.1}, "go with --sense lidar"),
    ],
)
def test_what_does_not_go_with_a_lidar_is_refused_in_one_line(given, words):
    with pytest.raises(OptionError, match=words) as caught:
        prepare("house", given={**LIDAR, **given})
    assert "\n" not in str(caught.value)
