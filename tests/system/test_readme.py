"""What the README shows is run as it stands."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from repository import ROOT, environment

from sim import cli

README = (ROOT / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", README, re.S)
SCENES = {
    name: text for text in re.findall(r"```xml\n(.*?)```", README, re.S) for name in re.findall('model="(.*?)"', text)
}


def run(code: str, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=240, env=environment()
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_first_snippet_drives_and_names_the_favourite_class(tmp_path):
    lines = run(PYTHON[0], tmp_path).splitlines()
    assert len(lines) > 100
    assert lines[-1].split()[-1] in ("-1,0", "0,1", "0,0")


@pytest.mark.slow
def test_a_system_of_ones_own_reaches_the_goal(tmp_path):
    (tmp_path / "boat.xml").write_text(SCENES["boat"])
    assert run(PYTHON[1], tmp_path).strip() == "GOAL"


def test_a_scene_of_ones_own_has_a_class_for_each_way_around(tmp_path, capsys):
    scene = tmp_path / "gate.xml"
    scene.write_text(SCENES["gate"])
    assert cli.main(["plan", str(scene), "--vertices", "300"]) == 0
    assert len(re.findall(r"^-?\d+,-?\d+ ", capsys.readouterr().out, re.M)) >= 2


@pytest.mark.parametrize("command", ["scenes", "plan", "run", "estimate", "sweep", "import"])
def test_every_command_explains_itself(command, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main([command, "--help"])
    assert end.value.code == 0
    assert command in capsys.readouterr().out


def test_every_picture_is_there_and_all_together_are_small():
    folder = ROOT / "docs"
    shown = re.findall(r"!\[[^\]]+\]\(docs/(.*?)\)", README)
    assert shown
    assert not [name for name in shown if not (folder / name).is_file()]
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1_500_000
