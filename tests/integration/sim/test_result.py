"""One record of a drive: what tells of it agrees, adds up, and says when to doubt it."""

from __future__ import annotations

import json
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pirrht.control.plan import Plan
from pirrht.outcome import Outcome
from sim.cli import main, plan_command, shared
from sim.drive.episode import Frame, Tally
from sim.drive.odometer import Odometer, ending
from sim.drive.plant import Advance
from sim.drive.result import FIGURES, DriveResult, explained
from sim.rehearsal import rehearse, small_of
from sim.scenario import Scenario, prepare
from sim.sweeps import runs
from sim.sweeps.parts import COLUMNS, row_of

PERIOD = 0.01


def advance(outcome: Outcome | None = None, **changes: Any) -> Advance:
    known: dict[str, Any] = {"time": PERIOD, "cost": 0.25, "length": 0.02, "clearance": 0.3}
    known |= {"states": np.array([[1.01, 2.5]]), "controls": np.zeros((1, 2)), "noise": np.zeros((1, 2))}
    return Advance(outcome=outcome, **{**known, **changes})


def plan(ess: float | None = None) -> Plan:
    estimate = (
        None if ess is None else SimpleNamespace(ess=ess, doubtful=ess < 10.0, value=8.0, class_weights={"0,0": 1.0})
    )
    return Plan(
        state=np.array([1.0, 2.5]), times=np.array([0.0, 0.1]), references=(), ids=("0,0",), fallback=None,
        estimate=estimate, instead=np.zeros((1, 2)),
    )  # fmt: skip


def frame(step: int, ess: float | None = None, outcome: Outcome | None = None) -> Frame:
    return Frame(
        step=step, time=step * PERIOD, plan=plan(ess), advance=advance(outcome), outcome=outcome, cost=1.0, length=1.0,
        noisy_length=2.0, clearance=0.2, driven_class=(0, 0), plan_seconds=0.001,
    )  # fmt: skip


# -- the odometer ------------------------------------------------------------------------------------------------


def test_periods_add_up_and_the_time_is_up_in_the_one_that_reaches_it(slit: Scenario):
    odometer = Odometer(slit.problem, slit.space, slit.start, max_time=0.1)
    frames = [odometer.frame(plan(), advance(), seconds=0.5) for _ in range(10)]
    assert [f.step for f in frames] == list(range(10))
    assert [f.outcome for f in frames] == [None] * 9 + [Outcome.TIMEOUT]
    assert frames[-1].end_time == pytest.approx(0.1)
    assert frames[-1].cost == pytest.approx(2.5)
    assert frames[-1].noisy_length == pytest.approx(0.2)
    assert frames[0].clearance == pytest.approx(slit.space.clearance(slit.start))


@pytest.mark.parametrize("outcome", [Outcome.GOAL, Outcome.COLLISION])
def test_what_happens_in_the_last_period_counts_more_than_the_clock(outcome: Outcome):
    assert ending(advance(outcome), 99.0, max_time=0.1) is outcome
    assert ending(advance(), 0.08, max_time=0.1) is None
    assert ending(advance(), 0.09 - 1e-12, max_time=0.1) is Outcome.TIMEOUT


# -- the record --------------------------------------------------------------------------------------------------


def test_every_figure_is_described_and_is_a_column_of_a_sweep():
    told = {f.name for f in fields(DriveResult)} - {"step_ms", "deadline_misses", "real_time", "blocked"}
    assert {figure.name for figure in FIGURES} == told
    assert all(figure in COLUMNS for figure in FIGURES)
    assert all(figure.text in explained() for figure in FIGURES)


def test_a_row_holds_what_the_json_tells():
    tally = Tally(PERIOD)
    for i in range(3):
        tally.add(frame(i, 20.0 - i, Outcome.GOAL if i == 2 else None))
    told = tally.result()
    row = row_of({"scene": "slit", **told})
    assert {name: row[name] for name in told if name in row} == {k: v for k, v in told.items() if k in row}
    assert row["timing_step_max_ms"] == told["step_ms"]["max"] == pytest.approx(1.0)
    assert (told["outcome"], told["executed_class"], told["least_ess"]) == ("goal", "0,0", 18.0)
    assert "real_time" not in told


# -- doubt -------------------------------------------------------------------------------------------------------


def test_weak_plans_are_counted_and_told_of_once_per_stretch():
    tally, news = Tally(PERIOD), []
    sizes = {0: 50.0, 10: 3.0, 11: 2.0, 12: 9.9, 60: 4.0, 400: 1.2}
    for i in range(401):
        news.append(tally.add(frame(i, sizes.get(i, 50.0))))
    told = [line for line in news if line]
    assert told == [
        "3.0 effective samples at 0.10 s: the control is a guess",
        "1.2 effective samples at 4.00 s: the control is a guess",
    ]
    result = tally.drive()
    assert (result.doubtful_plans, result.least_ess, result.least_ess_time) == (5, 1.2, pytest.approx(4.0))


