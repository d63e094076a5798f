"""What importers read: solids in the world, the ground, and notes and options for a scene made of them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from sim.mjcf.convex import FLAT

LOWEST = 0.01  # robots drive over what is no higher, like carpets and floors [m]
HIGHEST_FLOOR = 0.5  # of what lies under start and goal [m]
LOW = f"no higher than {LOWEST:g} m, so driven over and left out: "


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """One collision shape, fixed in the world."""

    name: str  # of its model, with link and collision where the model has several
    shape: str  # a type of MuJoCo's geoms
    size: Array  # MuJoCo's sizes of that type [m]; zeros for a mesh
    pose: Array  # (4, 4) in the world
    vertices: Array | None = None  # (v, 3) of a convex mesh, in its own frame [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """What a file holds for a robot that drives on the ground."""

    kind: str = "world"  # as messages call it: world, map, mesh
    solids: tuple[Solid, ...] = ()  # in file order
    ground: Array | None = None  # (4,) x0, x1, y0, y1 that the file bounds [m]
    notes: tuple[str, ...] = ()  # sentences on what differs from the file
    options: Mapping[str, str] = field(default_factory=dict)  # that a scene of it shall carry
    custom: tuple[str, ...] = ()  # MJCF elements of its motions
    bodies: tuple[str, ...] = ()  # MJCF elements of moving obstacles
    start: tuple[float, ...] | None = None  # x, y [m], heading [rad], if the file's kind has one
    goal: tuple[float, ...] | None = None  # x, y, radius [m]


def part_solid(name: str, pose: Array, vertices: Array) -> Solid:
    """Make a solid of a convex part of a mesh, which is a box if it can be."""
    if box := as_box(vertices):
        return Solid(name, "box", box[1], pose @ box[0])
    return Solid(name, "mesh", np.zeros(3), pose, vertices)


def is_low(solid: Solid) -> bool:
    """Return whether a solid ends a little above the ground, so that robots drive over it."""
    return 0 < top_of(solid) <= LOWEST


def top_of(solid: Solid) -> float:
    """Return how high a box or mesh ends [m]; infinite of other shapes."""
    corners = corners_of(solid)
    return float(corners[:, 2].max()) if len(corners) else np.inf


def corners_of(solid: Solid) -> Array:
    """Return the corners of a box or mesh in the world, (v, 3) [m]; none of other shapes."""
    own = np.empty((0, 3)) if solid.vertices is None else solid.vertices
    if solid.shape == "box":
        own = solid.size * np.array([*product((-1.0, 1.0), repeat=3)])
    return own @ solid.pose[:3, :3].T + solid.pose[:3, 3]


def raised_floor(world: World, ends: Sequence[Sequence[float] | None]) -> str:
    """Report a floor above the ground by its name and height; empty without one.

    It is what all `ends` of a task, x and y first [m], have under them at one height.
    """
    floors = [one for one in world.solids if LOWEST < top_of(one) <= HIGHEST_FLOOR]
    under = [{round(top_of(one), 4): one.name for one in floors if _covers(one, end[:2])} for end in ends if end]
    tops = set.intersection(*map(set, under)) if under else set()
    if not tops:
        return ""
    top = max(tops)
    return (
        f'"{under[0][top]}" lies under start and goal and ends {top:g} m above the ground, so that it is an obstacle; '
        f"if it is a floor, lower the {world.kind} by {top:g} m"
    )


def _covers(solid: Solid, place: Sequence[float]) -> bool:
    """Return whether a box or mesh lies under or over a place, x and y [m]."""
    planes = ConvexHull(corners_of(solid)[:, :2]).equations
    return bool(np.all(planes[:, :2] @ np.array(place) + planes[:, 2] <= 0.0))


def as_box(corners: Array) -> tuple[Array, Array] | None:
    """Find the box with these corners (8, 3), if there is one: its pose (4, 4) and half sizes (3,) [m]."""
    edges = (corners - corners[0])[np.argsort(np.linalg.norm(corners - corners[0], axis=1))][1:]
    square = [edge for edge in edges[1:-1] if abs(edge @ edges[0]) < FLAT * np.linalg.norm(edges[0])]
    if len(edges) != 7 or not square:
        return None
    frame = np.array([edges[0], square[0], edges[-1] - edges[0] - square[0]])
    sizes = np.linalg.norm(frame, axis=1)
    axes = frame / sizes[:, None]
    gaps = np.linalg.norm(corners[:, None] - corners[0] - np.array([*product((0.0, 1.0), repeat=3)]) @ frame, axis=2)
    if np.abs(axes @ axes.T - np.eye(3)).max() > FLAT or max(gaps.min(axis=0).max(), gaps.min(axis=1).max()) > FLAT:
        return None
    pose = np.eye(4)
    second = axes[1] - axes[0] * (axes[0] @ axes[1])
    second /= np.linalg.norm(second)
    pose[:3] = np.column_stack([axes[0], second, np.cross(axes[0], second), corners.mean(axis=0)])
    return pose, sizes / 2


def transform(values: Array, *, degrees: bool = False) -> Array:
    """The matrix (4, 4) of x, y, z [m] and roll, pitch, yaw (6,) about fixed axes, or a quaternion x, y, z, w (7,)."""
    by_angles = len(values) == 6
    turn = Rotation.from_euler("xyz", values[3:], degrees=degrees) if by_angles else Rotation.from_quat(values[3:])
    matrix = np.eye(4)
    matrix[:3, 3] = values[:3]
    matrix[:3, :3] = turn.as_matrix()

    return matrix


def distinct(names: Iterable[str], taken: Iterable[str], mark: str = " ", first: int = 2) -> Iterator[str]:
    """Yield names, each with a number where it is taken."""
    seen = set(taken)
    numbers = dict[str, int]()

    for name in names:
        own = name
        while own in seen:
            number = numbers.get(name, first)
            own = f"{name}{mark}{number}"
            numbers[name] = number + 1
        seen.add(own)
        yield own


def text(*values: float) -> str:
    """Write numbers as MJCF has them."""
    return " ".join(f"{value:.10g}" for value in values)
