"""Collision meshes as convex parts, since MuJoCo collides with the convex hull of a mesh.

A mesh that is not convex is cut along planes of its own faces, the deepest inside its hull first, until every part
lies within `CONCAVE` of its hull. Walls and furniture of flat faces come out exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import product
from pathlib import Path

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.collada import Faces, read_collada
from sim.importing.limits import FARTHEST, content_of

SUFFIXES = (".dae", ".stl", ".obj")
CONCAVE = 0.03  # how deep the surface of a convex part may lie inside its hull [m]
MOST_CUTS, MOST_PARTS = 100, 1000  # parts of what hangs together, and of one mesh
_OPEN = 1.5  # where a surface has an edge, a hull of more than this times its area is no solid
_FLAT = 1e-3  # least thickness of a part [m]
_SAME = 1e-5  # corners closer than this are one, and points closer to a plane lie on it [m]
_EMPTY = 1e-12  # area of no triangle [m2]


@dataclass(frozen=True, slots=True)
class MeshKey:
    """Which mesh of which file."""

    path: Path
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    name: str = ""  # of a submesh; empty for all
    centred: bool = False  # the middle of its bounds becomes the origin
    hull: bool = False  # its hull is asked for


@dataclass(frozen=True, slots=True)
class Parts:
    """Convex parts of one mesh."""

    vertices: tuple[Array, ...]  # (v, 3) each, corners of the hull [m]
    rough: float = 0.0  # how far a hull sticks out at most [m]; 0 if all are within `CONCAVE`


@dataclass(slots=True)
class Meshes:
    """Meshes that were read, each once."""

    known: dict[MeshKey, Parts] = field(default_factory=dict)

    def parts(self, key: MeshKey) -> Parts:
        """Split a mesh into convex parts.

        Raises:
            SceneError: unreadable, of another format, or without triangles.
        """
        if key not in self.known:
            self.known[key] = _parts(key)
        return self.known[key]

    @staticmethod
    def triangles(path: Path) -> Array:
        """Read the corners of a file's triangles, (t, 3, 3) [m]."""
        return _read(path, "")


def as_box(corners: Array) -> tuple[Array, Array] | None:
    """Find the box with these corners (8, 3), if there is one: its pose (4, 4) and half sizes (3,) [m]."""
    lengths = np.linalg.norm(corners - corners[0], axis=1)
    edges = (corners - corners[0])[np.argsort(lengths)][1:]
    if len(edges) != 7:
        return None
    square = [edge for edge in edges[1:-1] if abs(edge @ edges[0]) < _FLAT * np.linalg.norm(edges[0])]
    if not square:
        return None
    frame = np.array([edges[0], square[0], edges[-1] - edges[0] - square[0]])
    sizes = np.linalg.norm(frame, axis=1)
    axes = frame / sizes[:, None]
    expected = corners[0] + np.array(list(product((0.0, 1.0), repeat=3))) @ frame
    gaps = np.linalg.norm(corners[:, None] - expected, axis=2)
    if np.abs(axes @ axes.T - np.eye(3)).max() > _FLAT or max(gaps.min(axis=0).max(), gaps.min(axis=1).max()) > _FLAT:
        return None
    pose = np.eye(4)
    first, second = axes[0], axes[1] - axes[0] * (axes[0] @ axes[1])
    second /= np.linalg.norm(second)
    pose[:3, :3] = np.column_stack([first, second, np.cross(first, second)])
    pose[:3, 3] = corners.mean(axis=0)
    return pose, sizes / 2


def _parts(key: MeshKey) -> Parts:
    triangles = _read(key.path, key.name)
    if not len(triangles):
        which = f" under the name {key.name!r}" if key.name else ""
        raise SceneError(f"{key.path}: it has no triangles{which}; export it again")
    if key.centred:
        corners = triangles.reshape(-1, 3)
        triangles = triangles - (corners.min(axis=0) + corners.max(axis=0)) / 2
    triangles = triangles * key.scale
    if not np.all(np.abs(triangles) <= FARTHEST):
        raise SceneError(f"{key.path}: corners are farther out than {FARTHEST:g} m; scale it down")
    pieces = [] if key.hull else _pieces(triangles)
    parts = [part for piece in pieces for part in _convex(piece)] if len(pieces) <= MOST_PARTS else []
    if 0 < len(parts) <= MOST_PARTS:
        return Parts(tuple(hull for hull, _ in parts), max(rough if rough > CONCAVE else 0.0 for _, rough in parts))
    hull = _hull(triangles)
    return Parts((_corners(hull),), 0.0 if key.hull else float(_depths(triangles, hull).max()))


def _read(path: Path, name: str) -> Array:
    """Read the corners of a file's triangles, (t, 3, 3)."""
    suffix = path.suffix.lower()
    if suffix == ".dae":
        return read_collada(path, name)
    if suffix not in SUFFIXES:
        raise SceneError(f"{path}: meshes are read from {', '.join(SUFFIXES)}; convert it")
    if name:
        raise SceneError(f"{path}: submesh {name!r} is read from .dae only; write a file of its own for it")
    data = content_of(path, "a mesh")
    try:
        mesh = trimesh.load_mesh(BytesIO(data), file_type=suffix[1:], process=False)
        return np.array(mesh.triangles, dtype=float)
    except Exception as error:  # whatever readers of meshes raise for what is none
        reason = " ".join(str(error).split())[:100]
        raise SceneError(f"{path}: this is no mesh of triangles ({reason}); export it again") from None


