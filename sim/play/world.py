"""World of a run, and its changes when something is moved: plain values, nothing is planned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError, SceneError
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Goal, Scene
from sim.mjcf.edits import PREFIX
from sim.play.events import GOAL, Move, Noise
from sim.scenario import Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """A scenario that may have been changed since it was loaded, and where its loose bodies stand.

    Attributes:
        scenario: with the scene as it is now; its free space is that of the scene as it was planned for last.
        places: x, y of every loose body by the name under which it is moved, (2,) [m].
        grounded: whether the free space is that of the scene as it is now.
    """

    scenario: Scenario
    places: Mapping[str, Array]
    grounded: bool = True

    @classmethod
    def of(cls, scenario: Scenario) -> World:
        """That of a scenario whose scene was loaded loose."""
        model = scenario.loaded.model
        own = {mover.name for mover in scenario.loaded.scene.movers}  # those go where their motions say
        loose = {name: body for name, body in loose_bodies(model).items() if name not in own}
        found = {name: np.array(model.body_pos[body, :2]) for name, body in loose.items()}
        return cls(scenario=scenario, places={**found, GOAL: scenario.loaded.scene.goal.center.astype(float)})

    @property
    def scene(self) -> Scene:
        """As it is now."""
        return self.scenario.loaded.scene

    @cached_property
    def _solids(self) -> dict[str, list[int]]:
        """Obstacles of the scene by loose body."""
        loaded = self.scenario.loaded
        geoms = np.flatnonzero(loaded.obstacle_geoms & ~loaded.moving_geoms)
        owner = {body: name for name, body in loose_bodies(loaded.model).items()}
        solids: dict[str, list[int]] = {}
        for number, geom in enumerate(geoms.tolist()):
            root = int(loaded.model.body_rootid[loaded.model.geom_bodyid[geom]])
            if root in owner:
                solids.setdefault(owner[root], []).append(number)
        return solids

    def moved(self, event: Move, x: Array) -> World:
        """The world once something has been moved, with the robot in a state x (n,).

        Raises:
            OptionError: nothing of that name can be moved, or not there.
        """
        if event.what not in self.places:
            known = ", ".join(self.places)
            raise OptionError(f'there is no "{event.what}" that could be moved; there are {known}')
        there = np.array(event.to) + (self.places[event.what] if event.relative else 0.0)
        try:
            scene = replace(self._with(event.what, there), start=self._pose(x))
            self._check(scene, x, str(event))
        except SceneError as error:
            raise OptionError(f"{event}: {error}") from None
        places = {**self.places, event.what: there}
        return replace(self, scenario=self._in(scene), places=places, grounded=False)

    def shaken(self, event: Noise) -> World:
        """The world under another noise.

        Raises:
            OptionError: this robot has no such number, or it cannot work.
        """
        try:
            return replace(self, scenario=self.scenario.with_settings(noise=event.noise))
        except PirrhtError as error:
            raise OptionError(f"{event}: {error}") from None

    def _with(self, what: str, there: Array) -> Scene:
        scene = self.scene
        if what == GOAL:
            return replace(scene, goal=Goal(center=there, radius=scene.goal.radius))
        shift = np.array([*(there - self.places[what]), 0.0])
        mine = set(self._solids.get(what, ()))
        solids = [replace(o, position=o.position + shift) if i in mine else o for i, o in enumerate(scene.obstacles)]
        return replace(scene, obstacles=tuple(solids))

    def _check(self, scene: Scene, x: Array, what: str) -> None:
        robot, goal = Collision(scene.world, scene.footprint).clearance(np.array([x[:2], scene.goal.center]))
        for place, clearance in (("the robot", robot), ("the goal", goal)):
            if clearance <= 0.0:
                raise OptionError(f"{what}: that is on top of {place}, or too close; it stays where it was")

    def _pose(self, x: Array) -> Array:
        states = self.scenario.system.states
        heading = float(x[states.index("heading")]) if "heading" in states else 0.0
        return np.array([x[0], x[1], (heading + np.pi) % (2 * np.pi) - np.pi])

    def _in(self, scene: Scene) -> Scenario:
        s = self.scenario
        return replace(s, loaded=replace(s.loaded, scene=scene), problem=s.system.problem(scene, s.settings))


def loose_bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Bodies that can be moved by the names under which they are, without the one that shows the goal."""
    found = {}
    for body in np.flatnonzero(model.body_mocapid >= 0).tolist():
        name = model.body(body).name or f"body{body}"
        if name != PREFIX + GOAL:
            found[name.removeprefix(PREFIX)] = body
    return found
