"""A robot without a map answers what it finds: it waits or goes another way, and does not waver."""

import numpy as np
import pytest
from surprises import closed_door, person_in_a_door

from sim.scenario import prepare

pytestmark = pytest.mark.slow
GIVEN = {"robot": "puck", "sense": "lidar", "speed": 0.7, "noise": 0.05, "vertices": 300, "samples": 200, "period": 0.1}


def driven(path, **given):
    scenario = prepare(path, given={**GIVEN, "margin": 0.05, **given})
    return list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))


@pytest.mark.parametrize("rows", [
    "0 3.6 .6 0  1.5 3.6 .6 0  2.7 3 1.5 0  6 3 1.5 0  8 2 .5 0",  # it is in the door for a while
    "0 3.6 .6 0  1.5 3.6 .6 0  2.7 3 1.5 0",  # it stays there
])  # fmt: skip
def test_a_person_who_steps_into_a_door_is_waited_for_or_avoided_without_wavering(tmp_path, rows):
    frames = driven(person_in_a_door(tmp_path, rows), max_time=40.0)
    m = frames[-1].metrics
    assert m.outcome == "goal"
    assert m.class_switches <= 3  # it is something that stands, is on the move, and stands


def test_where_a_door_is_found_closed_the_robot_goes_back_and_takes_the_other_way(tmp_path):
    frames = driven(closed_door(tmp_path), max_time=60.0)
    states = np.vstack([frame.advance.states for frame in frames])
    assert frames[-1].metrics.outcome == "goal"
    high = np.flatnonzero(states[:, 1] > 3.9)
    assert len(high)  # it had gone for the door
    assert np.diff(high).max() == 1  # once
    assert states[:, 1].min() < 1.5
