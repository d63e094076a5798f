"""`benchmark.py mass`: psi of a mass is the same whatever samples follow, and the table adds up."""

from __future__ import annotations

import argparse
import json
import sys
from functools import cache

import benchmark
import numpy as np
import pytest
from benchmarks import mass

from pirrht.control.controller import Controller
from sim.files import plain
from sim.scenario import Scenario, prepare

START, ABOVE = (1.0, 2.5, 0.0, 0.0), (1.0, 3.5, 0.5, 0.8)


@cache
def slit() -> tuple[Scenario, Controller]:
    """A mass in `slit`, and who plans for it."""
    scenario = prepare("slit", robot="hover", given={"vertices": 1000, "threads": 1})
    controller = scenario.controller(scenario.grown_tree())
    assert isinstance(controller, Controller)
    return scenario, controller


@pytest.mark.parametrize("x", [START, ABOVE], ids=["start", "above"])
def test_psi_of_a_mass_is_the_same_from_three_guides(x):
    """Guides of all classes, all tapes, and another class's guide beside tapes; 100 000 samples each, seeds 1 to 3."""
    _, controller = slit()
    batches = mass.batches_at(controller, np.array(x))
    assert len(batches["guided"].proposals) > 1
    said = [mass.psi_of(controller.path_integral, batches[kind], 100_000, k) for k, kind in enumerate(mass.KINDS, 1)]
    assert all(one.ess > 100.0 for one in said)
    assert said[0].ess > 2.5 * max(said[1].ess, said[2].ess)
    for i, one in enumerate(said):
        for other in said[:i]:
            assert abs(one.log_psi - other.log_psi) < 4.0 * np.hypot(one.error, other.error)


@pytest.mark.thorough
def test_the_table_has_a_row_per_state_and_counts_those_within_a_percent():
    options = argparse.Namespace(part=None, states=6, samples=2000, plans=2, first_seed=3, noises=None, robot=None)
    header, rows, values = mass.rows(options)
    assert len(rows) == 7
    assert all(len(row) == len(header) for row in rows)
    assert [row[0] for row in rows] == ["slit"] * 5 + ["random3", "all 6"]
    clear = sum(one["claims_enough"] for one in values["states"])
    assert rows[-1][6].endswith(f" of {clear} within 1 %")
    assert all(one["speed"] <= np.sqrt(2.0 * mass.BRAKE * one["clearance"]) for one in values["states"])
    json.dumps(plain(values))


def test_a_benchmark_prints_its_table_and_writes_it(tmp_path, monkeypatch, capsys):
    """The command itself: two states on the line."""
    words = ["mass", "--part", "line", "--states", "2", "--samples", "500", "--noises", "0.3"]
    monkeypatch.setattr(sys, "argv", ["benchmark.py", *words, "--json", str(tmp_path / "line.json")])
    assert benchmark.main() == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("b ")
    assert len(lines) == 5
    found = json.loads((tmp_path / "line.json").read_text())
    assert all(abs(one["share"]) < 0.01 for one in found)


def test_a_benchmark_names_the_parts_that_there_are(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["benchmark.py", "mass", "--part", "plane"])
    with pytest.raises(SystemExit):
        benchmark.main()
    assert "`mass` has no part 'plane'; it has line" in capsys.readouterr().err
