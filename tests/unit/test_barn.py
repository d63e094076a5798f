"""The table of BARN: rows, and worlds of the right size."""

import numpy as np
import pytest
from benchmarks import barn, dynabarn, effective

from sim.barn import FASTEST, START, grown, length
from sim.mjcf import load

NEEDS_MOTIONS = pytest.mark.skipif(not dynabarn.levels(), reason="the worlds of DynaBARN are not here")
NEEDS_WORLDS = pytest.mark.skipif(not barn.worlds(), reason="the worlds of BARN are not here")


def test_a_row_counts_ends_and_averages_times_of_arrivals_alone():
    ends = [("goal", 12.0, 0.5), ("goal", 14.0, 0.3), ("collision", 3.0, 0.0), ("no path", np.nan, 0.0)]
    found = [
        {"outcome": e, "time": t, "score": s, "why": e, "step_ms": [10.0, 30.0], "map_ms": [5.0]} for e, t, s in ends
    ]
    assert barn.row("7", found) == ["7", "4", "2", "1", "0", "1", "13.0", "0.2000", "20", "30", "5", "5", "collision"]
    assert barn.row("7", found[:2])[-1] == ""


@NEEDS_WORLDS
def test_a_world_has_its_cylinders_start_and_length(tmp_path):
    assert len(barn.worlds()) == 50
    path = tmp_path / "barn.xml"
    path.write_text(barn.world("0"))
    loaded = load(path, robot="jackal", start=START)
    scene = loaded.scene
    assert loaded.meant == "jackal"
    places = np.array([one.position[:2] for one in scene.obstacles])
    assert {float(one.size[0]) for one in scene.obstacles} == {0.075}
    np.testing.assert_allclose(places.min(axis=0), [0.075, 0.075])
    assert len(places) == 209
    np.testing.assert_allclose([*scene.lower, *scene.upper, *scene.start], [0.0, 0.0, 4.5, 14.5, *START])
    np.testing.assert_allclose([*scene.goal.center, scene.goal.radius], [2.25, 13.0, 1.0])
    assert (barn.length("0"), barn.length("30")) == pytest.approx((13.5923, 11.8459), abs=1e-3)


def test_a_grown_world_needs_no_folder_and_is_scored_by_its_own_length():
    run = barn.Run(f"{barn.GROWN}3", 0)
    assert len(run.scenario().loaded.scene.obstacles) == len(grown(3))
    np.testing.assert_array_equal(barn.posts_of(run.world), grown(3))
    assert run.best == length(grown(3)) / FASTEST


@NEEDS_WORLDS
def test_a_narrower_goal_and_numbers_for_other_robots_are_options_of_the_same_world():
    drive = effective.Drive("puck", "BARN", "0", 0).scenario()
    s, scene = drive.settings, drive.loaded.scene
    assert (s.noise, s.vertices, s.limit, s.samples, s.period, s.classes) == (0.08, 2000, 0.8, 200, 0.02, 8)
    np.testing.assert_allclose([*scene.upper, *scene.goal.center, scene.goal.radius], [4.5, 14.0, 2.25, 13.0, 0.9])
    assert len(scene.obstacles) == 209


@NEEDS_MOTIONS
def test_a_world_of_moving_cylinders_is_for_a_robot_of_its_own_size_and_has_a_level(tmp_path):
    assert sorted(dynabarn.levels().values()) == sorted(5 * dynabarn.LEVELS)
    path = tmp_path / "moving.xml"
    path.write_text(dynabarn.world("8"))
    scene = load(path, robot="jackal").scene
    assert (len(scene.movers), len(scene.obstacles)) == (9, 3)
    np.testing.assert_allclose([*scene.start[:2], *scene.goal.center, scene.goal.radius], [11, 0, -9, 0, 1])
    assert dynabarn.Run("8", 0, known=False).best == 10.0


@NEEDS_WORLDS
def test_without_its_map_a_world_is_driven_with_a_lidar_and_faster():
    sensed = barn.Run("0", 3, known=False, method="mppi").scenario()
    s = sensed.settings
    assert (s.sense, s.speed, sensed.margin, s.seed, s.method) == ("lidar", 1.4, 0.03, 3, "mppi")
    assert (s.classes, s.max_time) == (8, 100.0)
    assert not sensed.space.scene.obstacles
    assert len(sensed.loaded.scene.obstacles) == 209
