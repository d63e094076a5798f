"""Runs that somebody interferes with, in real time or step by step: the plant, the policy, and the loop around them.

Events take place at the beginning of a control period, pushes at every step. Plans for a changed world are made in the
background, and take over.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from math import inf
from operator import attrgetter
from typing import Any, NamedTuple, cast

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.control.mapped import Mapped
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError, PirrhtError
from pirrht.freespace import FreeSpace
from sim.drive.executor import Advance, Control, Executor
from sim.drive.metrics import Frame
from sim.mjcf.edits import PREFIX
from sim.mjcf.footprint import collision_of
from sim.play.events import GOAL, Event, Move, Push
from sim.scenario import Driver, Scenario

ROBOT = "robot/robot"  # body of every robot
LATENCY = 0.3  # simulated time after which a changed world is waited for, where no clock runs [s]
FULLER = 2  # times as many vertices there is space for in a tree that grows on
SHOWN = mujoco.mjtState.mjSTATE_INTEGRATION  # part of MuJoCo's state that a picture needs, and more


def loose_bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Return bodies that can be placed, the one that shows the goal included, by the names under which they are."""
    bodies = np.flatnonzero(model.body_mocapid >= 0).tolist()
    return {(model.body(body).name or f"body{body}").removeprefix(PREFIX): body for body in bodies}


class World(NamedTuple):
    """A scenario that may have been changed since it was loaded, and who drives there."""

    scenario: Scenario
    driver: Driver


def first(scenario: Scenario, progress: Callable[[int], None] | None = None) -> World:
    """Plan a scenario that was loaded loose, before anything is changed."""
    tree = None if scenario.settings.method in TREELESS else scenario.grown_tree(progress)
    return World(scenario, scenario.driver(tree))


def build(scenario: Scenario, before: World) -> World:
    """Grow a tree and make a controller; if only the noise has changed, keep free space and tree."""
    tree, space = before.driver.tree, before.scenario.space
    if changed := scenario.loaded is not before.scenario.loaded:
        space = FreeSpace.of(scenario.problem.scene, space.grain)
    scenario = replace(scenario, space=space)
    if changed and tree is not None:
        tree = scenario.with_settings(tree=None).grown_tree()
        tree.reserve(FULLER * tree.size)
    driver = scenario.driver(tree)
    if isinstance(driver, Mapped) and isinstance(before.driver, Mapped):
        driver.sensor = before.driver.sensor
    return World(scenario, driver)


class Live(Policy):
    """The policy that decides now; the newest world that was requested is built, one at a time, and takes over.

    It does so a latency [s] of simulated time after its request, so that this does not depend on the machine, or
    without one when it is ready. `tell` takes a line on what could not be planned.
    """

    tree, run, path_integral, homology, believed = (
        cast(Any, property(attrgetter(f"built.driver.{name}")))
        for name in ("tree", "run", "path_integral", "homology", "believed")
    )

    def __init__(self, built: World, tell: Callable[[str], object], latency: float | None) -> None:
        self.built, self._tell, self._latency = built, tell, latency
        self.pool = ThreadPoolExecutor(1, thread_name_prefix="builder")
        self._requested: tuple[float, Future[World]] | None = None  # at which time of the run [s]

    def request(self, scenario: Scenario, at: float) -> None:
        """Request a scenario's world at a time of the run [s], in place of what was requested before."""
        if self._requested is not None:
            self._requested[1].cancel()
        self._requested = at, self.pool.submit(build, scenario, self.built)

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s]."""
        self.built.driver.begin(x, time)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,), in a new world if one is ready and has a path to the goal from there."""
        now = self.run.clock.time
        try:
            if (ready := self.ready(now)) is not None:
                ready.driver.begin(x, now)
                if isinstance(ready.driver, Mapped) and isinstance(self.built.driver, Mapped):
                    ready.driver.go_on(self.built.driver)
                plan = ready.driver.plan(x, left)
                self.built = ready
                return plan
        except PirrhtError as error:
            self._tell(f"{error}; the run continues with the earlier plan")
        return self.built.driver.plan(x, left)

    def ready(self, now: float) -> World | None:
        """Return the requested world, once; None if there is nothing yet at this time [s], and at infinity wait.

        SceneError, OptionError: nothing can be planned there.
        """
        if self._requested is None:
            return None
        at, future = self._requested
        if now < inf and not (future.done() if self._latency is None else now >= at + self._latency - 1e-9):
            return None
        self._requested = None
        return future.result()


