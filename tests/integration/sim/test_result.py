"""Figures of a run agree, add up, and show when to doubt it; times hold no compiling."""

import gc
import json
from types import SimpleNamespace

import numpy as np
import pytest
from doors import door
from numba.core import event

from pirrht import Outcome, PathIntegral, Plan
from pirrht.estimation.factory import ProposalFactory
from pirrht.estimation.sampling import TUNING
from sim import rehearsal, tree_file
from sim.cli import main, plan_command
from sim.cli.parser import parser
from sim.drive.executor import Advance
from sim.drive.metrics import EpisodeMetrics, Frame, TimedPlan, ending
from sim.drive.result import FIGURES, explained
from sim.rehearsal import rehearse, small_of
from sim.scenario import Scenario, prepare
from sim.sweeps import runs
from sim.sweeps.parts import COLUMNS, row_of

PERIOD = 0.01


def advance(outcome: Outcome | None = None) -> Advance:
    return Advance(
        outcome=outcome, time=PERIOD, cost=0.25, length=0.02, clearance=0.3, states=np.array([[1.01, 2.5]]),
        controls=np.zeros((1, 2)), noise=np.zeros((1, 2)), attitudes=np.empty((1, 0)),
    )  # fmt: skip


@pytest.fixture
def metrics(slit: Scenario) -> EpisodeMetrics:
    return EpisodeMetrics(slit, slit.start, period=PERIOD, max_time=10.0)


def enter(metrics: EpisodeMetrics, ess: float | None = None, outcome: Outcome | None = None) -> Frame:
    estimate = None
    if ess is not None:
        estimate = SimpleNamespace(ess=ess, doubtful=ess < 10.0, value=8.0, class_weights={"0,0": 1.0})
    plan = Plan(
        state=np.array([1.0, 2.5]), times=np.array([0.0, 0.1]), references=(), ids=("0,0",), fallback=None,
        estimate=estimate, instead=np.zeros((1, 2)),
    )  # fmt: skip
    return metrics.frame(TimedPlan(plan=plan, plan_seconds=0.001), advance(outcome))


def test_periods_add_up_and_the_time_is_up_in_the_one_that_reaches_it(slit: Scenario):
    metrics = EpisodeMetrics(slit, slit.start, period=PERIOD, max_time=0.1)
    frames = [enter(metrics) for _ in range(10)]
    assert (frames[0].news, metrics.doubtful_plans, metrics.least_ess) == (None, 0, None)
    assert [f.step for f in frames] == list(range(10))
    assert [f.outcome for f in frames] == [None] * 9 + [Outcome.TIMEOUT]
    last = frames[-1]
    assert (last.end_time, last.cost, last.noisy_length) == pytest.approx((0.1, 2.5, 0.2))
    assert frames[0].clearance == pytest.approx(slit.space.clearance(slit.start))
    for outcome in (Outcome.GOAL, Outcome.COLLISION):  # counts more than the clock
        assert ending(advance(outcome), 99.0, max_time=0.1) is outcome
    assert ending(advance(), 0.09 - 1e-12, max_time=0.1) is Outcome.TIMEOUT


def test_every_figure_is_described_and_a_row_holds_those_of_the_json(metrics: EpisodeMetrics):
    assert all(figure in COLUMNS and figure.text in explained() for figure in FIGURES)
    for i in range(3):
        enter(metrics, 20.0 - i, Outcome.GOAL if i == 2 else None)
    result = metrics.json()
    assert [*result] == [*(figure.name for figure in FIGURES), "step_ms", "deadline_misses", "blocked"]
    row = row_of({"scene": "slit", **result})
    assert {name: row[name] for name in result if name in row} == {k: v for k, v in result.items() if k in row}
    assert row["timing_step_max_ms"] == result["step_ms"]["max"] == pytest.approx(1.0)
    assert (result["outcome"], result["executed_class"], result["least_ess"]) == ("goal", "0,0", 18.0)


