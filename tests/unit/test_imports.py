"""Imports point downward: each room of the method may ask those below it, and nothing of the simulator."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from imported import imported, reached

import pirrht

PACKAGE = Path(pirrht.__file__).parent
GROUND = {"arrays", "errors", "outcome", "shown", "compiled"}
SPACE = GROUND | {"geometry", "topology", "freespace"}
MOTION = SPACE | {"systems", "problem"}
MAY_IMPORT: dict[str, set[str]] = {
    "arrays": set(),
    "errors": set(),
    "outcome": set(),
    "shown": set(),
    "files": {"errors"},
    "compiled": set(),
    "geometry": GROUND,
    "topology": GROUND | {"geometry"},
    "freespace": GROUND | {"geometry", "topology"},
    "plotting": SPACE,
    "systems": GROUND | {"geometry"},
    "problem": GROUND | {"geometry", "systems"},
    "steering": MOTION,
    "shortening": MOTION | {"steering"},
    "tree": MOTION | {"files", "plotting", "steering", "shortening"},
    "rollouts": MOTION,
    "guidance": MOTION | {"steering", "rollouts"},
    "estimation": MOTION | {"steering", "rollouts", "guidance"},
    "exact": MOTION | {"rollouts"},
    "control": MOTION | {"plotting", "steering", "shortening", "tree", "rollouts", "guidance", "estimation", "exact"},
}
DOORS = {  # who must and who may name a foreign library
    "fcl": ({"geometry.collision"}, {"geometry.collision", "geometry.fcl_shapes"}),
    "scipy": ({"exact.planar"}, {"exact.planar", "exact.heading_grid"}),
    "matplotlib": ({"plotting.axes"}, {"plotting.axes", "plotting.ground", "plotting.lines"}),
}
FOREIGN = {"sim", "mujoco", "rerun", "trimesh", "pyarrow", "tqdm", "distributed"}
LATE = {"matplotlib"}  # only what draws imports it, and only then
NOISE = {"temperature", "diffusion"}


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts)


FILES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}
MODULES = [name for name in FILES if not name.endswith("__init__")]
PACKAGES = [name.removesuffix(".__init__") for name in FILES if name.endswith(".__init__")]


def room_of(module: str) -> str:
    return module.partition(".")[0]


def imports(module: str) -> frozenset[str]:
    return imported(FILES[module])


@cache
def inner(module: str) -> frozenset[str]:
    """Modules of the package that a module imports."""
    return frozenset(name.removeprefix("pirrht.") for name in imports(module)) & frozenset(MODULES)


@cache
def reachable(module: str) -> frozenset[str]:
    """Modules of the package that a module imports, directly or not; itself only in a circle."""
    return reached(module, inner)


def outer(module: str) -> set[str]:
    """Libraries that a module imports."""
    return {name.partition(".")[0] for name in imports(module)}


def test_every_room_stands_in_the_table_and_asks_those_above_it_only():
    assert {room_of(module) for module in MODULES} == set(MAY_IMPORT)
    rooms = list(MAY_IMPORT)
    for place, room in enumerate(rooms):
        assert MAY_IMPORT[room] <= set(rooms[:place])


@pytest.mark.parametrize("module", MODULES)
def test_a_module_asks_only_rooms_below_its_own(module):
    room = room_of(module)
    assert {room_of(other) for other in inner(module)} - {room} <= MAY_IMPORT[room]


@pytest.mark.parametrize("module", MODULES)
def test_no_module_imports_itself_in_a_circle(module):
    assert module not in reachable(module)


@pytest.mark.parametrize("module", MODULES)
def test_no_module_names_what_lies_above(module):
    assert not outer(module) & FOREIGN


@pytest.mark.slow
def test_importing_the_whole_package_loads_nothing_that_lies_above():
    script = (
        "import sys, pirrht\n"
        "for name in pirrht.__all__: getattr(pirrht, name)\n"
        f"for name in {MODULES!r}: __import__('pirrht.' + name)\n"
        f"print(sorted({FOREIGN | LATE!r} & {{name.partition('.')[0] for name in sys.modules}}))"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_tree_and_samples_meet_in_control_only():
    for module in MODULES:
        rooms = {room_of(other) for other in reachable(module)} | {room_of(module)}
        assert not {"tree", "estimation"} <= rooms or room_of(module) == "control"
    assert {"tree.homology_tree", "estimation.sampler"} <= reachable("control.controller")


@pytest.mark.parametrize("module", [name for name in MODULES if room_of(name) in ("steering", "shortening", "tree")])
def test_the_tree_knows_nothing_of_noise(module):
    parsed = ast.parse(FILES[module].read_text())
    assert not {node.attr for node in ast.walk(parsed) if isinstance(node, ast.Attribute)} & NOISE


@pytest.mark.parametrize("library", DOORS)
def test_a_foreign_library_has_one_door(library):
    must, may = DOORS[library]
    assert must <= {module for module in MODULES if library in outer(module)} <= may


@pytest.mark.parametrize("name", pirrht.__all__)
def test_every_public_name_exists(name):
    assert getattr(pirrht, name) is not None
    assert name in dir(pirrht)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = pirrht.nonsense


def test_importing_the_package_is_quick_because_names_come_on_demand():
    script = "import sys, pirrht; print({'numba', 'numpy', 'scipy', 'fcl'} & set(sys.modules))"
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "set()"


@pytest.mark.parametrize("module", MODULES)
def test_every_module_says_what_it_is_for(module):
    said = ast.get_docstring(ast.parse(FILES[module].read_text()))
    assert said is not None
    assert len(said.split()) >= 5


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_says_in_some_lines_what_it_is_for_and_holds_nothing_else(package):
    parsed = ast.parse(FILES[f"{package}.__init__"].read_text())
    said = ast.get_docstring(parsed)
    assert said is not None
    assert len([line for line in said.splitlines() if line.strip()]) >= (4 if "." in package else 5)
    assert len(parsed.body) == 1
