"""Collision meshes as convex parts, since MuJoCo collides with the convex hull of a mesh: a room would be a block.

A mesh that is not convex is cut along planes of its own faces, the deepest inside its hull first, until every part
lies within `CONCAVE` of its hull. Walls and furniture of flat faces come out exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from trimesh.graph import connected_component_labels
from trimesh.intersections import slice_faces_plane
from trimesh.triangles import area, cross

from pirrht.arrays import Array, IntArray
from pirrht.errors import OptionError, SceneError
from sim.importing.collada import read_collada
from sim.importing.solids import FLAT, World, part_solid
from sim.mjcf.limits import FARTHEST, content_of

SUFFIXES = (".dae", ".obj", ".stl")
CONCAVE = 0.03  # how deep the surface of a convex part may lie inside its hull [m]
CONCAVITY = 0.05  # that CoACD leaves in a part, as a share of the size of the mesh: its own default
MOST_CUTS, MOST_PARTS = 100, 1000  # parts of what hangs together, and of one mesh
_OPEN = 1.5  # where a surface has an edge, a hull of more than this times its area is no solid
_SAME = 1e-5  # corners closer than this are one, and points closer to a plane lie on it [m]
_EMPTY = 1e-12  # area of no triangle [m2]


def read_mesh(source: Path) -> World:
    """Read a mesh as a world of its convex parts, by CoACD where its own faces leave parts that are not convex."""
    parts, rough = split(source)
    parts = _by_coacd(source) if rough else parts
    flat = np.vstack(parts)[:, :2]
    ground = np.stack([flat.min(axis=0), flat.max(axis=0)], axis=1).ravel()
    solids = tuple(part_solid(f"part {number}", np.eye(4), one) for number, one in enumerate(parts, 1))
    return World(kind="mesh", solids=solids, ground=ground)


def _by_coacd(source: Path) -> list[Array]:
    try:
        import coacd
    except ImportError:
        raise OptionError(
            f"{source}: convex parts of this mesh need CoACD; install it with `pip install 'pirrht[decompose]'`"
        ) from None
    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(_read(source, "")))
    coacd.set_log_level("error")
    closed = "off" if mesh.is_watertight else "auto"  # what is open is closed first, on a coarse grid
    try:
        found = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, preprocess_mode=closed)
    except Exception as error:  # of a library in C++
        raise SceneError(f"{source}: CoACD finds no convex parts ({' '.join(str(error).split())})") from None
    return [np.asarray(corners, dtype=float) for corners, _ in found]


def split(
    path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0), name: str = "", *, centred: bool = False, hull: bool = False
) -> tuple[list[Array], float]:
    """Split a mesh, or its submesh of a name, into convex parts.

    Args:
        centred: whether the middle of its bounds becomes the origin.
        hull: whether its hull is asked for.

    Returns:
        corners of each part (v, 3) [m], and how far a hull sticks out at most [m], 0 if all are within `CONCAVE`.

    Raises:
        SceneError: it is unreadable, of another format, or without triangles.
    """
    triangles = _read(path, name)
    if not len(triangles):
        which = f" under the name {name!r}" if name else ""
        raise SceneError(f"{path}: it has no triangles{which}; export it again")
    if centred:
        corners = triangles.reshape(-1, 3)
        triangles = triangles - (corners.min(axis=0) + corners.max(axis=0)) / 2
    triangles = triangles * scale
    if not np.all(np.abs(triangles) <= FARTHEST):
        raise SceneError(f"{path}: corners are farther out than {FARTHEST:g} m; scale it down")
    pieces = [] if hull else _pieces(triangles)
    parts = [part for piece in pieces for part in _convex(piece)] if len(pieces) <= MOST_PARTS else []
    if 0 < len(parts) <= MOST_PARTS:
        return [corners for corners, _ in parts], max(rough if rough > CONCAVE else 0.0 for _, rough in parts)
    whole = _hull(triangles)
    return [_corners(whole)], 0.0 if hull else float(_depths(triangles, whole).max())


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
    if np.linalg.det(piece).sum() < 0:
        piece = piece[:, ::-1]  # normals outward
    faces = _indexed(piece)
    edges = np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1)
    closed = not np.any(np.unique(edges, axis=0, return_counts=True)[1] % 2)
    count, todo = 0, [piece]
    while todo:
        part = todo.pop()
        hull = _hull(part)
        depths = _depths(part, hull)
        if depths.max() > CONCAVE and count + len(todo) < MOST_CUTS:
            across = cross(part)
            face = int(np.argmax(np.where(depths > CONCAVE, depths, 0) * np.linalg.norm(across, axis=1) ** 0.5))
            todo += _cut(part, part[face, 0], across[face] / np.linalg.norm(across[face]))
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
    return np.asarray(hull.points[hull.vertices])


def _depths(triangles: Array, hull: ConvexHull) -> Array:
    """Measure how deep triangles lie inside a hull, at a corner or the middle, (t,) [m]."""
    corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    points = np.ascontiguousarray(np.concatenate([corners, triangles.mean(axis=1)]).T)
    depths = np.full(points.shape[1], np.inf)
    for *normal, offset in np.unique(hull.equations, axis=0):
        np.minimum(depths, -offset - np.array(normal) @ points, out=depths)
    return np.asarray(np.maximum(depths[index.reshape(-1, 3)].max(axis=1), depths[len(corners) :]))


def _cut(triangles: Array, point: Array, normal: Array) -> list[Array]:
    """Cut a surface with a plane through a point; what hangs together behind it, and what does before it."""
    corners = triangles.reshape(-1, 3)
    heights = (corners - point) @ normal
    heights[np.abs(heights) < _SAME] = 0.0
    faces, found = np.arange(len(corners)).reshape(-1, 3), []
    for side in (-1, 1):
        vertices, kept, _ = slice_faces_plane(corners, faces, side * normal, point, cached_dots=side * heights)
        found += _pieces(vertices[kept])
    return found


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
    of_face = connected_component_labels(np.concatenate([faces[:, :2], faces[:, 1:]]))[faces[:, 0]]
    order = np.argsort(of_face, kind="stable")
    return np.split(triangles[order], np.flatnonzero(np.diff(of_face[order])) + 1)


def _indexed(triangles: Array) -> IntArray:
    corners = np.round(triangles.reshape(-1, 3) / _SAME)
    return np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)
