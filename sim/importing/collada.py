"""Triangles of COLLADA files (.dae), placed by unit and nodes as in Gazebo, which ignores `<up_axis>`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.sdf_files import parse
from sim.mjcf.limits import MOST_ELEMENTS, MOST_TRIANGLES

_INSIDE = ("node", "skin", "instance_node", "instance_geometry", "instance_controller")


def read_collada(path: Path, name: str = "") -> Array:
    """Read the corners of all triangles, or of those under the name of a node or geometry, (t, 3, 3) [m]."""
    try:
        root = parse(path, "a COLLADA file")
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]
        unit = float(getattr(root.find("asset/unit"), "attrib", {}).get("meter", 1.0))
        return unit * np.concatenate([np.empty((0, 3, 3)), *_placed(root, name)])
    except (ValueError, LookupError, OverflowError, AttributeError) as error:
        reason = " ".join(str(error).split())[:100]
        raise SceneError(f"{path}: this is no COLLADA file of triangles ({reason}); export it again") from None


def _placed(root: ET.Element, name: str) -> Iterator[Array]:
    """Yield the triangles of each instance of a geometry, (t, 3, 3) [units of the file]."""
    ids = {f"#{element.get('id')}": element for element in root.iter() if element.get("id")}
    shapes: dict[ET.Element, Array] = {}
    elements = triangles = 0
    scene = root.findall("scene/instance_visual_scene")[:1] or root.findall("library_geometries/geometry")[::-1]
    todo = [(element, np.eye(4), not name) for element in scene]
    while todo:
        element, pose, wanted = todo.pop()
        if element.tag == "skin" or element.tag.startswith("instance_"):
            element = ids[element.get("url", element.get("source", ""))]
        wanted = wanted or name in (element.get("name"), element.get("id"))
        if element.tag == "geometry" and wanted:
            if element not in shapes:
                shapes[element] = np.concatenate([np.empty((0, 3, 3)), *_polygons(element, ids)])
            yield shapes[element] @ pose[:3, :3].T + pose[:3, 3]
        elements, triangles = elements + 1 + len(element), triangles + len(shapes.get(element, ()))
        if elements > MOST_ELEMENTS or triangles > MOST_TRIANGLES:
            raise ValueError(f"its instances have more than {MOST_ELEMENTS} elements or {MOST_TRIANGLES} triangles")
        for part in element:
            pose = pose @ _matrix(part)
        todo += [(part, pose, wanted) for part in reversed(element) if part.tag in _INSIDE]


def _polygons(geometry: ET.Element, ids: dict[Any, Any]) -> Iterator[Array]:
    """Yield polygons split into triangles around their first corners, (t, 3, 3)."""
    for part in geometry.iterfind("mesh/*"):
        inputs = {one.get("semantic"): one for one in part.findall("input")}
        if part.tag in ("triangles", "polylist", "polygons", "trifans", "tristrips") and "VERTEX" in inputs:
            block = ids[ids[inputs["VERTEX"].get("source")].find("input[@semantic='POSITION']").get("source")]
            width = int(getattr(block.find("technique_common/accessor"), "attrib", {}).get("stride", 3))
            points = _numbers(block.findtext("float_array")).reshape(-1, width)[:, :3]
            stride = 1 + max(int(one.get("offset", 0)) for one in part.findall("input"))
            for indices in part.iter("p"):
                corners = points[_numbers(indices.text, np.uint64)[int(inputs["VERTEX"].get("offset", 0)) :: stride]]
                counts = np.array([len(corners)])
                if part.tag in ("triangles", "polylist"):
                    counts = _numbers(part.findtext("vcount", "3 " * (len(corners) // 3)), np.int64)
                place, first = np.arange(len(corners)), np.repeat(np.cumsum(counts) - counts, counts)
                inner = np.flatnonzero((place > first) & (place < first + np.repeat(counts, counts) - 1))
                before = inner - 1 if part.tag == "tristrips" else first[inner]
                yield corners[np.stack([before, inner, inner + 1], axis=1)]


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
    return matrix


def _numbers(text: str | None, kind: type = float) -> Array:
    return np.array((text or "").split(), dtype=kind)
