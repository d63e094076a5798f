"""The long tests of integration/test_sweep.py and of integration/sim/sweeps."""

import random
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from integration.sim.sweeps.test_engine import results
from integration.test_sweep import QUICK, rows
from mjcf_samples import WALL
from repository import environment
from tasks import Task, die_of_two, gone, wait_for

from sim.cli import main
from sim.cli.parser import parser
from sim.sweeps import parts, sweep
from sim.sweeps.dataset import Dataset
from sim.sweeps.engine import TRIES

STOPPED = """
import os, signal, sys
from sim import cli
from sim.sweeps import dataset, parts
def once(folder, write, add=parts.add):
    parts.add = add
    add(folder, write)
    {signals}
dataset.CHUNK_RUNS, dataset.CHUNK_SECONDS, parts.add = 20, float("inf"), once
sys.exit(cli.main(sys.argv[1:]))
"""  # a sweep that is told to stop as soon as its first 20 runs are written


def written(folder: Path) -> int:
    return len(list(folder.glob("runs/part-*.parquet")))


@contextmanager
def started(*words: str, program=("-m", "sim.cli")):
    """A sweep as a process of its own, which does not outlive the test."""
    process = subprocess.Popen(
        [sys.executable, *program, "sweep", *words], stderr=subprocess.PIPE, stdout=subprocess.PIPE,
        env=environment(), text=True, start_new_session=True,
    )  # fmt: skip
    with process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(scope="module")
def long_sweep(tmp_path_factory) -> tuple[list[str], list[dict]]:
    """A sweep of some seconds, and its rows when nothing disturbs it."""
    folder = tmp_path_factory.mktemp("whole") / "sweep"
    words = ["slit", "--methods", "passive", "--noise", "0.1,0.3", "--seeds", "0:80", "--jobs", "2", *QUICK]
    assert main(["sweep", *words, "-o", str(folder)]) == 0
    return words, rows(folder)


@pytest.mark.thorough
def test_a_sweep_that_is_killed_again_and_again_ends_with_the_same_rows(long_sweep, tmp_path):
    words, expected = long_sweep
    folder, chance = tmp_path / "sweep", random.Random(3)
    for _ in range(3):
        before = written(folder)
        with started(*words, "-o", str(folder)) as process:
            wait_for(lambda before=before, process=process: written(folder) > before or process.poll() is not None)
            time.sleep(0.4 * chance.random())
    assert 0 < len(rows(folder)) <= len(expected)
    assert main(["sweep", *words, "-o", str(folder)]) == 0
    assert rows(folder) == expected
    assert len(parts.rows(Dataset(folder).files())) == len(expected)


@pytest.mark.thorough
def test_ctrl_c_waits_for_what_is_under_way_and_the_same_command_goes_on(long_sweep, tmp_path):
    words, expected = long_sweep
    as_a_terminal = STOPPED.format(signals="os.killpg(0, signal.SIGINT)")  # to all processes
    with started(*words, "-o", str(tmp_path / "sweep"), program=("-c", as_a_terminal)) as process:
        _, told = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "under way are waited for" in told
    kept, last = told.strip().splitlines()[-2:]
    assert last == "pirrht: interrupted"
    assert "Traceback" not in told
    done = rows(tmp_path / "sweep")
    assert kept == f"{len(done)} of 160 runs kept in {tmp_path / 'sweep'}; the same command continues"
    assert 20 <= len(done) <= 22  # those that were written, and what two processes were at
    assert all(row in expected for row in done)
    assert main(["sweep", *words, "-o", str(tmp_path / "sweep")]) == 0
    assert rows(tmp_path / "sweep") == expected


