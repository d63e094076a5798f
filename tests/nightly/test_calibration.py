"""Random scenes are what they promise, and the table of `benchmark.py calibration` adds up."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks import calibration, calibration_car, calibration_table, contested, oblique_scene, scenes

from pirrht import FreeSpace
from sim.files import plain
from sim.mjcf import load
from sim.scenario import prepare

SEEDS = (3, 13)
OPTIONS = argparse.Namespace(
    part=None, scene=None, scenes=2, states=2, plans=3, first_seed=3, noises=[0.3], at=None, workers=1, png=None,
    json=None, near_goal=None,
)  # fmt: skip


@pytest.fixture(scope="module")
def spaces() -> dict[int, FreeSpace]:
    return {seed: FreeSpace.of(scenes.scene_of(seed)) for seed in SEEDS}


def test_a_seed_means_a_scene():
    assert scenes.random_scene(3) == scenes.random_scene(3)
    assert scenes.random_scene(3) != scenes.random_scene(4)


@pytest.mark.parametrize("seed", range(12))
def test_scenes_load_with_room_at_start_and_goal(seed, tmp_path):
    scene = load(scenes.write_scene(seed, tmp_path)).scene
    assert 2 <= len(scene.obstacles) <= 8
    assert 0.08 <= scene.robot_radius <= 0.25
    assert 0.15 <= scene.goal.radius <= 0.3
    space = FreeSpace.of(scene)
    assert min(space.clearance(scene.start), space.clearance(scene.goal.center)) > scenes.ROOM - 0.01
    assert np.hypot(*(scene.start[:2] - scene.goal.center)) > scenes.APART


def test_a_solid_is_set_as_far_from_another_as_is_asked():
    rng = np.random.default_rng(0)
    for _ in range(20):
        one, other = scenes._solid(rng), scenes._solid(rng)
        moved = other.beside(one, rng.uniform(0, 6), 0.3)
        gap = np.max(-one.shadow - np.roll(moved.shadow, len(scenes.ANGLES) // 2))
        assert gap == pytest.approx(0.3, abs=1e-6)


def test_states_are_free_and_a_third_each_is_near_and_far(spaces):
    for seed, space in spaces.items():
        states = scenes.random_states(space, 30, seed)
        assert np.array_equal(states, scenes.random_states(space, 30, seed))
        clearance = np.array([space.clearance(x) for x in states])
        assert np.all(clearance > 0.0)
        assert [np.sum((clearance >= a) & (clearance < b)) for a, b in scenes.STRATA] == [10, 10, 10]
        beyond = np.hypot(*(states - space.scene.goal.center).T) - space.scene.goal.radius
        assert np.all(beyond >= scenes.BESIDE)


def test_states_near_the_goal_are_free_and_as_near_as_is_asked(spaces):
    for seed, space in spaces.items():
        states = scenes.states_near_goal(space, 30, seed, 0.5)
        beyond = np.hypot(*(states - space.scene.goal.center).T) - space.scene.goal.radius
        assert np.all((beyond > 0.0) & (beyond < 0.5))
        assert np.all(np.array([space.clearance(x) for x in states]) > 0.0)


def plan(v: float, u: tuple[float, float], error: float = 0.1) -> dict:
    return {"v": v, "v_error": error, "u": u, "u_error": (error, error), "ess": 10.0, "samples": 100, "ms": 1.0}


def test_coverage_counts_plans_whose_truth_lies_within_what_they_claim():
    plans = [plan(1.05, (1.0, 0.0)), plan(1.15, (1.25, 0.0)), plan(1.25, (1.0, 0.15)), plan(1.35, (1.35, 0.0))]
    state = {"noise": 0.2, "room": 0.7, "v": 1.0, "u": (1.0, 0.0), "plans": plans, "without": 1, "finer": None}
    row, total = calibration_table.summaries([state])
    assert (row["from"], row["to"], total["to"]) == (0.5, 1.0, None)
    assert (row["v1"], row["v2"], row["v3"]) == (0.25, 0.5, 0.25)
    assert (row["ux1"], row["ux2"], row["uy1"], row["uy2"]) == (0.5, 0.5, 0.75, 1.0)
    assert (row["u2"], row["u3"]) == (0.5, 0.25)
    assert row["v_bias"] == pytest.approx(0.2)
    assert row["u_bias"] == pytest.approx(0.15)
    assert (row["ess"], row["v_bad"], row["u_bad"], row["without"]) == (0.1, 1, 1, 1)
    assert len(calibration_table.text_of(row)) == len(calibration_table.HEADER)


def test_the_table_has_coverage_by_room_and_a_picture(tmp_path: Path):
    OPTIONS.png = tmp_path / "coverage.png"
    header, rows, values = calibration.rows(OPTIONS)
    assert {"v in 1", "both in 2", "ESS"} <= set(header)
    assert all(len(row) == len(header) for row in rows)
    total = next(row for row in values["table"] if row["to"] is None)
    assert (total["states"], total["plans"] + total["without"]) == (4, 12)
    assert 0.0 < total["v2"] <= 1.0
    assert values["truth"][0]["v"] < 0.01
    json.dumps(plain(values))
    assert OPTIONS.png.stat().st_size > 10_000


def test_the_cars_bias_is_that_of_its_plans_less_a_million_samples_and_unclear_truth_does_not_count():
    said = [{"v": v, "v_error": 0.1, "ess": 50.0, "ms": 1.0} for v in (2.1, 2.15, 2.3)]
    clear = {"fine": {"v": 2.0, "v_error": 0.0, "ess": 1e4}, "coarse": {"v": 2.05, "v_error": 0.01, "ess": 1e4}}
    unclear = {"fine": {"v": 9.0, "v_error": 1.0, "ess": 3.0}, "coarse": {"v": 2.0, "v_error": 0.0, "ess": 3.0}}
    row = calibration_car.summary([{**truth, "plans": said, "without": 0} for truth in (clear, unclear)])
    assert (row["states"], row["unclear"], row["plans"]) == (2, 1, 3)
    assert row["bias"] == pytest.approx(0.55 / 3)
    assert row["steps"] == pytest.approx(0.05)
    assert row["v2"] == pytest.approx(2 / 3)
    assert len(calibration_car._text({"noise": 0.1, "scene": "all", **row})) == len(calibration_car.HEADER)


@pytest.mark.parametrize("seed", range(6))
def test_random_bodies_cross_the_straight_way_when_the_robot_would_come_by_and_leave_start_and_goal(seed):
    scenario = oblique_scene.oblique_scenario(seed, {})
    assert oblique_scene.oblique_scene(seed) == oblique_scene.oblique_scene(seed)
    scene, crowd = scenario.loaded.scene, scenario.space.moving
    start, goal = scene.start[:2], scene.goal.center
    last = max(float(mover.motion.rows[-1, 0]) for mover in scene.movers)
    assert last <= oblique_scene.LAST
    assert crowd.distance(start, 0.0) >= oblique_scene.CLEAR - 1e-6
    assert crowd.distance(goal, last) >= scene.goal.radius + oblique_scene.CLEAR - 1e-6
    way = goal - start
    for mover in scene.movers:
        times = np.linspace(0.0, last, 2000)
        places = np.array([mover.motion.pose(t)[:2] for t in times])
        aside = (places - start) @ np.array([-way[1], way[0]])
        met = np.flatnonzero(aside[1:] * aside[:-1] <= 0.0)
        when = np.hypot(*(places[met] - start).T)
        assert np.any(np.abs(times[met] - when) <= oblique_scene.AROUND + 0.01)


def test_shares_of_classes_are_apart_by_the_greatest_difference_of_any():
    said = contested.mean_of([{"0": 0.5, "1": 0.5}, {"0": 0.7, "other": 0.3}])
    assert contested.apart(said, {"0": 0.9, "2": 0.1}) == pytest.approx(0.3)


def test_pooled_shares_are_those_of_the_sums_of_psi_by_class():
    psi = np.array([[0.3, 0.1], [0.02, 0.18]])  # of two plans, by class
    state = {
        "shares": {"0": 0.5, "1": 0.5},
        "plans": [dict(zip("01", row / row.sum(), strict=True)) for row in psi],
        "log_psi": np.log(psi.sum(axis=1)).tolist(),
    }
    pooled = contested.pooled_of(state)
    assert [pooled["0"], pooled["1"]] == pytest.approx(psi.sum(axis=0) / psi.sum())


def test_errors_of_pooled_shares_are_those_of_their_spread():
    """Twenty plans, psi of two classes gamma distributed, 2000 times (seed 0): 31.7 % beyond one, within 4 points."""
    rng, off = np.random.default_rng(0), []
    for _ in range(2000):
        psi = rng.gamma(4.0, size=(20, 2))
        plans = [dict(zip("01", row / row.sum(), strict=True)) for row in psi]
        paths = rng.binomial(contested.PATHS, 0.5) / contested.PATHS
        state = {"shares": {"0": paths, "1": 1.0 - paths}, "plans": plans, "log_psi": np.log(psi.sum(axis=1)).tolist()}
        off.append(contested.in_errors(state))
    assert np.mean(np.array(off) > 1.0) == pytest.approx(0.317, abs=0.04)


def test_both_ways_contend_at_the_start_of_crossing_and_shares_there_are_those_of_the_grids_paths():
    """b = 0.3, seed 0: standard errors of 1 point for 2400 paths and about 2 for four plans."""
    scenario = prepare("crossing", given={"noise": 0.3, "vertices": 300})
    controller = scenario.controller(scenario.grown_tree())
    given = {"places": np.zeros((0, 2)), "seed": 0, "last": 4.5, "plans": 4, "most": 4}
    (one,) = contested.contested(scenario, scenario.truth(), controller, **given)
    assert (one["x"], one["t"]) == (scenario.start[:2].tolist(), 0.0)
    assert max(one["shares"].values()) < contested.TUNING.decided
    assert contested.apart(contested.pooled_of(one), one["shares"]) < 0.09
    assert contested.in_errors(one) < 4.0


def test_plans_are_made_until_a_share_is_known_to_a_point_or_there_are_enough():
    scenario = prepare("crossing", given={"noise": 0.3, "vertices": 300})
    controller = scenario.controller(scenario.grown_tree())
    given = {"places": np.zeros((0, 2)), "seed": 0, "last": 4.5, "plans": 4, "most": 60}
    (one,) = contested.contested(scenario, Halves(), controller, **given)
    made = len(one["plans"])
    assert made % 4 == 0
    assert 4 < made <= 60
    assert len(one["log_psi"]) == made


class Halves:
    """An exact law by which either way is as likely."""

    def shares(self, x, paths, *, t):
        return {"0": 0.5, "1": 0.5}


def test_where_one_way_has_all_the_weight_nothing_contends():
    scenario = prepare("closing_door", given={"noise": 0.05, "vertices": 300})
    controller = scenario.controller(scenario.grown_tree())
    late = np.array([[4.5, 2.5]])  # beyond the wall
    assert contested.contested(scenario, None, controller, late, 0, last=1.0, plans=2) == []  # no grid is asked
