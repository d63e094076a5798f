"""Imports point downward: planner and sampler know neither the simulator nor each other."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import pirrht

PACKAGE = Path(pirrht.__file__).parent
FOREIGN = {"mujoco", "rerun", "trimesh", "sim", "matplotlib", "pyarrow", "tqdm", "distributed"}
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py") if path.stem != "__init__")


@cache
def imports(module: str) -> frozenset[str]:
    """Everything a module of the package imports, wherever in the file, by full name."""
    names = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            assert node.module is not None
            names.add(node.module)
            if node.module == "pirrht":
                names |= {f"pirrht.{alias.name}" for alias in node.names}
    return frozenset(names)


@cache
def reachable(module: str) -> frozenset[str]:
    """Modules of the package that a module imports, directly or not; itself only in a cycle."""
    seen: set[str] = set()
    waiting = [module]
    while waiting:
        for name in imports(waiting.pop()):
            package, _, inner = name.partition(".")
            if package == "pirrht" and inner in MODULES and inner not in seen:
                seen.add(inner)
                waiting.append(inner)
    return frozenset(seen)


@pytest.mark.parametrize("module", MODULES)
def test_no_module_names_what_lies_above(module):
    assert not {name.partition(".")[0] for name in imports(module)} & FOREIGN


def test_importing_the_whole_package_loads_nothing_that_lies_above():
    script = (
        "import sys, pirrht\n"
        "for name in pirrht.__all__: getattr(pirrht, name)\n"
        f"for name in {MODULES!r}: __import__('pirrht.' + name)\n"
        f"print(sorted({FOREIGN!r} & {{name.partition('.')[0] for name in sys.modules}}))"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_tree_and_path_integral_never_meet_below_the_controller():
    assert not reachable("tree") & {"path_integral", "rollout", "exits", "noise", "controller"}
    assert not reachable("path_integral") & {"tree", "graph", "polish", "controller"}
    assert {"tree", "path_integral"} <= reachable("controller")


def test_the_tree_knows_nothing_of_noise():
    source = (PACKAGE / "tree.py").read_text()
    assert "temperature" not in source
    assert "diffusion" not in source


@pytest.mark.parametrize("module", MODULES)
def test_no_module_imports_itself_in_a_circle(module):
    assert module not in reachable(module)


def test_errors_import_nothing_of_the_package():
    assert reachable("errors") == frozenset()


@pytest.mark.parametrize(
    ("library", "doors"),
    [("fcl", {"collision"}), ("scipy", {"desirability_planar", "desirability_car", "desirability_check"})],
    ids=["FCL", "SciPy only for the grid"],
)
def test_a_foreign_library_has_one_door(library, doors):
    assert {module for module in MODULES if library in {name.partition(".")[0] for name in imports(module)}} == doors


@pytest.mark.parametrize("name", pirrht.__all__)
def test_every_public_name_exists(name):
    assert getattr(pirrht, name) is not None
    assert name in dir(pirrht)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = pirrht.nonsense


def test_importing_the_package_is_quick_because_names_come_on_demand():
    script = "import sys, pirrht; print('numba' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"


@pytest.mark.parametrize("module", MODULES)
def test_every_module_says_what_it_is_for(module):
    loaded = importlib.import_module(f"pirrht.{module}")
    assert loaded.__doc__