@pytest.mark.parametrize("signals", [("SIGINT", "SIGINT"), ("SIGTERM",)])
def test_ctrl_c_twice_and_sigterm_end_it_at_once_and_keep_what_was_finished(signals, tmp_path):
    words = ["slit", "--methods", "passive", "--seeds", "0:50", "--jobs", "2", *QUICK, "-o", str(tmp_path / "sweep")]
    sent = "; ".join(f"os.kill(os.getpid(), signal.{name})" for name in signals)
    with started(*words, program=("-c", STOPPED.format(signals=sent))) as process:
        _, told = process.communicate(timeout=120)
    assert process.returncode == 128 + signal.Signals[signals[0]]
    assert "Traceback" not in told
    assert 20 <= len(rows(tmp_path / "sweep")) <= 22


def test_a_tree_that_does_not_fit_is_refused_first_and_asked_of_no_method_without_one(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    Path("letter.npz").write_text("dear")
    assert main(["plan", "slit", "--vertices", "100", "-o", "slit.npz"]) == 0
    robot = ["slit", "--tree", "slit.npz", "--robot", "unicycle"]
    for words, culprit in (
        (["slit", "--tree", "nosuch.npz"], "nosuch.npz does not exist"),
        (["slit", "--tree", "letter.npz"], "letter.npz is no tree"),
        (["slit", "clutter", "--tree", "slit.npz"], "slit.npz was grown for another task"),
        (robot, "slit.npz was grown for another task"),
    ):
        for output in ([], ["-o", "sweep"]):
            refused(["sweep", *words, "--methods", "passive,pi-rrht", "--seeds", "0:1", *output], culprit)
    assert not Path("sweep").exists()
    arguments = parser().parse_args(["sweep", *robot, "--methods", "passive"])
    assert len(sweep.checked(sweep.parse(vars(arguments)).jobs())) == 10


def test_a_scene_that_has_changed_is_refused_and_one_that_moved_is_not(tmp_path, refused):
    scene, moved = tmp_path / "wall.xml", tmp_path / "there" / "wall.xml"
    scene.write_text(WALL)
    moved.parent.mkdir()
    words = ["--methods", "passive", "--seeds", "0:1", *QUICK, "-o", str(tmp_path / "sweep")]
    assert main(["sweep", str(scene), *words]) == 0
    scene.rename(moved)
    assert main(["sweep", str(moved), *words]) == 0
    assert written(tmp_path / "sweep") == 1
    moved.write_text(WALL.replace('size="0.1 2.1', 'size="0.2 2.1'))
    refused(["sweep", str(moved), *words], "another wall")
    assert written(tmp_path / "sweep") == 1


# -- processes ---------------------------------------------------------------------------------------------------


def test_an_item_that_ends_every_process_is_given_up_and_one_that_ends_a_process_once_is_done(tmp_path):
    told = results(
        die_of_two, [Task("a", number, str(tmp_path)) for number in range(6)], lost=lambda task, why: (task.number, why)
    )
    assert sorted(told, key=str) == [(2, f"its process died {TRIES} times"), 0, 1, 3, 4, 5]
    assert (tmp_path / "dead").exists()


PARENT = """
import sys
from tasks import Task, held
from sim.sweeps.engine import Agenda, Pool, Stop
if __name__ == "__main__":
    tasks = [Task(str(n), n, sys.argv[1]) for n in (8, 9)]
    with Pool(2, Stop()) as pool:
        list(pool.run(held, Agenda(tasks), lambda task, why: None))
"""


def test_no_process_outlives_a_parent_that_is_killed(tmp_path):
    script, marks = tmp_path / "parent.py", tmp_path / "marks"
    script.write_text(PARENT)
    marks.mkdir()
    parent = subprocess.Popen([sys.executable, script, marks], env=environment())
    try:
        wait_for(lambda: len(list(marks.iterdir())) == 2)
        pids = [int(mark.name.split("-")[1]) for mark in marks.iterdir()]
        assert not any(map(gone, pids))
    finally:
        parent.kill()
        parent.wait()
    wait_for(lambda: all(map(gone, pids)), 20.0)
