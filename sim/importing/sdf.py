"""The obstacles of a Gazebo world: collision shapes of its models, where the file has them.

Poses follow SDFormat 1.4 to 1.11: nested and included models, links, collisions, frames, `relative_to` and
`placement_frame`. Poses of a state block take precedence, as in Gazebo: those of models and links are in world
coordinates. Models that move in Gazebo are static obstacles where they start.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.meshes import MeshKey, split
from sim.importing.sdf_files import ModelPaths, read_world
from sim.importing.sdf_poses import Scope, is_true, label_of, numbers
from sim.importing.solids import Solid, World, part_solid
from sim.mjcf.limits import FARTHEST, FINEST
from sim.mjcf.refusals import listed

_SHAPES = {
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
}  # geometry -> its measures and how many numbers each has
_LEVEL = 1e-6  # how far a ground plane may be off [m] and [1]
LOWEST = 0.01  # robots drive over what is no higher, like carpets [m]
_NOTES = {
    "moving": "not static in Gazebo, here obstacles that stay where they start (or leave them out by name): ",
    "actors": "actors have no collisions and are left out: ",
    "low": f"no higher than {LOWEST:g} m, so driven over and left out: ",
    "lost": f"farther out than {FARTHEST:g} m and left out: ",
    "rough": "meshes too intricate to split, whose hulls stick out by up to {:.2g} m: ",
}


def read_sdf(path: Path, *, folders: Sequence[Path] = (), without: Sequence[str] = ()) -> World:
    """Read the obstacles of the one world, or of the models without a world, in an SDF file.

    Args:
        folders: where included models and meshes are searched for, before the folders around the file.
        without: names of models to leave out.
    """
    try:
        world = read_world(ModelPaths(path, tuple(folders)))
        return _Reader(Scope.of_world(world, path), frozenset(without)).world()
    except RecursionError:
        raise SceneError(f"{path}: poses refer to each other in too long a chain; shorten it") from None


class _Reader:
    def __init__(self, scope: Scope, without: frozenset[str]) -> None:
        self.scope, self.without, self.split = scope, without, cache(split)
        self.noted: dict[str, dict[str, float]] = defaultdict(dict)  # names by note

    def world(self) -> World:
        """Take over all models."""
        solids: list[Solid] = []
        grounds: list[Array] = []
        for model in self._models(self.scope):
            links = [(model.link(part), part) for part in model.element.findall("link")]
            found = [(link, one, _geometry(link, one)) for link, part in links for one in part.findall("collision")]
            shapes = [geometry for _, _, geometry in found if geometry.tag not in ("plane", "empty")]
            if shapes and not model.static:
                self.noted["moving"][model.label.partition("::")[0]] = 0.0
            for link, collision, geometry in found:
                if geometry.tag == "plane":
                    grounds += _ground(link, collision, geometry)
                elif geometry.tag != "empty":
                    name = model.label if len(shapes) == 1 else f"{link.label}::{collision.get('name')}"
                    solids += self._solids(" ".join(name.split()), link, collision, geometry)
        unknown = self.without.difference(self.noted["left"])
        if unknown:
            names = listed([part.get("name", "") for part in self.scope.element.findall("model")])
            self.scope.refuse(f"there is no model {listed(sorted(unknown))} to leave out; models are {names}")
        notes = tuple(
            words.format(max(self.noted[note].values())) + listed([*self.noted[note]])
            for note, words in _NOTES.items()
            if self.noted[note]
        )
        return World(solids=tuple(solids), ground=grounds[0] if grounds else None, notes=notes)

    def _models(self, scope: Scope) -> Iterator[Scope]:
        """Yield the models of a world or model, nested ones after the one they are in."""
        for part in scope.element:
            tag, name = part.tag.rpartition("}")[2], part.get("name", "")
            if tag in ("include", "population"):
                scope.refuse(f'<{tag}> "{name}" cannot be taken over; write its models out, or remove it')
            if tag == "actor":
                self.noted["actors"][name] = 0.0
            if tag not in ("model", "link", "actor", "plugin") and part.find(".//collision") is not None:
                scope.refuse(f"<{tag}> holds models, which is not SDFormat; expand the file, or remove it")
            if tag == "model":
                model = scope.child(part)
                left = self.without.intersection((model.label, name))
                self.noted["left"].update(dict.fromkeys(left, 0.0))
                if not left:
                    yield model
                    yield from self._models(model)

    def _solids(self, name: str, link: Scope, collision: ET.Element, geometry: ET.Element) -> Iterator[Solid]:
        if geometry.tag == "mesh":
            parts = self.split(_mesh_key(link, collision, geometry))
            if parts.rough:
                self.noted["rough"][name] = parts.rough
            pose = link.pose(collision)
            solids = [part_solid(name, pose, vertices) for vertices in parts.vertices]
        else:
            solids = [_solid(name, link, collision, geometry)]
        for solid in solids:
            if np.any(np.abs(solid.pose) > FARTHEST):
                self.noted["lost"][name] = 0.0
            elif 0 < solid.top <= LOWEST:
                self.noted["low"][name] = 0.0
            else:
                yield solid


def _geometry(link: Scope, collision: ET.Element) -> ET.Element:
    known = ", ".join((*_SHAPES, "mesh"))
    shapes = collision.findall("geometry/*")
    if len(shapes) != 1:
        link.refuse(f"{label_of(collision)} has {len(shapes)} shapes in its <geometry>; write one of {known}")
    if shapes[0].tag not in (*_SHAPES, "mesh", "plane", "empty"):
        uri = (shapes[0].findtext("uri") or "").strip()
        which = f"<{shapes[0].tag}>" + (f" {uri!r}" if uri else "")
        link.refuse(f"{label_of(collision)} is a {which}; replace it by one of {known}, or remove it")
    return shapes[0]


def _solid(name: str, link: Scope, collision: ET.Element, geometry: ET.Element) -> Solid:
    measures: list[float] = []
    for measure, count in _SHAPES[geometry.tag]:
        values = numbers(geometry.findtext(measure), count)
        if values is None or not np.all(values >= FINEST):
            text = (geometry.findtext(measure) or "").strip()[:60]
            link.refuse(
                f"<{geometry.tag}> of {label_of(collision)} has <{measure}> {text!r}; write {count} positive number(s) "
                f"from {FINEST:g} to {FARTHEST:g}"
            )
        measures.extend(values)
    halves = {"box": 0.5, "cylinder": [1.0, 0.5], "capsule": [1.0, 0.5]}
    size = np.array(measures) * halves.get(geometry.tag, 1.0)
    return Solid(name=name, shape=geometry.tag, size=size, pose=link.pose(collision))


def _mesh_key(link: Scope, collision: ET.Element, mesh: ET.Element) -> MeshKey:
    scale = numbers(mesh.findtext("scale") or "1 1 1", 3)
    if scale is None or not np.all(np.abs(scale) >= FINEST):
        text = (mesh.findtext("scale") or "").strip()[:60]
        link.refuse(f"<mesh> of {label_of(collision)} has <scale> {text!r}; write 3 numbers other than 0")
    return MeshKey(
        path=Path(mesh.findtext("uri") or ""),
        scale=tuple(scale.tolist()),
        name=(mesh.findtext("submesh/name") or "").strip(),
        centred=is_true(mesh.findtext("submesh/center")),
        hull=mesh.get("optimization") == "convex_hull",
    )


def _ground(link: Scope, collision: ET.Element, plane: ET.Element) -> list[Array]:
    """The rectangle of a ground plane, if it has one; other planes are refused."""
    normal = numbers(plane.findtext("normal") or "0 0 1", 3)
    pose = link.pose(collision)
    if normal is None or np.linalg.norm(normal) < _LEVEL:
        link.refuse(f"<plane> of {label_of(collision)} has no <normal>; write 0 0 1")
    up = pose[:3, :3] @ normal / np.linalg.norm(normal)
    if up[2] < 1 - _LEVEL or abs(pose[2, 3]) > _LEVEL:
        link.refuse(f"{label_of(collision)} is a plane other than the ground z = 0; write a box, or remove it")
    size = numbers(plane.findtext("size"), 2)
    if size is None or not np.all(size > 0):
        return []
    (x, y), (a, b) = pose[:2, 3], size / 2
    return [np.array([x - a, x + a, y - b, y + b])]
