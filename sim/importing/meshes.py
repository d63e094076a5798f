"""Meshes of files: triangles of OBJ, STL, PLY and COLLADA, as scenes of their convex parts (`sim.mjcf.convex`).

COLLADA files (.dae) are placed as Gazebo places them, by their unit and nodes but not by `<up_axis>`.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.sdf_files import parse
from sim.importing.solids import LOW, World, is_low, part_solid
from sim.mjcf.convex import Budget, convex_parts, split_surface
from sim.mjcf.library import FARTHEST, MOST_ELEMENTS, MOST_TRIANGLES, content_of, listed, refused

SUFFIXES = (".dae", ".obj", ".ply", ".stl")
WIDEST = 1000.0  # of a mesh that is a scene [m]: in millimetres rooms are wider
_BINARY = 84, 50  # bytes of a binary STL file before its triangles, and of each
_INSIDE = ("node", "instance_node", "instance_geometry")  # of a COLLADA scene


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


def split(
    path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0), *, hull: bool = False, budget: Budget | None = None
) -> tuple[list[Array], float]:
    """Split a mesh as of `split_surface`; SceneError if it is none."""
    return split_surface(checked(path, scale), budget or Budget(), hull=hull)


def checked(path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> Array:
    """Read the corners of a mesh's triangles, (t, 3, 3) [m]; SceneError: it has none, or they are too far out."""
    triangles = _read(path) * scale
    if not len(triangles):
        raise SceneError(f"{path}: it has no triangles; export it again")
    if not np.all(np.abs(triangles) <= FARTHEST):
        raise SceneError(f"{path}: corners are farther out than {FARTHEST:g} m; scale it down")
    return triangles


def _read(path: Path) -> Array:
    """Read the corners of a file's triangles, (t, 3, 3)."""
    suffix = path.suffix.lower()
    if suffix == ".dae":
        return read_collada(path)
    if suffix not in SUFFIXES:
        raise SceneError(f"{path}: meshes are read from {', '.join(SUFFIXES)}; convert it")
    data = content_of(path, "a mesh")
    begin, each = _BINARY
    whole = begin + each * int.from_bytes(data[begin - 4 : begin], "little")
    if not (b"format binary" in data[:1000] if suffix == ".ply" else suffix == ".stl" and len(data) == whole):
        data = data.decode(errors="replace").encode()  # trimesh needs another library for text that is not UTF-8
    with refused(f"{path}: this is no mesh of triangles (", "); export it again", Exception, most=100):
        return np.array(trimesh.load_mesh(BytesIO(data), file_type=suffix[1:], process=False).triangles, dtype=float)


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
