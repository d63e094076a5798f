"""What a rehearsal compiles and loads is all that a run uses: nothing is compiled while the clock runs."""

import pytest
from commands import call
from repository import ROOT

PROGRAM = """
import sys
sys.path.append(sys.argv[1])
from benchmarks.moving_scene import moving_scenario
from pirrht.jit import linking
from sim.drive import episode
from sim.rehearsal import rehearse
from sim.scenario import prepare

late = []

def asked(code, args, plain=linking.Code._found_or_made):  # for code that this process has not yet
    late.append(f"{code.py_func.__module__}.{code.py_func.__name__}")
    return plain(code, args)

def begun(plain=episode.undisturbed):
    late.clear()
    return plain()

linking.Code._found_or_made = asked
episode.undisturbed = begun
scene, robot = sys.argv[2:]
if scene == "many":  # paths by which classes go on there come in another layout: to compile for it took nine periods
    given = {"samples": 60, "period": 0.1, "max_time": 3.0, "real_time": True, "predict": "velocity"}
    scenario = moving_scenario(0, 24, given)
else:
    scenario = prepare(scene, robot=robot or None, given={"vertices": 300, "samples": 60, "max_time": 1.0})
rehearse(scenario, driving=True)
tree = scenario.grown_tree()
driver, plant = scenario.driver(tree), scenario.plant()
early = len(late)
late.clear()
frames = list(scenario.drive(plant, driver))
print(early, len(frames), *late)
"""


@pytest.mark.parametrize(("scene", "robot"), [("crossing", ""), ("closing_door", "rover"), ("slit", ""), ("many", "")])
def test_nothing_is_compiled_or_loaded_once_a_run_has_begun(scene, robot, tmp_path):
    compiled, frames, *late = call(tmp_path, "-c", PROGRAM, str(ROOT / "scripts"), scene, robot).split()
    assert late == []
    assert int(compiled) > 30
    assert int(frames) > 5


HELPED = """
import os, sys
from numba.core import event
from sim import rehearsal
from sim.cli import main
os.sched_getaffinity = lambda _: {0, 1}
process = rehearsal.helper("slit", {"robot": "puck"})
if sys.argv[1] == "early":
    process.stdin.close()  # as when the command that began it has gone
print("helper", process.wait(300))
with event.install_recorder("numba:compile") as compiled:
    sys.argv[1] == "early" or main(["run", "slit", "--robot", "puck", "--max-time", "0.1"])
print("compiled", len(compiled.buffer))
"""


def test_another_process_compiles_all_that_a_run_needs(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    said = call(tmp_path, "-c", HELPED, "late")
    assert "helper 0" in said
    assert "compiled 0" in said


def test_what_compiles_for_a_command_ends_with_it(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert "helper 1" in call(tmp_path, "-c", HELPED, "early")
