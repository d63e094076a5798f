"""The state that `pirrht estimate --at` names: how much of it must be given, and speeds that nothing can brake."""

import numpy as np
import pytest

from pirrht.errors import NoReference
from sim.cli.plan_command import state_of
from sim.scenario import prepare

FEW = {"vertices": 200, "samples": 50}
FAST = (2.2, 2.9, 6.0, 0.0)  # in front of a wall of `slit`, and towards it


@pytest.mark.parametrize(
    ("robot", "at", "state"),
    [
        ("hover", [1.0, 2.5], [1.0, 2.5, 0.0, 0.0]),
        ("hover", [1.0, 2.5, 0.3], [1.0, 2.5, 0.3, 0.0]),
        ("puck", [1.0, 2.5, 0.3], [1.0, 2.5]),
        ("unicycle", [1.0, 2.5, 0.3], [1.0, 2.5, 0.3]),
        ("car", [1.0, 2.5, 0.3], [1.0, 2.5, 0.3, 0.0]),
    ],
)
def test_a_pose_is_a_state_of_every_robot_and_missing_numbers_are_zero(robot, at, state):
    np.testing.assert_array_equal(state_of(at, prepare("slit", robot=robot, given=FEW)), state)


def test_a_speed_that_nothing_can_brake_is_named_as_the_reason():
    hover = prepare("slit", robot="hover", given=FEW)
    tree = hover.grown_tree()
    controller = hover.driver(tree)
    with pytest.raises(NoReference, match=r"at rest: at this speed hardly any path .* start slower") as refused:
        controller.plan(np.array(FAST))
    assert refused.value.hasty
    assert controller.plan(np.array([*FAST[:2], 0.0, 0.0])).references
    with pytest.raises(NoReference, match="more vertices"):  # at rest outside of everything there is none either
        tree.references(np.array([-50.0, 0.0, 6.0, 0.0]))
