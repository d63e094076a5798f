"""Real-time drives, on a clock that is told how long everything takes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import NoReference
from pirrht.estimation.estimate import Rollouts
from pirrht.moving.collision import MovingObstacles
from pirrht.outcome import Outcome
from pirrht.planner.tree import HomologyTree
from pirrht.topology.homology import Driven
from sim.cli import main
from sim.drive import realtime
from sim.drive.episode import Frame, Tally
from sim.drive.plant import Analytic
from sim.drive.realtime_planner import BEHIND, MOST, Handover, Planner, Ready, foreseen
from sim.scenario import Scenario, prepare

PERIOD, STEP = 0.1, 0.01


class FakeClock:
    """Jumps to the next waking as soon as the threads of plant and planner both wait; then only one of them runs.

    Of threads that wake at the same time the plant's is the first.
    """

    def __init__(self) -> None:
        self._now, self._turn = 100.0, threading.Condition()
        self._waiting: dict[str, float] = {}
        self._known: dict[str, threading.Thread] = {}

    def now(self) -> float:
        return self._now

    def wait(self, until: float) -> None:
        me = threading.current_thread()
        if me is threading.main_thread():
            self._now = max(self._now, until)
            return
        with self._turn:
            self._known[me.name] = me
            self._waiting[me.name] = until
            while self._next() != me.name:
                self._turn.wait(0.002)  # a thread that has ended tells nobody
            self._now = max(self._now, self._waiting.pop(me.name))

    def _next(self) -> str | None:
        busy = [name for name, t in self._known.items() if t.is_alive() and name not in self._waiting]
        if len(self._known) < 2 or busy:
            return None
        return min(self._waiting, key=lambda name: (self._waiting[name], name != "plant"))


class FakeDriver:
    """Plans take the time that they are told to, if they have a limit; the law of plan i steers i+1 cm/s aside."""

    tree = None

    def __init__(self, scenario: Scenario, clock: FakeClock, seconds: Callable[[int], float]) -> None:
        self.problem, self.space, self.homology = scenario.problem, scenario.space, scenario.homology
        self.clock, self.seconds = clock, seconds
        self.made: list[Array] = []
        self.left: list[float] = []
        self.elapsed: list[float] = []

    def begin(self, x: Array) -> None:
        self._driven, self.time = Driven(self.homology, x), 0.0
        self.made, self.left, self.elapsed = [], [], []

    def observe(self, states: Array, duration: float, until: float | None = None) -> None:
        self.time += duration
        self._driven.observe(states, self.time if until is None else until)

    def expect(self, states: Array, duration: float) -> None:
        self.time += duration
        self._driven.expect(states, self.time)
        self.elapsed.append(duration)

    def driven_class(self) -> tuple[int, ...]:
        return self._driven.winding()

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        i = len(self.made)
        if left is not None:
            self.made.append(x)
            self.left.append(left())
            self.clock.wait(self.clock.now() + self.seconds(i))
        u = np.array([0.01 * (i + 1), 0.0])
        return Plan(
            state=x, times=np.array([0.0, 0.1]), references=(), ids=(), estimate=None, fallback=None,
            instead=u[None], law=lambda state, s: u,
        )  # fmt: skip


def drive(
    scenario: Scenario, seconds: Callable[[int], float], periods: int = 6
) -> tuple[list[Frame], FakeDriver, Tally]:
    clock = FakeClock()
    driver = FakeDriver(scenario, clock, seconds)
    quiet = scenario.with_settings(noise=1e-6)
    plant = Analytic(quiet.problem, lambda points: np.ones(len(points)), period=PERIOD, physics_step=STEP)
    rng, tally = np.random.default_rng(0), Tally(PERIOD)
    frames = []
    for frame in realtime.run(
        plant, driver, scenario.start, rng, period=PERIOD, max_time=periods * PERIOD, clock=clock
    ):
        tally.add(frame)
        frames.append(frame)
    return frames, driver, tally


def controls(frames: list[Frame]) -> Array:
    """Which plan steered at every physics step, by its number; (k,)."""
    return np.rint(100 * np.concatenate([frame.advance.controls[:, 0] for frame in frames])).astype(int)


def test_fast_plans_take_over_when_their_period_begins(slit: Scenario):
    frames, driver, tally = drive(slit, lambda i: 0.05)
    assert [frame.step for frame in frames] == list(range(6))
    assert [frame.outcome for frame in frames] == [None] * 5 + [Outcome.TIMEOUT]
    np.testing.assert_array_equal(controls(frames), np.repeat(np.arange(1, 7), 10))
    timing = tally.result()["real_time"]
    assert tally.misses == timing["deadline_misses"] == 0
    assert timing["periods"] == 6
    assert timing["slack_ms"]["min"] == pytest.approx(50.0)
    assert timing["late_ms"]["max"] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(driver.elapsed, PERIOD)


def test_plans_are_made_for_the_state_in_which_they_take_over(slit: Scenario):
    frames, driver, _ = drive(slit, lambda i: 0.05)
    for frame, planned in zip(frames, driver.made, strict=False):
        np.testing.assert_allclose(planned, frame.plan.state, atol=1e-6)
    assert driver.left == pytest.approx([0.07] * len(driver.left))


def test_a_slow_plan_is_a_miss_and_the_old_law_goes_on_until_it_is_there(slit: Scenario):
    frames, _, tally = drive(slit, lambda i: 0.125 if i == 2 else 0.02)
    # Plan 2, begun at 0.1 for 0.2, is ready at 0.225; plan 3, begun then for 0.3, is ready in time.
    expected = np.repeat([1, 2, 3, 4, 5, 6], [10, 13, 7, 10, 10, 10])
    np.testing.assert_array_equal(controls(frames), expected)
    assert [frame.timing.missed for frame in frames if frame.timing] == [False, False, True, False, False, False]
    assert tally.misses == 1
    assert tally.result()["deadline_misses"] == 1
    assert frames[2].plan.control == pytest.approx([0.02, 0.0])


def test_a_planner_that_never_keeps_up_misses_almost_all(slit: Scenario):
    frames, driver, tally = drive(slit, lambda i: 0.0 if i < 1 else 0.25, periods=10)
    assert tally.misses == 9 - sum(not frame.timing.missed for frame in frames[1:] if frame.timing)
    assert tally.misses >= 7
    assert len(driver.made) <= 6
    assert np.all(np.diff(controls(frames)) >= 0)  # no older plan takes over again


def test_errors_of_either_thread_end_the_drive(slit: Scenario):
    def fails(i: int) -> float:
        if i == 3:
            raise NoReference([0.0, 0.0], vertices=1, limit=0.6)
        return 0.01

    with pytest.raises(NoReference):
        drive(slit, fails)
    assert not {"plant", "planner"} & {thread.name for thread in threading.enumerate()}


def test_a_drive_that_is_given_up_leaves_no_thread_behind(slit: Scenario):
    clock = FakeClock()
    driver = FakeDriver(slit, clock, lambda i: 0.01)
    plant = Analytic(slit.problem, lambda points: np.ones(len(points)), period=PERIOD, physics_step=STEP)
    frames = realtime.run(plant, driver, slit.start, np.random.default_rng(0), period=PERIOD, max_time=5.0, clock=clock)
    next(frames)
    frames.close()
    assert not {"plant", "planner"} & {thread.name for thread in threading.enumerate()}


def test_a_plant_that_is_late_is_foreseen_in_no_more_steps(slit: Scenario):
    driver = FakeDriver(slit, FakeClock(), lambda i: 0.0)
    plan = driver.plan(slit.start)
    ready = Ready(plan=plan, begin=0.0, seconds=0.0, slack=0.0, samples=0, vertices=0)
    states = foreseen(driver, ready, 0.0, slit.start, 1.0, 0.01)
    assert len(states) == MOST + 1
    np.testing.assert_allclose(states[-1], slit.start + np.array([0.01, 0.0]), atol=1e-12)


def test_what_is_foreseen_ends_before_the_goal(slit: Scenario):
    driver = FakeDriver(slit, FakeClock(), lambda i: 0.0)
    goal, u = slit.problem.scene.goal, np.array([1.0, 0.0])
    plan = Plan(
        state=goal.center, times=np.array([0.0, 9.0]), references=(), ids=(), estimate=None, fallback=None,
        instead=u[None],
    )  # fmt: skip
    ready = Ready(plan=plan, begin=0.0, seconds=0.0, slack=0.0, samples=0, vertices=0)
    x = goal.center - [goal.radius + 0.035, 0.0]
    states = foreseen(driver, ready, 0.0, x, 0.1, 0.01)
    np.testing.assert_allclose(states, [x + k * 0.01 * u for k in range(4)])
    far = foreseen(driver, ready, 0.05, slit.start, 0.1, 0.01)
    np.testing.assert_allclose(far[-1], slit.start + 0.05 * u)
    np.testing.assert_array_equal(foreseen(driver, ready, 0.2, slit.start, 0.1, 0.01), [slit.start])  # too late


def test_what_was_expected_gives_way_to_what_was_driven(slit: Scenario):
    homology = slit.space.homology
    plain, doubtful = (Driven(homology, slit.start) for _ in range(2))
    there, loop = np.array([[1.2, 2.5]]), np.array([[4.5, 2.5], [4.5, 3.5], [2.3, 3.5], [1.0, 2.5]])
    doubtful.expect(loop)
    doubtful.expect(loop)
    assert doubtful.winding() == (1, 0)
    for one in (plain, doubtful):
        one.observe(there)
    assert plain.winding() == doubtful.winding() == (0, 0)


class Growing:
    """A tree whose vertices take 2 ms each."""

    def __init__(self, clock: FakeClock) -> None:
        self.size, self._clock = 10, clock

    def grow(self, size: int, enough: Callable[[int], bool] | None = None) -> None:
        self._clock.wait(self._clock.now() + 0.002 * (size - self.size))
        self.size = size


@pytest.mark.parametrize(("grow", "expected"), [(None, 9), (5, 5), (0, 0)])
def test_the_tree_grows_in_the_time_that_is_left(slit: Scenario, grow: int | None, expected: int):
    clock = FakeClock()
    driver = FakeDriver(slit, clock, lambda i: 0.0)
    driver.tree = Growing(clock)  # type: ignore[assignment]
    planner = Planner(driver, clock, PERIOD, grow)
    share = Handover(planner.first(slit.start), slit.start)
    planner._grow(share, clock.now(), clock.now() + 0.02)
    assert driver.tree.size == 10 + expected  # type: ignore[attr-defined]
    assert clock.now() <= 100.0 + 0.02


def test_the_tree_does_not_grow_while_the_plant_is_late(slit: Scenario):
    clock = FakeClock()
    driver = FakeDriver(slit, clock, lambda i: 0.0)
    driver.tree = Growing(clock)  # type: ignore[assignment]
    planner = Planner(driver, clock, PERIOD, None)
    share = Handover(planner.first(slit.start), slit.start)
    planner._grow(share, clock.now() - 1.01 * BEHIND * PERIOD, clock.now() + 0.02)
    assert driver.tree.size == 10  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("lasted", "left"),
    [
        ([0.12] * 4, [0.07, 0.0375, 0.0375, 0.03]),  # 50 ms after the samples' time is up, and then 82.5
        ([0.05, 0.05, 0.12, 0.05, 0.05], [0.07] * 5),  # one that was disturbed is no rule
    ],
)
def test_time_is_kept_for_what_usually_follows_the_samples(slit: Scenario, lasted: list[float], left: list[float]):
    clock = FakeClock()
    driver = FakeDriver(slit, clock, lambda i: lasted[len(found)])
    planner = Planner(driver, clock, PERIOD, None)
    found: list[float] = []
    for _ in lasted:
        planner.first(slit.start)
        found += driver.left
    assert found == pytest.approx(left)


@pytest.mark.parametrize("seconds", [0.0, 0.05, 1.0])
def test_samples_are_drawn_until_their_time_is_up(
    slit: Scenario, slit_tree: HomologyTree, monkeypatch: pytest.MonkeyPatch, seconds: float
):
    """A sample takes 0.1 ms here; the first round has 36 of them, since two classes are promised nearly nothing."""
    controller = slit.with_settings(samples=20).controller(slit_tree)
    spent, rollout = [0.0], controller.path_integral.rollout

    def timed(*arguments: Any, **options: Any) -> Rollouts:
        rollouts = rollout(*arguments, **options)
        spent[0] += 1e-4 * rollouts.size
        return rollouts

    monkeypatch.setattr(controller.path_integral, "rollout", timed)
    estimate = controller.plan(slit.start, lambda: seconds - spent[0]).estimate
    assert estimate is not None
    drawn = sum(part.size for part in estimate.parts)
    assert 36 <= drawn <= max(36.0, 1e4 * seconds)
    assert drawn > 1e4 * seconds - 36 / 0.6 - 10  # what is left would not do for another round
    shares = [np.diff(part.tables.first) / part.size for part in estimate.parts]
    np.testing.assert_allclose(shares, shares[:1] * len(shares), atol=0.02)
    assert estimate.class_weights.keys() >= {"0,0", "-1,0", "0,1"}


def test_a_short_drive_against_the_real_clock(tmp_path, capsys):
    words = ["run", "slit", "--vertices", "80", "--samples", "20", "--period", "0.1", "--max-time", "0.3"]
    assert main([*words, "--real-time", "--record", str(tmp_path / "x.rrd")]) == 1
    said = capsys.readouterr().out
    assert "real time:" in said
    assert "of 3 plans late" in said


def test_time_and_precision_cannot_both_end_sampling(capsys):
    assert main(["run", "slit", "--real-time", "--target-error", "0.1"]) == 2
    assert "--target-error" in capsys.readouterr().err


def test_periods_add_up_as_they_do_without_a_clock(slit: Scenario):
    frames, _, tally = drive(slit, lambda i: 0.05)
    assert [frame.time for frame in frames] == pytest.approx(PERIOD * np.arange(6))
    assert tally.result()["cost"] == pytest.approx(sum(frame.advance.cost for frame in frames))
    assert frames[-1].noisy_length == pytest.approx(sum(frame.advance.length for frame in frames))
    assert tally.result()["path_length"] == pytest.approx(0.01 * PERIOD * 21, rel=1e-3)  # 1 to 6 cm/s, without noise


def test_bodies_that_move_set_out_when_the_drive_does_and_not_when_it_was_rehearsed():
    scenario = prepare("crossing", start=(2.6, 2.5), given={"period": PERIOD})
    frames, *_ = drive(scenario, lambda i: 0.05, periods=4)
    crowd = MovingObstacles(scenario.loaded.scene.movers, scenario.loaded.scene.footprint)
    assert [frame.time for frame in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    for frame in frames:  # the disc comes nearer all the time
        assert frame.clearance == pytest.approx(crowd.clearance(frame.plan.state, frame.time))
        expected = crowd.clearance(frame.state[:2], frame.end_time)
        assert frame.advance.clearance == pytest.approx(min(1.0, expected), abs=1e-9)
