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
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.scene import Scene
from sim.mjcf.dressed import dress
from sim.mjcf.edits import PREFIX
from sim.play.drive import ROBOT, Disturbed, Snapshot
from sim.play.events import GOAL, Event, Move, Noise, Push
from sim.play.world import loose_bodies

REFRESH = 1.0 / 60.0  # [s]
PATIENCE = 3.0  # with a window that is to close [s]
PULL, PULLED = 4.0, 3.0  # speed per distance from the cursor [1/s], at most [m/s]
LASTS = 0.1  # of a pull, after which it is told anew [s]
LESS, MORE, HOME = ord("8"), ord("9"), 268  # keys of the viewer: 8, 9 and Home
AWAY = 1.35  # times the size of the workspace the camera is away
FACTOR = 1.25  # of noise per stroke
KEYS = "8 less noise, 9 more; Home: back to the start"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Held:
    """A body that is dragged."""

    body: int
    place: Array  # (2,) where it was taken [m]
    cursor: Array  # (3,) and the cursor then [m]

    def dragged_to(self, cursor: Array, azimuth: float) -> Array:
        """Move the taken place with the cursor, (2,) [m]: up in the picture is away from the camera, on the ground."""
        way, ahead = cursor - self.cursor, np.radians(azimuth)
        there: Array = self.place + way[:2] + way[2] * np.array([np.cos(ahead), np.sin(ahead)])
        return there


def _pull(way: Array) -> Push:
    """A push towards a place that is `way` (2,) [m] ahead."""
    speed = PULL * way
    speed *= min(1.0, PULLED / max(float(np.hypot(*speed)), 1e-9))
    return Push(at=0.0, speed=(float(speed[0]), float(speed[1])), lasts=LASTS)


class Mouse:
    """Translate a viewer's mouse to events, by how its perturbation changes from picture to picture."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._robot = int(model.body(ROBOT).id)
        self._names = {body: name for name, body in loose_bodies(model).items()}
        self._names[int(model.body(PREFIX + GOAL).id)] = GOAL
        self._held: _Held | None = None
        self._there = np.zeros(2)  # and where it is dragged to [m]

    def events(self, data: mujoco.MjData, perturb: Any, azimuth: float) -> list[Event]:
        """Return events of the mouse now; a loose body that is dragged is shown where it is held.

        Args:
            data: what is shown.
            perturb: the viewer's.
            azimuth: where its camera looks to [degrees].
        """
        body = int(perturb.select) if perturb.active else None
        done: list[Event] = []
        if self._held is not None and body != self._held.body:
            done += self._released(self._held)
            self._held = None
        if body == self._robot or body in self._names:
            place = np.array(data.xpos[body, :2], dtype=float)
            if self._held is None:
                self._held = _Held(body=body, place=place, cursor=np.array(perturb.refpos, dtype=float))
            there = self._there = self._held.dragged_to(np.array(perturb.refpos, dtype=float), azimuth)
            if body == self._robot:
                done.append(_pull(there - place))
            else:
                data.mocap_pos[data.model.body_mocapid[body], :2] = there
        return done

    def _released(self, held: _Held) -> list[Event]:
        if held.body not in self._names:
            return []
        x, y = (float(v) for v in self._there)  # not what is shown: the viewer has moved that after its own ways
        return [Move(at=0.0, what=self._names[held.body], to=(x, y))] if (x, y) != tuple(held.place) else []

    def holds(self, row: int, model: mujoco.MjModel) -> bool:
        """Return whether a row of the mocap poses is what is being dragged."""
        return self._held is not None and int(model.body_mocapid[self._held.body]) == row


class Window:
    """A viewer's window on a drive, kept up to date on a thread of its own.

    Args:
        plant: what is shown and interfered with.
        launch: (model, data, key_callback=...) -> a handle, as `mujoco.viewer.launch_passive`.
    """

    def __init__(self, plant: Disturbed, launch: Callable[..., Any] | None = None) -> None:
        self._plant, self.keys = plant, deque[int]()
        self.model = copy.copy(plant.world.scenario.loaded.model)
        dress(self.model)
        self.data = mujoco.MjData(self.model)
        self._mouse = Mouse(self.model)
        self.home = False  # whether the key Home was struck
        self._ended = threading.Event()
        self._put(plant.snapshot)
        mujoco.mj_forward(self.model, self.data)
        self.handle = (launch or launcher())(self.model, self.data, key_callback=self.keys.append)
        self._look(plant.world.scene)
        self._thread = threading.Thread(target=self._watch, name="window", daemon=True)

    def start(self) -> Window:
        """Begin to show; the window itself."""
        self._thread.start()
        return self

    @property
    def open(self) -> bool:
        """Return whether it has not been closed."""
        return bool(self.handle.is_running())

    def close(self) -> None:
        """Close it."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self.handle.close()
        until = time.monotonic() + PATIENCE
        while self.handle.m is not None and time.monotonic() < until:  # X minds if it draws while the process ends
            time.sleep(REFRESH)

    def _look(self, scene: Scene) -> None:
        """Look at the workspace from above, and a little from the south."""
        size, middle = scene.upper - scene.lower, 0.5 * (scene.upper + scene.lower)
        with self.handle.lock():
            camera = self.handle.cam
            camera.lookat[:] = *middle, 0.0
            camera.distance = AWAY * max(float(size[1]), float(size[0]) / 1.6)
            camera.azimuth, camera.elevation = 90.0, -70.0

    def _watch(self) -> None:
        while self.open and not self._ended.wait(REFRESH):
            self.refresh()

    def refresh(self) -> None:
        """Show where everything is, and pass on what was done since."""
        with self.handle.lock():
            self._put(self._plant.snapshot)
            events = [
                *self._mouse.events(self.data, self.handle.perturb, float(self.handle.cam.azimuth)),
                *self._typed(),
            ]
            mujoco.mj_forward(self.model, self.data)
        self.handle.sync()
        self._plant.asked.extend(events)

    def _put(self, seen: Snapshot) -> None:
        data = self.data
        data.time, data.qpos[:] = seen.time, seen.qpos
        for row in range(self.model.nmocap):
            if not self._mouse.holds(row, self.model):
                data.mocap_pos[row], data.mocap_quat[row] = seen.mocap[row], seen.turns[row]

    def _typed(self) -> list[Event]:
        events: list[Event] = []
        while self.keys:
            key = self.keys.popleft()
            self.home |= key == HOME
            if key in (LESS, MORE):
                noise = self._plant.world.scenario.settings.noise
                events.append(Noise(at=0.0, noise=noise * (FACTOR if key == MORE else 1.0 / FACTOR)))
        return events


def launcher() -> Callable[..., Any]:
    """MuJoCo's passive viewer.

    Raises:
        OptionError: it cannot be had.
    """
    try:
        from mujoco import viewer
    except (ImportError, RuntimeError) as error:
        raise OptionError(f"MuJoCo's viewer cannot be had ({error}); use --headless, or pip install mujoco") from None

    def launch(*arguments: Any, **named: Any) -> Any:
        return viewer.launch_passive(*arguments, show_left_ui=False, show_right_ui=False, **named)

    return launch
