"""Describe obstacles: convex solids, and how those move that do, by rows of a time and a pose, linear in between.

In space a pose is x, y, z [m] and a unit quaternion (w, x, y, z); between two rows it turns evenly, the short way.
"""

import math
from bisect import bisect_right
from collections.abc import Collection, Sequence
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
        for part, value in (("size", size), ("position", position), ("rotation", rotation)):
            object.__setattr__(self, part, value)
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

    rows: Array  # (k, 4) t [s], x, y [m], yaw [rad]; in space (k, 8) t, x, y, z, and a quaternion, w first
    repeat: bool = False  # whether it starts over at the first row when it has reached the last
    offset: float = 0.0  # how much later than this motion's clock the rows' clock is [s]
    rates: Array = field(init=False, repr=False)  # (k, 3) or (k, 6) of x, y, yaw, or x, y, z and turns [1/s] from each
    _rows: list[list[float]] = field(init=False, repr=False)  # the same rows as numbers

    def __post_init__(self) -> None:
        if not isinstance(self.repeat, bool | np.bool_):
            raise SceneError(f"a motion has repeat {short(self.repeat)}; it must be True or False")
        width, must = 4, "a time, x, y and a yaw"
        given = rows_of(self.rows, "the rows of a motion", must)
        first = next(iter(given), ())
        if isinstance(first, Collection) and getattr(first, "ndim", 1) > 0 and len(first) == 8:
            width, must = 8, "a time, x, y, z and a quaternion w, x, y, z"
        rows = np.array([numbers(row, (width,), f"row {i} of a motion", must) for i, row in enumerate(given, start=1)])
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
        object.__setattr__(self, "rows", _unit(rows) if width == 8 else rows)
        object.__setattr__(self, "rates", _rates(rows))
        object.__setattr__(self, "_rows", rows.tolist())

    @property
    def in_space(self) -> bool:
        """Tell whether its poses are in space, with a quaternion."""
        return bool(self.rows.shape[1] == 8)

    @property
    def last(self) -> float:
        """Return when it rests for good [s], negative if it does already; infinity where it starts over."""
        return math.inf if self.repeat else float(self.rows[-1, 0]) - self.offset

    def pose(self, time: Array | float) -> Array:
        """Return x, y [m] and yaw [rad], or in space place and quaternion, at times (...) [s], (..., 3) or (..., 7).

        Before the first row it rests there.
        """
        t = np.asarray(time, dtype=float) + self.offset
        if self.repeat:
            t = np.where(t > 0.0, np.mod(t, self.rows[-1, 0]), t)
        if not self.in_space:
            return np.stack([np.interp(t, self.rows[:, 0], self.rows[:, k]) for k in (1, 2, 3)], axis=-1)
        t = np.clip(t, 0.0, self.rows[-1, 0])
        i = np.searchsorted(self.rows[:, 0], t, side="right") - 1
        return _on(self.rows[i, 1:], self.rates[i], t - self.rows[i, 0])

    def pose_at(self, time: float) -> tuple[float, ...]:
        """Return the pose at one time [s], as numbers."""
        if self.in_space:
            return tuple(self.pose(time).tolist())
        t = time + self.offset
        if self.repeat and t > 0.0:
            t %= self._rows[-1][0]
        i = bisect_right(self._rows, t, key=itemgetter(0))
        if i in (0, len(self._rows)):
            return tuple(self._rows[max(i - 1, 0)][1:])
        (s, *a), (u, *b) = self._rows[i - 1 : i + 1]
        return tuple((q - p) / (u - s) * (t - s) + p for p, q in zip(a, b, strict=True))

    def velocity(self, time: float) -> Array:
        """Return rates of x, y [m/s] and yaw [rad/s] that led to where it is at a time [s], (3,); in space (6,)."""
        t = time + self.offset
        period = float(self.rows[-1, 0])

        if len(self.rows) < 2 or t < 0.0 or (t > period and not self.repeat):
            return np.zeros(self.rates.shape[1])
        if self.repeat and t > period:
            t = math.fmod(t, period) or period
        i = max(int(np.searchsorted(self.rows[:, 0], t, side="left")), 1)
        return np.asarray(self.rates[i - 1])

    def __repr__(self) -> str:
        again = ", over and over" if self.repeat else ""
        return f"Motion({len(self.rows)} rows over {self.rows[-1, 0]:g} s{again})"

    def after(self, time: float) -> "Motion":
        """Return the motion on a clock that starts at a time [s] of this one's."""
        return replace(self, offset=self.offset + time)

    def straight_on(self, time: float, horizon: float) -> "Motion":
        """Return the motion at the velocity of a time [s] from then on, up to the horizon [s], on a clock from then."""
        pose = np.array(self.pose_at(time))
        rates = self.velocity(time)
        if not self.in_space:
            return Motion(rows=np.array([[0.0, *pose], [horizon, *(pose + horizon * rates)]]))
        parts = 1 + int(horizon * np.linalg.norm(rates[3:]))  # of a radian at most: rows turn the short way
        times = np.linspace(0.0, horizon, parts + 1)
        return Motion(rows=np.column_stack([times, _on(np.tile(pose, (parts + 1, 1)), rates, times)]))


