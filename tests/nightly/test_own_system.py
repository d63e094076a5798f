"""The systems of docs/own-robot.md, its boat and the examples, are short and go wherever the robots of the house go."""

import json
import re
import shutil
from pathlib import Path

import pytest
from commands import call, reported
from repository import ROOT
from thoroughly import thorough

PAGE = (ROOT / "docs" / "own-robot.md").read_text()
EXAMPLES = ROOT / "scripts" / "examples" / "systems"
SMALL = ("--vertices", "100", "--samples", "20")
BOAT = ("--robot", "boat.xml", "--system", "moor:BOAT")
WIND = ("--system", "wind:BALLOON")
TUG = ("--robot", "tug.xml", "--system", "tug:TUG")
SCOOTER = ("--robot", "unicycle", "--system", "scooter:SCOOTER")
ALL = [BOAT, *(thorough(words, id=words[-1].partition(":")[0]) for words in (WIND, TUG, SCOOTER))]  # 30 s of kernels


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the examples, with the boat's hull and a module of its system."""
    folder = Path(shutil.copytree(EXAMPLES, tmp_path_factory.mktemp("own") / "examples"))
    system = "\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.S)[::2])  # the balloon, and the boat that drifts so
    hull = next(text for text in re.findall(r"```xml\n(.*?)```", PAGE, re.S) if 'model="boat"' in text)
    (folder / "boat.xml").write_text(hull)
    (folder / "moor.py").write_text(system.replace("from balloon import Balloon\n", ""))
    return folder


@pytest.mark.thorough
def test_a_boat_is_swept_in_worker_processes_and_the_dataset_knows_its_system(folder):
    words = (*SMALL, "--max-time", "0.03", "--seeds", "0:2", "--jobs", "2", "-o", "runs")
    assert [(row["outcome"], row["error"]) for row in reported(folder, "sweep", "slit", *BOAT, *words)] == [
        ("timeout", None)
    ] * 2
    assert json.loads((folder / "runs" / "manifest.json").read_text())["settings"]["system"] == "moor:BOAT"
    told = call(folder, "-m", "sim.cli", "sweep", "slit", "--robot", "boat.xml", *words, status=2)
    assert "was made with --system moor:BOAT and this sweep is without --system" in told


@pytest.mark.thorough
def test_a_boat_arrives(folder):
    assert reported(folder, "run", "slit", *BOAT, "--vertices", "600", "--seed", "1")["outcome"] == "goal"


@pytest.mark.parametrize(
    ("line", "wrong", "words"),
    [
        ("= p[0], p[1]", "= p[0], q[0]", "drift(x, p, out) fails at x = [0.0, 0.0] with an out of (2,) (NameError"),
        ("= p[0], p[1]", "= p[0], np.nan", "drift(x, p, out) writes [0.15, nan]"),
        ("return rng.uniform(", "return sea.uniform(", "in sample: NameError: name 'sea' is not defined; fix it"),
    ],
)
def test_what_fails_in_a_boats_own_code_is_told_in_one_line(folder, line, wrong, words):
    text = (folder / "moor.py").read_text()
    assert line in text
    (folder / "leak.py").write_text(text.replace(line, wrong))
    assert words in call(
        folder, "-m", "sim.cli", "plan", "slit", *[word.replace("moor:", "leak:") for word in BOAT], *SMALL, status=2
    )


@pytest.mark.parametrize("words", ALL)
def test_a_system_is_planned_for_in_three_classes_drives_and_is_recorded(folder, words):
    found = reported(folder, "plan", "slit", *words, "--vertices", "300")
    assert sorted(one["id"] for one in found["classes"]) == ["-1,0", "0,0", "0,1"]
    found = reported(folder, "run", "slit", *words, *SMALL, "--max-time", "0.1", "--record", "own.rrd", status=1)
    assert found["outcome"] == "timeout"
    assert (folder / "own.rrd").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "at"), [thorough(WIND, ("1", "2.5"), id="wind"), thorough(TUG, ("1", "2.5", "0", "0"), id="tug")]
)
def test_samples_of_an_example_count(folder, words, at):
    """More than 1 of 100 are effective, where a guide that knew no wind left 1 of 600."""
    found = reported(folder, "estimate", "slit", *words, "--vertices", "300", "--at", *at, "--samples", "1000")
    (ess,) = found["ess"]
    assert ess > 0.01 * 3 * 1000
