"""Tasks on processes: each is done once, whatever happens to those who do them."""

import signal

import pytest
from tasks import Task, gone, held, square, threads_of

from sim.sweeps.engine import ENVIRONMENT, Agenda, Crew, Pool, Stop, interruptible

TASKS = [Task(scene, number) for scene in ("a", "b", "c") for number in range(4)]


def results(work, tasks, size=2, stop=None, lost=lambda task, why: why):
    with Pool(size, stop or Stop()) as pool:
        return [done[1] for done in pool.run(work, Agenda(tasks), lost) if done is not None]


def test_everything_is_done_once_in_processes_and_in_turn():
    expected = sorted(square(task) for task in TASKS)
    assert sorted(results(square, TASKS)) == expected
    assert sorted(r for _, r in Crew(Stop()).run(square, Agenda(TASKS), lambda task, why: why)) == expected


def test_a_task_is_of_a_point_that_nobody_is_at_and_of_the_first_if_all_are_taken():
    agenda = Agenda(TASKS)
    assert agenda.take(2, 1, [("a",)]) == [TASKS[4]]
    assert agenda.take(2, 1, [("a",), ("c",)]) == [TASKS[5]]
    assert agenda.take(2, 1, [("a",), ("b",), ("c",)]) == [TASKS[0]]
    agenda.add([TASKS[5]])
    assert agenda.take(2, 1) == [TASKS[5]]


def test_processes_do_linear_algebra_in_one_thread_each_unless_told_otherwise(monkeypatch):
    for name in ENVIRONMENT:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(ENVIRONMENT[0], "3")
    assert results(threads_of, TASKS[:1]) == [["3", *["1"] * (len(ENVIRONMENT) - 1)]]
    assert threads_of(TASKS[0]) == ["3", *[None] * (len(ENVIRONMENT) - 1)]


def test_one_wish_to_stop_waits_for_what_is_under_way(tmp_path):
    stop, done = Stop(), []
    tasks = [Task(str(number), number, str(tmp_path)) for number in range(5)]
    with Pool(2, stop) as pool:
        for result in pool.run(held, Agenda(tasks), lambda task, why: None):
            if stop.asked == 0 and len(list(tmp_path.iterdir())) == 2:
                stop.ask()
                (tmp_path / "leave").touch()
            done += [] if result is None else [result[1]]
    assert sorted(done) == [0, 1]
    assert len(list(tmp_path.glob("*-*"))) == 2


def test_two_wishes_to_stop_end_it_at_once_and_leave_no_process(tmp_path):
    stop, done = Stop(), []
    with Pool(2, stop) as pool:
        for result in pool.run(held, Agenda([Task("a", 9, str(tmp_path))]), lambda task, why: None):
            done += [] if result is None else [result]
            if list(tmp_path.iterdir()):
                stop.ask(2)
    assert done == []  # nobody gave it leave to end
    assert all(gone(int(mark.name.split("-")[1])) for mark in tmp_path.iterdir())


def test_in_turn_a_second_wish_is_an_interrupt():
    stop = Stop()
    with Crew(stop) as crew:
        results = crew.run(square, Agenda(TASKS), lambda task, why: why)
        assert next(results) == (TASKS[0], 0)
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
