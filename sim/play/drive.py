"""Runs that somebody interferes with, in real time or step by step: the plant, and the loop around it.

Events take place at the beginning of a control period, pushes at every step.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError
from sim.drive.executor import Advance, Control, Executor
from sim.drive.metrics import Frame
from sim.mjcf.coordinates import rolls
from sim.mjcf.edits import PREFIX
from sim.play.driver import Built, Live
from sim.play.events import GOAL, Event, Move, Noise, Push
from sim.play.world import World, loose_bodies
from sim.scenario import Scenario

ROBOT = "robot/robot"  # body of every robot
SEEN = 1.0 / 60.0  # how often somebody who watches is shown where everything is [s]
LATENCY = 0.3  # simulated time after which a changed world is waited for, where no clock runs [s]


class Snapshot(NamedTuple):
    """State of everything, for somebody who watches from another thread."""

    time: float  # of the run [s]
    qpos: Array  # (nq,)
    mocap: Array  # (nmocap, 3) [m]
    turns: Array  # (nmocap, 4)


class InteractivePlant(Executor):
    """The robot in MuJoCo, in a scene that was loaded loose, and what is done to it.

    Args:
        tell: takes a line on what was done, and on what was refused.
    """

    def __init__(self, world: World, live: Live, tell: Callable[[str], object]) -> None:
        self.world, self._live, self._tell = world, live, tell
        self.script = deque[Event]()  # events to come, in the order of their times
        self.asked = deque[Event]()  # events of now, from another thread
        self.done: list[Event] = []
        self._push: Push | None = None
        scenario, model = world.scenario, world.scenario.loaded.model
        self._robot = int(model.body(ROBOT).id)
        self.rows = {name: int(model.body_mocapid[body]) for name, body in loose_bodies(model).items()}
        self.rows[GOAL] = int(model.body_mocapid[model.body(PREFIX + GOAL).id])
        model.geom_size[model.geom(PREFIX + GOAL).id, 0] = world.scene.goal.radius
        model.site_rgba[[i for i in range(model.nsite) if model.site(i).name == "goal"], 3] = 0.0
        # Actuators that hold velocities carry the robot along: a force of a moment does nothing against them.
        servos = bool(np.all(model.actuator_gainprm[:, 0] == -model.actuator_biasprm[:, 2]))
        self._carried = servos and not rolls(model)
        super().__init__(scenario.loaded, scenario.problem, period=scenario.settings.period)

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Start at a state (n,) at a time [s]; whatever has been moved stays there."""
        super().reset(state, time)
        self._push = None
        for name, place in self.world.places.items():
            self.data.mocap_pos[self.rows[name], :2] = place
        self.snapshot = self._seen()

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision; see `Plant.advance`."""
        begun = self.time
        if begun > 0.0:  # before, a run in real time only tries everything once
            self.take_note()

        def disturbed(x: Array, s: float) -> Array:
            u = control_at(x, s)
            self._lean(begun + s)
            if begun + s >= self.snapshot.time + SEEN:
                self.snapshot = self._seen()
            return u

        advance = super().advance(disturbed, rng)
        self.data.xfrc_applied[self._robot] = 0.0
        self.snapshot = self._seen()
        return advance

    def take_note(self) -> None:
        """Let whatever is due take place."""
        while self.script and self.script[0].at <= self.time + 1e-9:
            self._take(self.script.popleft())
        while self.asked:
            self._take(self.asked.popleft())

    def _take(self, event: Event) -> None:
        """Let an event take place, or report why it cannot."""
        event = replace(event, at=max(event.at, round(self.time, 9)))
        if isinstance(event, Push):
            goes_on, self._push = self._push is not None, event
            if goes_on:  # a hand that holds on is reported once
                return
        else:
            try:
                self._change(event)
            except OptionError as error:
                self._tell(str(error))
                return
        self.done.append(event)
        self._tell(f"{event} at {self.time:.2f} s")

    def _change(self, event: Move | Noise) -> None:
        built = self._live.built.world
        world = built if built.scene is self.world.scene else self.world
        self.world = world.moved(event, self.state) if isinstance(event, Move) else world.shaken(event)
        self.enter(self.world.scenario.problem)
        if isinstance(event, Move):
            self.data.mocap_pos[self.rows[event.what], :2] = self.world.places[event.what]
        self._live.request(self.world, self.time)

    def _lean(self, now: float) -> None:
        """Push, if somebody does at this time [s]."""
        force, push = self.data.xfrc_applied[self._robot], self._push
        if push is None:
            return
        if now >= push.at + push.lasts - 1e-9:
            force[:], self._push = 0.0, None
            return
        over = self.physics_step if self._carried else max(push.lasts, self.physics_step)
        force[:2] = self._model.body_subtreemass[self._robot] / over * np.array(push.speed)

    def _seen(self) -> Snapshot:
        return Snapshot(self.time, *(v.copy() for v in (self.data.qpos, self.data.mocap_pos, self.data.mocap_quat)))


class Play:
    """One robot in a world that somebody changes.

    Args:
        scenario: loaded loose.
        script: events by the times of the first run.
        real_time: against the clock, and changed worlds take over when they are ready; else step by step, and they do
            after `LATENCY`, so that results do not depend on the machine.
        tell: takes a line on whatever happens.
    """

    def __init__(
        self, scenario: Scenario, built: Built, *, script: Iterable[Event] = (), real_time: bool,
        tell: Callable[[str], object] = lambda line: None,
    ) -> None:  # fmt: skip
        self.scenario = scenario.with_settings(real_time=real_time)
        self.live = Live(built, tell, None if real_time else LATENCY)
        self.plant = InteractivePlant(built.world, self.live, tell)
        self.plant.script.extend(script)
        self._rng = scenario.plant_rng()

    def drive(self, start: Array | None = None) -> Generator[Frame]:
        """Drive from a state (n,) to the goal, a collision or the end of the time; one frame per control period.

        Raises:
            NoReference: already the start has no reference.
        """
        return self.scenario.drive(self.plant, self.live, start=start, rng=self._rng)

    def again(self, *, home: bool) -> Array:
        """Return the start of the next run, once what has been moved since the last one is planned for.

        It is the scene's if `home`, else where the robot is.

        Raises:
            SceneError, OptionError: nothing can be planned there.
        """
        start = self.scenario.start if home else self.plant.state
        self.plant.reset(start, self.plant.time)
        self.plant.take_note()
        self.live.catch_up()
        return start

    def close(self) -> None:
        """Stop what plans in the background."""
        self.live.close()


def first(scenario: Scenario, progress: Callable[[int], None] | None = None) -> Built:
    """Plan a scenario that was loaded loose, before anything is changed."""
    tree = None if scenario.settings.method in TREELESS else scenario.grown_tree(progress)
    return Built(world=World.of(scenario), tree=tree, driver=scenario.driver(tree))
