"""The state that `pirrht estimate --at` asks about: how much of it must be said, and speeds that nothing can brake."""

from __future__ import annotations

from argparse import Namespace

import numpy as np
import pytest

from pirrht.errors import NoReference, OptionError
from sim.cli import estimate_command
from sim.cli.parser import read
from sim.scenario import Scenario, prepare

FEW = {"vertices": 200, "samples": 50}
FAST = (2.2, 2.9, 6.0, 0.0)  # in front of a wall of `slit`, and towards it


@pytest.fixture(scope="module")
def hover() -> Scenario:
    return prepare("slit", robot="hover", given=FEW)


@pytest.mark.parametrize("said", [[1.0, 2.5], [1.0, 2.5, 0.3], [1.0, 2.5, 0.3, -0.2]])
def test_what_is_not_said_of_a_state_is_zero(hover, said):
    np.testing.assert_array_equal(estimate_command._state(said, hover), [*said, *[0.0] * (4 - len(said))])


@pytest.mark.parametrize(("robot", "n"), [("puck", 2), ("unicycle", 3), ("car", 4)])
def test_three_numbers_are_a_pose_of_every_robot(robot, n):
    known = estimate_command._state([1.0, 2.5, 0.3], prepare("slit", robot=robot, given=FEW))
    np.testing.assert_array_equal(known, [1.0, 2.5, 0.3, 0.0][:n])


@pytest.mark.parametrize("said", [[1.0], [1.0, 2.5, 0.3, -0.2, 7.0]])
def test_too_few_and_too_many_numbers_are_refused(hover, said):
    plural = "" if len(said) == 1 else "s"
    with pytest.raises(OptionError, match=rf"has {len(said)} number{plural}; .* the first few of X Y VX VY"):
        estimate_command._state(said, hover)


def test_a_speed_that_nothing_can_brake_is_named_as_the_reason(hover):
    tree = hover.grown_tree()
    controller = hover.driver(tree)
    with pytest.raises(NoReference, match=r"same place at rest some are: few paths brake .* start slower") as refused:
        controller.plan(np.array(FAST))
    assert refused.value.hasty
    assert controller.plan(np.array([*FAST[:2], 0.0, 0.0])).references
    with pytest.raises(NoReference, match="more vertices"):  # at rest outside of everything there is none either
        tree.references(np.array([-50.0, 0.0, 6.0, 0.0]))
    assert not tree.too_fast(np.array([-50.0, 0.0, 6.0, 0.0]))


def test_where_samples_of_a_fast_car_all_die_its_speed_is_named(capsys):
    line = "estimate slit --robot car --vertices 200 --samples 50 --at 2.2 2.8 0 8"
    arguments: Namespace = read(line.split())
    assert estimate_command.estimate(arguments) == 0
    assert "no sample reached the goal; start slower" in capsys.readouterr().out
