"""Scripts: tables of benchmarks add up and compare like with like, random scenes are what they promise."""

import argparse
import json
import re
import sys

import benchmark
import numpy as np
import pytest
from benchmarks import calibration, calibration_table, contested, mass, peers, rollouts, scenes, speed
from thoroughly import thorough

from pirrht import FreeSpace
from sim.files import plain
from sim.scenario import prepare


def test_missing_peers_are_told_and_ours_is_timed_all_the_same(monkeypatch):
    monkeypatch.setattr(peers, "missing", lambda module: True)
    monkeypatch.setattr(rollouts, "NUMBERS", (600,))
    monkeypatch.setattr(rollouts, "REPEATS", (1,))
    table, values = rollouts.rows(argparse.Namespace(scene=None, drive=0.1, part=None))
    assert [row[-1] for row in table].count(peers.HINT) == len(rollouts.PEERS)
    assert values["600"][rollouts.OURS]["steps_per_second"] > 0
    assert values["600"][rollouts.DEFAULT]["ess"] > 3.0 * values["600"][rollouts.OURS]["ess"]
    assert {len(row) for row in table} == {len(speed.HEADER)}
    assert values["same_on_1_and_2_threads"]


@pytest.mark.parametrize("name", rollouts.PEERS)
def test_a_peer_finds_the_answer_that_we_find(name):
    module, build = rollouts.PEERS[name]
    pytest.importorskip(module)
    setting = rollouts.Setting("slit")
    work = build(setting.task(), 6000)
    found = rollouts._peer(setting, work, 6000)
    assert found["off"] < 4.0
    assert 1.0 <= work(0).ess < 0.05 * 6000
    assert found.get("log_psi_off", 0.0) < 4.0


@pytest.mark.parametrize("seed", [3, 13])
def test_a_seed_means_a_scene_whose_states_are_free_and_a_third_each_is_near_and_far(seed):
    assert scenes.random_scene(seed) == scenes.random_scene(seed) != scenes.random_scene(seed + 1)
    space = FreeSpace.of(scenes.scene_of(seed))
    states = scenes.random_states(space, 30, seed)
    assert np.array_equal(states, scenes.random_states(space, 30, seed))
    clearance = np.array([space.clearance(x) for x in states])
    assert np.all(clearance > 0.0)
    assert [np.sum((clearance >= a) & (clearance < b)) for a, b in scenes.STRATA] == [10, 10, 10]
    assert np.all((np.hypot(*(states - space.scene.goal.center).T) - space.scene.goal.radius) >= scenes.BESIDE)


def plan(v: float, u: tuple[float, float], error: float = 0.1) -> dict:
    return {"v": v, "v_error": error, "u": u, "u_error": (error, error), "ess": 10.0, "samples": 100, "ms": 1.0}


def test_coverage_counts_plans_whose_truth_lies_within_what_they_claim():
    plans = [plan(1.05, (1.0, 0.0)), plan(1.15, (1.25, 0.0)), plan(1.25, (1.0, 0.15)), plan(1.35, (1.35, 0.0))]
    state = {"noise": 0.2, "room": 0.7, "v": 1.0, "u": (1.0, 0.0), "plans": plans, "without": 1, "finer": None}
    row, total = calibration_table.summaries([state])
    assert (row["from"], row["to"], total["to"]) == (0.5, 1.0, None)
    shares = {"v1": 0.25, "v2": 0.5, "v3": 0.25, "ux1": 0.5, "ux2": 0.5, "uy1": 0.75, "uy2": 1.0, "u2": 0.5, "u3": 0.25}
    others = {"v_bias": 0.2, "u_bias": 0.15, "ess": 0.1, "v_bad": 1, "u_bad": 1, "without": 1}
    assert {name: row[name] for name in shares | others} == pytest.approx(shares | others)
    assert len(calibration_table.text_of(row)) == len(calibration_table.HEADER)


