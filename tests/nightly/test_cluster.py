"""Sweeps on a Dask cluster on this machine: equal results, whatever happens to workers and scheduler."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from repository import environment
from tasks import Task, die_of_two, slow, square

from pirrht.errors import OptionError, PirrhtError
from sim.cli import main
from sim.sweeps.dataset import Dataset
from sim.sweeps.engine import Agenda, Stop
from sim.sweeps.parts import RESULTS, key_of

distributed = pytest.importorskip("distributed")

from sim.sweeps.cluster import Cluster  # noqa: E402

pytestmark = pytest.mark.cluster
QUICK = ["--plant", "sde", "--period", "0.1", "--max-time", "1", "--samples", "20", "--vertices", "100"]


class Local:
    """A scheduler and two workers as processes of their own, of which each can be killed."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._processes = folder, list[subprocess.Popen[bytes]]()
        file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        deadline = time.monotonic() + 60.0
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        self.address: str = json.loads(file.read_text())["address"]
        for _ in range(2):
            self.add_worker()

    def add_worker(self) -> None:
        options = ["--nthreads", "1", "--no-dashboard", "--memory-limit", "0", "--local-directory", str(self._folder)]
        self._start("worker", self.address, *options, "--nanny")

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], "--host", "127.0.0.1", *words[1:]]
        with (self._folder / f"{len(self._processes)}.log").open("wb") as log:
            process = subprocess.Popen(command, env=environment(), stdout=log, stderr=log, start_new_session=True)
        self._processes.append(process)
        return process

    def end(self) -> None:
        for process in reversed(self._processes):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def local(tmp_path) -> Iterator[Local]:
    folder = tmp_path / "dask"
    folder.mkdir()
    known = Local(folder)
    yield known
    known.end()


def results(address: str, work, tasks, lost=lambda task, why: (task.number, why)):
    with Cluster(address, Stop()) as cluster:
        return [done[1] for done in cluster.run(work, Agenda(tasks), lost) if done is not None]


def test_everything_is_done_once_and_killers_are_given_up(local):
    tasks = [Task(scene, number) for scene in "ab" for number in range(30)]
    assert sorted(results(local.address, square, tasks)) == sorted(map(square, tasks))
    told = results(local.address, die_of_two, [Task("a", number) for number in range(5)])
    assert sorted(r for r in told if isinstance(r, int)) == [0, 1, 3, 4]
    assert [r for r in told if not isinstance(r, int)] == [(2, "the workers died")]


def test_a_sweep_has_the_same_rows_as_on_this_machine_though_a_worker_dies(local, tmp_path):
    words = ["sweep", "slit", "--methods", "pi-rrht,passive", "--noise", "0.1,0.3", "--seeds", "0:6", *QUICK]
    process = subprocess.Popen(
        [sys.executable, "-m", "sim.cli", *words, "-o", tmp_path / "cluster", "--scheduler", local.address],
        env=environment(),
    )
    try:
        deadline = time.monotonic() + 300.0
        while not list(tmp_path.glob("cluster/runs/part-*")) and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.05)
        os.killpg(local._processes[-1].pid, signal.SIGKILL)
        assert process.wait(timeout=300) == 0
    finally:
        process.kill()
        process.wait()
    assert main([*words, "-o", str(tmp_path / "pool")]) == 0

    def rows(folder: str) -> list[dict]:
        found = [{name: record[name] for name in RESULTS} for record in Dataset(tmp_path / folder).records()]
        return sorted(found, key=lambda row: repr(key_of(row)))

    assert len(rows("cluster")) == 24
    assert rows("cluster") == rows("pool")


def test_a_scheduler_that_is_gone_costs_one_line_and_what_was_finished_stays(local):
    tasks = [Task("a", number) for number in range(200)]
    done = []
    with Cluster(local.address, Stop()) as cluster, pytest.raises(PirrhtError, match="the scheduler is gone"):  # noqa: PT012
        for result in cluster.run(slow, Agenda(tasks), lambda task, why: None):
            done += [] if result is None else [result]
            if len(done) == 3:
                os.killpg(local.scheduler.pid, signal.SIGKILL)
    assert 3 <= len(done) < 200
    assert len(set(done)) == len(done)


def test_a_wish_to_stop_waits_for_the_batches_under_way(local):
    stop, done = Stop(), []
    with Cluster(local.address, stop) as cluster:
        for result in cluster.run(slow, Agenda([Task("a", n) for n in range(200)]), lambda task, why: None):
            done += [] if result is None else [result]
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
