"""Describe scenes as plain values: obstacles, the start of the robot, and its goal."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, NotRequired, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.formatting import short
from pirrht.geometry import solids
from pirrht.geometry.checks import number, numbers, parts_of, width_of
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Kind, Mover, Obstacle
from pirrht.geometry.tuning import TUNING

ROUNDING = TUNING.rounding
AXES = {2: "x, y [m]", 3: "x, y, z [m]"}  # of a position, by how many numbers it has
NO_FOOTPRINT = Footprint()  # a disc of the robot's radius

__all__ = ["ROUNDING", "Footprint", "Goal", "Kind", "Obstacle", "Scene", "SceneTask", "Workspace"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goal:
    """The disc the robot's centre has to reach; in space, the ball.

    Attributes:
        center: x, y, (2,), in space x, y, z, (3,) [m]; the paper's goal representative point.
        radius: of the disc or ball [m].

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

    def __post_init__(self) -> None:
        d = width_of(self.center)
        object.__setattr__(self, "center", numbers(self.center, (d,), "the goal center", AXES[d]))
        object.__setattr__(self, "radius", number(self.radius, "the goal radius", "a positive number [m]"))

    def __repr__(self) -> str:
        return f"Goal({formatting.vector(self.center)}, radius {self.radius:g} m)"

    def contains(self, position: Array) -> NDArray[np.bool_]:
        """Return whether positions (..., d) [m] lie in the closed disc or ball, (...,)."""
        inside: NDArray[np.bool_] = np.hypot.reduce(position - self.center, axis=-1) <= self.radius
        return inside


class Waiver(NamedTuple):
    """A disc in which plans keep less than the safety margin: at a start, a goal or a narrow passage; all in [m]."""

    x: float
    y: float
    radius: float  # of the disc
    less: float  # by which the margin is smaller, except near the rim


class Workspace(NamedTuple):
    """Static obstacles and border; distances, fields and topology depend on them and the footprint alone."""

    lower: Array  # (d,) least corner of the box that holds the robot's centre [m]; d is 2, or 3 in space
    upper: Array  # (d,) greatest corner [m]
    obstacles: tuple[Obstacle, ...]
    waivers: tuple[Waiver, ...] = ()

    def contains(self, position: Array) -> bool:
        """Return whether a robot centre (d,) [m] lies strictly inside the workspace."""
        return bool(np.all(position > self.lower) and np.all(position < self.upper))


