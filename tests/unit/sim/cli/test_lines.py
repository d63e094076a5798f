"""Lines beside the tables: what is uncertain in a drive, and why no sample arrived."""

from __future__ import annotations

import numpy as np
import pytest
from sim.cli.estimate_command import touching

from sim.cli import tables
from sim.scenario import prepare


@pytest.mark.parametrize(
    ("robot", "line"),
    [
        ("puck", "puck: noise 0.3 m/sqrt(s), lambda 0.18"),
        ("hover", "hover: noise 0.3 m/s/sqrt(s), lambda 0.18"),
    ],
)
def test_noise_is_told_in_its_unit_and_lambda_is_r_b_b(robot, line):
    """R = 2 for both."""
    assert tables.odds(prepare("slit", robot=robot, given={"noise": 0.3})) == line


def test_a_state_that_touches_an_obstacle_is_told_from_one_with_too_few_samples():
    """The upper wall of `slit` ends at y = 2.85, and a puck's footprint has 0.1 m."""
    scenario = prepare("slit")
    assert "free distance there is 5e-05 m" in touching(scenario, np.array([3.0, 2.95005]))
    assert touching(scenario, np.array([3.0, 2.96])) is None


def test_passages_that_a_turning_circle_does_not_fit_into_name_a_robot_that_turns_on_the_spot():
    unused = [{"at": [1.0, 2.0], "width": width, "between": ["a", "b"]} for width in (0.8, 3.0)]
    assert "does not fit into 1: --robot rover" in tables.passages_line({"open": 5, "unused": unused}, 2.4)
    assert "rover" not in tables.passages_line({"open": 5, "unused": unused}, 0.5)
    assert "rover" not in tables.passages_line({"open": 5, "unused": unused})
