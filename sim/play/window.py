"""MuJoCo's passive viewer as what somebody interferes through: the mouse pushes and moves, keys change the noise.

Double-click a body, then drag it with Ctrl and the right mouse button: the robot is pulled towards the cursor, and
whatever is loose is put down where the button is released.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from pirrht.errors import OptionError
from sim.mjcf.loose import PREFIX
from sim.play.events import GOAL, Event, Move, Noise, Push
from sim.play.plant import ROBOT, Disturbed, Snapshot
from sim.play.world import loose_bodies

REFRESH = 1.0 / 60.0  # [s]
PULL, PULLED = 4.0, 3.0  # speed per distance from the cursor [1/s], at most [m/s]
LASTS = 0.1  # of a pull, after which it is told anew [s]
LESS, MORE, HOME = ord("8"), ord("9"), 268  # keys of the viewer: 8, 9 and Home
FACTOR = 1.25  # of noise per stroke
KEYS = "8 less noise, 9 more; Home: back to the start"


class Mouse:
    """What a mouse does in a viewer, told by how its perturbation changes from picture to picture."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._robot = int(model.body(ROBOT).id)
        self._names = {body: name for name, body in loose_bodies(model).items()}
        self._names[int(model.body(PREFIX + GOAL).id)] = GOAL
        self._dragged: int | None = None

    def events(self, data: mujoco.MjData, perturb: Any) -> list[Event]:
        """What it does now; a loose body that is dragged is shown where the cursor is."""
        body = int(perturb.select) if perturb.active else None
        to = np.array(perturb.refpos[:2], dtype=float)
        done: list[Event] = []
        if self._dragged is not None and body != self._dragged:
            row = data.model.body_mocapid[self._dragged]
            x, y = (float(v) for v in data.mocap_pos[row, :2])
            done.append(Move(at=0.0, what=self._names[self._dragged], to=(x, y)))
            self._dragged = None
        if body == self._robot:
            pull = PULL * (to - data.xpos[body, :2])
            pull *= min(1.0, PULLED / max(float(np.hypot(*pull)), 1e-9))
            done.append(Push(at=0.0, speed=(float(pull[0]), float(pull[1])), lasts=LASTS))
        elif body in self._names:
            self._dragged = body
            data.mocap_pos[data.model.body_mocapid[body], :2] = to
        return done

    def holds(self, row: int, model: mujoco.MjModel) -> bool:
        """Whether a row of the mocap poses is what is being dragged."""
        return self._dragged is not None and int(model.body_mocapid[self._dragged]) == row


class Window:
    """A viewer's window on a drive, kept up to date on a thread of its own.

    Args:
        plant: what is shown and interfered with.
        launch: (model, data, key_callback=...) -> a handle, as `mujoco.viewer.launch_passive`.
    """

    def __init__(self, plant: Disturbed, launch: Callable[..., Any] | None = None) -> None:
        self._plant, self.keys = plant, deque[int]()
        self.model = plant.world.scenario.loaded.model
        self.data = mujoco.MjData(self.model)
        self._mouse = Mouse(self.model)
        self.home = False  # whether the key Home was struck
        self._ended = threading.Event()
        self._put(plant.snapshot)
        self.handle = (launch or launcher())(self.model, self.data, key_callback=self.keys.append)
        self._thread = threading.Thread(target=self._watch, name="window", daemon=True)

    def start(self) -> Window:
        """Begin to show; the window itself."""
        self._thread.start()
        return self

    @property
    def open(self) -> bool:
        """Whether it has not been closed."""
        return bool(self.handle.is_running())

    def close(self) -> None:
        """Close it."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self.handle.close()

    def _watch(self) -> None:
        while self.open and not self._ended.wait(REFRESH):
            self.refresh()

    def refresh(self) -> None:
        """Show where everything is, and pass on what was done since."""
        with self.handle.lock():
            self._put(self._plant.snapshot)
            events = [*self._mouse.events(self.data, self.handle.perturb), *self._typed()]
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
