"""Runs that somebody interferes with, in real time or step by step: the plant, the loop around it, and its frames.

Events take place at the begin of a control period, pushes at every step.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from sim.drive import episode, realtime
from sim.drive.executor import Executor
from sim.drive.odometer import Frame, Odometer
from sim.drive.plant import Advance, Control
from sim.mjcf.coordinates import rolls
from sim.mjcf.edits import PREFIX
from sim.play.driver import Builder, Built, Live
from sim.play.events import GOAL, Event, Move, Noise, Push
from sim.play.world import World, loose_bodies
from sim.scenario import Scenario

ROBOT = "robot/robot"  # body of every robot
SEEN = 1.0 / 60.0  # how often somebody who watches is shown where everything is [s]
LATENCY = 0.3  # simulated time after which a changed world is waited for, where no clock runs [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """State of everything, for somebody who watches from another thread."""

    time: float  # of the drive [s]
    qpos: Array  # (nq,)
    mocap: Array  # (nmocap, 3) [m]
    turns: Array  # (nmocap, 4)


class Disturbed:
    """The robot in MuJoCo, and what is done to it.

    Args:
        executor: the robot, in a scene that was loaded loose.
        world: as it is at first.
        live: who drives; told to plan anew.
        tell: takes a line on what was done, and on what was refused.
    """

    def __init__(self, executor: Executor, world: World, live: Live, tell: Callable[[str], object]) -> None:
        self.executor, self.world, self._live, self._tell = executor, world, live, tell
        self.script: deque[Event] = deque()  # what will be done, in the order of times
        self.asked: deque[Event] = deque()  # what somebody does now, from another thread
        model = self._model = world.scenario.loaded.model
        self._robot, self._mass = int(model.body(ROBOT).id), float(model.body_subtreemass[model.body(ROBOT).id])
        self._rows = {name: int(model.body_mocapid[body]) for name, body in loose_bodies(model).items()}
        self._rows[GOAL] = int(model.body_mocapid[model.body(PREFIX + GOAL).id])
        model.geom_size[model.geom(PREFIX + GOAL).id, 0] = world.scene.goal.radius
        model.site_rgba[[i for i in range(model.nsite) if model.site(i).name == "goal"], 3] = 0.0
        self._carried = not rolls(model) and _servos(world)
        self._push: Push | None = None
        self.done: list[Event] = []
        self.snapshot: Snapshot
        self._set_out()

    @property
    def physics_step(self) -> float:
        """Length of a physics step [s]."""
        return self.executor.physics_step

    @property
    def state(self) -> Array:
        """That of the robot, (n,)."""
        return self.executor.state

    @property
    def time(self) -> float:
        """Time of the drive [s]."""
        return self.executor.time

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Stand at a state (n,) at a time [s]; whatever has been moved stays there."""
        self.executor.reset(state, time)
        self._push = None
        self._set_out()

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision; see `Plant.advance`."""
        begun = self.time
        if begun > 0.0:  # before, a drive in real time only tries everything once
            self.take_note()

        def disturbed(x: Array, s: float) -> Array:
            u = control_at(x, s)
            self._lean(begun + s)
            if begun + s >= self.snapshot.time + SEEN:
                self.snapshot = self._seen()
            return u

        advance = self.executor.advance(disturbed, rng)
        self.executor.data.xfrc_applied[self._robot] = 0.0
        self.snapshot = self._seen()
        return advance

    def take_note(self) -> None:
        """Let whatever is due take place."""
        while self.script and self.script[0].at <= self.time + 1e-9:
            self._take(self.script.popleft())
        while self.asked:
            self._take(self.asked.popleft())

    def _take(self, event: Event) -> None:
        """Let an event take place, or say why it cannot."""
        event = replace(event, at=max(event.at, round(self.time, 9)))
        try:
            if isinstance(event, Push):
                goes_on = self._push is not None  # a hand that holds on is told of once
                self._push = event
                if goes_on:
                    return
            else:
                self._change(event)
        except OptionError as error:
            self._tell(str(error))
            return
        self.done.append(event)
        self._tell(f"{event} at {self.time:.2f} s")

    def _change(self, event: Move | Noise) -> None:
        built = self._live.built.world
        world = built if built.scene is self.world.scene else self.world
        world = world.moved(event, self.state) if isinstance(event, Move) else world.shaken(event)
        self.world = world
        self.executor.enter(world.scenario.problem)
        if isinstance(event, Move):
            self._set(event.what)
        self._live.builder.want(world, self._live.tree if world.grounded else None, self.time)

    def _lean(self, now: float) -> None:
        """Push, if somebody does at this time [s]."""
        force, push = self.executor.data.xfrc_applied[self._robot], self._push
        if push is None:
            return
        if now >= push.at + push.lasts - 1e-9:
            force[:], self._push = 0.0, None
            return
        over = self.physics_step if self._carried else max(push.lasts, self.physics_step)
        force[:2] = self._mass / over * np.array(push.speed)

    def _set_out(self) -> None:
        """Put whatever is loose where it stands now."""
        for name in self.world.places:
            self._set(name)
        self.snapshot = self._seen()

    def _set(self, name: str) -> None:
        data = self.executor.data
        data.mocap_pos[self._rows[name], :2] = self.world.places[name]

    def _seen(self) -> Snapshot:
        data = self.executor.data
        return Snapshot(
            time=self.time, qpos=data.qpos.copy(), mocap=data.mocap_pos.copy(), turns=data.mocap_quat.copy()
        )


def _servos(world: World) -> bool:
    """Return whether the robot's actuators hold velocities, against which a force of a moment does nothing."""
    model = world.scenario.loaded.model
    return bool(np.all(model.actuator_gainprm[:, 0] == -model.actuator_biasprm[:, 2]))


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
        """Return the start of the next run, once what has been moved since the last one is planned for.

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
        time = 0.0 if before is None else before.odometer.time
        live, homology = self._live, self._live.homology
        odometer = Odometer(live.problem, space, x, self._max_time, homology=homology, time=time, busy=True)
        if before is None:
            return _Stage(space=space, odometer=odometer, length=0.0, noisy=0.0)
        last = before.odometer
        odometer.step, odometer.cost = last.step, last.cost
        return _Stage(
            space=space, odometer=odometer, length=before.length + last.length.total,
            noisy=before.noisy + last.length.noisy,
        )  # fmt: skip


def first(scenario: Scenario, progress: Callable[[int], None] | None = None) -> Built:
    """Plan a scenario that was loaded loose, before anything is changed."""
    from pirrht.control.settings import TREELESS

    tree = None if scenario.settings.method in TREELESS else scenario.grown_tree(progress)
    return Built(world=World.of(scenario), tree=tree, driver=scenario.driver(tree))
