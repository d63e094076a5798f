"""The scripts of `scripts/examples` are the manual: ten of them, short, and each runs."""

from __future__ import annotations

import runpy
import sys

import pytest
from repository import ROOT

EXAMPLES = sorted((ROOT / "scripts" / "examples").glob("*.py"))
SHOWN = {  # a line of what an example prints
    "01_first_plan": "b = 0.3: v = 12.",
    "02_psi_on_the_floor": "GGG",
    "03_mppi_comparison": "pi-rrht  reached the goal in 3 of 3 runs",
    "04_own_scene": "exit status 0",
    "05_own_robot": "class 0,0",
    "06_own_controller": "b = 0.1: 10 of 10 reach the goal",
    "07_moving_obstacles": "2 s: the disc is predicted at (3.25, 2.29)",
    "08_sweep": "6 of 6 runs asked for are there",
    "09_occupancy_grid": "classes 1,0, 0,-1",
    "10_custom_proposal": "within",
}


def test_there_are_ten_examples_of_at_most_eighty_lines():
    assert [file.stem for file in EXAMPLES] == [*SHOWN]
    assert all(len(file.read_text().splitlines()) <= 80 for file in EXAMPLES)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_runs(file, tmp_path, monkeypatch, capsys):
    if file.stem == "06_own_controller":
        pytest.importorskip("gymnasium")
    monkeypatch.setattr(sys, "argv", [str(file), str(tmp_path)])
    runpy.run_path(str(file), run_name="__main__")
    assert SHOWN[file.stem] in capsys.readouterr().out
