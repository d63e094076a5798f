"""Nothing in the user's current folder is imported or executed, whatever its files are called, but by `--system`."""

import importlib.util
import itertools
import subprocess
import sys

import pytest
from repository import environment

from pirrht.errors import OptionError
from sim import systems
from sim.recording import export, viewer

PACKAGES = ("sim", "pirrht", "rerun", "rerun_cli", "multiprocessing", "mujoco", "numpy")
MODULES = ("numba", "rerun_sdk", "subprocess", "socket", "signal", "tempfile", "pickle", "threading", "tqdm")
TRAP = """
import os
with open(os.path.join({folder!r}, "executed"), "a") as stream:
    stream.write(__name__ + "\\n")
"""


@pytest.fixture
def project(tmp_path, monkeypatch: pytest.MonkeyPatch):
    """A user's folder, which is the current one, with modules that note down when they are executed."""
    folder, files = tmp_path / "project", ("__init__", "__main__", "cli", "guard", "spawn")
    for name in (*MODULES, *map("/".join, itertools.product(PACKAGES, files))):
        file = folder / f"{name}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(TRAP.format(folder=str(tmp_path)))
    monkeypatch.chdir(folder)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    monkeypatch.setenv("PYTHONPATH", environment()["PYTHONPATH"])
    return folder


def executed(project) -> list[str]:
    """Names of modules of the project that were executed."""
    mark = project.parent / "executed"
    return mark.read_text().splitlines() if mark.exists() else []


def test_processes_of_a_sweep_import_nothing_from_there_and_neither_does_python_m(project):
    script = project.parent / "command.py"  # as installed: a script in a folder of its own
    script.write_text("import sys\nfrom sim.cli import main\nif __name__ == '__main__':\n    sys.exit(main())\n")
    sweep = ["sweep", "slit", "--methods", "passive", "--seeds", "0:2", "--max-time", "0.1", "--jobs", "2"]
    for command in ([str(script), *sweep], ["-m", "sim.cli", "scenes"]):
        done = subprocess.run([sys.executable, *command], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert executed(project) == []
        if (project / "sim").exists():
            (project / "sim").rename(project / "other")  # Python itself looks there for what `-m` names


def test_viewer_server_and_repair_import_nothing_from_there(project, monkeypatch: pytest.MonkeyPatch):
    started: list[list[str]] = []
    monkeypatch.setattr(viewer, "_await", lambda *_: None)
    monkeypatch.setattr(viewer, "check_display", lambda: None)
    with monkeypatch.context() as patch:
        patch.setattr(subprocess, "Popen", lambda command, **_: started.append(command))
        viewer.spawn()
        viewer.Server()
    for command in started:
        ran = subprocess.Popen([*command, "--version"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert b"rerun" in ran.stdout.read()
        ran.communicate()
    assert len(started) == 2
    file = project.parent / "broken.rrd"
    file.write_bytes(b"RRF2" + bytes(60))
    with pytest.raises(OptionError, match="no Rerun recording"):
        export.read(file)
    assert executed(project) == []


def test_a_system_of_the_folder_hides_nothing_that_is_imported_later(project, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(systems, "_folders", set())
    (project / "tempfile_boat.py").write_text(
        "import boat_parts\nfrom sim.systems import named\ndef BOAT():\n    return named(boat_parts.NAME)\n"
    )
    (project / "boat_parts.py").write_text("NAME = 'unicycle'\n")
    (project / "boat_more.py").write_text("")
    assert systems.chosen("tempfile_boat:BOAT").name == "unicycle"
    assert sys.path.index(str(project)) == len(sys.path) - 1
    assert importlib.util.find_spec("boat_more") is not None  # a module of theirs may import it when it is called
    assert executed(project) == []
