"""The long tests of integration/sim/sweeps/test_engine.py."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from integration.sim.sweeps.test_engine import results
from repository import environment
from tasks import Task, die_at_first, die_of_two, gone

from sim.sweeps.engine import TRIES


def test_what_a_killed_process_was_at_is_done_by_another(tmp_path):
    tasks = [Task("a", number, str(tmp_path)) for number in range(6)]
    assert sorted(results(die_at_first, tasks)) == list(range(6))
    assert (tmp_path / "dead").exists()


def test_an_item_that_ends_every_process_is_given_up_and_the_others_are_done():
    told = results(die_of_two, [Task("a", number) for number in range(4)], lost=lambda task, why: (task.number, why))
    assert sorted(r for r in told if isinstance(r, int)) == [0, 1, 3]
    (given_up,) = (r for r in told if not isinstance(r, int))
    assert given_up == (2, f"its process died {TRIES} times")


PARENT = """
import sys
from tasks import Task, held
from sim.sweeps.engine import Agenda, Pool, Stop
if __name__ == "__main__":
    tasks = [Task(str(n), n, sys.argv[1]) for n in (8, 9)]
    with Pool(2, Stop()) as pool:
        list(pool.run(held, Agenda(tasks), lambda task, why: None))
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_no_process_outlives_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    marks = tmp_path / "marks"
    marks.mkdir()
    parent = subprocess.Popen([sys.executable, script, marks], env=environment())
    try:
        deadline = time.monotonic() + 60.0
        while len(list(marks.iterdir())) < 2 and time.monotonic() < deadline:
            time.sleep(0.1)
        pids = [int(mark.name.split("-")[1]) for mark in marks.iterdir()]
        assert len(pids) == 2
        assert not any(map(gone, pids))
    finally:
        parent.kill()
        parent.wait()
    deadline = time.monotonic() + 20.0
    while not all(map(gone, pids)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert all(map(gone, pids))
