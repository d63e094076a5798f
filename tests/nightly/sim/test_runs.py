"""Robots among moving obstacles are not hit, first plans are no guesses, and systems of one's own are driven."""

from __future__ import annotations

import numpy as np
import pytest
from doors import door
from tug import Tug

from pirrht.errors import OptionError
from pirrht.outcome import Outcome
from pirrht.steering.double_integrator import MassSteering
from pirrht.systems.double_integrator import DoubleIntegrator
from sim import systems
from sim.cli import main
from sim.mjcf import scene_names
from sim.scenario import prepare
from sim.scenario.scenario import ENOUGH
from sim.systems import System

SEEDS = 4


@pytest.mark.parametrize("stays", [False, True], ids=["goes", "stays"])
@pytest.mark.parametrize("predict", ["known", "velocity"])
@pytest.mark.parametrize("robot", ["puck", "hover", "rover", "car"])
def test_a_robot_in_a_door_is_not_hit(tmp_path, robot, predict, stays):
    given = {"noise": 0.05, "period": 0.05, "predict": predict, "vertices": 600}
    scenario = prepare(door(tmp_path, stays=stays), robot=robot, radius=0.1 if robot == "puck" else None, given=given)
    tree, outcomes = scenario.grown_tree(), []
    for seed in range(SEEDS):
        one = scenario.with_settings(seed=seed)
        *_, last = one.drive(one.plant(), one.driver(tree))
        outcomes.append(last.outcome)
    if stays and predict == "velocity":
        assert outcomes == [Outcome.TIMEOUT] * SEEDS
    elif stays:  # a robot that knows that nobody will leave may pass before
        assert Outcome.COLLISION not in outcomes
    else:
        assert outcomes == [Outcome.GOAL] * SEEDS


def test_a_robot_that_cannot_stop_is_reported(tmp_path, capsys):
    main(["run", door(tmp_path), "--robot", "unicycle", "--predict", "velocity", "--max-time", "3"])
    said = capsys.readouterr()
    assert "this robot cannot stop, and takes the longest free way" in said.out + said.err


@pytest.mark.parametrize("name", scene_names())
def test_the_first_plan_of_every_scene_rests_on_enough_effective_samples(name):
    for seed in range(3):
        scenario = prepare(name, given={"seed": seed})
        estimate = scenario.driver(scenario.grown_tree()).plan(scenario.start).estimate
        assert estimate is not None
        assert estimate.ess >= ENOUGH, seed


class Forgetful(DoubleIntegrator):
    """One that does not say that its velocity moves it."""

    @staticmethod
    def drift(x, p, out):
        out[:] = 0.0


@pytest.mark.parametrize("kind", [Tug, Forgetful])
def test_mppi_plans_for_a_mass_of_ones_own_and_one_that_noise_cannot_move_is_refused(monkeypatch, kind):
    monkeypatch.setattr(systems, "_known", dict(systems._known))
    system = System(
        name=kind.__name__.lower(), dynamics=lambda settings: kind(b=settings.noise), steering=MassSteering.of,
        R=2.0 * np.eye(2), states=("x", "y", "vx", "vy"), defaults={"period": 0.05, "vertices": 60, "samples": 20},
    )  # fmt: skip
    given = {"plant": "sde", "method": "mppi" if kind is Tug else "pi-rrht"}
    mine = prepare("slit", robot="hover", system=system, given=given)
    if kind is Tug:
        assert np.isfinite(mine.driver().plan(mine.start).estimate.value)
        return
    with pytest.raises(OptionError, match=r"^Forgetful: its noise never reaches x, y; its drift must say how"):
        mine.controller(mine.grown_tree())