def test_weak_plans_are_counted_and_reported_once_per_stretch(metrics: EpisodeMetrics):
    sizes = {0: 50.0, 10: 3.0, 11: 2.0, 12: 9.9, 60: 4.0, 400: 1.2}
    assert [line for line in [enter(metrics, sizes.get(i, 50.0)).news for i in range(401)] if line] == [
        "3.0 effective samples at 0.10 s: the control is a guess",
        "1.2 effective samples at 4.00 s: the control is a guess",
    ]
    assert (metrics.doubtful_plans, metrics.least_ess, metrics.least_ess_time) == (5, 1.2, pytest.approx(4.0))


def test_a_run_reports_how_many_of_its_plans_are_guesses(tmp_path, capsys, monkeypatch):
    """Plans draw their samples once, however weak they are."""
    monkeypatch.setitem(PathIntegral.__init__.__kwdefaults__, "tuning", TUNING._replace(first_plan=1, later_plan=1))
    file = tmp_path / "run.json"
    words = ["run", "slit", "--noise", "0.3", "--vertices", "80", "--max-time", "0.1", "--json", str(file)]
    assert main([*words, "--samples", "2"]) == 1
    said, known = capsys.readouterr().out, json.loads(file.read_text())
    assert known["doubtful_plans"] > 0
    weak = f"{known['doubtful_plans']} of 10 plans had fewer than 10 effective samples, the weakest"
    assert f"{weak} {known['least_ess']:.1f} at {known['least_ess_time']:.2f} s" in said
    assert said.count("the control is a guess") == 1
    assert known["path_length"] < known["noisy_path_length"]
    assert main([*words, "--samples", "400"]) == 1
    assert "effective samples" not in capsys.readouterr().out


def test_a_run_without_surviving_samples_does_not_blame_its_paths(capsys):
    words = "run slit --method mppi --noise 8 --samples 2 --horizon 1 --period 0.002 --max-time 0.004"
    assert main(words.split()) == 1
    said = capsys.readouterr()
    assert "blocked at 0.00 s: no sample survived; the last controls go on" in said.out + said.err
    assert "no sample survived for most of the time: try more --samples or less --noise" in said.out
    assert "no path" not in said.out + said.err


@pytest.mark.parametrize("stays", [False, True])
def test_the_robot_waits_for_who_stands_in_the_door_as_far_as_it_can_see(tmp_path, capsys, stays):
    result = tmp_path / "run.json"
    words = "--noise 0.05 --period 0.05 --samples 100 --vertices 600 --predict velocity --json"
    status = main(["run", door(tmp_path, stays=stays), *words.split(), str(result)])
    drive, shown = json.loads(result.read_text()), capsys.readouterr()
    assert (status, drive["outcome"]) == ((1, "timeout") if stays else (0, "goal"))
    assert drive["min_clearance"] > 0.0
    begin, end = drive["blocked"][0][0], drive["blocked"][-1][1]
    assert 0.0 < begin < 2.5
    assert end == pytest.approx(7.0, abs=0.1) if stays else 5.5 < end < 8.0
    assert drive["blocked_time"] == pytest.approx(sum(b - a for a, b in drive["blocked"]))
    assert drive["fallbacks"] == pytest.approx(drive["blocked_time"] / 0.05)
    said = shown.out + shown.err
    assert f"blocked at {begin:.2f} s: no " in said
    assert "; braking" in said
    assert stays or "going on" in said


def test_compiling_is_not_reported_as_planning(monkeypatch: pytest.MonkeyPatch, capsys):
    wall, notice, real = SimpleNamespace(now=0.0), plan_command.notice(), plan_command.planned
    happening = SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__="numba.np"))})

    def planned(scenario: Scenario):
        notice.on_start(happening)
        wall.now += 90.0
        notice.on_end(happening)
        return real(scenario)

    monkeypatch.setattr(plan_command, "time", SimpleNamespace(perf_counter=lambda: wall.now))
    monkeypatch.setattr(event, "timer", lambda: wall.now)
    monkeypatch.setattr(plan_command, "planned", planned)
    assert plan_command.plan(parser().parse_args(["plan", "slit", "--vertices", "60"])) == 0
    assert wall.now == 90.0
    assert "FCL calls, 0.00 s" in capsys.readouterr().out