def _unit(rows: Array) -> Array:
    """Scale the quaternions of rows (k, 8) to 1, each on the side of the one before; SceneError where one is 0."""
    size = np.linalg.norm(rows[:, 4:], axis=1)
    if not size.all():
        raise SceneError(f"the quaternion of row {int(np.argmin(size)) + 1} of a motion is 0; 1, 0, 0, 0 turns nothing")
    rows[:, 4:] /= size[:, None]
    flips = np.sum(rows[1:, 4:] * rows[:-1, 4:], axis=1) < 0.0
    rows[1:, 4:] *= np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)[:, None]
    return rows


def _rates(rows: Array) -> Array:
    """Return the rates of poses from each of rows (k, 4) or (k, 8) to the next [1/s], (k, 3) or (k, 6); 0 at last."""
    steps = np.diff(rows[:, 1:], axis=0)
    if rows.shape[1] == 8:
        turn = _times(rows[1:, 4:], rows[:-1, 4:] * [1.0, -1.0, -1.0, -1.0])
        sine = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
        angle = 2.0 * np.arctan2(sine, turn[:, :1])
        steps = np.hstack([steps[:, :3], angle * turn[:, 1:] / np.maximum(sine, 1e-300)])
    return np.vstack([steps / np.diff(rows[:, :1], axis=0), np.zeros(steps.shape[1])])


def _times(one: Array, other: Array) -> Array:
    """Multiply quaternions (..., 4), w first."""
    p = one[..., 1:]
    q = other[..., 1:]
    scalar = one[..., :1] * other[..., :1] - np.sum(p * q, axis=-1, keepdims=True)
    return np.concatenate([scalar, one[..., :1] * q + other[..., :1] * p + np.cross(p, q)], axis=-1)


def _on(poses: Array, rates: Array, times: Array) -> Array:
    """Move poses in space (..., 7) on at rates (..., 6) for times (...) [s], (..., 7)."""
    gone = times[..., None] * rates
    half = 0.5 * np.linalg.norm(gone[..., 3:], axis=-1, keepdims=True)
    turn = np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * gone[..., 3:]], axis=-1)
    return np.concatenate([poses[..., :3] + gone[..., :3], _times(turn, poses[..., 3:])], axis=-1)


def rotation_of(pose: Sequence[float]) -> Array:
    """Return the rotation (3, 3) of a pose: x, y and a yaw, or place and quaternion."""
    if len(pose) == 3:
        return about_vertical(pose[2])
    w, x, y, z = pose[3:]
    q = np.array([x, y, z])
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(2.0 * (np.outer(q, q) + w * across) + (w * w - q @ q) * _UNIT)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mover:
    """A moving obstacle and its solids."""

    name: str
    solids: tuple[Obstacle, ...]  # in the body's own frame; in the plane heights are above the ground [m]
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
        pose = self.motion.pose_at(time)
        turn = rotation_of(pose)
        shift = np.array([*pose[:2], pose[2] if len(pose) > 3 else 0.0])

        return tuple(replace(o, position=turn @ o.position + shift, rotation=turn @ o.rotation) for o in self.solids)
