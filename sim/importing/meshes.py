"""Collision meshes as convex parts, since MuJoCo collides with the convex hull of a mesh: a room would be a block.

A mesh that is not convex is cut along planes of its own faces, the deepest inside its hull first, until every part
lies within `CONCAVE` of its hull. Walls and furniture of flat faces come out exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull
from trimesh.triangles import area, cross

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from sim.importing.collada import Faces, read_collada
from sim.importing.solids import FLAT, World, part_solid
from sim.mjcf.limits import FARTHEST, content_of

SUFFIXES = (".dae", ".obj", ".stl")
CONCAVE = 0.03  # how deep the surface of a convex part may lie inside its hull [m]
CONCAVITY = 0.05  # that CoACD leaves in a part, as a share of the size of the mesh: its own default
MOST_CUTS, MOST_PARTS = 100, 1000  # parts of what hangs together, and of one mesh
_OPEN = 1.5  # where a surface has an edge, a hull of more than this times its area is no solid
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


def read_mesh(source: Path) -> World:
    """Read a mesh as a world of its convex parts, by CoACD where its own faces leave parts that are not convex."""
    parts = split(MeshKey(source))
    corners = _by_coacd(source) if parts.rough else parts.vertices
    flat = np.vstack(corners)[:, :2]
    ground = np.stack([flat.min(axis=0), flat.max(axis=0)], axis=1).ravel()
    solids = tuple(part_solid(f"part {number}", np.eye(4), one) for number, one in enumerate(corners, 1))
    return World(kind="mesh", solids=solids, ground=ground)


def _by_coacd(source: Path) -> tuple[Array, ...]:
    try:
        import coacd
    except ImportError:
        raise OptionError(
            f"{source}: convex parts of this mesh need CoACD; install it with `pip install 'pirrht[decompose]'`"
        ) from None
    triangles = _read(source, "")
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    coacd.set_log_level("error")
    closed = "off" if mesh.is_watertight else "auto"  # what is open is closed first, on a coarse grid
    try:
        found = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, preprocess_mode=closed)
    except Exception as error:  # of a library in C++
        raise SceneError(f"{source}: CoACD finds no convex parts ({' '.join(str(error).split())})") from None
    return tuple(np.asarray(corners, dtype=float) for corners, _ in found)


def split(key: MeshKey) -> Parts:
    """Split a mesh into convex parts; SceneError if it is unreadable, of another format, or without triangles."""
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
            across = cross(part)
            face = int(np.argmax(np.where(depths > CONCAVE, depths, 0) * np.linalg.norm(across, axis=1) ** 0.5))
            normal = across[face] / np.linalg.norm(across[face])
            todo += [p for side in _cut(part, normal, part[face, 0] @ normal) for p in _pieces(side)]
            continue
        plates = [] if closed or hull.area <= _OPEN * area(part).sum() else list(_plates(part))
        for points in plates or [_corners(hull)]:
            count += 1
            yield points, 0.0 if plates else float(depths.max())


def _hull(triangles: Array) -> ConvexHull:
    """Build the convex hull; what is flat, a line or a point gets a thickness."""
    points = np.unique(triangles.reshape(-1, 3), axis=0)
    middle = points.mean(axis=0)
    for axis in np.linalg.eigh((points - middle).T @ (points - middle))[1].T:
        if np.ptp(points @ axis) < FLAT:
            points = np.concatenate([points - axis * FLAT / 2, points + axis * FLAT / 2])
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
    faces = cross(triangles) @ normal
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
    normals = cross(part) / (2 * area(part))[:, None]
    planes = np.round(np.column_stack([normals / FLAT, np.einsum("ti,ti->t", normals, part[:, 0]) / FLAT]))
    _, group = np.unique(planes, axis=0, return_inverse=True)
    for plane in range(group.max() + 1):
        for plate in _pieces(part[group.ravel() == plane]):
            hull = _hull(plate)
            whole = hull.area <= 2 * area(plate).sum() * 1.01 + FLAT * 4 * np.ptp(plate.reshape(-1, 3), axis=0).sum()
            yield from [_corners(hull)] if whole else (_corners(_hull(one[None])) for one in plate)


def _pieces(triangles: Array) -> list[Array]:
    """Separate what does not hang together, (t, 3, 3) each; corners at one place are one."""
    triangles = triangles[area(triangles) > _EMPTY]
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
