"""Random scenes are what they promise, and the table of `benchmark.py calibration` adds up."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks import calibration, calibration_table, contested, scenes

from pirrht import FreeSpace
from sim.files import plain

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


def test_states_are_free_and_a_third_each_is_near_and_far(spaces):
    for seed, space in spaces.items():
        states = scenes.random_states(space, 30, seed)
        assert np.array_equal(states, scenes.random_states(space, 30, seed))
        clearance = np.array([space.clearance(x) for x in states])
        assert np.all(clearance > 0.0)
        assert [np.sum((clearance >= a) & (clearance < b)) for a, b in scenes.STRATA] == [10, 10, 10]
        beyond = np.hypot(*(states - space.scene.goal.center).T) - space.scene.goal.radius
        assert np.all(beyond >= scenes.BESIDE)


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
