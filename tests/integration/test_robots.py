"""Commands for a unicycle and among moving obstacles; tests/nightly has the other robots."""

import json
from pathlib import Path

import pytest

from sim.cli import main


@pytest.mark.parametrize(("scene", "robot"), [("clutter", "unicycle"), ("crossing", "puck")])
def test_plan_run_and_estimate_report_the_same_classes(scene, robot, tmp_path: Path):
    few, found, record = ["--samples", "20"], {}, tmp_path / "run.rrd"
    words = {"plan": [], "run": [*few, "--max-time", "0.2", "--record", str(record)],
             "estimate": [*few, "--at", "1", "2.5"]}  # fmt: skip
    for command, more in words.items():
        file = tmp_path / f"{command}.json"
        assert main([command, scene, "--vertices", "200", *more, "--json", str(file)]) == (command == "run")
        found[command] = json.loads(file.read_text())
    assert found["plan"]["robot"] == found["run"]["robot"] == robot
    assert (found["run"]["outcome"], found["run"]["fallbacks"]) == ("timeout", 0)
    assert [one["id"] for one in found["plan"]["classes"]] == [one["id"] for one in found["run"]["classes"]]
    assert found["estimate"]["value"][0] > 0.0
    assert record.stat().st_size > 1000


def test_warm_compiles_kernels_of_a_robot(capsys):
    assert main(["warm", "puck"]) == 0
    assert main(["warm", "tank"]) == 2
    assert "tank" in capsys.readouterr().err
