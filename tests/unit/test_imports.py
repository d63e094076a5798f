"""Slow libraries are imported late, and public names come on demand; import-linter checks who may import whom."""

import ast
import re
import subprocess
import sys

import pytest
from repository import ROOT, environment

import pirrht

NOISE = {"temperature", "diffusion"}
SLOW = {"rerun", "matplotlib", "pyarrow", "numba", "mujoco", "scipy", "distributed", "gymnasium", "trimesh", "fcl"}
HELPED = ("", "plan", "run", "play", "estimate", "sweep", "report", "export", "import")


def modules(package: str):
    return sorted((ROOT / package).rglob("*.py"))


def loaded_by(*lines: str) -> set[str]:
    """Libraries that are loaded once these statements have run, which end by SystemExit or not."""
    tried = [f"try:\n    {line}\nexcept SystemExit:\n    pass" for line in lines]
    script = "\n".join(["import sys", *tried, "print('\\n'.join(['', *sys.modules]))"])
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment())
    return {name.partition(".")[0] for name in ran.stdout.splitlines()}


def test_every_public_name_exists():
    assert [name for name in pirrht.__all__ if getattr(pirrht, name) is None or name not in dir(pirrht)] == []


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = pirrht.nonsense


def test_importing_the_package_loads_nothing_because_names_come_on_demand():
    assert not loaded_by("import pirrht") & {"numba", "numpy", "scipy", "fcl"}


def test_importing_every_module_of_the_package_draws_nothing():
    files = [file for file in modules("pirrht") if file.stem != "__init__"]
    names = [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files]
    loaded = loaded_by(f"for name in {names!r}: __import__(name)")
    assert "numba" in loaded
    assert not loaded & {"matplotlib", "mujoco", "rerun", "sim"}


def test_no_string_of_the_method_names_a_module_of_the_simulator_which_contracts_could_not_see():
    for file in modules("pirrht"):
        nodes = ast.walk(ast.parse(file.read_text()))
        strings = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
        assert [text for text in strings if re.fullmatch(r"sim(\.\w+)+", text)] == [], file


def test_help_and_a_refused_command_load_nothing_that_is_slow():
    lines = [f"main({[*command.split(), '--help']!r})" for command in HELPED]
    assert not loaded_by("from sim.cli import main", *lines, "main(['run', 'slit', '--noise', 'nan'])") & SLOW


def test_a_plan_loads_no_viewer_no_pictures_and_no_tables():
    loaded = loaded_by("from sim.cli import main", "main(['plan', 'slit', '--vertices', '30'])")
    assert "mujoco" in loaded
    assert not loaded & {"rerun", "matplotlib", "pyarrow", "distributed", "gymnasium"}


def test_the_tree_knows_nothing_of_noise():
    for room in ("steering", "planner"):
        for file in modules(f"pirrht/{room}"):
            nodes = ast.walk(ast.parse(file.read_text()))
            assert not {node.attr for node in nodes if isinstance(node, ast.Attribute)} & NOISE, file


def test_the_planner_asks_a_steering_and_not_what_type_it_is():
    for file in modules("pirrht/planner"):
        calls = [node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call)]
        kinds = [ast.unparse(call.args[1]) for call in calls if ast.unparse(call.func) == "isinstance"]
        assert set(kinds) <= {"Integral"}, file
