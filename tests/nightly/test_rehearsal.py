"""What a rehearsal compiles and loads is all that a drive uses: nothing is compiled while the clock runs."""

from __future__ import annotations

import subprocess
import sys

import pytest
from repository import ROOT, environment

KNOWN = """
import gc, sys
from benchmarks.moving_scene import moving_scenario
from numba.core.dispatcher import Dispatcher
from sim.drive import realtime
from sim.rehearsal import rehearse
from sim.scenario import prepare

def known():
    every = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {
        (one.py_func.__module__, one.py_func.__name__, str(types))
        for one in every for types in one.overloads if not one.py_func.__module__.startswith(left_out)
    }
"""

SIMULATED = """
left_out = ()
scenario = prepare(sys.argv[1], robot=sys.argv[2] or None, given={"vertices": 300, "samples": 60, "max_time": 1.0})
tree = scenario.grown_tree()
scenario.references(tree)
driver = scenario.driver(tree)
rehearse(scenario, driving=True)
before = known()
frames = list(scenario.drive(scenario.plant(), driver))
"""

# Paths by which classes go on there come in another layout: to compile for it took nine periods.
BY_VELOCITY = """
left_out = "numba."
def undisturbed(plain=realtime._undisturbed):
    global before
    before = known()
    return plain()

realtime._undisturbed = undisturbed
given = {"samples": 60, "period": 0.1, "max_time": 3.0, "real_time": True, "predict": "velocity"}
scenario = moving_scenario(0, 24, given)
rehearse(scenario, driving=True)
tree = scenario.grown_tree()
frames = list(scenario.drive(scenario.plant(), scenario.driver(tree)))
"""

LATE = 'print(len(before), len(frames), *sorted(f"{module}.{name}" for module, name, _ in known() - before))'


@pytest.mark.parametrize(
    "words",
    [(SIMULATED, "crossing", ""), (SIMULATED, "closing_door", "rover"), (SIMULATED, "slit", ""), (BY_VELOCITY,)],
    ids=["crossing", "closing_door", "slit", "many bodies in real time"],
)
def test_nothing_is_compiled_or_loaded_once_a_drive_has_begun(words):
    program, *scene = words
    run = subprocess.run(
        [sys.executable, "-c", KNOWN + program + LATE, *scene],
        env=environment(ROOT / "scripts"), capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    compiled, frames, *late = run.stdout.split()
    assert late == []
    assert int(compiled) > 30
    assert int(frames) > 5
