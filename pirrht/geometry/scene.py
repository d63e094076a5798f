"""Scenes as plain values: what stands where, where the robot starts and where it should go."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht import shown
from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.motion import Mover
from pirrht.geometry.obstacle import Kind, Obstacle

__all__ = ["Footprint", "Goal", "Kind", "Obstacle", "Scene", "World"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goal:
    """The disc the robot's centre has to reach.

    Attributes:
        center: x, y, (2,) [m]; the paper's goal representative point.
        radius: of the disc [m].

    Examples:
        >>> import numpy as np
        >>> from pirrht import Goal
        >>> goal = Goal(center=np.array([5.5, 2.5]), radius=0.25)
        >>> goal
        Goal((5.5, 2.5), radius 0.25 m)
        >>> bool(goal.contains(np.array([5.4, 2.6])))
        True
    """

    center: Array
    radius: float

    def __repr__(self) -> str:
        return f"Goal({shown.vector(self.center)}, radius {self.radius:g} m)"

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

    Attributes:
        name: what messages and pictures call it.
        lower: least corner of the box that holds the robot's centre, (2,) [m].
        upper: its greatest corner, (2,) [m].
        obstacles: convex solids that stand.
        goal: the disc to be reached.
        start: x, y [m] and heading [rad], (3,).
        robot_radius: of the sphere as which the robot plans [m].
        robot_height: of that sphere's centre above the ground [m].
        defaults: option name -> value that the scene asks for, in the option's unit.
        movers: bodies that move; `obstacles` holds only what stands.

    Raises:
        SceneError: start or goal lie outside the workspace, or something is empty; names the scene.

    Examples:
        >>> import numpy as np
        >>> from pirrht import Goal, Kind, Obstacle, Scene
        >>> table = Obstacle(
        ...     name="table", kind=Kind.BOX, size=np.array([0.4, 0.4, 0.3]),
        ...     position=np.array([2.0, 1.5, 0.3]), rotation=np.eye(3),
        ... )
        >>> Scene(
        ...     name="room", lower=np.zeros(2), upper=np.array([4.0, 3.0]), obstacles=(table,),
        ...     goal=Goal(center=np.array([3.4, 1.5]), radius=0.3), start=np.array([0.6, 1.5, 0.0]), robot_radius=0.2,
        ... )
        Scene('room', 4 x 3 m, 1 obstacle, 0 that move, from (0.6, 1.5) to (3.4, 1.5), robot of 0.2 m)
    """

    name: str
    lower: Array
    upper: Array
    obstacles: tuple[Obstacle, ...]
    goal: Goal
    start: Array
    robot_radius: float
    robot_height: float = 0.1
    defaults: dict[str, float] = field(default_factory=dict)
    movers: tuple[Mover, ...] = ()

    def __repr__(self) -> str:
        across, up = self.upper - self.lower
        stand = f"{len(self.obstacles)} obstacle{'s' if len(self.obstacles) != 1 else ''}"
        way = f"from {shown.vector(self.start[:2])} to {shown.vector(self.goal.center)}"
        return (
            f"Scene({shown.name(self.name)}, {across:g} x {up:g} m, {stand}, {len(self.movers)} that move, {way}, "
            f"robot of {self.robot_radius:g} m)"
        )

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
