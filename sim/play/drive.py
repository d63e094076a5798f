"""The loop of `pirrht play`: a drive whose world changes, in real time or step by step, and its frames."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import dataclass, replace

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.collision import Collision
from sim.drive import episode, realtime
from sim.drive.executor import Executor
from sim.drive.odometer import Frame, Odometer
from sim.play.driver import Builder, Built, Live
from sim.play.events import Event
from sim.play.plant import Disturbed
from sim.play.world import World
from sim.scenario import Scenario

LATENCY = 0.3  # simulated time after which a changed world is waited for, where no clock runs [s]


class Play:
    """One robot in a world that somebody changes.

    Args:
        scenario: loaded loose.
        built: who decides at first.
        script: what is done, by the times of the first drive.
        real_time: against the clock, and changed worlds take over when they are ready; else step by step, and they do
            after `LATENCY`, so that results do not depend on the machine.
        tell: takes a line on whatever happens.
    """

    def __init__(
        self, scenario: Scenario, built: Built, *, script: Iterable[Event] = (), real_time: bool,
        tell: Callable[[str], object] = lambda line: None,
    ) -> None:  # fmt: skip
        self.scenario, self.real_time = scenario, real_time
        self.builder = Builder(None if real_time else LATENCY)
        self.live = Live(built, self.builder, tell)
        executor = Executor(scenario.loaded, scenario.problem, period=scenario.settings.period)
        self.plant = Disturbed(executor, built.world, self.live, tell)
        self.plant.script.extend(script)
        self._rng = scenario.plant_rng()

    def drive(self, start: Array | None = None) -> Generator[Frame]:
        """Drive from a state (n,) to the goal, a collision or the end of the time; one frame per control period.

        Raises:
            NoReference: already the start has no reference.
        """
        s, start = self.scenario.settings, self.scenario.start if start is None else start
        if self.real_time:
            frames = realtime.run(
                self.plant, self.live, start, self._rng, period=s.period, max_time=s.max_time, grow=s.grow
            )
        else:
            frames = episode.run(self.plant, self.live, start, self._rng, max_time=s.max_time, grow=s.grow or 0)
        with closing(frames):
            ledger = _Ledger(self.live, start, s.max_time)
            for frame in frames:
                yield ledger.entered(frame)

    def again(self, *, home: bool) -> Array:
        """Where the next drive starts, once what has been moved since the last one is planned for.

        Args:
            home: at the start; else where the robot is.

        Raises:
            SceneError, OptionError: nothing can be planned there.
        """
        start = self.scenario.start if home else self.plant.state
        self.plant.reset(start, self.plant.time)
        self.plant.take_note()
        self.live.catch_up()
        return start

    def close(self) -> None:
        """Let go of what plans in the background."""
        self.builder.close()


@dataclass(slots=True)
class _Stage:
    """The part of a drive that goes through one world."""

    space: FreeSpace
    odometer: Odometer
    length: float  # driven before [m]
    noisy: float  # with noise [m]


class _Ledger:
    """Tells frames of a drive in the terms of the world that each was planned in: classes, free distance, length."""

    def __init__(self, live: Live, start: Array, max_time: float) -> None:
        self._live, self._max_time = live, max_time
        self._stage = self._begun(live.space, start)

    def entered(self, frame: Frame) -> Frame:
        """The frame, of the world in which it was planned."""
        space, before = frame.plan.space, self._stage
        if space is not None and space is not before.space:
            self._stage = self._begun(space, frame.plan.state, before)
        stage = self._stage
        now = stage.odometer.frame(
            frame.plan, frame.advance, seconds=frame.plan_seconds, vertices=frame.vertices, timing=frame.timing
        )
        return replace(
            now, outcome=frame.outcome, length=stage.length + now.length, noisy_length=stage.noisy + now.noisy_length
        )

    def _begun(self, space: FreeSpace, x: Array, before: _Stage | None = None) -> _Stage:
        scene = space.scene
        collision = Collision(scene.world, scene.footprint)  # the planner's own is busy
        odometer = Odometer(
            self._live.problem, space, x, self._max_time, lambda y: float(collision.clearance(y[None, :2])[0]),
            homology=self._live.homology, time=0.0 if before is None else before.odometer.time,
        )  # fmt: skip
        if before is None:
            return _Stage(space=space, odometer=odometer, length=0.0, noisy=0.0)
        last = before.odometer
        odometer.step, odometer.cost = last.step, last.cost
        return _Stage(
            space=space, odometer=odometer, length=before.length + last.length.total,
            noisy=before.noisy + last.length.noisy,
        )  # fmt: skip


def first(scenario: Scenario, progress: Callable[[int], None] | None = None) -> Built:
    """Who decides in a scenario that was loaded loose, before anything is changed."""
    from pirrht.control.methods import TREELESS

    tree = None if scenario.settings.method in TREELESS else scenario.grown_tree(progress)
    return Built(world=World.of(scenario), tree=tree, driver=scenario.driver(tree))
