"""Drives begin as soon as their own tree is there, and no more trees are kept than are needed."""

from __future__ import annotations

import heapq
import io
from collections.abc import Iterator
from pathlib import Path
from zlib import crc32

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pirrht.errors import PirrhtError
from sim.sweeps import runs, sweep
from sim.sweeps.engine import Agenda, Stop, in_turn
from sim.sweeps.parts import KEY
from sim.sweeps.runs import Errand, Job, Planned, Survey
from sim.sweeps.sweep import Grown, Pipeline, Progress

TREE = b"wood"


def jobs(scenes: int, methods: tuple[str, ...] = ("pi-rrht", "passive"), seeds: int = 3) -> list[Job]:
    return [
        Job(scene=f"s{scene}", method=method, noise=0.1, seed=seed, task=(), given=())
        for scene in range(scenes)
        for method in methods
        for seed in range(seeds)
    ]


def done(item: Survey | Errand):
    """What a worker would answer."""
    if isinstance(item, Survey):
        return Grown(place=item.job.place, planned=Planned(tree=TREE))
    needs = runs.needs_tree(item.job)
    assert (item.planned is not None) == needs
    if needs and isinstance(item.planned.tree, str):
        assert Path(item.planned.tree).read_bytes() == TREE  # there until the last of its runs has ended
    return runs.failure(item.job, "")


def name(item: Survey | Errand) -> str:
    return f"{item.job.scene}{'*' if isinstance(item, Survey) else ''}"


def simulated(workers: int, seconds) -> sweep.Crew:
    """A crew whose workers take as long as `seconds` says for each item."""

    def crew(work, agenda: Agenda, lost) -> Iterator:
        busy: list[tuple[float, int, object]] = []
        last: dict[int, tuple] = {}
        now = 0.0
        while agenda or busy:
            for k in sorted(set(range(workers)) - {k for _, k, _ in busy}):
                if agenda:
                    item = agenda.take(last.get(k), [last[other] for _, other, _ in busy])
                    last[k] = item.point
                    heapq.heappush(busy, (now + seconds(item), k, item))
            now, _, item = heapq.heappop(busy)
            yield done(item)

    return crew


def test_one_worker_drives_through_each_tree_before_it_grows_the_next(tmp_path):
    order, most = [], 0
    flow = Pipeline(jobs(3), tmp_path)

    def crew(work, agenda, lost):
        for item in iter(lambda: agenda.take(order[-1].point if order else None, ()) if agenda else None, None):
            order.append(item)
            yield done(item)

    records = []
    for record in flow.run(crew):
        records += [] if record is None else [record]
        most = max(most, flow.trees)
    told = [name(item) for item in order]
    assert [told.index(f"s{k}*") for k in range(3)] == sorted(told.index(f"s{k}*") for k in range(3))
    for k in range(3):
        grown = told.index(f"s{k}*")
        following = [item for item in order[grown + 1 :] if runs.needs_tree(item.job)][:3]
        assert [name(item) for item in following] == 3 * [f"s{k}"]
    assert most == 1
    assert len(records) == 18
    assert not list(tmp_path.iterdir())


@settings(max_examples=60)
@given(
    workers=st.integers(1, 6),
    scenes=st.integers(1, 9),
    methods=st.lists(st.sampled_from(["pi-rrht", "single", "passive", "mppi"]), min_size=1, unique=True),
    pace=st.lists(st.floats(0.1, 50.0), min_size=2, max_size=7),
)
def test_every_run_has_one_record_and_there_are_no_more_trees_than_workers_and_one(workers, scenes, methods, pace):
    wanted = jobs(scenes, tuple(methods))
    flow = Pipeline(wanted, None)
    crew = simulated(workers, lambda item: pace[crc32(repr(item.point).encode()) % len(pace)])
    keys, most = [], 0
    for record in flow.run(crew):
        keys += [] if record is None else [tuple(record[k] for k in KEY)]
        most = max(most, flow.trees)
    assert sorted(keys, key=str) == sorted((tuple(runs.failure(j, "")[k] for k in KEY) for j in wanted), key=str)
    assert most <= workers + 1
    assert flow.trees == 0


def test_a_tree_that_cannot_be_had_costs_its_own_runs_only(monkeypatch):
    def survey(wish):
        planned = Planned(error="no way") if wish.job.scene == "s0" else Planned(tree=TREE)
        return wish.job.place, planned

    def drive(job, planned=None):
        if planned is not None and planned.error is not None:
            raise PirrhtError(planned.error)
        return {**runs.failure(job, ""), "outcome": "goal"}

    monkeypatch.setattr(runs, "survey", survey)
    monkeypatch.setattr(runs, "drive", drive)
    found = Pipeline(jobs(2), None).run(lambda work, agenda, lost: in_turn(work, agenda, Stop()))
    errors = {(r["scene"], r["method"], r["seed"]): r["error"] for r in found if r is not None}
    assert {key for key, error in errors.items() if error} == {("s0", "pi-rrht", seed) for seed in range(3)}
    assert len(errors) == 12


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_sees_runs_done_goals_and_trees_and_a_pipe_nothing(terminal, monkeypatch):
    stream = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    with Progress(8, [{"outcome": "goal"}], 2) as progress:
        progress.add(None, 1)
        for outcome in ("goal", "collision", "goal", None):
            progress.add({"outcome": outcome}, 2)
        progress.add(None, 2)
    told = stream.getvalue()
    assert not terminal or all(part in told for part in ("trees 1/2", "5/8", "goal 75%", "runs"))
    assert terminal or told == ""
