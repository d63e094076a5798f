"""Errands on processes: each is done once, whatever happens to those who do them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from repository import environment

from sim.sweeps.engine import LIBRARIES, TRIES, Agenda, Pool, Stop, _hand_out, in_turn, interruptible


@dataclass(frozen=True)
class Task:
    scene: str
    number: int
    folder: str = ""

    @property
    def point(self):
        return (self.scene,)


TASKS = [Task(scene, number) for scene in ("a", "b", "c") for number in range(4)]


def square(task: Task) -> int:
    return task.number**2


def process_of(task: Task) -> tuple[str, int]:
    time.sleep(0.02)
    return task.scene, os.getpid()


def threads_of(task: Task) -> list[str | None]:
    return [os.environ.get(name) for name in LIBRARIES]


def die_at_first(task: Task) -> int:
    """Ends its process the first time that number 2 is tried."""
    mark = Path(task.folder) / "dead"
    if task.number == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return task.number


def die_of_two(task: Task) -> int:
    if task.number == 2:
        os._exit(7)
    return task.number


def held(task: Task) -> int:
    """Leaves a mark and waits for leave to end."""
    Path(task.folder, f"{task.number}-{os.getpid()}").touch()
    while not Path(task.folder, "leave").exists():
        time.sleep(0.02)
    return task.number


def gone(pid: int) -> bool:
    """Whether a process has ended, even if nobody has asked for its status."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def results(work, tasks, size=2, stop=None, lost=lambda task, why: why):
    with Pool(size) as pool:
        return [r for r in pool.run(work, Agenda(tasks), stop or Stop(), lost) if r is not None]


def test_everything_is_done_once_in_processes_and_in_turn():
    expected = sorted(square(task) for task in TASKS)
    assert sorted(results(square, TASKS)) == expected
    assert sorted(in_turn(square, Agenda(TASKS), Stop())) == expected


def test_two_processes_keep_to_scenes_of_their_own_while_there_are_some():
    done = results(process_of, TASKS)
    switches = 0
    for pid in {pid for _, pid in done}:
        scenes = [scene for scene, own in done if own == pid]
        switches += sum(a != b for a, b in zip(scenes, scenes[1:], strict=False))
    assert switches <= 2  # three scenes and two processes: one more scene each at most


def test_processes_do_linear_algebra_in_one_thread_each_unless_told_otherwise(monkeypatch):
    for name in LIBRARIES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(LIBRARIES[0], "3")
    assert results(threads_of, TASKS[:1]) == [["3", *["1"] * (len(LIBRARIES) - 1)]]
    assert threads_of(TASKS[0]) == ["3", *[None] * (len(LIBRARIES) - 1)]


class Hand:
    """A process that is idle after an item of a scene, and takes note of what it is given."""

    def __init__(self, scene: str) -> None:
        self.item, self.last = None, (scene,)

    def give(self, work, item):
        self.item, self.last = item, item.point


def test_who_is_idle_at_the_same_time_keeps_its_scene():
    hands = [Hand("a"), Hand("b")]
    _hand_out(hands, square, Agenda([task for task in TASKS if task.scene != "a"]), Stop())
    assert [hand.last for hand in hands] == [("c",), ("b",)]


def test_an_item_goes_to_a_point_that_nobody_is_at():
    agenda = Agenda(TASKS)
    assert agenda.take(None, [("a",)]).scene == "b"
    assert agenda.take(("b",), [("a",)]).scene == "b"
    assert agenda.take(("x",), [("a",), ("b",)]).scene == "c"


@pytest.mark.slow
def test_what_a_killed_process_was_at_is_done_by_another(tmp_path):
    tasks = [Task("a", number, str(tmp_path)) for number in range(6)]
    assert sorted(results(die_at_first, tasks)) == list(range(6))
    assert (tmp_path / "dead").exists()


@pytest.mark.slow
def test_an_item_that_ends_every_process_is_given_up_and_the_others_are_done():
    told = results(die_of_two, [Task("a", number) for number in range(4)], lost=lambda task, why: (task.number, why))
    assert sorted(r for r in told if isinstance(r, int)) == [0, 1, 3]
    (given_up,) = (r for r in told if not isinstance(r, int))
    assert given_up == (2, f"the process died {TRIES} times (exit status 7)")


def test_one_wish_to_stop_waits_for_what_is_under_way(tmp_path):
    stop = Stop()
    tasks = [Task(str(number), number, str(tmp_path)) for number in range(5)]
    done = []
    with Pool(2) as pool:
        for result in pool.run(held, Agenda(tasks), stop, lambda task, why: None):
            if stop.asked == 0 and len(list(tmp_path.iterdir())) == 2:
                stop.ask()
                (tmp_path / "leave").touch()
            done += [] if result is None else [result]
    assert sorted(done) == [0, 1]
    assert len(list(tmp_path.glob("*-*"))) == 2


def test_two_wishes_to_stop_end_it_at_once_and_leave_no_process(tmp_path):
    stop, done = Stop(), []
    with Pool(2) as pool:
        for result in pool.run(held, Agenda([Task("a", 9, str(tmp_path))]), stop, lambda task, why: None):
            done += [] if result is None else [result]
            if list(tmp_path.iterdir()):
                stop.ask(2)
    assert done == []  # nobody gave it leave to end
    assert all(gone(int(mark.name.split("-")[1])) for mark in tmp_path.iterdir())


def test_in_turn_a_second_wish_is_an_interrupt():
    stop = Stop()
    results = in_turn(square, Agenda(TASKS), stop)
    assert next(results) == 0
    with pytest.raises(KeyboardInterrupt):
        stop.ask(2)
    assert list(results) == []


def test_ctrl_c_is_a_wish_and_afterwards_an_interrupt_again():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background ignores it
    try:
        with interruptible() as stop:
            signal.raise_signal(signal.SIGINT)  # in this thread, so that it is heard before the next line
            assert stop.asked == 1
            signal.raise_signal(signal.SIGTERM)
            assert stop.asked == 3
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


PARENT = """
import sys
from test_engine import Task, held
from sim.sweeps.engine import Agenda, Pool, Stop
if __name__ == "__main__":
    tasks = [Task(str(n), n, sys.argv[1]) for n in (8, 9)]
    with Pool(2) as pool:
        list(pool.run(held, Agenda(tasks), Stop(), lambda task, why: None))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_no_process_outlives_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    marks = tmp_path / "marks"
    marks.mkdir()
    parent = subprocess.Popen([sys.executable, script, marks], env=environment(Path(__file__).parent))
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
