"""BARN: scores by the rules of the challenge, clocks that start late, worlds of our own with a way through."""

import numpy as np
import pytest
from thoroughly import first

from pirrht import OptionError
from sim import barn


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


def test_the_shortest_way_is_around_what_it_does_not_fit_through():
    wall = np.column_stack([np.arange(-4.425, -0.8, 0.15), np.full(25, 6.0)])
    assert barn.length(np.empty((0, 2))) == pytest.approx(10.0, abs=0.16)
    assert barn.length(wall) == pytest.approx(np.hypot(1.8, 3.0) + np.hypot(1.8, 7.0), rel=0.06)
    closed = np.vstack([wall, np.add(wall, (3.0, 0.0))])
    assert barn.length(closed) == np.inf
    assert barn.length(np.add(closed, (50.0, 0.0))) == pytest.approx(10.0, abs=0.16)  # cylinders elsewhere do not count


@pytest.mark.parametrize("seed", first(range(50), 2))
def test_grown_worlds_depend_on_their_seed_alone_and_leave_a_way(seed: int):
    posts = barn.grown(seed)
    np.testing.assert_array_equal(posts, barn.grown(seed))
    assert len(posts) != len(barn.grown(seed + 1)) or np.any(posts != barn.grown(seed + 1))
    assert 10.0 < barn.length(posts, barn.CLEAR) < 20.0
    inner = posts[(np.abs(posts[:, 0] + 2.25) < 2.1) & (posts[:, 1] > 0.2)]
    assert 10 < len(inner) < 200
    assert inner[:, 1].min() > 5.1


@pytest.mark.parametrize(("least", "rows"), [(1, "##.# ###. .#.."), (2, "##.. ###. .#.."), (3, ".#.. ###. ....")])
def test_neighbours_fill_a_cell_and_too_few_empty_it(least: int, rows: str):
    field = np.array([[*row] for row in ["##.#", "#.#.", ".#.."]]) == "#"
    full = np.array([[*row] for row in rows.split()]) == "#"
    np.testing.assert_array_equal(barn.smoothed(field, least), full)


@pytest.mark.parametrize("content", [None, "[1, 2]", "nothing"])
def test_what_is_no_file_of_worlds_is_refused_by_name(tmp_path, content):
    file = tmp_path / "worlds.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(OptionError, match=r"worlds.json: no worlds of BARN or their lengths .*; write JSON by name"):
        barn.read(file)
