"""Robots are not hit, first plans are no guesses, and systems of one's own, the optimal law and margins are driven."""

import numpy as np
import pytest
from doors import door
from mjcf_samples import ON_GROUND
from tug import Tug

from pirrht import OptionError, Outcome
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
    assert "this robot cannot stop and takes the path that stays free longest" in said.out + said.err


@pytest.mark.parametrize("name", scene_names())
def test_the_first_plan_of_every_scene_rests_on_enough_effective_samples(name):
    for seed in range(3):
        scenario = prepare(name, given={"seed": seed})
        enough = 10.0 if name == "windy_forest" else ENOUGH  # a drone among trees: 11 to 76
        assert scenario.driver(scenario.grown_tree()).plan(scenario.start).estimate.ess >= enough, seed


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


def test_the_optimal_law_reaches_the_goal_in_nearly_all_runs_and_takes_the_detour(slit):
    """24 drives of the equation itself, seeds 0 to 23: 23.5 (0.7) should arrive, 1.1 (1.0) of them through the slit."""
    noisy = slit.with_settings(noise=0.3, method="optimal")
    truth, elsewhere = noisy.truth(), np.array([2.0, 2.0])
    plan = noisy.optimal(truth).plan(noisy.start)
    assert (plan.estimate, plan.fallback, plan.favourite) == (None, None, None)
    assert plan.at(elsewhere, 0.004) == pytest.approx(truth.control(elsewhere))
    goals, slits = 0, 0
    for seed in range(24):
        scenario = noisy.with_settings(seed=seed, plant="sde")
        *_, last = scenario.drive(scenario.plant(), scenario.optimal(truth))
        goals += last.outcome is Outcome.GOAL
        slits += last.metrics.executed_class == "0,0"
    assert goals >= 20
    assert slits <= 6


@pytest.mark.parametrize("seed", [0, 1])
def test_gaps_are_wide_enough_for_the_noise_the_cheapest_way_squeezes_through_two_and_ten_classes_are_near(seed):
    """The obstacle course is as hard and as varied as it claims; narrow is less than four robot radii."""
    scenario = prepare("clutter", given={"seed": seed, "classes": 16})
    tree = scenario.grown_tree()
    references, passages = scenario.references(tree), tree.passages
    assert passages.width.min() > 0.5
    assert np.count_nonzero(passages.width[passages.crossed(references[0].trajectory.points)] < 4 * 0.15) >= 2
    costs = np.array([reference.cost for reference in references])
    assert len(costs) >= 10
    assert costs[9] <= 1.3 * costs[0]


# -- inside the margin -------------------------------------------------------------------------------------------

COVERED = """<mujoco><worldbody>
<geom name="wall" type="box" size="1.5 0.1 0.3" pos="1.5 0.4 0.3" euler="0 0 10"/>
<geom name="post" type="cylinder" size="0.3 0.3" pos="3 1.8 0.3"/>
<site name="workspace" type="box" size="2.5 1.75 0.5" pos="2.5 1.75 0.5"/>
<site name="start" pos="0.75 0.58 0" euler="0 0 30"/><site name="goal" type="cylinder" size="0.45 0.01" pos="3 2 0"/>
</worldbody></mujoco>"""


def test_an_estimate_inside_the_margin_is_the_exact_value(tmp_path):
    (tmp_path / "room.xml").write_text(COVERED)
    scenario = prepare(tmp_path / "room.xml", margin=0.15, given={"noise": 0.1, "samples": 2000})
    assert len(scenario.space.scene.waivers) == 2  # at the start, and in the free part of the goal
    estimate = scenario.controller(scenario.grown_tree()).plan(scenario.start).estimate
    assert abs(estimate.value - float(scenario.truth().value(scenario.start))) < 4.0 * estimate.value_error + 0.005


@pytest.mark.parametrize("robot", ON_GROUND)
def test_every_robot_drives_out_of_the_margin_into_a_partly_covered_goal(tmp_path, robot):
    room = COVERED.replace("0.75 0.58", "0.75 0.72") if robot == "jackal" else COVERED  # it is longer
    (tmp_path / "room.xml").write_text(room)
    scenario = prepare(tmp_path / "room.xml", robot=robot, margin=0.15, given={"max_time": 15.0})
    frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    assert frames[-1].outcome is Outcome.GOAL
