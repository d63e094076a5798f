"""Events that interfere with a run, the world that they change, and scripts that time them, as JSON.

A script is a list of steps, each at a time of the run, as in FORM.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError, one_line
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Goal, Scene
from sim.files import why_unreadable
from sim.mjcf.edits import PREFIX
from sim.scenario import Driver, Scenario

GOAL = "goal"  # the name under which the goal's disc is moved
LARGEST = 1 << 20  # bytes of a script
FORM = '[{"at": 0.5, "push": [0, 0.4], "for": 0.3}, {"at": 1, "move": "goal", "to": [5, 3]}, {"at": 2, "noise": 0.3}]'
_KEYS = {"push": {"at", "push", "for"}, "move": {"at", "move", "to", "by"}, "noise": {"at", "noise"}}
_NUMBERS = {  # keys of a step: how many numbers, from and to [s], [m/s], [m]
    "at": (1, 0.0, 1e5), "for": (1, 1e-3, 1e5), "push": (2, -20.0, 20.0), "to": (2, -1e4, 1e4), "by": (2, -1e4, 1e4),
    "noise": (1, 1e-6, 1e3),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """A push on the robot's body: one with velocity servos is carried along meanwhile, others gain that speed."""

    at: float  # time of the run [s]
    speed: tuple[float, float]  # [m/s]
    lasts: float = 0.2  # [s]

    def __str__(self) -> str:
        return f"pushed by ({self.speed[0]:.2g}, {self.speed[1]:.2g}) m/s for {self.lasts:.2g} s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A static obstacle, or the goal, is put elsewhere."""

    at: float  # time of the run [s]
    what: str
    to: tuple[float, float]  # where its centre goes [m], or how far
    relative: bool = False  # `to` is how far

    def __str__(self) -> str:
        return f"{self.what} moved {'by' if self.relative else 'to'} ({self.to[0]:.3g}, {self.to[1]:.3g})"


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """The noise becomes another."""

    at: float  # time of the run [s]
    noise: float  # b, as --noise

    def __str__(self) -> str:
        return f"noise {self.noise:.3g}"


Event = Push | Move | Noise


