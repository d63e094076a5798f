"""Robots on the ground: x, y, perhaps a heading, and perhaps speeds along x and y or ahead."""

from collections.abc import Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.scene import Goal
from sim.states.adapter import Component, Joints, StateAdapter
from sim.text import counted

UPRIGHT = 1 - 1e-6  # upward part of the axis of an upright cylinder, at least
REACH = 1e4  # of a goal at most [m]
TURNED = 1e3  # heading of a start at most [rad]
CYLINDER, SPHERE = 5, 2  # MuJoCo's numbers of these shapes, which is slow to import


class Plane(StateAdapter):
    """Adapts states that begin with x and y; "heading" is the direction of the robot's x-axis."""

    components = MappingProxyType({
        "x": Component("m", "position {}", "X"),
        "y": Component("m", "position {}", "Y"),
        "heading": Component("rad", "heading of a car {}", "TH", turned=True),
        "vx": Component("m/s", "velocity along x of a mass {}", "VX"),
        "vy": Component("m/s", "velocity along y of a mass {}", "VY"),
        "speed": Component("m/s", "speed of a car ahead {}, where that is state", "V"),
    })  # fmt: skip
    pose = ("x", "y", "heading")
    dimension = 2
    velocities = ("vx", "vy")
    speeds = ("speed",)
    start_form = ("X", "Y", "[TH]")
    goal_form = ("X", "Y", "R")
    workspace_form = ("X0", "X1", "Y0", "Y1")

    def __init__(self, states: Sequence[str]) -> None:
        super().__init__(states)
        self.heading = self.states.index("heading") if "heading" in self.states else None

    def start_of(self, x: Array) -> Array:
        """Return x, y [m] and the heading from -pi to pi [rad], (3,)."""
        heading = 0.0 if self.heading is None else float(x[self.heading])
        return np.array([x[0], x[1], (heading + np.pi) % (2 * np.pi) - np.pi])

    def start(self, data: Any, site: int, given: Sequence[float] | None) -> Array:
        """Read x, y [m] and heading [rad], (3,); the x-axis of the site is the heading."""
        if given is not None and len(given) not in (2, 3):
            raise SceneError(f"the start has {counted(len(given), 'number')}; give x, y and optionally a heading")
        if given is None and site < 0:
            raise SceneError('no site "start"; add <site name="start" pos="x y 0"/> or give --start X Y')
        heading = float(np.arctan2(data.site_xmat[site, 3], data.site_xmat[site, 0])) if site >= 0 else 0.0
        place = [*(data.site_xpos[site, :2] if given is None else given), heading][:3]
        if not abs(place[2]) <= TURNED:
            raise SceneError(f"the start has the heading {place[2]:g}; write radians, from -{TURNED:g} to {TURNED:g}")
        return np.array(place, dtype=float)

    def goal(self, model: Any, data: Any, site: int, given: Sequence[float] | None) -> Goal:
        """Read the disc of a sphere or an upright cylinder."""
        remedy = '<site name="goal" type="cylinder" pos="x y 0" size="radius 0.005"/>'
        if given is None and site < 0:
            raise SceneError(f'no site "goal"; add {remedy} or give --goal X Y R')
        if given is None:
            kind = int(model.site_type[site])
            if kind != SPHERE and not (kind == CYLINDER and abs(data.site_xmat[site, 8]) >= UPRIGHT):
                raise SceneError(f'site "goal" is no sphere or upright cylinder; write {remedy}')
            given = [*data.site_xpos[site, :2], model.site_size[site, 0]]
        if len(given) != 3:
            raise SceneError(f"the goal has {counted(len(given), 'number')}; give x, y and radius, and no heading")
        if given[2] > REACH:
            raise SceneError(f"the goal has a radius of {given[2]:g}; write at most {REACH:g} m")
        return Goal(center=np.array(given[:2], dtype=float), radius=float(given[2]))

    def borders_text(self, lower: Array, upper: Array) -> str:
        """Return the ranges of x and y."""
        return f"x {lower[0]:g} to {upper[0]:g} and y {lower[1]:g} to {upper[1]:g}"

    def unfit(self, model: Any, system: str) -> str:
        """Refuse joints that are no slides along x and y, perhaps with a hinge about z, and no free joint on wheels."""
        from sim.states import planar_joints

        return planar_joints.unfit(model, self, system)

    def rest(self, model: Any) -> Array:
        """Return joint positions (nq,) at the origin, heading along x; of a robot on wheels once it has settled."""
        from sim.states import planar_joints

        return planar_joints.rest_pose(model)

    def joints(self, model: Any) -> Joints:
        """Return those of slides and a hinge, or of a free joint on wheels."""
        from sim.states import planar_joints

        return planar_joints.joints_of(model, self)

    def above(self, states: Array) -> Array:
        """Return x and y, (..., 2)."""
        return states[..., :2]

    def drawn(self, states: Array, height: float | Array) -> Array:
        """Return x, y and the height, (..., 3)."""
        return np.concatenate([states[..., :2], np.broadcast_to(height, states.shape[:-1])[..., None]], axis=-1)

    def poses(self, states: Array) -> Array:
        """Return x, y and heading, which is 0 of what has none."""
        heading = np.zeros(states.shape[:-1]) if self.heading is None else states[..., self.heading]
        return np.concatenate([states[..., :2], heading[..., None]], axis=-1)

    def ahead(self, x: Array, y: Array) -> Array:
        """Return the way, turned back by the heading at x."""
        dx, dy = y[:2] - x[:2]
        heading = 0.0 if self.heading is None else float(x[self.heading])
        c = np.cos(heading)
        s = np.sin(heading)

        return np.array([c * dx + s * dy, c * dy - s * dx, 0.0])

    def direction(self, start: Array) -> Array | None:
        """Return the direction of the start's heading, if the system has one."""
        return None if self.heading is None else np.array([np.cos(start[2]), np.sin(start[2])])

    def facing(self, points: Array, count: int) -> list[Array]:
        """Return the points themselves, or with each of so many even headings in the third column."""
        if self.heading is None:
            return [points]
        turns = 2.0 * np.pi * np.arange(count) / count
        return [np.column_stack([points, np.full(len(points), turn)]) for turn in turns]
