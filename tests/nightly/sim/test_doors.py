"""Nobody is hit in a door: every robot that can stop, with known motions and with predicted ones."""

from __future__ import annotations

import pytest
from doors import door

from pirrht.outcome import Outcome
from sim.cli import main
from sim.scenario import prepare

SEEDS = 4


@pytest.mark.parametrize("stays", [False, True], ids=["goes", "stays"])
@pytest.mark.parametrize("predict", ["known", "velocity"])
@pytest.mark.parametrize("robot", ["puck", "hover", "rover", "car"])
def test_whoever_stands_in_the_door_is_not_hit(tmp_path, robot, predict, stays):
    given = {"noise": 0.05, "period": 0.05, "predict": predict, "vertices": 600}
    scenario = prepare(door(tmp_path, stays=stays), robot=robot, radius=0.1 if robot == "puck" else None, given=given)
    tree, outcomes = scenario.grown_tree(), []
    for seed in range(SEEDS):
        one = scenario.with_settings(seed=seed)
        *_, last = one.drive(one.plant(), one.driver(tree))
        outcomes.append(last.outcome)
    if stays and predict == "velocity":
        assert outcomes == [Outcome.TIMEOUT] * SEEDS
    elif stays:  # who knows that nobody will leave may pass before
        assert Outcome.COLLISION not in outcomes
    else:
        assert outcomes == [Outcome.GOAL] * SEEDS


def test_a_robot_that_cannot_stop_is_reported(tmp_path, capsys):
    file = door(tmp_path)
    main(["run", file, "--robot", "unicycle", "--predict", "velocity", "--max-time", "3"])
    said = capsys.readouterr()
    assert "this robot cannot stop, and takes the longest free way" in said.out + said.err
