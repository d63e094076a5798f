"""MuJoCo's passive viewer as what somebody interferes through: the mouse pushes and moves, keys change the noise.

Double-click a body, then drag it with Ctrl and the right mouse button: the robot is pulled towards the cursor, and
whatever is loose is put down where the button is released.
"""

from __future__ import annotations

import copy
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from sim.mjcf.dressed import dress
from sim.mjcf.edits import PREFIX
from sim.play.drive import ROBOT, InteractivePlant
from sim.play.events import GOAL, Event, Move, Noise, Push
from sim.play.world import loose_bodies

REFRESH = 1.0 / 60.0  # [s]
PATIENCE = 3.0  # with a window that is to close [s]
PULL, PULLED = 4.0, 3.0  # speed per distance from the cursor [1/s], at most [m/s]
LASTS = 0.1  # of a pull, after which it is repeated [s]
LESS, MORE, HOME = ord("8"), ord("9"), 268  # keys of the viewer: 8, 9 and Home
AWAY = 1.35  # times the size of the workspace the camera is away
FACTOR = 1.25  # of noise per stroke
KEYS = "8 less noise, 9 more; Home: back to the start"


class Mouse:
    """Translate a viewer's mouse to events, by how its perturbation changes from picture to picture."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._robot = int(model.body(ROBOT).id)
        self._names = {body: name for name, body in loose_bodies(model).items()}
        self._names[int(model.body(PREFIX + GOAL).id)] = GOAL
        self.held: int | None = None  # body that is dragged
        self._place, self._cursor = np.zeros(2), np.zeros(3)  # where it was taken, and the cursor then [m]
        self._there = np.zeros(2)  # where it is dragged to [m]

    def events(self, data: mujoco.MjData, perturb: Any, azimuth: float) -> list[Event]:
        """Return events of the mouse now, for the viewer's perturbation and its camera's azimuth [degrees].

        A loose body that is dragged is shown in `data` where it is held.
        """
        body = int(perturb.select) if perturb.active else None
        events: list[Event] = []
        if self.held is not None and body != self.held:
            if self.held in self._names and not np.array_equal(self._there, self._place):
                x, y = self._there.tolist()  # not what is shown: the viewer itself has moved that
                events.append(Move(at=0.0, what=self._names[self.held], to=(x, y)))
            self.held = None
        if body is None or not (body == self._robot or body in self._names):
            return events
        place, cursor = np.array(data.xpos[body, :2], dtype=float), np.array(perturb.refpos, dtype=float)
        if self.held is None:
            self.held, self._place, self._cursor = body, place, cursor
        gone, ahead = cursor - self._cursor, np.radians(azimuth)  # up in the picture is away from the camera
        self._there = self._place + gone[:2] + gone[2] * np.array([np.cos(ahead), np.sin(ahead)])
        if body == self._robot:
            events.append(_pull(self._there - place))
        else:
            data.mocap_pos[data.model.body_mocapid[body], :2] = self._there
        return events


def _pull(ahead: Array) -> Push:
    """Return a push towards a place that is `ahead` (2,) [m]."""
    speed = PULL * ahead
    speed *= min(1.0, PULLED / max(float(np.hypot(*speed)), 1e-9))
    return Push(at=0.0, speed=(float(speed[0]), float(speed[1])), lasts=LASTS)


class Window:
    """A viewer's window on a plant, kept up to date on a thread of its own; `launch` makes the viewer's handle."""

    def __init__(self, plant: InteractivePlant, launch: Callable[..., Any] | None = None) -> None:
        self._plant, self.keys = plant, deque[int]()
        self.model = copy.copy(plant.world.scenario.loaded.model)
        dress(self.model)
        self.data = mujoco.MjData(self.model)
        self._mouse = Mouse(self.model)
        self.home = False  # whether the key Home was struck
        self._ended = threading.Event()
        self._put()
        mujoco.mj_forward(self.model, self.data)
        self.handle = (launch or _launcher())(self.model, self.data, key_callback=self.keys.append)
        scene = plant.world.scene
        with self.handle.lock():  # the workspace from above, and a little from the south
            width, depth = (scene.upper - scene.lower).tolist()
            camera = self.handle.cam
            camera.lookat[:] = *(0.5 * (scene.upper + scene.lower)), 0.0
            camera.distance, camera.azimuth, camera.elevation = AWAY * max(depth, width / 1.6), 90.0, -70.0
        self.thread = threading.Thread(target=self._watch, name="window", daemon=True)

    def start(self) -> Window:
        """Begin to show; the window itself."""
        self.thread.start()
        return self

    @property
    def open(self) -> bool:
        """Return whether it has not been closed."""
        return bool(self.handle.is_running())

    def close(self) -> None:
        """Close it."""
        self._ended.set()
        if self.thread.is_alive():
            self.thread.join()
        self.handle.close()
        until = time.monotonic() + PATIENCE
        while self.handle.m is not None and time.monotonic() < until:  # X minds if it draws while the process ends
            time.sleep(REFRESH)

    def _watch(self) -> None:
        while self.open and not self._ended.wait(REFRESH):
            self.refresh()

    def refresh(self) -> None:
        """Show where everything is, and pass on what was done since."""
        with self.handle.lock():
            self._put()
            events = self._mouse.events(self.data, self.handle.perturb, float(self.handle.cam.azimuth))
            mujoco.mj_forward(self.model, self.data)
        while self.keys:
            key = self.keys.popleft()
            self.home |= key == HOME
            if key in (LESS, MORE):
                noise = self._plant.world.scenario.settings.noise
                events.append(Noise(at=0.0, noise=noise * (FACTOR if key == MORE else 1.0 / FACTOR)))
        self.handle.sync()
        self._plant.asked.extend(events)

    def _put(self) -> None:
        data, seen = self.data, self._plant.snapshot
        held = -1 if self._mouse.held is None else self.model.body_mocapid[self._mouse.held]
        others = np.arange(self.model.nmocap) != held
        data.time, data.qpos[:] = seen.time, seen.qpos
        data.mocap_pos[others], data.mocap_quat[others] = seen.mocap[others], seen.turns[others]


def _launcher() -> Callable[..., Any]:
    """Return MuJoCo's passive viewer."""
    try:
        from mujoco import viewer
    except (ImportError, RuntimeError) as error:
        raise OptionError(f"MuJoCo's viewer cannot be had ({error}); use --headless, or pip install mujoco") from None
    return lambda *data, **named: viewer.launch_passive(*data, show_left_ui=False, show_right_ui=False, **named)