class InteractivePlant(Executor):
    """The robot in MuJoCo, in a scene that was loaded loose, and what is done to it, reported line by line.

    `snapshot` is what MuJoCo knows under `SHOWN`, for somebody who watches from another thread.
    """

    def __init__(self, scenario: Scenario, live: Live, tell: Callable[[str], object]) -> None:
        self.scenario, self._live, self._tell = scenario, live, tell  # with the scene as it is now
        self.script = deque[Event]()  # events to come, in the order of their times
        self.asked = deque[Event]()  # events of now, from another thread
        self.done: list[Event] = []
        self._push: Push | None = None
        model, scene = scenario.loaded.model, scenario.loaded.scene
        self._robot = int(model.body(ROBOT).id)
        own = {mover.name for mover in scene.movers}  # those go where their motions say
        bodies = {name: body for name, body in loose_bodies(model).items() if name not in own}
        self.rows = {name: int(model.body_mocapid[body]) for name, body in bodies.items()}
        self._home = model.key_mpos[0].reshape(-1, 3)  # where a reset puts bodies [m]
        self._home[self.rows[GOAL], : scene.dimension] = scene.goal.center
        model.geom_size[model.geom(PREFIX + GOAL).id, 0] = scene.goal.radius
        model.site_rgba[[i for i in range(model.nsite) if model.site(i).name == "goal"], 3] = 0.0
        # Actuators that hold velocities carry the robot along: a force of a moment does nothing against them.
        servos = bool(np.all(model.actuator_gainprm[:, 0] == -model.actuator_biasprm[:, 2]))
        real = scenario.real or scenario.problem
        super().__init__(scenario.loaded, real, period=scenario.settings.period, senses=scenario.senses())
        self._carried = servos and not self._joints.rolls

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Start at a state (n,) at a time [s]; moved obstacles stay where they are."""
        super().reset(state, time)
        self._push = None
        self._show()

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision; see `Plant.advance`."""
        if self.time > 0.0:  # before, a run in real time only tries everything once
            self.take_note()
        return super().advance(control_at, rng)

    def take_note(self) -> None:
        """Apply all events that are due."""
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
                new = self._moved(event) if isinstance(event, Move) else self.scenario.with_settings(noise=event.noise)
            except PirrhtError as error:
                self._tell(f"{event}: {error}")
                return
            self.scenario = new
            self.enter(new.real or new.problem)
            if self.senses is None or not (isinstance(event, Move) and event.what != GOAL):  # else its lidar sees it
                self._live.request(new, self.time)
        self.done.append(event)
        self._tell(f"{event} at {self.time:.2f} s")

    def _moved(self, event: Move) -> Scenario:
        """Put a body elsewhere, and return the scenario then; SceneError or OptionError if that cannot be."""
        if (row := self.rows.get(event.what)) is None:
            raise OptionError(f'there is no "{event.what}" that could be moved; there are {", ".join(self.rows)}')
        x, s, states = self.state, self.scenario, self.scenario.system.adapter
        shift = np.array([*event.to, 0.0])
        if not event.relative:
            shift[:2] -= self.data.mocap_pos[row, :2]
        scene, loaded = replace(s.loaded.scene, start=states.start_of(x)), s.loaded
        if event.what == GOAL:
            scene = replace(scene, goal=replace(scene.goal, center=scene.goal.center + shift[states.position]))
        else:
            bodies = self._model.body_rootid[self._model.geom_bodyid[loaded.obstacle_geoms & ~loaded.moving_geoms]]
            pairs = zip(scene.obstacles, self._model.body_mocapid[bodies] == row, strict=True)
            obstacles = (replace(o, position=o.position + shift) if is_it else o for o, is_it in pairs)
            scene = replace(scene, obstacles=tuple(obstacles))
        ends = np.array([x[states.position], scene.goal.center])
        collision = collision_of(scene.world, scene.footprint)
        clearances = collision.clearance(ends)
        if not scene.footprint.is_disc:
            clearances[0] = collision.clearance(states.poses(x[None]))[0]
        for place, clearance in zip(("the robot", "the goal"), clearances, strict=True):
            if clearance <= 0.0:
                raise OptionError(f"the new place is on top of {place} or too close to it, so nothing moves")
        scenario = s.among(scene)
        self.data.mocap_pos[row] += shift
        self._home[row] = self.data.mocap_pos[row]
        return scenario

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        """Make one step, under a push if somebody pushes."""
        force = self.data.xfrc_applied[self._robot]
        push = self._push
        mass = self._model.body_subtreemass[self._robot]

        force[:] = 0.0
        if push is not None and self.time - step >= push.at + push.lasts - 1e-9:
            self._push = push = None
        if push is not None:
            force[:2] = mass / (step if self._carried else max(push.lasts, step)) * np.array(push.speed)
        x = super()._move(x, u, dw, step)
        self._show()
        return x

    def _show(self) -> None:
        snapshot = np.empty(mujoco.mj_stateSize(self._model, SHOWN))
        mujoco.mj_getState(self._model, self.data, snapshot, SHOWN)
        self.snapshot = snapshot


class Play:
    """One robot in a world that somebody changes.

    Args:
        scenario: loaded loose.
        script: events by the times of the first run.
        real_time: against the clock, and changed worlds take over when they are ready; else after `LATENCY`.
        tell: takes a line on whatever happens.
    """

    def __init__(
        self, scenario: Scenario, built: World, *, script: Iterable[Event] = (), real_time: bool,
        tell: Callable[[str], object] = lambda line: None,
    ) -> None:  # fmt: skip
        self.scenario = scenario.with_settings(real_time=real_time)
        self.live = Live(built, tell, None if real_time else LATENCY)
        self.plant = InteractivePlant(built.scenario, self.live, tell)
        if isinstance(built.driver, Mapped):
            built.driver.sensor = self.plant.senses
        self.plant.script.extend(script)
        self._rng = scenario.plant_rng()

    def drive(self, start: Array | None = None) -> Generator[Frame]:
        """Drive from a state (n,) to the goal, a collision or the end of the time; see `episode.run`."""
        return self.scenario.drive(self.plant, self.live, start=start, rng=self._rng)

    def again(self, *, home: bool) -> Array:
        """Return the start of the next run, once what has been moved since the last one is planned for.

        It is the scene's if `home`, else where the robot is. SceneError, OptionError: nothing can be planned there.
        """
        start = self.scenario.start if home else self.plant.state
        self.plant.reset(start, self.plant.time)
        self.plant.take_note()
        self.live.built = self.live.ready(inf) or self.live.built
        return start

    def close(self) -> None:
        """Let what plans in the background end, and nothing more begin."""
        self.live.pool.shutdown(wait=True, cancel_futures=True)
