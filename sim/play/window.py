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

from pirrht.errors import OptionError
from sim.mjcf.edits import dress
from sim.play.drive import ROBOT, SHOWN, InteractivePlant, loose_bodies
from sim.play.events import Event, Move, Noise, Push

REFRESH = 1.0 / 60.0  # [s]
PATIENCE = 3.0  # with a window that is to close [s]
PULL, PULLED = 4.0, 3.0  # speed per distance from the cursor [1/s], at most [m/s]
LASTS = 0.1  # of a pull, after which it is repeated [s]

# Keys of the viewer: 8, 9 and Home
LESS = ord("8")
MORE = ord("9")
HOME = 268

FACTOR = 1.25  # of noise per stroke
KEYS = "8 less noise, 9 more; Home: back to the start"


class Window:
    """A viewer's window on a plant, kept up to date on a thread of its own; `launch` makes the viewer's handle."""

    def __init__(self, plant: InteractivePlant, launch: Callable[..., Any] | None = None) -> None:
        self._plant, self.keys = plant, deque[int]()
        model = self.model = copy.copy(plant.scenario.loaded.model)
        dress(model)
        scene = plant.scenario.loaded.scene
        width, depth = (scene.upper - scene.lower).tolist()
        model.stat.extent = 0.9 * max(depth, width / 1.6)  # the viewer begins at 1.5 times this distance
        model.vis.global_.azimuth, model.vis.global_.elevation = 90, -70  # from above, and a little from the south
        self.data = mujoco.MjData(model)
        self._robot = int(model.body(ROBOT).id)
        self._names = {body: name for name, body in loose_bodies(model).items()}
        self._held: int | None = None  # body that is dragged
        self._place = np.zeros(2)  # where it was taken [m]
        self._cursor = np.zeros(3)  # the cursor then [m]
        self._there = np.zeros(2)  # where it is dragged to [m]
        self.home = False  # whether the key Home was struck
        self._ended = threading.Event()
        mujoco.mj_setState(model, self.data, plant.snapshot, SHOWN)
        mujoco.mj_forward(model, self.data)
        self.handle = (launch or _launcher())(model, self.data, key_callback=self.keys.append)
        self.thread = threading.Thread(target=self._watch, name="window", daemon=True)

    @property
    def open(self) -> bool:
        """Return whether it has not been closed."""
        return bool(self.handle.is_running())

    def close(self) -> None:
        """Close it, once its thread has been started."""
        self._ended.set()
        self.thread.join()
        self.handle.close()
        until = time.monotonic() + PATIENCE
        while self.handle.m is not None and time.monotonic() < until:  # X minds if it draws while the process ends
            time.sleep(REFRESH)

    def _watch(self) -> None:
        while self.open and not self._ended.wait(REFRESH):
            self.refresh()

    def refresh(self) -> None:
        """Show where everything is, and pass on events since the last call."""
        with self.handle.lock():
            mujoco.mj_setState(self.model, self.data, self._plant.snapshot, SHOWN)
            events = self._dragged(self.handle.perturb)
            mujoco.mj_forward(self.model, self.data)
        while self.keys:
            key = self.keys.popleft()
            self.home |= key == HOME
            if key in (LESS, MORE):
                noise = self._plant.scenario.settings.noise
                events.append(Noise(at=0.0, noise=noise * (FACTOR if key == MORE else 1.0 / FACTOR)))
        self.handle.sync()
        self._plant.asked.extend(events)

    def _dragged(self, perturb: Any) -> list[Event]:
        """Return events of the mouse by the viewer's perturbation; a loose body is shown where it is held."""
        body = int(perturb.select) if perturb.active else None
        if self._held is not None and body != self._held:  # it is let go
            name, self._held = self._names.get(self._held), None
            if name is None or np.array_equal(self._there, self._place):
                return []
            x, y = self._there.tolist()
            return [Move(at=0.0, what=name, to=(x, y))]
        if body is None or not (body == self._robot or body in self._names):
            return []
        place = np.array(self.data.xpos[body, :2])
        cursor = np.array(perturb.refpos, dtype=float)

        if self._held is None:
            self._held, self._place, self._cursor = body, place, cursor
        gone = cursor - self._cursor
        ahead = np.radians(self.handle.cam.azimuth)
        up = np.array([np.cos(ahead), np.sin(ahead)])  # in the picture: away from the camera
        self._there = self._place + gone[:2] + gone[2] * up
        if body != self._robot:
            self.data.mocap_pos[self.model.body_mocapid[body], :2] = self._there
            return []
        speed = PULL * (self._there - place)
        speed *= min(1.0, PULLED / max(float(np.hypot(*speed)), 1e-9))
        return [Push(at=0.0, speed=(float(speed[0]), float(speed[1])), lasts=LASTS)]


def _launcher() -> Callable[..., Any]:
    """Return MuJoCo's passive viewer."""
    try:
        from mujoco import viewer
    except (ImportError, RuntimeError) as error:
        raise OptionError(f"MuJoCo's viewer cannot be had ({error}); use --headless, or pip install mujoco") from None
    return lambda *data, **named: viewer.launch_passive(*data, show_left_ui=False, show_right_ui=False, **named)
