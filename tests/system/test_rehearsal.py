"""What a rehearsal compiles and loads is all that a drive uses: nothing is compiled while the clock runs."""

from __future__ import annotations

import subprocess
import sys

import pytest

COUNTED = """
import gc, sys
from numba.core.dispatcher import Dispatcher
from sim.rehearsal import rehearse
from sim.scenario import prepare

def known():
    every = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {(one.py_func.__module__, one.py_func.__name__, str(types)) for one in every for types in one.overloads}

scenario = prepare(sys.argv[1], robot=sys.argv[2] or None, given={"vertices": 300, "samples": 60, "max_time": 1.0})
tree = scenario.grown_tree()
scenario.references(tree)
driver = scenario.driver(tree)
rehearse(scenario, driving=True)
before = known()
frames = list(scenario.drive(scenario.plant(), driver))
print(len(before), len(frames), *sorted(f"{module}.{name}" for module, name, _ in known() - before))
"""


@pytest.mark.parametrize(("scene", "robot"), [("crossing", ""), ("closing_door", "rover"), ("slit", "")])
def test_nothing_is_compiled_or_loaded_once_a_drive_has_begun(scene, robot):
    run = subprocess.run(
        [sys.executable, "-c", COUNTED, scene, robot], capture_output=True, text=True, check=True, timeout=600
    )
    compiled, frames, *late = run.stdout.split()
    assert late == []
    assert int(compiled) > 30
    assert int(frames) > 5
