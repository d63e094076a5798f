"""Scenes as plain values: what stands where, where the robot starts and where it should go."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.motion import Mover
from pirrht.geometry.obstacle import Kind, Obstacle

__all__ = ["Footprint", "Goal", "Kind", "Obstacle", "Scene", "World"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goal:
    """The disc the robot's centre has to reach."""

    center: Array  # (2,) [m]; the paper's goal representative point
    radius: float  # [m]

    def contains(self, position: Array) -> NDArray[np.bool_]:
        """Whether positions (..., 2) [m] lie in the closed disc, (...,)."""
        inside: NDArray[np.bool_] = np.hypot(*np.moveaxis(position - self.center, -1, 0)) <= self.radius
        return inside


class World(NamedTuple):
    """What stands where; distances, clearance fields and topological obstacles depend on it and the footprint alone."""

    lower: Array  # (2,) least corner of the box that holds the robot's centre [m]
    upper: Array  # (2,) greatest corner [m]
    obstacles: tuple[Obstacle, ...]

    def contains(self, position: Array) -> bool:
        """Whether a robot centre (2,) [m] lies strictly inside the workspace."""
        return bool(np.all(position > self.lower) and np.all(position < self.upper))


class Footprint(NamedTuple):
    """The sphere as which a robot plans."""

    radius: float  # [m]
    height: float  # of its centre above the ground [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """A planar workspace with solid obstacles, the footprint of a robot in it, and its task: a start and a goal.

    Raises:
        SceneError: start or goal lie outside the workspace, or something is empty; names the scene.
    """

    name: str
    lower: Array  # (2,) least corner of the box that holds the robot's centre [m]
    upper: Array  # (2,) greatest corner [m]
    obstacles: tuple[Obstacle, ...]
    goal: Goal
    start: Array  # (3,) x, y [m], heading [rad]
    robot_radius: float  # [m]
    robot_height: float = 0.1  # height of the sphere's centre above the ground [m]
    defaults: dict[str, float] = field(default_factory=dict)  # option name -> value the scene asks for
    movers: tuple[Mover, ...] = ()  # what moves; `obstacles` holds only what stands

    def __post_init__(self) -> None:
        if not (np.isfinite(self.robot_radius) and self.robot_radius > 0):
            raise SceneError(f"{self.name}: the robot radius is {self.robot_radius:g}; it must be positive")
        if not (np.isfinite(self.goal.radius) and self.goal.radius > 0):
            raise SceneError(f"{self.name}: the goal radius is {self.goal.radius:g}; it must be positive")
        if not np.all(self.lower < self.upper):
            raise SceneError(f"{self.name}: the workspace is empty, from {self.lower} to {self.upper}")
        for what, point in (("start", self.start), ("goal", self.goal.center)):
            if not (np.all(np.isfinite(point)) and self.world.contains(point[:2])):
                raise SceneError(
                    f"{self.name}: the {what} ({point[0]:g}, {point[1]:g}) lies outside the workspace "
                    f"[{self.lower[0]:g}, {self.upper[0]:g}] x [{self.lower[1]:g}, {self.upper[1]:g}]"
                )

    @property
    def world(self) -> World:
        """Bounds, 2 x (2,) [m], and obstacles."""
        return World(self.lower, self.upper, self.obstacles)

    @property
    def footprint(self) -> Footprint:
        """Radius and height of the robot [m]."""
        return Footprint(self.robot_radius, self.robot_height)
