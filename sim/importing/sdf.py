"""What stands still in a Gazebo world: the collision shapes of its static models, placed in the world.

Poses follow SDFormat 1.4 to 1.11: nested models, links, collisions, frames and `relative_to`. A state block
has the last word, as in Gazebo: its poses of models and links are in world coordinates.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from defusedxml.common import DTDForbidden
from defusedxml.ElementTree import fromstring

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.limits import FARTHEST, FINEST, content_of
from sim.importing.sdf_poses import Scope, label_of, numbers

_SHAPES = {
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
}  # geometry -> its measures and how many numbers each has
_MOVING = ("actor", "population")
_LEVEL = 1e-6  # how far a ground plane may be off [m] and [1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """One collision shape, fixed in the world."""

    name: str  # of its model, with link and collision where the model has several
    shape: str  # a type of MuJoCo's geoms
    size: Array  # MuJoCo's sizes of that type [m]
    pose: Array  # (4, 4) in the world


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """What an SDF file holds for a robot that drives on the ground."""

    solids: tuple[Solid, ...]  # in file order
    ground: Array | None  # (4,) x0, x1, y0, y1 of the first ground plane that has a size [m]


def read_sdf(path: Path, progress: Callable[[int, int], object] | None = None) -> World:
    """The static obstacles of the one world in an SDF file.

    Args:
        progress: told how many of how many collision shapes are done, now and then.

    Raises:
        SceneError: unreadable, malformed, with a document type, or with a part that cannot be taken over.
    """
    try:
        return _read(Scope.of_world(_world(path), path), progress)
    except RecursionError:
        raise SceneError(f"{path}: poses refer to each other in too long a chain; shorten it") from None


def _read(scope: Scope, progress: Callable[[int, int], object] | None) -> World:
    done, total = 0, sum(1 for _ in scope.element.iter("collision"))
    solids: list[Solid] = []
    grounds: list[Array] = []
    for model in _models(scope):
        found = list(_collisions(model))
        shapes = [part for part in found if _geometry(*part).tag not in ("plane", "empty")]
        for link, collision in found:
            geometry = _geometry(link, collision)
            if geometry.tag == "plane":
                grounds += _ground(link, collision, geometry)
            elif geometry.tag != "empty":
                name = model.label if len(shapes) == 1 else f"{link.label}::{collision.get('name')}"
                solids.append(_solid(" ".join(name.split()), link, collision, geometry))
        done += len(found)
        if progress is not None:
            progress(done, total)
    return World(solids=tuple(solids), ground=grounds[0] if grounds else None)


def _world(path: Path) -> ET.Element:
    """The world element, after a look at everything that could make parsing itself dangerous."""
    data = content_of(path, "an SDF world file")
    try:
        root = fromstring(data, forbid_dtd=True)
    except DTDForbidden as error:
        raise SceneError(f"{path}: <!DOCTYPE {error.name}> could declare entities; remove that declaration") from None
    except (ET.ParseError, ValueError, LookupError) as error:
        raise SceneError(f"{path}: not XML: {error}; mend it there") from None
    worlds = root.findall("world") if root.tag == "sdf" else []
    if len(worlds) != 1:
        scene = "this is a scene already: give it to pirrht run" if root.tag == "mujoco" else "write one <sdf><world>"
        raise SceneError(f"{path}: {len(worlds)} elements <world> in <{root.tag}>; {scene}")
    world: ET.Element = worlds[0]
    return world


def _models(scope: Scope) -> Iterator[Scope]:
    """The static models of a world or model, nested ones after the one they are in."""
    for part in scope.element:
        what = label_of(part)
        tag = part.tag.rpartition("}")[2] if isinstance(part.tag, str) else ""
        if tag == "include":
            uri = (part.findtext("uri") or "").strip()
            scope.refuse(f"<include> {uri!r} lies outside the file; paste its model, or remove it")
        if tag in _MOVING:
            scope.refuse(f"{what} moves or multiplies; remove it")
        if tag != "model":
            continue
        model = scope.child(part)
        if model.static:
            yield model
        elif part.find("link/collision") is not None:
            scope.refuse(f"{what} is not static; write <static>1</static> into it, or remove it")
        yield from _models(model)


def _collisions(model: Scope) -> Iterator[tuple[Scope, ET.Element]]:
    """The collisions of a model's own links, each with its link."""
    for element in model.element.findall("link"):
        link = model.link(element)
        for collision in element.findall("collision"):
            yield link, collision


def _geometry(link: Scope, collision: ET.Element) -> ET.Element:
    known = ", ".join(_SHAPES)
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1:
        link.refuse(f"{label_of(collision)} has {len(shapes)} shapes in its <geometry>; write one of {known}")
    if shapes[0].tag not in (*_SHAPES, "plane", "empty"):
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
    pose = link.pose(collision)
    if np.any(np.abs(pose) > FARTHEST):
        link.refuse(f"{label_of(collision)} lies farther out than {FARTHEST:g} m; mend its poses")
    return Solid(name=name, shape=geometry.tag, size=size, pose=pose)


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
