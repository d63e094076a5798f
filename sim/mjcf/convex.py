"""Convex parts of surfaces, since MuJoCo collides with the convex hull of a mesh: a room would be a block.

A mesh that is not convex is cut along planes of its own faces, the deepest inside its hull first, until every part
lies within `CONCAVE` of its hull. Walls and furniture of flat faces come out exactly. Where that takes too many cuts,
CoACD splits the mesh, or if it is not installed its faces are taken one by one. A surface that is stored from both
sides counts once.
"""

from collections.abc import Iterator
from itertools import chain

import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from trimesh.graph import connected_component_labels
from trimesh.intersections import slice_faces_plane
from trimesh.triangles import area, cross

from pirrht.arrays import Array, IntArray
from pirrht.errors import OptionError, SceneError
from sim.mjcf.library import refused

FLAT = 1e-3  # least thickness of a part of a mesh [m]
CONCAVE = 0.03  # how deep the surface of a convex part may lie inside its hull [m]
MOST_CUTS, MOST_PARTS = 100, 1000  # parts of what hangs together, and of one mesh
MOST_WORK = 2e9  # depths of points below planes of hulls, for all meshes of a file: about five seconds
MOST_FACES = 20_000  # triangles that CoACD is given: it takes half a minute for them
_OPEN = 1.5  # where a surface has an edge, a hull of more than this times its area is no solid
_SAME = 1e-5  # corners closer than this are one, and points closer to a plane lie on it [m]
_CUTTING = 2500  # depths that take as long as cutting a triangle
_EMPTY = 1e-12  # area of no triangle [m2]


class Budget:
    """Counts the work that may still be spent on splitting meshes."""

    def __init__(self, most: float = MOST_WORK) -> None:
        self.left = most

    def take(self, work: float) -> bool:
        """Take some work; False if there is less left."""
        self.left -= work
        return self.left >= 0.0


def convex_parts(triangles: Array, label: str) -> tuple[list[Array], list[str]]:
    """Split triangles (t, 3, 3) [m] into convex parts, corners of each (v, 3), and say if their own faces do not do.

    Then CoACD splits them, or if it is not installed the surface is taken by its faces.
    """
    parts, rough = split_surface(triangles, Budget())
    if not rough:
        return parts, []
    what = f"{label}: its own faces leave parts that are not convex"
    try:
        parts = _by_coacd(triangles, label)
    except ImportError:
        parts = list(chain.from_iterable(map(_plates, _pieces(triangles))))
        if len(parts) > MOST_PARTS:
            more = f"{len(parts)} faces, more than {MOST_PARTS}: install CoACD, `pip install 'pirrht[decompose]'`"
            raise OptionError(f"{what}, and it has {more}") from None
        return parts, [f"{what}; it is taken by {len(parts)} flat faces (`pirrht[decompose]` makes solid parts)"]
    return parts, [f"{what}; CoACD makes {len(parts)} of them, on a coarse grid"]


def _by_coacd(triangles: Array, label: str) -> list[Array]:
    """Return the corners of convex parts (v, 3) [m] that CoACD finds."""
    import coacd

    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))
    if len(mesh.faces) > MOST_FACES:
        few = f"simplify it to {MOST_FACES} triangles or fewer"
        raise SceneError(f"{label}: its {len(mesh.faces)} triangles would take CoACD minutes; {few}")
    coacd.set_log_level("error")
    with refused(f"{label}: CoACD finds no convex parts (", ")", Exception):  # of a library in C++
        found = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces))  # closes what is open, on a coarse grid
    return [np.asarray(corners, dtype=float) for corners, _ in found]


def split_surface(triangles: Array, budget: Budget, *, hull: bool = False) -> tuple[list[Array], float]:
    """Split triangles (t, 3, 3) [m] into convex parts, or take their hull where that is asked for.

    Returns corners of each part (v, 3) [m], and how far a hull sticks out at most [m], 0 if all are within `CONCAVE`.
    Once the budget is spent, the hull is returned.
    """
    parts = [] if hull else _parts(triangles, budget)
    if not parts:
        whole = _hull(triangles)
        few = triangles[:: 1 + int(_work(triangles, whole) / MOST_WORK)]  # their depths are those of nearly all
        parts = [(whole.points[whole.vertices], 0.0 if hull else float(_depths(few, whole).max()))]
    rough = max(depth for _, depth in parts)
    return [corners for corners, _ in parts], rough if rough > CONCAVE else 0.0


