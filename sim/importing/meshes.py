"""Collision meshes as convex parts, since MuJoCo collides with the convex hull of a mesh: a room would be a block.

A mesh that is not convex is cut along planes of its own faces, the deepest inside its hull first, until every part
lies within `CONCAVE` of its hull. Walls and furniture of flat faces come out exactly. Where that takes too many cuts,
CoACD splits the mesh, or if it is not installed its faces are taken one by one. A surface that is stored from both
sides counts once. COLLADA files (.dae) are placed as Gazebo places them, by unit and nodes but not by `<up_axis>`.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from trimesh.graph import connected_component_labels
from trimesh.intersections import slice_faces_plane
from trimesh.triangles import area, cross

from pirrht.arrays import Array, IntArray
from pirrht.errors import OptionError, SceneError
from sim.importing.sdf_files import parse
from sim.importing.solids import FLAT, LOW, World, is_low, part_solid
from sim.mjcf.library import FARTHEST, MOST_ELEMENTS, MOST_TRIANGLES, content_of, listed, refused

SUFFIXES = (".dae", ".obj", ".ply", ".stl")
CONCAVE = 0.03  # how deep the surface of a convex part may lie inside its hull [m]
MOST_CUTS, MOST_PARTS = 100, 1000  # parts of what hangs together, and of one mesh
WIDEST = 1000.0  # of a mesh that is a scene [m]: in millimetres rooms are wider
MOST_WORK = 2e9  # depths of points below planes of hulls, for all meshes of a file: about five seconds
MOST_FACES = 20_000  # triangles that CoACD is given: it takes half a minute for them
_OPEN = 1.5  # where a surface has an edge, a hull of more than this times its area is no solid
_SAME = 1e-5  # corners closer than this are one, and points closer to a plane lie on it [m]
_CUTTING = 2500  # depths that take as long as cutting a triangle
_EMPTY = 1e-12  # area of no triangle [m2]
_BINARY = 84, 50  # bytes of a binary STL file before its triangles, and of each
_INSIDE = ("node", "instance_node", "instance_geometry")  # of a COLLADA scene


class Budget:
    """Counts the work that may still be spent on splitting meshes."""

    def __init__(self, most: float = MOST_WORK) -> None:
        self.left = most

    def take(self, work: float) -> bool:
        """Take some work; False if there is less left."""
        self.left -= work
        return self.left >= 0.0


def read_mesh(source: Path, dimension: int = 2) -> World:
    """Read a mesh as a world of its convex parts; in the plane, of what is high enough not to be driven over."""
    triangles = checked(source)
    parts, notes = convex_parts(triangles, str(source))
    corners = np.vstack(parts)
    bounds = np.column_stack([corners.min(axis=0), corners.max(axis=0)]).ravel()
    if np.ptp(corners, axis=0).max() > WIDEST:
        wide = f"it is {np.ptp(corners, axis=0).max():g} m wide; if its unit is the millimetre, scale it by 0.001"
        raise SceneError(f"{source}: {wide}, else cut out {WIDEST:g} m")
    solids = [part_solid(f"part {number}", np.eye(4), one) for number, one in enumerate(parts, 1)]
    low = [solid.name for solid in solids if dimension == 2 and is_low(solid)]
    return World(
        kind="mesh", solids=tuple(solid for solid in solids if solid.name not in low),
        ground=bounds, notes=(*notes, *([LOW + listed(low)] if low else [])),
    )  # fmt: skip


def convex_parts(triangles: Array, label: str) -> tuple[list[Array], list[str]]:
    """Split triangles (t, 3, 3) [m] into convex parts, corners of each (v, 3), and say if their own faces do not do.

    Then CoACD splits them, or if it is not installed the surface is taken by its faces.
    """
    parts, rough = _split(triangles, Budget())
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


def split(
    path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0), *, hull: bool = False, budget: Budget | None = None
) -> tuple[list[Array], float]:
    """Split a mesh into convex parts, or take its hull where that is asked for; SceneError if it is no mesh.

    Returns corners of each part (v, 3) [m], and how far a hull sticks out at most [m], 0 if all are within `CONCAVE`.
    Once the budget is spent, the hull is returned.
    """
    return _split(checked(path, scale), budget or Budget(), hull=hull)


def checked(path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> Array:
    """Read the corners of a mesh's triangles, (t, 3, 3) [m]; SceneError: it has none, or they are too far out."""
    triangles = _read(path) * scale
    if not len(triangles):
        raise SceneError(f"{path}: it has no triangles; export it again")
    if not np.all(np.abs(triangles) <= FARTHEST):
        raise SceneError(f"{path}: corners are farther out than {FARTHEST:g} m; scale it down")
    return triangles


def _split(triangles: Array, budget: Budget, *, hull: bool = False) -> tuple[list[Array], float]:
    """Split triangles (t, 3, 3) as of `split`."""
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


