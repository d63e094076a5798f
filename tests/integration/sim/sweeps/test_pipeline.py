"""Drives begin as soon as their own tree is there, and no more trees are kept than are needed."""

import heapq
import io
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pirrht.errors import PirrhtError
from sim.sweeps import runs
from sim.sweeps.engine import Agenda, Crew, Stop
from sim.sweeps.parts import key_of
from sim.sweeps.runs import Job, Planned, Task
from sim.sweeps.sweep import Progress, driven

TREE = b"wood"


def jobs(scenes: int, methods: tuple[str, ...] = ("pi-rrht", "passive"), seeds: int = 3) -> list[Job]:
    grid = product([f"s{k}" for k in range(scenes)], methods, range(seeds))
    return [Job(scene=scene, method=m, noise=0.1, seed=seed, given=()) for scene, m, seed in grid]


class Simulated:
    """A crew whose workers take as long as `seconds` says for each task; it takes note of what it is given."""

    def __init__(self, workers: int, seconds) -> None:
        self.workers, self.seconds, self.order = workers, seconds, []

    def run(self, work, agenda: Agenda, lost):
        busy: list[tuple[float, int, Task]] = []
        now = 0.0
        while agenda or busy:
            while agenda and len(busy) < self.workers:
                (task,) = agenda.take(self.workers, 1, {task.point for _, _, task in busy})
                self.order.append(task)
                heapq.heappush(busy, (now + self.seconds(task), len(self.order), task))
            now, _, task = heapq.heappop(busy)
            assert (task.planned is not None) == (task.job.needs_tree and not task.grows)
            if task.planned is not None:  # its tree is there until the last of its runs has ended
                assert Path(task.planned.tree).read_bytes() == TREE
            yield task, Planned(tree=TREE) if task.grows else lost(task, "")


def test_one_worker_drives_through_each_tree_before_it_grows_the_next(tmp_path):
    crew = Simulated(1, lambda task: 1.0)
    trees = [len(list(tmp_path.iterdir())) for _ in driven(jobs(3), crew, tmp_path)]
    order = [(task.job.scene, task.grows) for task in crew.order if task.job.needs_tree]
    assert order == [(f"s{k}", first) for k in range(3) for first in (True, False, False, False)]
    assert max(trees) == 1


@settings(max_examples=60)
@given(
    workers=st.integers(1, 6),
    scenes=st.integers(1, 9),
    methods=st.lists(st.sampled_from(["pi-rrht", "single", "passive", "mppi"]), min_size=1, unique=True),
    pace=st.lists(st.floats(0.1, 50.0), min_size=2, max_size=7),
)
def test_every_run_has_one_record_and_there_are_no_more_trees_than_workers_and_one(workers, scenes, methods, pace):
    wanted = jobs(scenes, tuple(methods))
    crew = Simulated(workers, lambda task: pace[crc32(repr(task.point).encode()) % len(pace)])
    keys, most = [], 0
    with TemporaryDirectory() as folder:
        for record, _ in driven(wanted, crew, Path(folder)):
            keys += [] if record is None else [key_of(record)]
            most = max(most, len(list(Path(folder).iterdir())))
        assert not list(Path(folder).iterdir())
    assert sorted(keys, key=str) == sorted((key_of(job.identity) for job in wanted), key=str)
    assert most <= workers + 1


def test_a_tree_that_cannot_be_had_costs_its_own_runs_only(monkeypatch):
    def grown(job):
        return Planned(**({"error": "no way"} if job.scene == "s0" else {"tree": TREE}))

    def drive(job, planned=None):
        if planned is not None and planned.error is not None:
            raise PirrhtError(planned.error)
        return {**job.identity, "outcome": "goal", "error": None}

    monkeypatch.setattr(runs, "grown", grown)
    monkeypatch.setattr(runs, "drive", drive)
    found = [record for record, _ in driven(jobs(2), Crew(Stop())) if record is not None]
    assert {(r["scene"], r["method"], r["seed"]) for r in found if r["error"]} == {
        ("s0", "pi-rrht", s) for s in range(3)
    }
    assert len(found) == 12


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_sees_runs_done_goals_and_trees_and_a_pipe_nothing(terminal, monkeypatch):
    stream = io.StringIO()
    stream.isatty = lambda: terminal
    monkeypatch.setattr("sys.stderr", stream)
    with Progress(8, [{"outcome": "goal"}], 2) as progress:
        progress.add(None, 1)
        for outcome in ("goal", "collision", "goal", None):
            progress.add({"outcome": outcome}, 2)
        progress.add(None, 2)
    shown = stream.getvalue()
    assert not terminal or all(part in shown for part in ("trees 1/2", "5/8", "goal 75%", "runs"))
    assert terminal or shown == ""
