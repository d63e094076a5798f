"""Sweeps on a Dask cluster on this machine: equal results, whatever happens to workers and scheduler."""

import json
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from integration.test_sweep import QUICK, rows
from repository import environment
from tasks import Task, die_of_two, slow, square, wait_for

from pirrht.errors import OptionError, PirrhtError
from sim.cli import main
from sim.sweeps.engine import Agenda, Stop

distributed = pytest.importorskip("distributed")

from sim.sweeps.cluster import Cluster  # noqa: E402

pytestmark = pytest.mark.cluster


@pytest.fixture
def local(tmp_path):
    """A scheduler and two workers as processes of their own, of which each can be killed."""
    folder, processes = tmp_path / "dask", list[subprocess.Popen[bytes]]()
    folder.mkdir()
    file = folder / "scheduler.json"

    def start(kind: str, options: str) -> None:
        command = f"{sys.executable} -m distributed.cli.dask_{kind} --host 127.0.0.1 --no-dashboard {options}".split()
        with (folder / f"{len(processes)}.log").open("wb") as log:
            process = subprocess.Popen(command, env=environment(), stdout=log, stderr=log, start_new_session=True)
        processes.append(process)

    def kill(number: int) -> None:
        if processes[number].poll() is None:
            os.killpg(processes[number].pid, signal.SIGKILL)
        processes[number].wait()

    start("scheduler", f"--port 0 --scheduler-file {file}")
    wait_for(file.exists, 60.0)
    address = json.loads(file.read_text())["address"]
    for _ in range(2):
        start("worker", f"{address} --nthreads 1 --memory-limit 0 --local-directory {folder} --nanny")
    yield SimpleNamespace(address=address, kill_scheduler=lambda: kill(0), kill_worker=lambda: kill(2))
    for number in (2, 1, 0):
        kill(number)


def results(address: str, work, tasks, lost=lambda task, why: (task.number, why)):
    with Cluster(address, Stop()) as cluster:
        return [done[1] for done in cluster.run(work, Agenda(tasks), lost) if done is not None]


def test_everything_is_done_once_and_killers_are_given_up(local):
    tasks = [Task(scene, number) for scene in "ab" for number in range(30)]
    assert sorted(results(local.address, square, tasks)) == sorted(map(square, tasks))
    told = results(local.address, die_of_two, [Task("a", number) for number in range(5)])
    assert sorted(told, key=str) == [(2, "the workers died"), 0, 1, 3, 4]


def test_a_sweep_has_the_same_rows_as_on_this_machine_though_a_worker_dies(local, tmp_path):
    words = ["sweep", "slit", "--methods", "pi-rrht,passive", "--noise", "0.1,0.3", "--seeds", "0:6", *QUICK]
    process = subprocess.Popen(
        [sys.executable, "-m", "sim.cli", *words, "-o", tmp_path / "cluster", "--scheduler", local.address],
        env=environment(),
    )
    try:
        wait_for(lambda: list(tmp_path.glob("cluster/runs/part-*")) or process.poll() is not None)
        local.kill_worker()
        assert process.wait(timeout=300) == 0
    finally:
        process.kill()
        process.wait()
    assert main([*words, "-o", str(tmp_path / "pool")]) == 0
    assert len(rows(tmp_path / "cluster")) == 24
    assert rows(tmp_path / "cluster") == rows(tmp_path / "pool")


def test_a_scheduler_that_is_gone_costs_one_line_and_what_was_finished_stays(local):
    tasks, done = [Task("a", number) for number in range(200)], []
    with Cluster(local.address, Stop()) as cluster, pytest.raises(PirrhtError, match="the scheduler is gone"):  # noqa: PT012
        for result in cluster.run(slow, Agenda(tasks), lambda task, why: None):
            done += [] if result is None else [result[1]]
            if len(done) == 3:
                local.kill_scheduler()
    assert 3 <= len(done) < 200
    assert len(set(done)) == len(done)


def test_a_wish_to_stop_waits_for_the_batches_under_way(local):
    stop, done = Stop(), []
    with Cluster(local.address, stop) as cluster:
        for result in cluster.run(slow, Agenda([Task("a", n) for n in range(200)]), lambda task, why: None):
            done += [] if result is None else [result[1]]
            if len(done) == 1:
                stop.ask()
    assert 1 <= len(done) < 100


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x", "foo", "tcp://127.0.0.1:99999"])
def test_no_scheduler_costs_one_line(address, monkeypatch):
    monkeypatch.setattr("sim.sweeps.cluster.REACHABLE", 0.5)
    with pytest.raises(OptionError, match="no scheduler answers there") as caught:
        Cluster(address, Stop())
    assert "\n" not in str(caught.value)


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(OptionError, match=r"pirrht\[cluster\]"):
        Cluster("tcp://127.0.0.1:8786", Stop())