class SceneTask(TypedDict):
    """Start, goal and robot of a scene."""

    start: ArrayLike  # x, y [m] and perhaps a heading [rad], which is 0 if not given, (2,) or (3,)
    goal: Goal | ArrayLike  # or x, y, radius [m], (3,)
    robot_radius: NotRequired[float]  # [m]
    footprint: NotRequired[Footprint]  # in place of a radius
    robot_height: NotRequired[float]  # of the robot's centre above the ground, 0.1 if not given [m]
    name: NotRequired[str]  # "scene" if not given


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """A workspace with solid obstacles, the footprint of a robot in it, and its task: a start and a goal.

    In the plane the robot moves at one height. A workspace whose corners have three numbers is one in space, and its
    robot a ball.

    Attributes:
        name: its name in messages and pictures.
        lower: least corner of the box that holds the robot's centre, (2,) or (3,) [m].
        upper: its greatest corner [m].
        obstacles: static convex solids.
        goal: the disc or ball to be reached.
        start: x, y [m] and heading [rad], in space x, y, z [m], (3,).
        robot_radius: of the sphere as which the robot plans, or the inscribed radius of its footprint [m].
        robot_height: of that sphere's centre above the ground [m], in the plane.
        defaults: option name -> value that the scene asks for, in the option's unit.
        movers: moving obstacles; `obstacles` holds only static ones.
        margin: part of the robot radius that is safety margin and not body [m]; a start inside it is no collision.
        narrow: discs around narrow passages in which less margin counts.
        waivers: these and those at start and goal; `FreeSpace.of` sets them.
        footprint: as which the robot plans, where that is no disc of the radius.

    Raises:
        SceneError: start or goal lie outside the workspace, something is empty, or a number is none or larger than
            1e6; names the scene.

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
    robot_radius: float = 0.0
    robot_height: float = TUNING.robot_height
    defaults: dict[str, float] = field(default_factory=dict)
    movers: tuple[Mover, ...] = ()
    margin: float = 0.0
    narrow: tuple[Waiver, ...] = ()
    waivers: tuple[Waiver, ...] = ()
    footprint: Footprint = NO_FOOTPRINT

    def __repr__(self) -> str:
        sides = " x ".join(f"{side:g}" for side in self.upper - self.lower)
        count = len(self.obstacles)

        return (
            f"Scene({formatting.name(self.name)}, {sides} m, {count} obstacle{'s' if count != 1 else ''}, "
            f"{len(self.movers)} that move, from {formatting.vector(self.place)} to "
            f"{formatting.vector(self.goal.center)}, robot of {self.robot_radius:g} m)"
        )

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise SceneError(f"the name of a scene is {short(self.name)}; it must be a text")
        self._check_parts()
        of = f"{self.name}: the "
        shape = self.footprint
        axes = AXES[self.dimension]
        if not shape.is_disc or (isinstance(self.robot_radius, float) and not self.robot_radius and shape.rounding):
            object.__setattr__(self, "robot_radius", shape.inscribed)
        measured = {
            "lower": numbers(self.lower, (self.dimension,), f"{of}least corner of the workspace", axes),
            "upper": numbers(self.upper, (self.dimension,), f"{of}greatest corner of the workspace", axes),
            "start": numbers(self.start, (3,), f"{of}start", "x, y [m] and a heading [rad], in space x, y, z [m]"),
            "robot_radius": number(self.robot_radius, f"{of}robot radius", "a positive number [m]"),
            "robot_height": number(self.robot_height, f"{of}height of the robot's centre", "a number [m]", 0.0),
            "margin": number(self.margin, f"{of}margin", "a part of the robot radius [m]", 0.0),
        }
        for key, value in measured.items():
            object.__setattr__(self, key, value)
        rounding = self.robot_radius if shape.is_disc else shape.rounding
        object.__setattr__(self, "footprint", replace(shape, rounding=rounding, height=self.robot_height))
        if not shape.is_disc and self.margin > shape.rounding + ROUNDING:
            raise SceneError(f"{of}margin is {self.margin:g}, and its footprint is grown by {shape.rounding:g} only")
        if not self.margin < self.robot_radius:
            raise SceneError(f"{of}margin is {self.margin:g}; it is a part of the robot radius, {self.robot_radius:g}")
        if not np.all(self.lower < self.upper):
            raise SceneError(f"{of}workspace is empty, from {self.lower} to {self.upper}")
        for what, point in (("start", self.place), ("goal", self.goal.center)):
            if not self.world.contains(point):
                box = " x ".join(f"[{low:g}, {high:g}]" for low, high in zip(self.lower, self.upper, strict=True))
                raise SceneError(f"{of}{what} {formatting.exact(point)} lies outside the workspace {box}")

    def _check_parts(self) -> None:
        """Refuse obstacles, movers, a goal and defaults of other types."""
        for key, kind in (("obstacles", Obstacle), ("movers", Mover), ("waivers", Waiver)):
            object.__setattr__(self, key, parts_of(getattr(self, key), kind, f"{self.name}: {key}"))
        if not isinstance(self.goal, Goal):
            raise SceneError(f"{self.name}: the goal is {short(self.goal)}; it must be a Goal")
        if not isinstance(self.footprint, Footprint):
            shape = short(self.footprint)
            raise SceneError(f"{self.name}: the footprint is {shape}; it must be a pirrht.Footprint")
        if not isinstance(self.defaults, dict) or not all(isinstance(name, str) for name in self.defaults):
            raise SceneError(f"{self.name}: the defaults are {short(self.defaults)}; they must be numbers by name")
        if len(self.goal.center) != self.dimension:
            center = formatting.exact(self.goal.center)
            raise SceneError(f"{self.name}: the goal center is {center}; it must be {AXES[self.dimension]}")
        in_space = self.dimension == 3
        if in_space and not (self.footprint.is_disc and not self.narrow):
            raise SceneError(f"{self.name}: a robot in space is a ball, and obstacles that waive margin are planar")
        for mover in self.movers:
            if mover.motion.in_space != in_space:
                row = "t, x, y, z and a quaternion w, x, y, z" if in_space else "t, x, y and a yaw"
                raise SceneError(f"{self.name}: rows of the motion of {mover.name} must be {row} here")

    @classmethod
    def from_boxes(cls, boxes: ArrayLike, *, lower: ArrayLike, upper: ArrayLike, **task: Unpack[SceneTask]) -> "Scene":
        """Make a scene of upright boxes.

        Args:
            boxes: a row x0, y0, x1, y1 [m] each, and perhaps a yaw about its middle [rad], (k, 4) or (k, 5).
            lower: least corner of the box that holds the robot's centre, (2,) [m].
            upper: its greatest corner, (2,) [m].
            task: `start` (x, y or x, y, heading), `goal` (x, y, radius, or a `Goal`), `robot_radius` or a
                `footprint`; and where they differ from "scene" and 0.1 m, `name` and `robot_height`.

        Raises:
            SceneError: a number is missing or cannot be; names the row.

        Examples:
            >>> from pirrht import Scene
            >>> room = {"lower": (0, 0), "upper": (4, 3), "start": (0.6, 1.4), "goal": (3.4, 1.5, 0.3)}
            >>> Scene.from_boxes([[1.6, 1.1, 2.4, 1.9]], robot_radius=0.2, **room)
            Scene('scene', 4 x 3 m, 1 obstacle, 0 that move, from (0.6, 1.4) to (3.4, 1.5), robot of 0.2 m)
        """
        return cls._of(solids.boxes(boxes, _height(task)), lower, upper, **task)

    @classmethod
    def from_discs(cls, discs: ArrayLike, *, lower: ArrayLike, upper: ArrayLike, **task: Unpack[SceneTask]) -> "Scene":
        """Make a scene of upright cylinders, rows x, y, radius [m], (k, 3); the rest as of `from_boxes`."""
        return cls._of(solids.discs(discs, _height(task)), lower, upper, **task)

    @classmethod
    def from_polygons(
        cls, polygons: Sequence[ArrayLike], *, lower: ArrayLike, upper: ArrayLike, **task: Unpack[SceneTask]
    ) -> "Scene":
        """Make a scene of upright prisms; a polygon that is not convex becomes triangles.

        Args: `polygons`, the corners of each in their order around it, (l, 2) [m]; the others are `from_boxes`'s.
        SceneError names a polygon that has no inside or crosses itself, or a number that cannot be.
        """
        return cls._of(solids.prisms(polygons, _height(task)), lower, upper, **task)

    @classmethod
    def from_grid(
        cls, occupied: ArrayLike, resolution: float, *, origin: ArrayLike = (0.0, 0.0), **task: Unpack[SceneTask]
    ) -> "Scene":
        """Make a scene of a grid of occupied cells, which few boxes cover exactly; its border is the workspace's.

        Args:
            occupied: which cells are, booleans (rows, columns); the first row is the lowest, as in ROS's messages
                (`np.flipud` turns a picture).
            resolution: side of a cell [m].
            origin: lower left corner of the grid, (2,) [m].
            task: `from_boxes`'s. SceneError: it is no such grid, or a number is missing or cannot be.
        """
        corner = numbers(origin, (2,), "the origin", "x, y [m]")
        grid = solids.occupancy(occupied, ("rows", "columns"))
        side = number(resolution, "the resolution", "the side of a cell, a positive number [m]")
        return cls._of(
            solids.cells(grid, side, corner, _height(task)), corner, corner + side * np.array(grid.shape[::-1]), **task
        )

    @classmethod
    def from_voxels(
        cls, occupied: ArrayLike, size: float, *, origin: ArrayLike = (0.0, 0.0, 0.0), **task: Unpack[SceneTask]
    ) -> "Scene":
        """Make a scene in space of a grid of occupied voxels, which few boxes cover exactly; its border is the grid's.

        Args:
            occupied: which voxels are, booleans (nx, ny, nz).
            size: side of a voxel [m].
            origin: least corner of the grid, (3,) [m].
            task: `from_boxes`'s, with `start` x, y, z and `goal` x, y, z, radius. SceneError as of `from_grid`.
        """
        corner = numbers(origin, (3,), "the origin", AXES[3])
        grid = solids.occupancy(occupied, ("nx", "ny", "nz"))
        side = number(size, "the size", "the side of a voxel, a positive number [m]")
        return cls._of(
            solids.voxels(grid, side, corner), corner, corner + side * np.array(grid.shape), space=True, **task
        )

    @classmethod
    def _of(
        cls, obstacles: tuple[Obstacle, ...], lower: ArrayLike, upper: ArrayLike, *, start: ArrayLike,
        goal: Goal | ArrayLike, robot_radius: float = 0.0, robot_height: float = TUNING.robot_height,
        footprint: Footprint = NO_FOOTPRINT, name: str = "scene", space: bool = False,
    ) -> "Scene":  # fmt: skip
        if footprint is not NO_FOOTPRINT and robot_radius:
            raise SceneError(f"{name}: both a robot_radius and a footprint are given; give one of them")
        d = 3 if space else 2
        if not isinstance(goal, Goal):
            *center, radius = numbers(goal, (d + 1,), "the goal", f"x, y,{' z,' * space} radius [m]")
            goal = Goal(center=np.array(center), radius=float(radius))
        low = numbers(lower, (d,), "lower", AXES[d])
        high = numbers(upper, (d,), "upper", AXES[d])
        begin = solids.table([start], (d, 3), "start", AXES[3] if space else "x, y [m] and perhaps a heading [rad]")[0]
        return cls(
            name=name, lower=low, upper=high, obstacles=obstacles, goal=goal, start=begin, robot_radius=robot_radius,
            robot_height=robot_height, footprint=footprint,
        )  # fmt: skip

    @property
    def dimension(self) -> int:
        """Return 3 for a workspace in space, else 2."""
        return width_of(self.lower)

    @property
    def place(self) -> Array:
        """Return where the robot's centre starts, (2,) or (3,) [m]."""
        return self.start[: self.dimension]

    @property
    def world(self) -> Workspace:
        """Return bounds, 2 x (d,) [m], static obstacles, and discs in which margins are smaller."""
        return Workspace(self.lower, self.upper, self.obstacles, self.waivers)

    @property
    def body(self) -> Footprint:
        """Return the footprint of the robot itself, without the safety margin."""
        return self.footprint.grown(-self.margin)


def height_of_walls(robot_height: float) -> float:
    """Return the height [m] of walls that are as far from a robot, whose centre is so high, as their outlines are."""
    return max(TUNING.wall_height, 2.0 * robot_height)


def _height(task: SceneTask) -> float:
    centre = number(task.get("robot_height", 0.0), "the height of the robot's centre", "a number [m]", 0.0)
    return height_of_walls(centre)
