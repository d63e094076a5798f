"""The obstacles of a Gazebo world: collision shapes of its models, where the file has them.

Poses follow SDFormat 1.4 to 1.11: nested and included models, links, collisions, frames, `relative_to` and
`placement_frame`. Poses of a state block take precedence, as in Gazebo: those of models and links are in world
coordinates. Models that move in Gazebo are static obstacles where they start.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.limits import FARTHEST, FINEST
from sim.importing.meshes import Meshes, MeshKey, as_box
from sim.importing.model_paths import ModelPaths
from sim.importing.sdf_files import read_world
from sim.importing.sdf_poses import Scope, is_true, label_of, numbers

_SHAPES = {
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
}  # geometry -> its measures and how many numbers each has
_LEVEL = 1e-6  # how far a ground plane may be off [m] and [1]
LOWEST = 0.01  # robots drive over what is no higher, like carpets [m]
_LISTED = 5  # names in a note


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """One collision shape, fixed in the world."""

    name: str  # of its model, with link and collision where the model has several
    shape: str  # a type of MuJoCo's geoms
    size: Array  # MuJoCo's sizes of that type [m]; zeros for a mesh
    pose: Array  # (4, 4) in the world
    vertices: Array | None = None  # (v, 3) of a convex mesh, in its own frame [m]

    @property
    def top(self) -> float:
        """The highest point of a box or mesh [m]; infinite for other shapes."""
        up = self.pose[2, :3]
        reach = np.abs(up) @ self.size if self.shape == "box" else np.inf
        return float(self.pose[2, 3] + (reach if self.vertices is None else (self.vertices @ up).max()))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """What an SDF file holds for a robot that drives on the ground."""

    solids: tuple[Solid, ...]  # in file order
    ground: Array | None  # (4,) x0, x1, y0, y1 of the first ground plane that has a size [m]
    notes: tuple[str, ...] = ()  # sentences on what differs from the file


def read_sdf(
    path: Path,
    progress: Callable[[int, int], object] | None = None,
    *,
    folders: Sequence[Path] = (),
    without: Sequence[str] = (),
) -> World:
    """Read the obstacles of the one world, or of the models without a world, in an SDF file.

    Args:
        progress: called with how many of how many collision shapes are done, now and then.
        folders: where included models and meshes are searched for, before the folders around the file.
        without: names of models to leave out.

    Raises:
        SceneError: unreadable, malformed, with a document type, or with a part that cannot be taken over.
    """
    try:
        world = read_world(ModelPaths(path, tuple(folders)))
        return _Reader(Scope.of_world(world, path), frozenset(without)).world(progress)
    except RecursionError:
        raise SceneError(f"{path}: poses refer to each other in too long a chain; shorten it") from None


@dataclass(slots=True)
class _Reader:
    scope: Scope
    without: frozenset[str]
    meshes: Meshes = field(default_factory=Meshes)
    moving: dict[str, None] = field(default_factory=dict)  # models that are not static
    actors: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)  # models left out on request
    low: dict[str, None] = field(default_factory=dict)  # shapes driven over
    lost: dict[str, None] = field(default_factory=dict)  # shapes too far out
    rough: dict[str, float] = field(default_factory=dict)  # mesh -> how far its hull sticks out [m]

    def world(self, progress: Callable[[int, int], object] | None) -> World:
        """Take over all models."""
        done, total = 0, sum(1 for _ in self.scope.element.iter("collision"))
        solids: list[Solid] = []
        grounds: list[Array] = []
        for model in self._models(self.scope):
            found = list(_collisions(model))
            shapes = [part for part in found if _geometry(*part).tag not in ("plane", "empty")]
            if shapes and not model.static:
                self.moving[model.label.partition("::")[0]] = None
            for link, collision in found:
                geometry = _geometry(link, collision)
                if geometry.tag == "plane":
                    grounds += _ground(link, collision, geometry)
                elif geometry.tag != "empty":
                    name = model.label if len(shapes) == 1 else f"{link.label}::{collision.get('name')}"
                    solids += self._solids(" ".join(name.split()), link, collision, geometry)
            done += len(found)
            if progress is not None:
                progress(done, total)
        unknown = self.without.difference(self.left)
        if unknown:
            names = _listed([part.get("name", "") for part in self.scope.element.findall("model")])
            self.scope.refuse(f"there is no model {_listed(sorted(unknown))} to leave out; models are {names}")
        return World(solids=tuple(solids), ground=grounds[0] if grounds else None, notes=tuple(self._notes()))

    def _models(self, scope: Scope) -> Iterator[Scope]:
        """Yield the models of a world or model, nested ones after the one they are in."""
        for part in scope.element:
            tag = part.tag.rpartition("}")[2]
            if tag in ("include", "population"):
                scope.refuse(
                    f'<{tag}> "{part.get("name", "")}" cannot be taken over; write its models out, or remove it'
                )
            if tag == "actor":
                self.actors.append(part.get("name", ""))
            if tag not in ("model", "link", "actor", "plugin") and part.find(".//collision") is not None:
                scope.refuse(f"<{tag}> holds models, which is not SDFormat; expand the file, or remove it")
            if tag != "model":
                continue
            model = scope.child(part)
            if names := self.without.intersection((model.label, part.get("name", ""))):
                self.left += names
                continue
            yield model
            yield from self._models(model)

    def _solids(self, name: str, link: Scope, collision: ET.Element, geometry: ET.Element) -> Iterator[Solid]:
        if geometry.tag == "mesh":
            parts = self.meshes.parts(_mesh_key(link, collision, geometry))
            if parts.rough:
                self.rough[name] = parts.rough
            pose = link.pose(collision)
            solids = [part_solid(name, pose, vertices) for vertices in parts.vertices]
        else:
            solids = [_solid(name, link, collision, geometry)]
        for solid in solids:
            if np.any(np.abs(solid.pose) > FARTHEST):
                self.lost[name] = None
            elif 0 < solid.top <= LOWEST:
                self.low[name] = None
            else:
                yield solid

    def _notes(self) -> Iterator[str]:
        if self.moving:
            yield (
                f"not static in Gazebo, here obstacles that stay where they start (or leave them out by name): "
                f"{_listed([*self.moving])}"
            )
        if self.actors:
            yield f"actors have no collisions and are left out: {_listed(self.actors)}"
        if self.low:
            yield f"no higher than {LOWEST:g} m, so driven over and left out: {_listed([*self.low])}"
        if self.lost:
            yield f"farther out than {FARTHEST:g} m and left out: {_listed([*self.lost])}"
        if self.rough:
            far = max(self.rough.values())
            yield f"meshes too intricate to split, whose hulls stick out by up to {far:.2g} m: {_listed([*self.rough])}"


def _listed(names: Sequence[str]) -> str:
    names = [" ".join(name.split())[:60] for name in names]
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")


def _collisions(model: Scope) -> Iterator[tuple[Scope, ET.Element]]:
    """The collisions of a model's own links, each with its link."""
    for element in model.element.findall("link"):
        link = model.link(element)
        for collision in element.findall("collision"):
            yield link, collision


