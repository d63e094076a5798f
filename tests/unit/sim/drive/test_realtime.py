"""Real-time runs, on a clock that knows how long everything takes."""

import threading
from typing import Any

import numpy as np
import pytest
import rerun as rr

from pirrht import NoReference, Outcome, Plan
from pirrht.arrays import Array
from pirrht.moving.collision import MovingObstacles
from sim.cli import main
from sim.drive import episode
from sim.drive.episode import BEHIND, IDLE, MOST_PIECES, Clock, Planner
from sim.drive.executor import Plant
from sim.drive.metrics import Frame, TimedPlan
from sim.recording.subject import Stream
from sim.scenario import Scenario, prepare

PERIOD, STEP = 0.1, 0.01


class FakeClock(Clock):
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
        with self._turn:
            if me is not threading.main_thread():
                self._known[me.name], self._waiting[me.name] = me, until
                while self._next() != me.name:
                    self._turn.wait(0.002)  # a thread that has ended tells nobody
                del self._waiting[me.name]
            self._now = max(self._now, until)

    def _next(self) -> str | None:
        busy = [name for name, t in self._known.items() if t.is_alive() and name not in self._waiting]
        if len(self._known) < 2 or busy:
            return None
        return min(self._waiting, key=lambda name: (self._waiting[name], name != "plant"))


class FakePolicy:
    """Plans take the time that they are told to, if they have a limit; the law of plan i steers i+1 cm/s aside."""

    tree: Any = None
    run = None
    path_integral = None
    believed = None

    def __init__(self, scenario: Scenario, clock: FakeClock, seconds=lambda i: 0.0) -> None:
        self.problem, self.space, self.homology = scenario.problem, scenario.space, scenario.homology
        self.clock, self.seconds = clock, seconds

    def begin(self, x: Array) -> None:
        self.made, self.left, self.elapsed = list[Array](), list[float](), list[float]()

    def observe(self, states: Array, duration: float, until: float) -> None:
        assert duration == 0.0  # `expect` has let it pass

    def expect(self, states: Array, duration: float) -> None:
        self.elapsed.append(duration)

    def plan(self, x: Array, left=None) -> Plan:
        i = len(self.made)
        if left is not None:
            self.made.append(x)
            self.left.append(left())
            self.clock.wait(self.clock.now() + self.seconds(i))
        return plan(x, 0.01 * (i + 1))


def plan(x: Array, speed: float) -> Plan:
    u = np.array([speed, 0.0])
    return Plan(
        state=x, times=np.array([0.0, 9.0]), references=(), ids=(), estimate=None, fallback=None, instead=u[None],
        law=lambda state, s: u,
    )  # fmt: skip


def frames_of(scenario: Scenario, policy: FakePolicy, periods: int):
    quiet = scenario.with_settings(noise=1e-6)
    plant = Plant(quiet.problem, lambda points: np.ones(len(points)), period=PERIOD, physics_step=STEP)
    rng = np.random.default_rng(0)
    return episode.run(plant, policy, scenario.start, rng, max_time=periods * PERIOD, clock=policy.clock)


def drive(scenario: Scenario, seconds, periods: int = 6) -> tuple[list[Frame], FakePolicy, dict[str, Any]]:
    policy = FakePolicy(scenario, FakeClock(), seconds)
    frames = list(frames_of(scenario, policy, periods))
    return frames, policy, frames[-1].metrics.json()


def controls(frames: list[Frame]) -> Array:
    """Which plan steered at every physics step, by its number; (k,)."""
    return np.rint(100 * np.concatenate([frame.advance.controls[:, 0] for frame in frames])).astype(int)


def test_fast_plans_take_over_when_their_period_begins(slit: Scenario):
    """They are made for the state in which they do, and periods add up as they do without a clock."""
    frames, policy, result = drive(slit, lambda i: 0.05)
    assert [frame.step for frame in frames] == list(range(6))
    assert [frame.outcome for frame in frames] == [None] * 5 + [Outcome.TIMEOUT]
    np.testing.assert_array_equal(controls(frames), np.repeat(np.arange(1, 7), 10))
    timing = result["real_time"]
    assert (result["deadline_misses"], timing["deadline_misses"], timing["periods"]) == (0, 0, 6)
    assert timing["slack_ms"]["min"] == pytest.approx(50.0)
    assert timing["late_ms"]["max"] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(policy.elapsed, PERIOD)
    for frame, planned in zip(frames, policy.made, strict=False):
        np.testing.assert_allclose(planned, frame.plan.state, atol=1e-6)
    assert policy.left == pytest.approx([0.07] * len(policy.left))
    assert [frame.time for frame in frames] == pytest.approx(PERIOD * np.arange(6))
    assert result["cost"] == pytest.approx(sum(frame.advance.cost for frame in frames))
    assert frames[-1].noisy_length == pytest.approx(sum(frame.advance.length for frame in frames))
    assert result["path_length"] == pytest.approx(0.01 * PERIOD * 21, rel=1e-3)  # 1 to 6 cm/s, without noise


def test_a_slow_plan_is_a_miss_and_the_old_law_goes_on_until_it_is_there(slit: Scenario):
    frames, _, result = drive(slit, lambda i: 0.125 if i == 2 else 0.02)
    # Plan 2, begun at 0.1 for 0.2, is ready at 0.225; plan 3, begun then for 0.3, is ready in time.
    np.testing.assert_array_equal(controls(frames), np.repeat([1, 2, 3, 4, 5, 6], [10, 13, 7, 10, 10, 10]))
    assert [frame.begin < frame.time - 1e-9 for frame in frames] == [False, False, True, False, False, False]
    assert result["deadline_misses"] == 1
    assert frames[2].plan.control == pytest.approx([0.02, 0.0])