def _read(path: Path) -> Array:
    """Read the corners of a file's triangles, (t, 3, 3)."""
    suffix = path.suffix.lower()
    if suffix == ".dae":
        return read_collada(path)
    if suffix not in SUFFIXES:
        raise SceneError(f"{path}: meshes are read from {', '.join(SUFFIXES)}; convert it")
    data = content_of(path, "a mesh")
    begin, each = _BINARY
    binary = suffix == ".ply" and b"format binary" in data[:1000]
    if not binary and (
        suffix != ".stl" or len(data) != begin + each * int.from_bytes(data[begin - 4 : begin], "little")
    ):
        data = data.decode(errors="replace").encode()  # trimesh needs another library for text that is not UTF-8
    with refused(f"{path}: this is no mesh of triangles (", "); export it again", Exception, most=100):
        return np.array(trimesh.load_mesh(BytesIO(data), file_type=suffix[1:], process=False).triangles, dtype=float)


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


def read_collada(path: Path) -> Array:
    """Read the corners of all triangles, (t, 3, 3) [m]."""
    begin = f"{path}: this is no COLLADA file of triangles ("
    wrong = (ValueError, LookupError, OverflowError)

    with refused(begin, "); export it again", *wrong, AttributeError, most=100):
        root = parse(path, "a COLLADA file")
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]
        unit = float(getattr(root.find("asset/unit"), "attrib", {}).get("meter", 1.0))
        return unit * np.concatenate([np.empty((0, 3, 3)), *_placed(root)])


def _placed(root: ET.Element) -> Iterator[Array]:
    """Yield the triangles of each instance of a geometry, (t, 3, 3) [units of the file]."""
    ids = {f"#{element.get('id')}": element for element in root.iter() if element.get("id")}
    points, elements, triangles = cache(_points), 0, 0
    shape = cache(lambda geometry: np.concatenate([np.empty((0, 3, 3)), *_polygons(geometry, ids, points)]))
    scene = root.findall("scene/instance_visual_scene")[:1] or root.findall("library_geometries/geometry")[::-1]
    todo = [(element, np.eye(4)) for element in scene]
    while todo:
        element, pose = todo.pop()
        element = ids[element.attrib["url"]] if element.tag.startswith("instance_") else element
        if element.tag == "geometry":
            triangles += len(shape(element))
            yield shape(element) @ pose[:3, :3].T + pose[:3, 3]
        elements += 1 + len(element)
        if elements > MOST_ELEMENTS or triangles > MOST_TRIANGLES:
            raise ValueError(f"its instances have more than {MOST_ELEMENTS} elements or {MOST_TRIANGLES} triangles")
        for part in element:
            pose = pose @ _matrix(part)
        todo += [(part, pose) for part in reversed(element) if part.tag in _INSIDE]


def _polygons(geometry: ET.Element, ids: dict[Any, Any], points: Callable[[ET.Element], Array]) -> Iterator[Array]:
    """Yield polygons split into triangles around their first corners, (t, 3, 3)."""
    for part in geometry.iterfind("mesh/*"):
        if part.tag in ("triangles", "polylist", "polygons"):
            vertex = part.find("input[@semantic='VERTEX']").attrib  # type: ignore[union-attr]
            block = ids[ids[vertex["source"]].find("input[@semantic='POSITION']").get("source")]
            stride = 1 + max(int(one.get("offset", 0)) for one in part.findall("input"))
            lists = [_numbers(p.text, np.uint64)[int(vertex.get("offset", 0)) :: stride] for p in part.findall("p")]
            corners = points(block)[np.concatenate([np.empty(0, np.uint64), *lists])]
            counts = _numbers(part.findtext("vcount", "3 " * (len(corners) // 3)), np.int64)
            if part.tag == "polygons":
                counts = np.array([len(one) for one in lists])
            place = np.arange(len(corners))
            first = np.repeat(np.cumsum(counts) - counts, counts)
            inner = np.flatnonzero((place > first) & (place < first + np.repeat(counts, counts) - 1))
            yield corners[np.stack([first[inner], inner, inner + 1], axis=1)]
        elif part.tag not in ("source", "vertices", "extra", "lines", "linestrips"):
            raise ValueError(f"<{part.tag}> is not read; write <triangles>, <polylist> or <polygons>")


def _points(block: ET.Element) -> Array:
    stride = int(getattr(block.find("technique_common/accessor"), "attrib", {}).get("stride", 3))
    return _numbers(block.findtext("float_array")).reshape(-1, stride)[:, :3]


def _matrix(part: ET.Element) -> Array:
    """Read a transform of a node, (4, 4); that of any other element is the identity."""
    matrix = np.eye(4)
    if part.tag == "matrix":
        return _numbers(part.text).reshape(4, 4)
    if part.tag == "translate":
        matrix[:3, 3] = _numbers(part.text)
    elif part.tag == "scale":
        matrix[:3, :3] = np.diag(_numbers(part.text))
    elif part.tag == "rotate":
        *axis, angle = _numbers(part.text)
        matrix[:3, :3] = Rotation.from_rotvec(np.array(axis) * angle / np.linalg.norm(axis), True).as_matrix()
    elif part.tag == "instance_controller":
        raise ValueError("<instance_controller> is not read")
    return matrix


def _numbers(text: str | None, kind: type = float) -> NDArray[Any]:
    return np.array((text or "").split(), dtype=kind)
