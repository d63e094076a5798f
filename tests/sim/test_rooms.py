"""Around the method imports point downward too, foreign libraries have their doors, and what is slow comes late."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from imported import imported, reached
from repository import environment

import sim

PACKAGE = Path(sim.__file__).parent
PLAIN = {"text", "files", "columns"}
WORDS = PLAIN | {"options", "settings", "memory", "systems", "system_import"}
CORE = WORDS | {"mjcf", "drawing", "drive", "scenario", "rehearsal", "result"}
MAY_IMPORT: dict[str, set[str]] = {
    "text": set(),
    "columns": set(),
    "files": set(),
    "options": PLAIN,
    "settings": PLAIN | {"options"},
    "memory": PLAIN | {"options", "settings"},
    "systems": PLAIN | {"options", "settings"},
    "system_import": PLAIN | {"options", "settings", "systems"},
    "mjcf": WORDS,
    "drawing": PLAIN,
    "drive": WORDS | {"mjcf", "drawing"},
    "episode": {"drive"},
    "executor": {"drive"},
    "scenario": WORDS | {"mjcf", "drive"},
    "rehearsal": WORDS | {"mjcf", "drive", "scenario"},
    "play": WORDS | {"mjcf", "drive", "scenario"},
    "result": CORE - {"result", "rehearsal"},
    "recording": CORE,
    "film": CORE,
    "figures": CORE,
    "importing": CORE,
    "sweeps": CORE,
    "report": CORE | {"sweeps", "figures"},
    "gym": CORE | {"sweeps"},
    "cli": CORE | {"play", "recording", "film", "figures", "importing", "sweeps", "report"},
}
DOORS: dict[str, set[str]] = {  # library -> rooms and modules that may name it
    "rerun": {"recording"},
    "mujoco": {"mjcf", "drive.executor", "film", "recording.geoms", "recording.bodies", "importing.scene_file", "play"},
    "matplotlib": {"figures", "report.plots"},
    "mpl_toolkits": {"figures"},
    "pyarrow": {"sweeps", "recording.export"},
    "distributed": {"sweeps.cluster"},
    "gymnasium": {"gym"},
    "av": {"film"},
    "trimesh": {"mjcf.obstacles"},
    "yaml": {"importing.ros_map"},
    "argparse": {"cli", "options", "sweeps.sweep", "figures"},
}
SLOW = {"rerun", "matplotlib", "pyarrow", "numba", "mujoco", "scipy", "distributed", "gymnasium", "trimesh", "fcl"}


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")


FILES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py")) if path != PACKAGE / "__init__.py"}


def room_of(module: str) -> str:
    return module.partition(".")[0]


def imports(module: str) -> frozenset[str]:
    return imported(FILES[module])


@cache
def inner(module: str) -> frozenset[str]:
    """Modules of the package that a module imports."""
    found = frozenset(name.removeprefix("sim.") for name in imports(module) if name.startswith("sim.")) & FILES.keys()
    parents = {other for other in found if f"sim.{other}" in imports(module) and _only_on_the_way(module, other)}
    return found - parents


def _only_on_the_way(module: str, package: str) -> bool:
    """Whether a package is named for a module in it only, as in `from sim.cli import tables`."""
    return FILES[package].name == "__init__.py" and any(
        name.startswith(f"sim.{package}.") and name.removeprefix("sim.") in FILES for name in imports(module)
    )


@cache
def reachable(module: str) -> frozenset[str]:
    """Modules of the package that a module imports, directly or not; itself only in a circle."""
    return reached(module, inner)


def loaded_by(code: str) -> set[str]:
    """Libraries that are loaded once some code has run, which ends by SystemExit or not."""
    script = f"import sys\ntry:\n    {code}\nexcept SystemExit:\n    pass\nprint('\\n'.join(sys.modules))"
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment())
    return {name.partition(".")[0] for name in ran.stdout.splitlines()}


def test_every_room_stands_in_the_table_and_asks_those_above_it_only():
    assert {room_of(module) for module in FILES} == set(MAY_IMPORT)
    rooms = list(MAY_IMPORT)
    for place, room in enumerate(rooms):
        assert MAY_IMPORT[room] <= set(rooms[:place])


@pytest.mark.parametrize("module", FILES)
def test_a_module_asks_only_rooms_below_its_own(module):
    room = room_of(module)
    assert {room_of(other) for other in inner(module)} - {room} <= MAY_IMPORT[room]


@pytest.mark.parametrize("module", FILES)
def test_no_module_imports_itself_in_a_circle(module):
    assert module not in reachable(module)


@pytest.mark.parametrize("library", DOORS)
def test_a_foreign_library_has_its_doors(library):
    named = {module for module in FILES if library in {name.partition(".")[0] for name in imports(module)}}
    assert named
    assert not [module for module in named if not {module, room_of(module)} & DOORS[library]]


@pytest.mark.parametrize("command", ["", "plan", "run", "play", "estimate", "sweep", "report", "export", "import"])
def test_help_loads_nothing_that_is_slow(command):
    words = [*command.split(), "--help"]
    assert not loaded_by(f"from sim.cli import main; main({words!r})") & SLOW


def test_a_refused_command_line_loads_nothing_that_is_slow():
    assert not loaded_by("from sim.cli import main; main(['run', 'slit', '--noise', 'nan'])") & SLOW


@pytest.mark.slow
def test_a_plan_loads_no_viewer_no_pictures_and_no_tables():
    code = "from sim.cli import main; main(['plan', 'slit', '--vertices', '30'])"
    assert not loaded_by(code) & {"rerun", "matplotlib", "pyarrow", "distributed", "gymnasium"}


@pytest.mark.parametrize("module", FILES)
def test_every_module_says_what_it_is_for(module):
    said = ast.get_docstring(ast.parse(FILES[module].read_text()))
    assert said is not None
    assert len(said.split()) >= 3
