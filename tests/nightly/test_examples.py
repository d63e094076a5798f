"""The examples of docs/own-robot.md are short, and go wherever the robots of the house go."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from commands import told
from repository import ROOT
from thoroughly import thorough

EXAMPLES = ROOT / "scripts" / "examples" / "systems"
DOCS = (ROOT / "docs" / "own-robot.md").read_text()
WIND = ("--system", "wind:BALLOON")
TUG = ("--robot", "tug.xml", "--system", "tug:TUG")
SCOOTER = ("--robot", "unicycle", "--system", "scooter:SCOOTER")
ALL = [
    thorough(words, id=words[-1].partition(":")[0]) for words in (WIND, TUG, SCOOTER)
]  # half a minute of kernels each
SMALL = ("--vertices", "100", "--samples", "20")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the examples, since results are written beside them."""
    return Path(shutil.copytree(EXAMPLES, tmp_path_factory.mktemp("own") / "examples"))


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.py")), ids=lambda file: file.stem)
def test_an_example_takes_fewer_than_forty_lines_and_says_how_it_is_run(file):
    text = file.read_text()
    assert len(text.splitlines()) < 40
    command = re.search(r"pirrht run .*", text)
    assert command is not None
    assert f"\n{command.group()}\n" in DOCS


def test_numbers_of_the_tug_are_those_of_its_file():
    """Drag is damping over mass, and the command mass over gear."""
    text = (EXAMPLES / "tug.xml").read_text()
    mass, gear = (float(re.search(rf'\b{name}="([\d.]+)"', text).group(1)) for name in ("mass", "gear"))
    (damping,) = set(re.findall(r'damping="([\d.]+)"', text))
    drag = float(re.search(r"DRAG = ([\d.]+)", (EXAMPLES / "tug.py").read_text()).group(1))
    assert float(damping) / mass == pytest.approx(drag)
    assert f'data="{mass / gear:g} 0  0 {mass / gear:g}"' in text


@pytest.mark.parametrize("words", ALL)
def test_an_example_is_planned_for_in_three_classes(folder, words):
    found = told(folder, "plan", "slit", *words, "--vertices", "300")
    assert sorted(one["id"] for one in found["classes"]) == ["-1,0", "0,0", "0,1"]


@pytest.mark.parametrize("words", ALL)
def test_an_example_drives_and_is_recorded(folder, words):
    found = told(folder, "run", "slit", *words, *SMALL, "--max-time", "0.1", "--record", "own.rrd", status=1)
    assert found["outcome"] == "timeout"
    assert (folder / "own.rrd").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "at"), [thorough(WIND, ("1", "2.5"), id="wind"), thorough(TUG, ("1", "2.5", "0", "0"), id="tug")]
)
def test_samples_of_an_example_count(folder, words, at):
    """More than 1 of 100 are effective, where a guide that knew no wind left 1 of 600."""
    found = told(folder, "estimate", "slit", *words, "--vertices", "300", "--at", *at, "--samples", "1000")
    (ess,) = found["ess"]
    assert ess > 0.01 * 3 * 1000


@pytest.mark.parametrize("seed", [0, thorough(1)])
def test_the_robot_replans_to_another_class_when_a_crate_appears(seed, tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    import crate

    monkeypatch.setattr("sys.argv", ["crate.py", "--seed", str(seed), "--png", str(tmp_path / "crate.png")])
    assert crate.main() == 0
    assert re.match(r"from class 0,0 to (1,0|0,-1), driven \((1, 0|0, -1)\)", capsys.readouterr().out)
    assert (tmp_path / "crate.png").stat().st_size > 10_000