def loose_bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Return bodies that can be placed, the one that shows the goal included, by the names under which they are."""
    bodies = np.flatnonzero(model.body_mocapid >= 0).tolist()
    return {(model.body(body).name or f"body{body}").removeprefix(PREFIX): body for body in bodies}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """A scenario that may have been changed since it was loaded, where its loose bodies are, and who drives there."""

    scenario: Scenario  # with the scene as it is now
    places: Mapping[str, Array]  # x, y of every loose body by the name under which it is moved, (2,) [m]
    driver: Driver  # until plans for this world are made, that of an earlier one, as is the free space

    @classmethod
    def of(cls, scenario: Scenario, driver: Driver) -> World:
        """Return that of a scenario whose scene was loaded loose."""
        model, scene = scenario.loaded.model, scenario.loaded.scene
        own = {GOAL, *(mover.name for mover in scene.movers)}  # movers go where their motions say
        loose = {name: body for name, body in loose_bodies(model).items() if name not in own}
        places = {name: np.array(model.body_pos[body, :2]) for name, body in loose.items()}
        return cls(scenario=scenario, places={**places, GOAL: scene.goal.center.astype(float)}, driver=driver)

    @property
    def scene(self) -> Scene:
        """As it is now."""
        return self.scenario.loaded.scene

    def after(self, event: Move | Noise, x: Array) -> World:
        """Return the world once an event has taken place, with the robot in a state x (n,); nothing is planned.

        Raises:
            OptionError: nothing of that name can be moved, or not there; the robot has no such noise.
        """
        try:
            if isinstance(event, Noise):
                return replace(self, scenario=self.scenario.with_settings(noise=event.noise))
            return self._moved(event, x)
        except PirrhtError as error:
            raise OptionError(f"{event}: {error}") from None

    def _moved(self, event: Move, x: Array) -> World:
        if event.what not in self.places:
            raise OptionError(f'there is no "{event.what}" that could be moved; there are {", ".join(self.places)}')
        there = np.array(event.to) + (self.places[event.what] if event.relative else 0.0)
        s, states = self.scenario, self.scenario.system.states
        heading = float(x[states.index("heading")]) if "heading" in states else 0.0
        start = np.array([x[0], x[1], (heading + np.pi) % (2 * np.pi) - np.pi])
        scene = replace(self._with(event.what, there), start=start)
        clearances = Collision(scene.world, scene.footprint).clearance(np.array([x[:2], scene.goal.center]))
        for place, clearance in zip(("the robot", "the goal"), clearances, strict=True):
            if clearance <= 0.0:
                raise OptionError(f"that is on top of {place}, or too close; it stays where it was")
        scenario = replace(s, loaded=replace(s.loaded, scene=scene), problem=s.system.problem(scene, s.settings))
        return replace(self, scenario=scenario, places={**self.places, event.what: there})

    def _with(self, what: str, there: Array) -> Scene:
        scene, loaded = self.scene, self.scenario.loaded
        if what == GOAL:
            return replace(scene, goal=Goal(center=there, radius=scene.goal.radius))
        shift = np.array([*(there - self.places[what]), 0.0])
        geoms = np.flatnonzero(loaded.obstacle_geoms & ~loaded.moving_geoms)  # in the order of the scene's obstacles
        mine = loaded.model.body_rootid[loaded.model.geom_bodyid[geoms]] == loose_bodies(loaded.model)[what]
        pairs = zip(scene.obstacles, mine, strict=True)
        return replace(scene, obstacles=tuple(replace(o, position=o.position + shift) if i else o for o, i in pairs))


def read(path: Path) -> tuple[Event, ...]:
    """Return the steps of a script in the order of their times.

    Raises:
        OptionError: it cannot be read, or a step is none; names it and shows a script.
    """
    why = why_unreadable(path)
    if why is not None:
        raise OptionError(f"--script {path}: it {why}; give a JSON file like {FORM}")
    try:
        with path.open("rb") as stream:
            steps = json.loads(stream.read(LARGEST))
    except (ValueError, RecursionError, OSError) as error:
        raise OptionError(f"--script {path}: this is no JSON ({one_line(error)}); write a list like {FORM}") from None
    if not isinstance(steps, list):
        raise OptionError(f"--script {path}: it holds no list of steps; write one like {FORM}")
    events = [_event(f"--script {path}: step {i}", step) for i, step in enumerate(steps, 1)]
    return tuple(sorted(events, key=lambda event: event.at))


def _event(where: str, step: Any) -> Event:
    kinds = [kind for kind in _KEYS if isinstance(step, Mapping) and kind in step]
    if len(kinds) != 1:
        raise OptionError(f"{where} is not one of push, move and noise; write it as in {FORM}")
    kind, keys = kinds[0], _KEYS[kinds[0]]
    for name in sorted(set(step) - keys):
        raise OptionError(f'{where} has "{name}"; a {kind} has {", ".join(sorted(keys))}')

    values: dict[str, Any] = {}
    for name in {"at", *step} & _NUMBERS.keys():
        (count, low, high), value = _NUMBERS[name], step.get(name)
        found = value if count > 1 and isinstance(value, list) else [value]
        if len(found) != count or not all(type(one) in (int, float) and low <= one <= high for one in found):
            required = f"{'a number' if count == 1 else 'two numbers [x, y]'} from {low:g} to {high:g}"
            raise OptionError(f'{where}: "{name}" is {json.dumps(value)[:40]}; it must be {required}')
        values[name] = float(value) if count == 1 else tuple(map(float, found))
    if kind == "push":
        return Push(at=values["at"], speed=values["push"], lasts=values.get("for", 0.2))
    if kind == "noise":
        return Noise(**values)
    if len(step.keys() & {"to", "by"}) != 1 or not isinstance(step["move"], str):
        raise OptionError(f'{where}: a move names what is moved, and has either "to": [x, y] or "by": [x, y]')
    to = values.get("to") or values["by"]
    return Move(at=values["at"], what=step["move"], to=to, relative="by" in step)
