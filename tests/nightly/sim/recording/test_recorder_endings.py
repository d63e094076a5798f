"""The long tests of integration/sim/recording/test_recorder_endings.py."""

import subprocess
import sys
import time

import pytest
from repository import environment
from thoroughly import first

from sim.recording import export

KILLED = """
import sys, time
from pathlib import Path
from drives import Drive
drive = Drive()
with drive.recorder(Path(sys.argv[1])) as recorder:
    for frame in drive.frames(max_time=30.0):
        recorder.log(frame)
        print(frame.step, flush=True)
        time.sleep(float(sys.argv[2]))
"""


def lost_when_killed(file, pause: float, steps: int) -> float:
    """Kill a drive that pauses between its steps [s]; how long before it the last step was taken that is kept [s]."""
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(file), str(pause)], env=environment(), stdout=subprocess.PIPE, text=True
    )
    taken = []
    for line in process.stdout:
        taken.append(time.monotonic())
        if int(line) == steps:
            break
    process.kill()
    killed = time.monotonic()
    process.wait()
    kept = [step for step, _, _ in export.read(file).steps]
    assert kept == list(range(len(kept)))
    return killed - taken[len(kept)] if len(kept) < len(taken) else 0.0


@pytest.mark.parametrize(("pause", "steps"), first([(0.04, 40), (0.0, 150)]))
def test_a_killed_run_leaves_all_but_its_last_moments(tmp_path, pause, steps):
    lost = []
    while not lost or (lost[-1] > 0.5 and len(lost) < 8):  # a busy machine may need more than one attempt
        lost.append(lost_when_killed(tmp_path / f"{len(lost)}.rrd", pause, steps))
    assert lost[-1] <= 0.5