def _parts(triangles: Array, budget: Budget) -> list[tuple[Array, float]]:
    """Cut triangles (t, 3, 3) into convex parts as of `_convex`; none where they are too many or take too much work."""
    pieces = _pieces(triangles)
    bodies = [body for piece in pieces for body in _bodies(piece)] if len(pieces) <= MOST_PARTS else []
    parts = [part for body in bodies for part in _convex(body, budget)] if len(bodies) <= MOST_PARTS else []
    return parts if len(parts) <= MOST_PARTS and budget.left >= 0.0 else []


def _bodies(piece: Array) -> Iterator[Array]:
    """Split a surface (t, 3, 3) into closed ones, normals outward, and what remains; each face counts once."""
    piece, twice = _from_one_side(piece)
    faces = _indexed(piece)
    count = len(faces)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, edge, meeting = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    pairs = order[meeting[edge[order]] == 2].reshape(-1, 2)
    # Two copies of each face, as stored and turned over: those that agree with their neighbours hang together.
    one, other = pairs.T // 3
    turned = count * (edges[pairs[:, 0], 0] == edges[pairs[:, 1], 0])
    links = np.stack([np.append(one, one + count), np.append(other + turned, other + count - turned)], axis=1)
    label = connected_component_labels(links, node_count=2 * count)
    body = np.minimum(label[:count], label[count:])
    sides, number = np.unique(np.stack([np.repeat(body, 3), edge], axis=1), axis=0, return_counts=True)
    closed = ~np.isin(body, sides[number % 2 == 1, 0])
    volumes = np.linalg.det(piece - piece.mean(axis=(0, 1)))
    whole = np.bincount(label, np.append(volumes, -volumes))
    inward = (closed | twice) & (whole[label[:count]] < whole[label[count:]])
    piece = np.where(inward[:, None, None], piece[:, ::-1], piece)
    group = np.where(closed, body, -1)
    order = np.argsort(group, kind="stable")
    yield from np.split(piece[order], np.flatnonzero(np.diff(group[order])) + 1)


def _from_one_side(piece: Array) -> tuple[Array, bool]:
    """Return a surface (t, 3, 3) with each face once, and whether it was stored from both sides.

    Solids that share faces keep both of them.
    """
    faces = np.sort(_indexed(piece), axis=1)
    _, first, count = np.unique(faces, axis=0, return_index=True, return_counts=True)
    single = first[count % 2 == 1]
    if len(first) == len(faces) or (len(single) and _closed(faces[single])):
        return piece, False
    return piece[first], True


def _closed(faces: IntArray) -> bool:
    """Return whether an even number of faces (t, 3) meets at every edge."""
    edges = np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1)
    return not np.any(np.unique(edges, axis=0, return_counts=True)[1] % 2)


def _convex(piece: Array, budget: Budget) -> Iterator[tuple[Array, float]]:
    """Cut one connected surface (t, 3, 3) into convex parts: corners of each hull, and how far it sticks out."""
    closed = _closed(_indexed(piece))
    volume = np.linalg.det(piece - piece.mean(axis=(0, 1)) * closed).sum() / 6
    if volume < 0:
        piece = piece[:, ::-1]  # normals outward
    # A closed surface without volume is stored from both sides by other triangles, and may be hollow or not.
    most = 0 if closed and abs(volume) < _SAME * area(piece).sum() else MOST_CUTS
    count, todo = 0, [piece]
    while todo:
        part = todo.pop()
        hull = _hull(part)
        if not budget.take(_work(part, hull)):
            return
        depths = _depths(part, hull)
        if depths.max() > CONCAVE and count + len(todo) < most:
            across = cross(part)
            face = int(np.argmax(np.where(depths > CONCAVE, depths, 0) * np.linalg.norm(across, axis=1) ** 0.5))
            todo += _cut(part, part[face, 0], across[face] / np.linalg.norm(across[face]))
            continue
        plates = [] if closed or hull.area <= _OPEN * area(part).sum() else list(_plates(part))
        for points in plates or [hull.points[hull.vertices]]:
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


def _work(triangles: Array, hull: ConvexHull) -> float:
    """Estimate what the depths of triangles inside a hull take, and cutting them: more than the depths below planes."""
    return float(2 * len(triangles) * (len(hull.equations) + _CUTTING))


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
    faces = np.arange(len(corners)).reshape(-1, 3)
    found = []

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
            for one in [hull] if whole else (_hull(triangle[None]) for triangle in plate):
                yield one.points[one.vertices]


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