def _convex(piece: Array) -> Iterator[tuple[Array, float]]:
    """Cut one connected surface (t, 3, 3) into convex parts: corners of each hull, and how far it sticks out."""
    if np.einsum("ti,ti->", piece[:, 0], np.cross(piece[:, 1], piece[:, 2])) < 0:
        piece = piece[:, ::-1]  # normals outward
    closed, count, todo = _is_closed(piece), 0, [piece]
    while todo:
        part = todo.pop()
        hull = _hull(part)
        depths = _depths(part, hull)
        if depths.max() > CONCAVE and count + len(todo) < MOST_CUTS:
            across = np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0])
            face = int(np.argmax(np.where(depths > CONCAVE, depths, 0) * np.linalg.norm(across, axis=1) ** 0.5))
            normal = across[face] / np.linalg.norm(across[face])
            todo += [p for side in _cut(part, normal, part[face, 0] @ normal) for p in _pieces(side)]
            continue
        plates = [] if closed or hull.area <= _OPEN * _area(part) else list(_plates(part))
        for points in plates or [_corners(hull)]:
            count += 1
            yield points, 0.0 if plates else float(depths.max())


def _hull(triangles: Array) -> ConvexHull:
    """Build the convex hull; what is flat, a line or a point gets a thickness."""
    points = np.unique(triangles.reshape(-1, 3), axis=0)
    middle = points.mean(axis=0)
    for axis in np.linalg.eigh((points - middle).T @ (points - middle))[1].T:
        if np.ptp(points @ axis) < _FLAT:
            points = np.concatenate([points - axis * _FLAT / 2, points + axis * _FLAT / 2])
    return ConvexHull(points)


def _corners(hull: ConvexHull) -> Array:
    found: Array = hull.points[hull.vertices]
    return found


def _depths(triangles: Array, hull: ConvexHull) -> Array:
    """Measure how deep triangles lie inside a hull, at a corner or the middle, (t,) [m]."""
    corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    points = np.ascontiguousarray(np.concatenate([corners, triangles.mean(axis=1)]).T)
    depths = np.full(points.shape[1], np.inf)
    for *normal, offset in np.unique(hull.equations, axis=0):
        np.minimum(depths, -offset - np.array(normal) @ points, out=depths)
    found: Array = np.maximum(depths[index.reshape(-1, 3)].max(axis=1), depths[len(corners) :])
    return found


def _cut(triangles: Array, normal: Array, offset: float) -> tuple[Array, Array]:
    """Cut a surface with a plane: what lies behind it, and what lies before it, (t, 3, 3) each."""
    heights = triangles @ normal - offset
    heights[np.abs(heights) < _SAME] = 0.0
    upper, lower = np.any(heights > 0, axis=1), np.any(heights < 0, axis=1)
    flat = ~upper & ~lower
    faces = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) @ normal
    behind, before = (lower & ~upper) | (flat & (faces > 0)), (upper & ~lower) | (flat & (faces <= 0))
    crossing, h = triangles[upper & lower], heights[upper & lower]
    above = h > 0
    alone = np.where(above.sum(axis=1) == 1, np.argmax(above, axis=1), np.argmin(above, axis=1))
    order = (alone[:, None] + np.arange(3)) % 3
    (a, b, c), h = np.moveaxis(np.take_along_axis(crossing, order[..., None], 1), 1, 0), np.take_along_axis(h, order, 1)
    p = a + (b - a) * (h[:, :1] / (h[:, :1] - h[:, 1:2]))
    q = a + (c - a) * (h[:, :1] / (h[:, :1] - h[:, 2:]))
    tip = np.stack([a, p, q], axis=1)
    rest = np.concatenate([np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)])
    up = h[:, 0] > 0
    both = np.concatenate([up, up])
    return (
        np.concatenate([triangles[behind], tip[~up], rest[both]]),
        np.concatenate([triangles[before], tip[up], rest[~both]]),
    )


def _plates(part: Array) -> Iterator[Array]:
    """Split a surface that encloses no solid into flat convex plates, corners of each."""
    across = np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0])
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    planes = np.round(np.column_stack([normals / _FLAT, np.einsum("ti,ti->t", normals, part[:, 0]) / _FLAT]))
    _, group = np.unique(planes, axis=0, return_inverse=True)
    for plane in range(group.max() + 1):
        for plate in _pieces(part[group.ravel() == plane]):
            hull = _hull(plate)
            whole = hull.area <= 2 * _area(plate) * 1.01 + _FLAT * 4 * np.ptp(plate.reshape(-1, 3), axis=0).sum()
            yield from [_corners(hull)] if whole else (_corners(_hull(one[None])) for one in plate)


def _pieces(triangles: Array) -> list[Array]:
    """Separate what does not hang together, (t, 3, 3) each; corners at one place are one."""
    triangles = triangles[_areas(triangles) > _EMPTY]
    if not len(triangles):
        return []
    faces = _indexed(triangles)
    pairs = np.concatenate([faces[:, :2], faces[:, 1:]])
    size = int(faces.max()) + 1
    group = connected_components(coo_array((np.ones(len(pairs)), pairs.T), shape=(size, size)), directed=False)[1]
    of_face = group[faces[:, 0]]
    order = np.argsort(of_face, kind="stable")
    return np.split(triangles[order], np.flatnonzero(np.diff(of_face[order])) + 1)


def _indexed(triangles: Array) -> Faces:
    corners = np.round(triangles.reshape(-1, 3) / _SAME)
    return np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)


def _is_closed(triangles: Array) -> bool:
    """Whether every edge belongs to an even number of triangles."""
    faces = _indexed(triangles)
    edges = np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1)
    return bool(np.all(np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0))


def _areas(triangles: Array) -> Array:
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    found: Array = np.linalg.norm(across, axis=1) / 2
    return found


def _area(triangles: Array) -> float:
    return float(_areas(triangles).sum())
