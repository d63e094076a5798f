"""BARN: scores by the rules of the challenge, clocks that start late, worlds of the right size."""

import numpy as np
import pytest
from benchmarks import barn, dynabarn

from sim.mjcf import load

NEEDS_MOTIONS = pytest.mark.skipif(not dynabarn.levels(), reason="the worlds of DynaBARN are not here")
NEEDS_WORLDS = pytest.mark.skipif(not barn.worlds(), reason="the worlds of BARN are not here")


@pytest.mark.parametrize(
    ("outcome", "time", "points"),
    [("goal", 1.0, 0.5), ("goal", 12.0, 0.5), ("goal", 24.0, 0.25), ("goal", 48.0, 0.125), ("goal", 99.0, 0.125),
     ("collision", 12.0, 0.0), ("timeout", 100.0, 0.0), ("no path", np.nan, 0.0)],
)  # fmt: skip
def test_a_score_is_the_best_time_over_that_of_the_run_within_bounds(outcome, time, points):
    assert barn.score(outcome, time, 6.0) == pytest.approx(points)


def test_the_clock_starts_once_the_robot_has_moved():
    x = np.array([0.0, 0.05, -0.09, 0.11, 0.0])
    states = np.column_stack([barn.START[0] + x, np.full(5, 3.0), np.zeros(5)])
    assert barn.waited(states, 0.002) == pytest.approx(0.006)
    assert barn.waited(states[:3], 0.002) == pytest.approx(0.006)


def test_a_row_counts_ends_and_averages_times_of_arrivals_alone():
    ends = [("goal", 12.0, 0.5), ("goal", 14.0, 0.3), ("collision", 3.0, 0.0), ("no path", np.nan, 0.0)]
    found = [{"outcome": e, "time": t, "score": s, "why": e, "step_ms": [10.0, 30.0]} for e, t, s in ends]
    assert barn.row("7", found) == ["7", "4", "2", "1", "0", "1", "13.0", "0.2000", "20", "30", "collision"]
    assert barn.row("7", found[:2])[-1] == ""


@NEEDS_WORLDS
def test_a_world_has_its_cylinders_start_and_length(tmp_path):
    assert len(barn.worlds()) == 50
    path = tmp_path / "barn.xml"
    path.write_text(barn.world("0").text())
    loaded = load(path, robot="jackal", start=barn.START)
    scene = loaded.scene
    places = np.array([one.position[:2] for one in scene.obstacles])
    assert {float(one.size[0]) for one in scene.obstacles} == {0.075}
    np.testing.assert_allclose(places.min(axis=0), [0.075, 0.075])
    assert len(places) == 209
    np.testing.assert_allclose([*scene.lower, *scene.upper, *scene.start], [0.0, 0.0, 4.5, 14.5, *barn.START])
    np.testing.assert_allclose([*scene.goal.center, scene.goal.radius], [2.25, 13.0, 1.0])
    assert (barn.length("0"), barn.length("30")) == pytest.approx((13.5923, 11.8459), abs=1e-3)


@NEEDS_MOTIONS
def test_a_world_of_moving_cylinders_is_for_a_robot_of_its_own_size_and_has_a_level(tmp_path):
    assert sorted(dynabarn.levels().values()) == sorted(5 * dynabarn.LEVELS)
    path = tmp_path / "moving.xml"
    path.write_text(dynabarn.world("8"))
    scene = load(path, robot="jackal").scene
    assert (len(scene.movers), len(scene.obstacles)) == (9, 3)
    np.testing.assert_allclose([*scene.start[:2], *scene.goal.center, scene.goal.radius], [11, 0, -9, 0, 1])
    assert dynabarn.Run("8", 0, known=False).best == 10.0