def test_the_table_has_coverage_by_room_and_a_picture(tmp_path):
    png = tmp_path / "coverage.png"
    options = argparse.Namespace(
        part=None, scene=None, scenes=2, states=2, plans=3, first_seed=3, noises=[0.3], at=None, workers=1,
        png=png, json=None, near_goal=None,
    )  # fmt: skip
    header, rows, values = calibration.rows(options)
    assert {"v in 1", "both in 2", "ESS"} <= set(header)
    assert all(len(row) == len(header) for row in rows)
    total = next(row for row in values["table"] if row["to"] is None)
    assert (total["states"], total["plans"] + total["without"]) == (4, 12)
    assert 0.0 < total["v2"] <= 1.0
    assert values["truth"][0]["v"] < 0.01
    json.dumps(plain(values))
    assert png.stat().st_size > 10_000


def test_pooled_shares_of_classes_are_those_of_the_sums_of_psi():
    psi = np.array([[0.3, 0.1], [0.02, 0.18]])  # of two plans, by class
    plans = [dict(zip("01", row / row.sum(), strict=True)) for row in psi]
    pooled = contested.pooled_of({"plans": plans, "log_psi": np.log(psi.sum(axis=1)).tolist()})
    assert [pooled["0"], pooled["1"]] == pytest.approx(psi.sum(axis=0) / psi.sum())
    said = contested.mean_of([{"0": 0.5, "1": 0.5}, {"0": 0.7, "other": 0.3}])
    assert contested.apart(said, {"0": 0.9, "2": 0.1}) == pytest.approx(0.3)  # the greatest difference of any


@pytest.mark.parametrize("x", [(1.0, 2.5, 0.0, 0.0), (1.0, 3.5, 0.5, 0.8)], ids=["start", "above"])
def test_psi_of_a_mass_is_the_same_from_three_guides(x):
    """Guides of all classes, all tapes, and another class's guide with tapes; 100 000 samples each, seeds 1 to 3."""
    scenario = prepare("slit", robot="hover", given={"vertices": 1000, "threads": 1})
    controller = scenario.controller(scenario.grown_tree())
    batches = mass.batches_at(controller, np.array(x))
    assert len(batches["guided"].proposals) > 1
    said = [mass.psi_of(controller.path_integral, batches[kind], 100_000, k) for k, kind in enumerate(mass.KINDS, 1)]
    assert all(one.ess > 100.0 for one in said)
    assert said[0].ess > 2.5 * max(said[1].ess, said[2].ess)
    for i, one in enumerate(said):
        for other in said[:i]:
            assert abs(one.log_psi - other.log_psi) < 4.0 * np.hypot(one.error, other.error)


def test_a_benchmark_prints_its_table_and_writes_it_and_names_the_parts_that_there_are(tmp_path, monkeypatch, capsys):
    """Two states on the line."""
    words = ["mass", "--part", "line", "--states", "2", "--samples", "500", "--noises", "0.3"]
    monkeypatch.setattr(sys, "argv", ["benchmark.py", *words, "--json", str(tmp_path / "line.json")])
    assert benchmark.main() == 0
    lines = capsys.readouterr().out.splitlines()
    assert (lines[0][:2], len(lines)) == ("b ", 5)
    assert all(abs(one["share"]) < 0.01 for one in json.loads((tmp_path / "line.json").read_text()))
    monkeypatch.setattr(sys, "argv", ["benchmark.py", "mass", "--part", "plane"])
    with pytest.raises(SystemExit):
        benchmark.main()
    assert "`mass` has no part 'plane'; it has line" in capsys.readouterr().err


@pytest.mark.parametrize("seed", [0, thorough(1)])
def test_the_robot_replans_to_another_class_when_a_crate_appears(seed, tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    import crate

    monkeypatch.setattr("sys.argv", ["crate.py", "--seed", str(seed), "--png", str(tmp_path / "crate.png")])
    assert crate.main() == 0
    assert re.match(r"from class 0,0 to (1,0|0,-1), driven (1,0|0,-1)", capsys.readouterr().out)
    assert (tmp_path / "crate.png").stat().st_size > 10_000