def test_errors_of_either_thread_and_whoever_gives_up_end_the_run_and_leave_no_thread(slit: Scenario):
    def fails(i: int) -> float:
        if i == 3:
            raise NoReference([0.0, 0.0], vertices=1, limit=0.6)
        return 0.01

    with pytest.raises(NoReference):
        drive(slit, fails)
    assert not {"plant", "planner"} & {thread.name for thread in threading.enumerate()}
    frames = frames_of(slit, FakePolicy(slit, FakeClock(), lambda i: 0.01), periods=50)
    next(frames)
    frames.close()
    assert not {"plant", "planner"} & {thread.name for thread in threading.enumerate()}


def test_predictions_end_before_the_goal_and_have_few_steps_where_a_plant_is_late(slit: Scenario):
    policy = FakePolicy(slit, FakeClock())

    def ahead(speed: float, time: float, x: Array, until: float) -> Array:
        ready = TimedPlan(plan=plan(x, speed), plan_seconds=0.0)
        return Planner(policy, policy.clock, PERIOD, None).predicted(ready, time, x, until)

    late = ahead(0.01, 0.0, slit.start, 1.0)
    assert len(late) == MOST_PIECES + 1
    np.testing.assert_allclose(late[-1], np.add(slit.start, (0.01, 0.0)), atol=1e-12)
    x = slit.problem.scene.goal.center - [slit.problem.scene.goal.radius + 0.035, 0.0]
    np.testing.assert_allclose(ahead(1.0, 0.0, x, 0.1), [np.add(x, (0.01 * k, 0.0)) for k in range(4)])
    np.testing.assert_allclose(ahead(1.0, 0.05, slit.start, 0.1)[-1], np.add(slit.start, (0.05, 0.0)))
    np.testing.assert_array_equal(ahead(1.0, 0.2, slit.start, 0.1), [slit.start])  # too late


class Growing:
    """A tree whose vertices take 3 ms each."""

    def __init__(self, clock: FakeClock) -> None:
        self.size, self._clock = 10, clock

    def grow(self, size: int, enough=None) -> None:
        while self.size < size and not (enough and enough(self.size)):
            self._clock.wait(self._clock.now() + 0.003)
            self.size += 1


@pytest.mark.parametrize(
    ("grow", "late", "expected"), [(None, 0.0, 6), (5, 0.0, 5), (0, 0.0, 0), (None, 1.01 * BEHIND * PERIOD, 0)]
)
def test_the_tree_grows_in_the_time_that_is_left_unless_the_plant_is_late(slit, grow, late, expected):
    clock = FakeClock()
    policy = FakePolicy(slit, clock)
    policy.tree = Growing(clock)
    planner = Planner(policy, clock, PERIOD, grow)
    planner.first(slit.start)
    planner.origin = clock.now() - late
    planner.extend(clock.now() + 0.02)
    assert policy.tree.size == 10 + expected
    assert clock.now() <= 100.0 + 0.02


@pytest.mark.parametrize(
    ("lasted", "left"),
    [
        ([0.12] * 4, [0.07, 0.0375, 0.0375, 0.03]),  # 50 ms after the samples' time is up, and then 82.5
        ([0.05, 0.05, 0.12, 0.05, 0.05], [0.07] * 5),  # one that was disturbed is no rule
    ],
)
def test_time_is_kept_for_what_usually_follows_the_samples(slit: Scenario, lasted: list[float], left: list[float]):
    clock, found = FakeClock(), []
    policy = FakePolicy(slit, clock, lambda i: lasted[len(found)])
    planner = Planner(policy, clock, PERIOD, None)
    for _ in lasted:
        planner.first(slit.start)
        found += policy.left
    assert found == pytest.approx(left)


def test_a_short_drive_against_the_real_clock(tmp_path, capsys):
    words = ["run", "slit", "--vertices", "80", "--samples", "20", "--period", "0.1", "--max-time", "0.3"]
    assert main([*words, "--real-time", "--record", str(tmp_path / "x.rrd")]) == 1
    said = capsys.readouterr().out
    assert "real time:" in said
    assert "of 3 plans late" in said


def test_moving_obstacles_set_out_when_the_run_does_and_not_when_it_was_rehearsed():
    scenario = prepare("crossing", start=(2.6, 2.5), given={"period": PERIOD})
    frames, *_ = drive(scenario, lambda i: 0.05, periods=4)
    crowd = MovingObstacles(scenario.loaded.scene.movers, scenario.loaded.scene.body)
    assert [frame.time for frame in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    for frame in frames:  # the disc comes nearer all the time
        assert frame.clearance == pytest.approx(crowd.clearance(frame.plan.state, frame.time))
        expected = crowd.clearance(frame.state[:2], frame.end_time)
        assert frame.advance.clearance == pytest.approx(min(1.0, expected), abs=1e-9)


def test_recordings_give_way_to_plans(monkeypatch):
    asked: list[float] = []
    monkeypatch.setattr(IDLE, "wait", asked.append)
    stream = Stream("test", "way")
    stream.columns("/number", [(0, 0.0)], rr.Scalars.columns(scalars=[1.0]))
    stream.log("/number", 1, 0.1, rr.Scalars(2.0))
    assert len(asked) == 2
