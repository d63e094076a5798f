"""World of a run, and its changes when something is moved: plain values, nothing is planned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError, SceneError
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Goal, Scene
from sim.mjcf.edits import PREFIX
from sim.play.events import GOAL, Move, Noise
from sim.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """A scenario that may have been changed since it was loaded, and where its loose bodies are."""

    scenario: Scenario  # with the scene as it is now; its free space is that of the one that was planned for last
    places: Mapping[str, Array]  # x, y of every loose body by the name under which it is moved, (2,) [m]
    grounded: bool = True  # whether the free space is that of the scene as it is now

    @classmethod
    def of(cls, scenario: Scenario) -> World:
        """Return that of a scenario whose scene was loaded loose."""
        model, scene = scenario.loaded.model, scenario.loaded.scene
        own = {mover.name for mover in scene.movers}  # those go where their motions say
        loose = {name: body for name, body in loose_bodies(model).items() if name not in own}
        places = {name: np.array(model.body_pos[body, :2]) for name, body in loose.items()}
        return cls(scenario=scenario, places={**places, GOAL: scene.goal.center.astype(float)})

    @property
    def scene(self) -> Scene:
        """As it is now."""
        return self.scenario.loaded.scene

    def moved(self, event: Move, x: Array) -> World:
        """Return the world once something has been moved, with the robot in a state x (n,).

        Raises:
            OptionError: nothing of that name can be moved, or not there.
        """
        if event.what not in self.places:
            raise OptionError(f'there is no "{event.what}" that could be moved; there are {", ".join(self.places)}')
        there = np.array(event.to) + (self.places[event.what] if event.relative else 0.0)
        s, states = self.scenario, self.scenario.system.states
        heading = float(x[states.index("heading")]) if "heading" in states else 0.0
        try:
            start = np.array([x[0], x[1], (heading + np.pi) % (2 * np.pi) - np.pi])
            scene = replace(self._with(event.what, there), start=start)
        except SceneError as error:
            raise OptionError(f"{event}: {error}") from None
        clearances = Collision(scene.world, scene.footprint).clearance(np.array([x[:2], scene.goal.center]))
        for place, clearance in zip(("the robot", "the goal"), clearances, strict=True):
            if clearance <= 0.0:
                raise OptionError(f"{event}: that is on top of {place}, or too close; it stays where it was")
        scenario = replace(s, loaded=replace(s.loaded, scene=scene), problem=s.system.problem(scene, s.settings))
        return replace(self, scenario=scenario, places={**self.places, event.what: there}, grounded=False)

    def shaken(self, event: Noise) -> World:
        """Return the world under another noise.

        Raises:
            OptionError: this robot has no such number, or it cannot work.
        """
        try:
            return replace(self, scenario=self.scenario.with_settings(noise=event.noise))
        except PirrhtError as error:
            raise OptionError(f"{event}: {error}") from None

    def _with(self, what: str, there: Array) -> Scene:
        scene, loaded = self.scene, self.scenario.loaded
        if what == GOAL:
            return replace(scene, goal=Goal(center=there, radius=scene.goal.radius))
        shift = np.array([*(there - self.places[what]), 0.0])
        geoms = np.flatnonzero(loaded.obstacle_geoms & ~loaded.moving_geoms)  # in the order of the scene's obstacles
        mine = loaded.model.body_rootid[loaded.model.geom_bodyid[geoms]] == loose_bodies(loaded.model)[what]
        pairs = zip(scene.obstacles, mine, strict=True)
        return replace(scene, obstacles=tuple(replace(o, position=o.position + shift) if i else o for o, i in pairs))


def loose_bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Return bodies that can be moved by the names under which they are, without the one that shows the goal."""
    bodies = np.flatnonzero(model.body_mocapid >= 0).tolist()
    names = {model.body(body).name or f"body{body}": body for body in bodies}
    return {name.removeprefix(PREFIX): body for name, body in names.items() if name != PREFIX + GOAL}
