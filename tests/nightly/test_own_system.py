"""The boat of docs/own-robot.md, registered in ten lines, goes wherever the robots of the house go."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from commands import told
from repository import ROOT, environment

PAGE = (ROOT / "docs" / "own-robot.md").read_text()
CLASSES = next(text for text in re.findall(r"```python\n(.*?)```", PAGE, re.S) if "class Boat" in text)
HULL = next(text for text in re.findall(r"```xml\n(.*?)```", PAGE, re.S) if 'model="boat"' in text)
SYSTEM = """
from sim.systems import System

BOAT = System(
    name="boat",
    dynamics=lambda settings: Boat(),
    steering=lambda problem: GroundTrack(),
    R=2 * np.eye(2),
    heeds=(),
)
"""
BOAT = ("slit", "--robot", "boat.xml", "--system", "moor:BOAT", "--vertices", "100", "--samples", "20")


@pytest.fixture(scope="module")
def moor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the boat's hull, and a module with its classes and its system."""
    folder = tmp_path_factory.mktemp("moor")
    (folder / "boat.xml").write_text(HULL)
    (folder / "moor.py").write_text(CLASSES[: CLASSES.index("loaded = load(")] + SYSTEM)
    return folder


def test_the_system_takes_about_ten_lines():
    assert len([line for line in SYSTEM.splitlines() if line.strip()]) <= 10


def test_a_boat_is_planned_for(moor):
    found = told(moor, "plan", *BOAT)
    assert found["robot"] == "boat"
    assert sorted(one["id"] for one in found["classes"]) == ["-1,0", "0,0", "0,1"]


def test_a_boat_drives_and_is_recorded(moor):
    found = told(moor, "run", *BOAT, "--max-time", "0.1", "--record", "boat.rrd", status=1)
    assert (found["outcome"], found["steps"]) == ("timeout", 10)
    assert found["lambda"] == pytest.approx(2 * 0.1**2)
    assert (moor / "boat.rrd").stat().st_size > 10_000


@pytest.mark.thorough
def test_a_boat_is_swept_in_worker_processes_and_the_dataset_knows_its_system(moor):
    words = ("--max-time", "0.03", "--seeds", "0:2", "--jobs", "2", "-o", "runs")
    rows = told(moor, "sweep", *BOAT, *words)
    assert [row["outcome"] for row in rows] == ["timeout"] * 2
    assert [row["error"] for row in rows] == [None] * 2
    assert json.loads((moor / "runs" / "manifest.json").read_text())["settings"]["system"] == "moor:BOAT"
    words = [word for word in ("sweep", *BOAT, *words) if word not in ("--system", "moor:BOAT")]
    done = subprocess.run(
        [sys.executable, "-m", "sim.cli", *words], cwd=moor, capture_output=True, text=True, env=environment()
    )
    assert done.returncode == 2
    assert "was made with --system moor:BOAT and this sweep is without --system" in done.stderr


@pytest.mark.parametrize(
    ("line", "wrong", "words"),
    [
        ("= p[0], p[1]", "= p[0], q[0]", "drift(x, p, out) fails at x = [0.0, 0.0] (NameError"),
        ("= p[0], p[1]", "= p[0], np.nan", "drift(x, p, out) writes [0.0, nan]"),
        ("return rng.uniform(", "return sea.uniform(", "in sample: NameError: name 'sea' is not defined; fix it"),
    ],
)
def test_what_fails_in_a_boats_own_code_is_told_in_one_line(moor, line, wrong, words):
    text = (moor / "moor.py").read_text()
    assert line in text
    (moor / "leak.py").write_text(text.replace(line, wrong))
    args = [word.replace("moor:", "leak:") for word in BOAT]
    done = subprocess.run(
        [sys.executable, "-m", "sim.cli", "plan", *args],
        cwd=moor, env=environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
