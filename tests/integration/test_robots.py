"""Commands for a unicycle and among moving obstacles; tests/nightly has the other robots."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sim.cli import main

SMALL = ["--vertices", "200", "--samples", "20"]


@pytest.mark.parametrize(("scene", "robot"), [("clutter", "unicycle"), ("crossing", "puck")])
def test_plan_run_and_estimate_report_the_same_classes(scene, robot, tmp_path: Path):
    words = {
        "plan": [],
        "run": ["--max-time", "0.2", "--record", str(tmp_path / "run.rrd")],
        "estimate": ["--at", "1", "2.5"],
    }
    found = {}
    for command, more in words.items():
        file = tmp_path / f"{command}.json"
        given = [scene, *(SMALL if command != "plan" else SMALL[:2])]
        assert main([command, *given, *more, "--json", str(file)]) == (command == "run")
        found[command] = json.loads(file.read_text())
    assert found["plan"]["robot"] == found["run"]["robot"] == robot
    assert (found["run"]["outcome"], found["run"]["fallbacks"]) == ("timeout", 0)
    assert [one["id"] for one in found["plan"]["classes"]] == [one["id"] for one in found["run"]["classes"]]
    assert found["estimate"]["value"][0] > 0.0
    assert (tmp_path / "run.rrd").stat().st_size > 1000


def test_warm_compiles_what_commands_of_a_robot_need(capsys):
    assert main(["warm", "puck"]) == 0
    assert main(["warm", "tank"]) == 2
    assert "tank" in capsys.readouterr().err
