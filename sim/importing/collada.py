"""Triangles of COLLADA files (.dae), placed as Gazebo places them.

Gazebo applies the unit of length and the transforms of the nodes, and ignores `<up_axis>`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.sdf_files import parse
from sim.mjcf.limits import MOST_NESTED, MOST_NODES, MOST_TRIANGLES

Faces = NDArray[np.int64]


def read_collada(path: Path, name: str = "") -> Array:
    """Read the corners of all triangles, or of those under the name of a node or geometry, (t, 3, 3) [m]."""
    try:
        root = parse(path, "a COLLADA file")
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]
        ids = {f"#{element.get('id')}": element for element in root.iter() if element.get("id")}
        found = list(_Document(root, name, ids).triangles())
        unit = float(getattr(root.find("asset/unit"), "attrib", {}).get("meter", 1.0))
        return unit * np.concatenate([np.empty((0, 3, 3)), *found])
    except (ValueError, LookupError, OverflowError, RecursionError, StopIteration, RuntimeError) as error:
        reason = " ".join(str(error).split())[:100]
        raise SceneError(f"{path}: this is no COLLADA file of triangles ({reason}); export it again") from None


@dataclass(slots=True)
class _Document:
    root: ET.Element
    name: str
    ids: dict[str, ET.Element]
    nodes: int = 0
    count: int = 0  # of triangles
    shapes: dict[str, Array] = field(default_factory=dict)  # triangles by id of the geometry

    def triangles(self) -> Iterator[Array]:
        """Yield the triangles of each instance of a geometry, (t, 3, 3) [units of the file]."""
        scene = self.root.find("scene/instance_visual_scene")
        if scene is None:
            geometries = self.root.iterfind("library_geometries/geometry")
            yield from (self._shape(geometry) for geometry in geometries if self._named(geometry))
        else:
            for node in self._at(scene).findall("node"):
                yield from self._node(node, np.eye(4), not self.name, 0)

    def _at(self, element: ET.Element, key: str = "url") -> ET.Element:
        return self.ids[element.get(key, "")]

    def _named(self, element: ET.Element) -> bool:
        return self.name in ("", element.get("name"), element.get("id"))

    def _node(self, node: ET.Element, pose: Array, wanted: bool, depth: int) -> Iterator[Array]:
        self.nodes += 1
        if self.nodes > MOST_NODES or depth > 2 * MOST_NESTED:
            raise ValueError(f"more than {MOST_NODES} nodes, or nested deeper than {2 * MOST_NESTED}")
        wanted = wanted or self._named(node)
        for part in node:
            pose = pose @ _matrix(part)
        for part in node:
            if part.tag in ("node", "instance_node"):
                inner = part if part.tag == "node" else self._at(part)
                yield from self._node(inner, pose, wanted, depth + 1)
            elif part.tag in ("instance_geometry", "instance_controller"):
                geometry = self._at(part)
                skin = geometry.find("skin")
                geometry = geometry if skin is None else self._at(skin, "source")
                if wanted or self._named(geometry):
                    yield self._shape(geometry) @ pose[:3, :3].T + pose[:3, 3]

    def _shape(self, geometry: ET.Element) -> Array:
        key = geometry.get("id", "")
        if key not in self.shapes:
            self.shapes[key] = np.concatenate([np.empty((0, 3, 3)), *self._primitives(geometry)])
        self.count += len(self.shapes[key])
        if self.count > MOST_TRIANGLES:
            raise ValueError(f"more than {MOST_TRIANGLES} triangles")
        return self.shapes[key]

    def _primitives(self, geometry: ET.Element) -> Iterator[Array]:
        for part in geometry.iterfind("mesh/*"):
            inputs = {one.get("semantic"): one for one in part.findall("input")}
            if part.tag in ("triangles", "polylist", "polygons", "trifans", "tristrips") and "VERTEX" in inputs:
                stride = 1 + max(int(one.get("offset", 0)) for one in part.findall("input"))
                first = int(inputs["VERTEX"].get("offset", 0))
                for indices in part.iter("p"):
                    corners = _whole(indices.text)[first::stride]
                    yield self._points(inputs["VERTEX"])[_faces(part, corners)]

    def _points(self, source: ET.Element) -> Array:
        vertices = self._at(source, "source")
        block = self._at(next(one for one in vertices.findall("input") if one.get("semantic") == "POSITION"), "source")
        accessor = block.find("technique_common/accessor")
        stride = 3 if accessor is None else int(accessor.get("stride", 3))
        return _numbers(block.findtext("float_array")).reshape(-1, stride)[:, :3]


def _numbers(text: str | None) -> Array:
    return np.array((text or "").split(), dtype=float)


def _whole(text: str | None) -> Faces:
    values = np.array((text or "").split(), dtype=np.int64)
    if np.any(values < 0):
        raise ValueError("a negative index")
    return values


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


def _faces(part: ET.Element, indices: Faces) -> Faces:
    """Split polygons of these corners into triangles (t, 3), around their first corners."""
    if part.tag == "triangles":
        return indices.reshape(-1, 3)
    if part.tag == "tristrips":
        return np.lib.stride_tricks.sliding_window_view(indices, 3)
    counts = _whole(part.findtext("vcount")) if part.tag == "polylist" else np.array([len(indices)])
    if counts.sum() != len(indices) or np.any(counts < 3):
        raise ValueError("polygons of less than three corners, or more corners than indices")
    triangles = counts - 2
    begin = np.repeat(np.cumsum(counts) - counts, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    fans: Faces = indices[np.stack([begin, begin + step + 1, begin + step + 2], axis=1)]
    return fans