def _geometry(link: Scope, collision: ET.Element) -> ET.Element:
    known = ", ".join((*_SHAPES, "mesh"))
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1:
        link.refuse(f"{label_of(collision)} has {len(shapes)} shapes in its <geometry>; write one of {known}")
    if shapes[0].tag not in (*_SHAPES, "mesh", "plane", "empty"):
        uri = (shapes[0].findtext("uri") or "").strip()
        which = f"<{shapes[0].tag}>" + (f" {uri!r}" if uri else "")
        link.refuse(f"{label_of(collision)} is a {which}; replace it by one of {known}, or remove it")
    return shapes[0]


def _solid(name: str, link: Scope, collision: ET.Element, geometry: ET.Element) -> Solid:
    what = f"<{geometry.tag}> of {label_of(collision)}"
    measures: list[float] = []
    for measure, count in _SHAPES[geometry.tag]:
        values = numbers(geometry.findtext(measure), count)
        if values is None or not np.all(values >= FINEST):
            text = (geometry.findtext(measure) or "").strip()[:60]
            link.refuse(
                f"{what} has <{measure}> {text!r}; write {count} positive number(s) from {FINEST:g} to {FARTHEST:g}"
            )
        measures.extend(values)
    size = np.array(measures)
    if geometry.tag == "box":
        size = size / 2
    elif geometry.tag in ("cylinder", "capsule"):
        size = size * [1.0, 0.5]
    return Solid(name=name, shape=geometry.tag, size=size, pose=link.pose(collision))


def part_solid(name: str, pose: Array, vertices: Array) -> Solid:
    """Make a solid of a convex part of a mesh, which is a box if it can be."""
    box = as_box(vertices)
    if box is None:
        return Solid(name=name, shape="mesh", size=np.zeros(3), pose=pose, vertices=vertices)
    return Solid(name=name, shape="box", size=box[1], pose=pose @ box[0])


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
    x, y = pose[:2, 3]
    return [np.array([x - size[0] / 2, x + size[0] / 2, y - size[1] / 2, y + size[1] / 2])]
