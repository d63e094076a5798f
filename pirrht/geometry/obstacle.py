"""Describe obstacles: convex solids, and how those move that do, by rows of a time and a pose, linear in between."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from enum import Enum
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.formatting import short
from pirrht.geometry.checks import FARTHEST, number, numbers, parts_of, rows_of
from pirrht.geometry.tuning import TUNING


class Kind(Enum):
    """Shapes an obstacle can have; sizes are MuJoCo's (half sizes, radius and half length, half axes)."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    CAPSULE = "capsule"
    ELLIPSOID = "ellipsoid"
    MESH = "mesh"


_SIZES = {Kind.SPHERE: 1, Kind.CYLINDER: 2, Kind.CAPSULE: 2, Kind.BOX: 3, Kind.ELLIPSOID: 3, Kind.MESH: 0}  # used
_UNIT = np.eye(3)


def about_vertical(yaw: float) -> Array:
    """Return the rotation (3, 3) by a yaw [rad]."""
    c = math.cos(yaw)
    s = math.sin(yaw)

    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacle:
    """One convex solid, fixed in the world.

    Attributes:
        name: what messages call it.
        kind: its shape.
        size: MuJoCo's sizes of the kind, (3,) [m]; unused for a mesh.
        position: its centre, (3,) [m].
        rotation: its axes in world coordinates, as columns, (3, 3).
        vertices: corners of a mesh's convex hull in its own frame, (k, 3) [m].
        faces: triangles of that hull, (l, 3) indices of corners.

    Raises:
        SceneError: a number is none, or larger than any scene's, or the rotation is none; names the obstacle.
    """

    name: str
    kind: Kind
    size: Array
    position: Array
    rotation: Array
    vertices: Array | None = None
    faces: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not isinstance(self.kind, Kind):
            raise SceneError(f"obstacle {short(self.name)} is {short(self.kind)}; give a text as its name, and a Kind")
        label = f"obstacle {self.name!r}"
        used = _SIZES[self.kind]
        size = numbers(self.size, (3,), f"{label}: size", "MuJoCo's three sizes of its kind [m]")
        position = numbers(self.position, (3,), f"{label}: position", "x, y, z [m]")
        rotation = numbers(self.rotation, (3, 3), f"{label}: rotation", "a matrix (3, 3)")
        if used and not size[:used].min() > 0.0:
            raise SceneError(f"{label}: size is {size.tolist()}; the first {used} must be positive")
        if not np.abs(rotation @ rotation.T - _UNIT).max() < TUNING.askew:
            raise SceneError(f"{label}: rotation is {rotation.tolist()}; its columns must be orthogonal unit vectors")
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "rotation", rotation)
        if self.kind is Kind.MESH:
            self._check_hull(label)

    def _check_hull(self, label: str) -> None:
        """Refuse corners and faces that are no hull."""
        vertices = numbers(self.vertices, (None, 3), f"{label}: vertices", "four corners x, y, z [m] or more")
        faces = numbers(self.faces, (None, 3), f"{label}: faces", "three indices of corners each")
        indices = faces.astype(np.int64)
        whole = len(vertices) >= 4 and len(faces) >= 4 and np.array_equal(indices, faces)
        if not whole or indices.min() < 0 or indices.max() >= len(vertices):
            raise SceneError(f"{label} has no hull; give four corners or more, and four faces or more of their indices")
        object.__setattr__(self, "faces", indices)
        object.__setattr__(self, "vertices", vertices)

    def __repr__(self) -> str:
        return f"Obstacle({self.name!r}, {self.kind.value} at {formatting.vector(self.position)})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Poses of an obstacle at any time, linear between rows; it rests after the last or starts over.

    SceneError: rows of another shape, that are not finite, or whose times do not increase from 0.
    """

    rows: Array  # (k, 4) t [s], x, y [m], yaw [rad]
    repeat: bool = False  # whether it starts over at the first row when it has reached the last
    offset: float = 0.0  # how much later than this motion's clock the rows' clock is [s]
    _rows: list[list[float]] = field(init=False, repr=False)  # the same rows as numbers

    def __post_init__(self) -> None:
        if not isinstance(self.repeat, bool | np.bool_):
            raise SceneError(f"a motion has repeat {short(self.repeat)}; it must be True or False")
        must = "a time, x, y and a yaw"
        given = rows_of(self.rows, "the rows of a motion", must)
        rows = np.array([numbers(row, (4,), f"row {i} of a motion", must) for i, row in enumerate(given, start=1)])
        if not len(rows):
            raise SceneError(f"a motion has no rows; each is {must}")
        if rows[0, 0] != 0.0:
            raise SceneError(f"the first row of a motion is at {rows[0, 0]:g} s; it must be at 0")
        late = rows[1:, 0] <= rows[:-1, 0]
        if late.any():
            row = int(np.argmax(late)) + 1
            times = f"{rows[row, 0]:g} s after one at {rows[row - 1, 0]:g} s"
            raise SceneError(f"row {row + 1} of a motion is at {times}; times must increase")
        if self.repeat and len(rows) < 2:
            raise SceneError("a motion that starts over has one row; it needs two or more")
        number(self.offset, "the offset of a motion", "a time [s]", -FARTHEST)
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "_rows", rows.tolist())

    @property
    def last(self) -> float:
        """Return when it rests for good [s], negative if it does already; infinity where it starts over."""
        return math.inf if self.repeat else float(self.rows[-1, 0]) - self.offset

    def pose(self, time: Array | float) -> Array:
        """Return x, y [m] and yaw [rad] at times (...) [s], (..., 3); before the first row it rests there."""
        t = np.asarray(time, dtype=float) + self.offset
        if self.repeat:
            t = np.where(t > 0.0, np.mod(t, self.rows[-1, 0]), t)
        return np.stack([np.interp(t, self.rows[:, 0], self.rows[:, k]) for k in (1, 2, 3)], axis=-1)

    def pose_at(self, time: float) -> tuple[float, float, float]:
        """Return x, y [m] and yaw [rad] at one time [s], as numbers."""
        t = time + self.offset
        if self.repeat and t > 0.0:
            t %= self._rows[-1][0]
        i = bisect_right(self._rows, t, key=itemgetter(0))
        if i in (0, len(self._rows)):
            _, x, y, yaw = self._rows[max(i - 1, 0)]
            return x, y, yaw
        (s, *a), (u, *b) = self._rows[i - 1 : i + 1]
        x, y, yaw = ((q - p) / (u - s) * (t - s) + p for p, q in zip(a, b, strict=True))
        return x, y, yaw

    def velocity(self, time: float) -> Array:
        """Return rates of x, y [m/s] and yaw [rad/s] that led to where it is at a time [s], (3,)."""
        t = time + self.offset
        period = float(self.rows[-1, 0])

        if len(self.rows) < 2 or t < 0.0 or (t > period and not self.repeat):
            return np.zeros(3)
        if self.repeat and t > period:
            t = math.fmod(t, period) or period
        i = max(int(np.searchsorted(self.rows[:, 0], t, side="left")), 1)
        step = self.rows[i] - self.rows[i - 1]
        return np.asarray(step[1:] / step[0])

    def __repr__(self) -> str:
        again = ", over and over" if self.repeat else ""
        return f"Motion({len(self.rows)} rows over {self.rows[-1, 0]:g} s{again})"

    def after(self, time: float) -> "Motion":
        """Return the motion on a clock that starts at a time [s] of this one's."""
        return replace(self, offset=self.offset + time)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mover:
    """A moving obstacle and its solids."""

    name: str
    solids: tuple[Obstacle, ...]  # in the body's own frame, x and y from its origin, heights above the ground [m]
    motion: Motion

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not isinstance(self.motion, Motion):
            raise SceneError(f"mover {short(self.name)} moves by {short(self.motion)}; give a text and a Motion")
        object.__setattr__(self, "solids", parts_of(self.solids, Obstacle, f"mover {self.name}: solids"))
        if not self.solids:
            raise SceneError(f"mover {self.name} has no solids; give it one or more")

    def __repr__(self) -> str:
        return f"Mover({self.name!r}, {self.motion!r})"

    def at(self, time: float) -> tuple[Obstacle, ...]:
        """Return its solids in the world at a time [s]."""
        x, y, yaw = self.motion.pose_at(time)
        turn = about_vertical(yaw)
        shift = np.array([x, y, 0.0])

        return tuple(replace(o, position=turn @ o.position + shift, rotation=turn @ o.rotation) for o in self.solids)