def test_policies_without_samples_are_not_doubted():
    tally = Tally(PERIOD)
    assert tally.add(frame(0)) is None
    assert (tally.drive().doubtful_plans, tally.drive().least_ess) == (0, None)


def test_a_drive_says_how_many_of_its_plans_are_guesses(tmp_path, capsys):
    file = tmp_path / "run.json"
    words = ["run", "slit", "--noise", "0.3", "--vertices", "80", "--max-time", "0.1", "--json", str(file)]
    assert main([*words, "--samples", "2"]) == 1
    told, known = capsys.readouterr().out, json.loads(file.read_text())
    assert known["doubtful_plans"] > 0
    weak = f"{known['doubtful_plans']} of 10 plans on fewer than 10 effective samples, the weakest on"
    assert f"{weak} {known['least_ess']:.1f} at {known['least_ess_time']:.2f} s" in told
    assert told.count("the control is a guess") == 1
    assert known["path_length"] < known["noisy_path_length"]
    assert main([*words, "--samples", "400"]) == 1
    assert "effective samples" not in capsys.readouterr().out


# -- what times hold ---------------------------------------------------------------------------------------------


class Compiler:
    """A clock, and a rehearsal that takes a minute and a half by it."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self, scenario: Scenario, *, driving: bool = False) -> None:
        self.now += 90.0

    def perf_counter(self) -> float:
        return self.now


def test_compiling_is_not_told_as_planning(monkeypatch: pytest.MonkeyPatch, capsys):
    wall, notice, real = Compiler(), shared.notice(), plan_command.planned
    kernel = SimpleNamespace(py_func=SimpleNamespace(__module__="numba.np"))

    def planned(scenario: Scenario) -> Any:
        notice.on_start(SimpleNamespace(data={"dispatcher": kernel}))
        wall.now += 90.0
        notice.on_end(SimpleNamespace(data={"dispatcher": kernel}))
        return real(scenario)

    monkeypatch.setattr(shared, "time", wall)
    monkeypatch.setattr(plan_command, "planned", planned)
    assert plan_command.plan(_arguments("plan slit --vertices 60")) == 0
    assert wall.now == 90.0
    assert "FCL calls, 0.00 s" in capsys.readouterr().out


def _arguments(line: str) -> Any:
    from sim.cli.parser import parser

    return parser().parse_args(line.split())


def test_a_sweeps_times_hold_no_compiling(monkeypatch: pytest.MonkeyPatch):
    compiler = Compiler()
    monkeypatch.setattr(runs, "rehearse", compiler)
    monkeypatch.setattr(runs, "time", compiler)
    monkeypatch.setattr(runs, "_rehearsed", set())
    task = tuple((name, None) for name in ("robot", "radius", "start", "goal", "preset"))
    given = (("vertices", 60), ("samples", 10), ("max_time", 0.02))
    job = runs.Job(scene="slit", method="pi-rrht", noise=0.1, seed=0, task=task, given=given)
    _, planned = runs.survey(runs.Survey(job=job))
    record = runs.drive(job, planned)
    assert compiler.now == 180.0
    assert (record["plan_seconds"], record["drive_seconds"]) == (0.0, 0.0)
    runs.drive(job, planned)
    assert compiler.now == 180.0  # once per kind of drive


def test_a_rehearsal_that_cannot_be_prevents_nothing(slit: Scenario, monkeypatch: pytest.MonkeyPatch):
    def fails(self: Scenario, *_: object) -> None:
        raise ValueError("a user's own steering")

    monkeypatch.setattr(Scenario, "steering", fails)
    rehearse(slit, driving=True)


@pytest.mark.parametrize("method", ["pi-rrht", "mppi", "optimal"])
def test_a_rehearsal_leaves_everything_as_it_was(slit: Scenario, method: str):
    scenario = slit.with_settings(method=method, samples=20, vertices=60)
    calls, tree = scenario.space.collision.calls, scenario.grown_tree()
    grown = scenario.space.collision.calls - calls
    rehearse(scenario, driving=True)
    again = scenario.grown_tree()
    assert scenario.space.collision.calls - calls == 2 * grown
    assert runs.pack(again) == runs.pack(tree)


@pytest.mark.parametrize("name", ["slit", "crossing"])
def test_a_rehearsal_plans_among_moving_bodies_where_some_move(name):
    """In a small room, with the settings' kinds of everything."""
    small = small_of(prepare(name))
    driver = small.driver(small.grown_tree())
    driver.begin(small.start)
    assert driver.path_integral.moving == small.moving == bool(prepare(name).loaded.scene.movers)
    assert driver.plan(small.start).estimate is not None
