"""Robots in space: x, y and z, and perhaps speeds along these axes."""

from collections.abc import Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.scene import Goal
from sim.states.adapter import Component, Joints, StateAdapter
from sim.states.plane import REACH, SPHERE
from sim.text import counted


class Space(StateAdapter):
    """Adapts states that begin with x, y and z; nothing turns."""

    components = MappingProxyType({
        "x": Component("m", "position {}", "X"),
        "y": Component("m", "position {}", "Y"),
        "z": Component("m", "height {}", "Z"),
        "vx": Component("m/s", "velocity along x of a mass {}", "VX"),
        "vy": Component("m/s", "velocity along y of a mass {}", "VY"),
        "vz": Component("m/s", "velocity upwards of a mass {}", "VZ"),
    })  # fmt: skip
    pose = ("x", "y", "z")
    dimension = 3
    velocities = ("vx", "vy", "vz")
    speeds = ()
    start_form = ("X", "Y", "Z")
    goal_form = ("X", "Y", "Z", "R")
    workspace_form = ("X0", "X1", "Y0", "Y1", "Z0", "Z1")

    def start_of(self, x: Array) -> Array:
        """Return x, y and z, (3,) [m]."""
        return np.array(x[:3], dtype=float)

    def start(self, data: Any, site: int, given: Sequence[float] | None) -> Array:
        """Read x, y and z, (3,) [m]."""
        if given is not None and len(given) != 3:
            raise SceneError(f"the start has {counted(len(given), 'number')}; give x, y and z of a robot in space")
        if given is None and site < 0:
            raise SceneError('no site "start"; add <site name="start" pos="x y z"/> or give --start X Y Z')
        return np.array(data.site_xpos[site] if given is None else given, dtype=float)

    def goal(self, model: Any, data: Any, site: int, given: Sequence[float] | None) -> Goal:
        """Read the ball of a sphere."""
        remedy = '<site name="goal" type="sphere" pos="x y z" size="radius"/>'
        if given is None and site < 0:
            raise SceneError(f'no site "goal"; add {remedy} or give --goal X Y Z R')
        if given is None:
            if int(model.site_type[site]) != SPHERE:
                raise SceneError(f'site "goal" is no sphere, which a robot in space needs; write {remedy}')
            given = [*data.site_xpos[site], model.site_size[site, 0]]
        if len(given) != 4:
            raise SceneError(f"the goal has {counted(len(given), 'number')}; give x, y, z and radius")
        if given[3] > REACH:
            raise SceneError(f"the goal has a radius of {given[3]:g}; write at most {REACH:g} m")
        return Goal(center=np.array(given[:3], dtype=float), radius=float(given[3]))

    def borders_text(self, lower: Array, upper: Array) -> str:
        """Return the ranges of x, y and z."""
        x, y, z = (f"{low:g} to {high:g}" for low, high in zip(lower, upper, strict=True))
        return f"x {x}, y {y} and z {z}"

    def unfit(self, model: Any, system: str) -> str:
        """Refuse joints that are no slides along x, y and z, and no free joint with rotors."""
        from sim.states import space_joints

        return space_joints.unfit(model, self, system)

    def rest(self, model: Any) -> Array:
        """Return joint positions (nq,) at the origin, level."""
        return np.array(model.qpos0)

    def joints(self, model: Any) -> Joints:
        """Return those of slides along x, y and z, or of a free joint with rotors."""
        from sim.states import space_joints

        return space_joints.joints_of(model, self)

    def above(self, states: Array) -> Array:
        """Return x and y, (..., 2)."""
        return states[..., :2]

    def drawn(self, states: Array, height: float | Array) -> Array:
        """Return x, y and z, (..., 3), whatever the height of robots on the ground."""
        return states[..., :3]

    def poses(self, states: Array) -> Array:
        """Return x, y and a heading of 0."""
        return np.concatenate([states[..., :2], np.zeros((*states.shape[:-1], 1))], axis=-1)

    def ahead(self, x: Array, y: Array) -> Array:
        """Return the way along the axes."""
        return np.asarray(y[:3] - x[:3])

    def direction(self, start: Array) -> Array | None:
        """Return nothing: it has no heading."""
        return None

    def facing(self, points: Array, count: int) -> list[Array]:
        """Return the points themselves."""
        return [points]
