"""`benchmark.py mass`: psi of a mass is the same whatever samples follow, and the table adds up."""

from __future__ import annotations

import argparse
import json
import sys
from functools import cache
from itertools import islice
from types import SimpleNamespace

import benchmark
import numpy as np
import pytest
from benchmarks import mass

from pirrht.control.controller import Controller
from sim.files import plain
from sim.mjcf.robot import read_robot
from sim.scenario import Scenario, prepare

START, ABOVE = (1.0, 2.5, 0.0, 0.0), (1.0, 3.5, 0.5, 0.8)
ACROSS = (4.9, 2.5, np.pi / 2.0)  # heads past the goal at (5.5, 2.5)


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


def test_another_classs_guide_leads_most_samples_of_the_third_kind():
    _, controller = slit()
    batches = mass.batches_at(controller, np.array(START))
    led, *held = batches["crossed"].proposals
    guided = [one for one in batches["guided"].proposals if one.lead.follows]
    cheapest = min(guided, key=lambda one: one.lead.guide.penalised)
    assert len(guided) > 1
    assert led.lead.follows
    assert led.name != cheapest.name
    assert not any(one.lead.follows for one in held)
    assert led.count / sum(batches["crossed"].counts) == pytest.approx(1.0 - mass.TAPES, abs=0.02)


def test_where_a_class_has_two_valleys_tapes_are_those_of_its_reference():
    """Across from the goal a rover may as well turn left as right: two guides of a class, one tape."""
    scenario = prepare("slit", robot="rover", given={"vertices": 500, "samples": 400, "threads": 2})
    controller = scenario.controller(scenario.grown_tree())
    x = np.array(ACROSS)
    batches = mass.batches_at(controller, x)
    led = [one for one in batches["guided"].proposals if one.lead.follows]
    assert len(led) > len({one.name for one in led})
    held = batches["tapes"].proposals
    assert len(held) == len({one.name for one in held}) == len(controller.tree.references(x))
    assert not any(one.lead.follows for one in held)


def test_psi_is_the_mean_of_weights_whatever_the_parts_that_they_are_drawn_in(monkeypatch):
    """Weights of 10 000 samples over 2000 nats, a tenth of them none; parts of 10 000 and of 1000."""
    log_weight = np.random.default_rng(4).uniform(-2000.0, -1990.0, 10_000)
    log_weight[:5000] -= 800.0
    log_weight[::10] = -np.inf
    w = np.exp(log_weight - log_weight.max())
    for part in (10_000, 1000):
        left = iter(log_weight.reshape(-1, part))
        integral = SimpleNamespace(rollout=lambda batch, seed: SimpleNamespace(log_weight=next(left)))  # noqa: B023
        batch = SimpleNamespace(counts=[3, 1], counting=lambda counts: None)
        monkeypatch.setattr(mass, "PART", part)
        said = mass.psi_of(integral, batch, 10_000, 1)
        assert said.samples == 10_000
        assert said.log_psi == pytest.approx(log_weight.max() + np.log(w.mean()), rel=1e-12)
        assert said.error == pytest.approx(w.std() / w.mean() / 100.0, rel=1e-9)
        assert said.ess == pytest.approx(w.sum() ** 2 / (w**2).sum(), rel=1e-9)


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


@pytest.mark.parametrize("robot", ["hover", "rover", "car"])
def test_random_scenes_have_room_for_what_collides_of_the_robot(robot: str):
    """Seeds 0 to 7; those of 2, 3 and 7 would else be too small for a car, that of 2 for the others."""
    own = read_robot(robot, None).radius
    found = [scenario.loaded.scene.robot_radius for scenario in islice(mass.scenarios(0, None, robot), 8)]
    assert min(found) >= own
