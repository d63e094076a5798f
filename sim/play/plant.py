"""A plant that somebody interferes with: events take place at the begin of a control period, pushes at every step."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from sim.drive.executor import Executor
from sim.drive.plant import Advance, Control
from sim.mjcf.coordinates import rolls
from sim.mjcf.loose import PREFIX
from sim.play.driver import Live
from sim.play.events import GOAL, Event, Move, Noise, Push
from sim.play.world import World, loose_bodies

ROBOT = "robot/robot"  # body of every robot
SEEN = 1.0 / 60.0  # how often somebody who watches is shown where everything is [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """Where everything is, for somebody who watches from another thread."""

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
    """Whether the robot's actuators hold velocities, against which a force of a moment does nothing."""
    model = world.scenario.loaded.model
    return bool(np.all(model.actuator_gainprm[:, 0] == -model.actuator_biasprm[:, 2]))