def test_no_garbage_is_collected_while_a_run_compiles(monkeypatch: pytest.MonkeyPatch):
    notice = plan_command.Notice()
    notice.reported, notice.run = True, ("slit", {})
    monkeypatch.setattr(plan_command.rehearsal, "helper", lambda *of: None)
    happening = SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__="pirrht.one"))})
    try:
        notice.on_start(happening)
        assert not gc.isenabled()
        notice.finish()
        assert gc.isenabled()
        assert gc.get_freeze_count() > 0  # what compiling leaves behind is not searched again
    finally:
        gc.unfreeze()
        gc.enable()


def test_the_times_of_a_sweeps_runs_hold_no_compiling(monkeypatch: pytest.MonkeyPatch):
    wall = SimpleNamespace(now=0.0)

    def compile_for(scenario: Scenario, *, driving: bool = False) -> None:
        wall.now += 90.0

    monkeypatch.setattr(runs, "rehearse", compile_for)
    monkeypatch.setattr(runs, "time", SimpleNamespace(perf_counter=lambda: wall.now))
    given = runs.frozen({"vertices": 60, "samples": 11, "max_time": 0.02})  # of no other test's runs
    job = runs.Job(scene="slit", method="pi-rrht", noise=0.1, seed=0, given=given)
    planned = runs.grown(job)
    records = [runs.drive(job, planned) for _ in range(2)]
    assert wall.now == 180.0  # once for the tree, once for the kind of run
    assert [(r["plan_seconds"], r["drive_seconds"]) for r in records] == [(0.0, 0.0)] * 2


@pytest.mark.parametrize("method", ["pi-rrht", "mppi", "optimal"])
def test_a_rehearsal_leaves_everything_as_it_was_and_one_that_cannot_be_prevents_nothing(
    slit: Scenario, method: str, tmp_path, monkeypatch: pytest.MonkeyPatch
):
    scenario = slit.with_settings(method=method, samples=20, vertices=60)
    calls, tree = scenario.space.collision.calls, scenario.grown_tree()
    grown = scenario.space.collision.calls - calls
    rehearse(scenario, driving=True)
    again = scenario.grown_tree()
    assert scenario.space.collision.calls - calls == 2 * grown
    for name, one in (("first", tree), ("again", again)):
        with (tmp_path / name).open("wb") as stream:
            tree_file.save(one, stream)
    assert (tmp_path / "again").read_bytes() == (tmp_path / "first").read_bytes()
    monkeypatch.setattr(Scenario, "steering", lambda self: 1 / 0)  # a user's own that fails
    rehearse(scenario, driving=True)


@pytest.mark.parametrize("name", ["slit", "crossing"])
def test_a_rehearsal_plans_among_moving_bodies_where_some_move(name):
    """In a small room, with the settings' kinds of everything."""
    scenario = prepare(name)
    small = small_of(scenario)
    driver = small.driver(small.grown_tree())
    driver.begin(small.start)
    assert driver.path_integral.moving == small.moving == bool(scenario.loaded.scene.movers)
    assert driver.plan(small.start).estimate is not None


@pytest.mark.parametrize("name", ["slit", "crossing"])
def test_another_process_compiles_what_a_plan_samples_before_what_it_rests_on(name, monkeypatch: pytest.MonkeyPatch):
    """Else it soon waits for the command, which makes a tree meanwhile, and then that waits for it."""
    made: list[str] = []
    climbing = ProposalFactory.climbing

    def ascent(self: ProposalFactory, *given, **more):
        made.append("ascent")
        return climbing(self, *given, **more)

    monkeypatch.setattr(ProposalFactory, "climbing", ascent)
    monkeypatch.setattr(rehearsal, "rehearse", lambda *_, **__: made.append("tree"))
    rehearsal.compile_last(name, {})
    assert (made[0], made[-1]) == ("ascent", "tree")
