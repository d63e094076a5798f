"""What is installed is complete: a wheel brings scenes and robots along and drives from any folder."""

import os
import subprocess
import sys
import zipfile

import pytest
from repository import ROOT

import pirrht


def call(*words, cwd, **environment: str) -> subprocess.CompletedProcess[str]:
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    known = inherited | {"PIP_DISABLE_PIP_VERSION_CHECK": "1"} | environment
    return subprocess.run([sys.executable, *map(str, words)], cwd=cwd, env=known, capture_output=True, text=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("wheel")
    pytest.importorskip("hatchling", reason="the wheel is built without a network")
    words = "-m pip wheel -q --no-deps --no-build-isolation --no-index -w"
    built = call(*words.split(), folder, ROOT, cwd=folder)
    assert built.returncode == 0, built.stderr
    (file,) = folder.glob("pirrht-*.whl")
    return file


def test_a_wheel_holds_both_packages_their_models_and_the_command_and_nothing_else(wheel):
    archive = zipfile.ZipFile(wheel)
    names = set(archive.namelist())
    for folder in ("pirrht", "sim"):
        assert {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("*.py")} <= names
    for path in (ROOT / "models").rglob("*.xml"):
        assert f"sim/models/{path.relative_to(ROOT / 'models').as_posix()}" in names
    assert {"pirrht/py.typed", "sim/py.typed"} <= names
    assert f"pirrht-{pirrht.__version__}-" in wheel.name
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"pirrht", "sim"}
    assert not [name for name in names if "__pycache__" in name or name.endswith(".nbi")]
    (entry,) = [name for name in names if name.endswith("entry_points.txt")]
    assert "pirrht = sim.cli:main" in archive.read(entry).decode()


def test_an_installed_copy_finds_its_own_scenes_drives_and_compiles_only_once(wheel, tmp_path, tmp_path_factory):
    installed = tmp_path_factory.mktemp("installed")
    words = "-m pip install -q --no-deps --no-index --no-compile --target"
    done = call(*words.split(), installed, wheel, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    listed = call("-m", "sim.cli", "scenes", cwd=tmp_path, PYTHONPATH=str(installed))
    assert listed.returncode == 0, listed.stderr
    assert f"files: {installed / 'sim' / 'models' / 'scenes'};" in listed.stdout
    assert "\nslit " in listed.stdout
    words = ("run", "slit", "--max-time", "0.05", "--vertices", "60", "--samples", "20", "--json", "run.json")
    for compiles in (True, False):
        ran = call("-m", "sim.cli", *words, cwd=tmp_path, PYTHONPATH=str(installed), NUMBA_CACHE_DIR="")
        assert ran.returncode == 1, ran.stderr
        assert "timeout after 0.05 s" in ran.stdout
        assert ("compiling kernels" in ran.stderr) == compiles
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]
