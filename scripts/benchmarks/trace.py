"""Count the modules that one control step enters, and the lines that an import of the sampler brings along.

Each scene runs in a process of its own with NUMBA_DISABLE_JIT=1, since a compiled kernel enters no module.
"""

import argparse
import ast
import json
import os
import subprocess
import sys
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STEPS = {"static": "slit", "among moving obstacles": "crossing"}  # scenes
ROBOT = "puck"
GIVEN = {"vertices": 60, "samples": 4, "threads": 1, "seed": 0}  # few, since they run interpreted
SAMPLER = "pirrht.estimation.sampler"


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of modules and lines."""
    steps = {options.scene: options.scene} if options.scene else STEPS
    found = {name: _in_process(scene, options.robot or ROBOT) for name, scene in steps.items()}
    closure = closure_of(SAMPLER)
    lines = sum(closure.values())
    table = [[name, str(len(modules)), ""] for name, modules in found.items()]
    table.append([f"import of {SAMPLER}", str(len(closure)), str(lines)])
    return ["step", "modules", "lines"], table, {"steps": found, "closure": closure}


def entered(scene: str, robot: str) -> list[str]:
    """Return the modules of the method whose code one `Controller.plan` runs, imports left out."""
    from sim.scenario import prepare

    scenario = prepare(scene, robot=robot, given=GIVEN)
    controller = scenario.driver(scenario.grown_tree())
    start = scenario.start
    files: set[str] = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_name != "<module>":
            files.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        controller.plan(start)
    finally:
        sys.setprofile(None)
    paths = (Path(file) for file in files if file.startswith(str(ROOT / "pirrht")))
    return sorted(".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths)


def closure_of(module: str) -> dict[str, int]:
    """Return lines of each module of the method that importing one brings along; `pirrht/__init__` is left out."""
    found: dict[str, int] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = ROOT.joinpath(*name.split("."))
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        if name in found or name == "pirrht" or not path.exists():
            continue
        text = path.read_text()
        found[name] = len(text.splitlines())
        for node in ast.parse(text).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pirrht"):
                waiting += [str(node.module), *(f"{node.module}.{one.name}" for one in node.names)]
    return dict(sorted(found.items()))


def _in_process(scene: str, robot: str) -> list[str]:
    command = [sys.executable, "-P", "-c", f"from benchmarks import trace; trace.main({scene!r}, {robot!r})"]
    path = os.pathsep.join([str(ROOT), str(ROOT / "scripts")])
    done = subprocess.run(
        command, env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}, stdout=subprocess.PIPE, check=True
    )
    return list(json.loads(done.stdout))


def main(scene: str, robot: str) -> None:
    """Print the modules of one step as JSON."""
    print(json.dumps(entered(scene, robot)))
