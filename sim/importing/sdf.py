"""The obstacles of a Gazebo world: collision shapes of its models, where the file has them.

Models that move in Gazebo are static obstacles where they start.
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
from sim.importing.meshes import split
from sim.importing.sdf_files import read_world
from sim.importing.sdf_poses import Frames, is_true, numbers
from sim.importing.solids import Solid, World, part_solid
from sim.mjcf.limits import FARTHEST, FINEST, MOST_NESTED
from sim.mjcf.refusals import listed

_SHAPES = {  # measures of a geometry, and how many numbers each has
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
}
_HALVES = {"box": 0.5, "cylinder": [1.0, 0.5], "capsule": [1.0, 0.5]}  # MuJoCo's sizes in units of these
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
        return _Reader(Frames(read_world(path, folders), path), frozenset(without)).world()
    except RecursionError:
        raise SceneError(f"{path}: poses refer to each other in too long a chain; shorten it") from None


class _Reader:
    def __init__(self, frames: Frames, without: frozenset[str]) -> None:
        self._frames, self._without, self._split = frames, without, cache(split)
        self._noted: dict[str, dict[str, float]] = defaultdict(dict)  # names by note

    def world(self) -> World:
        """Take over all models."""
        solids: list[Solid] = []
        grounds: list[Array] = []
        label, root = self._frames.label, self._frames.root
        for model in self._models(root):
            found = [(one, self._geometry(one)) for one in model.iterfind("link/collision")]
            several = sum(geometry.tag not in ("plane", "empty") for _, geometry in found)
            if several and not self._frames.static(model):
                self._noted["moving"][label(model).partition("::")[0]] = 0.0
            for collision, geometry in found:
                if geometry.tag == "plane":
                    grounds += self._ground(collision, geometry)
                elif geometry.tag != "empty":
                    name = " ".join(label(model if several == 1 else collision).split())
                    solids += self._solids(name, collision, geometry)
        unknown = self._without.difference(self._noted["left"])
        if unknown:
            names = listed([part.get("name", "") for part in root.findall("model")])
            self._frames.refuse(root, f"there is no model {listed(sorted(unknown))} to leave out; models are {names}")
        notes = tuple(
            words.format(max(self._noted[note].values())) + listed([*self._noted[note]])
            for note, words in _NOTES.items()
            if self._noted[note]
        )
        return World(solids=tuple(solids), ground=grounds[0] if grounds else None, notes=notes)

    def _models(self, scope: ET.Element, depth: int = 0) -> Iterator[ET.Element]:
        """Yield the models of a world or model, nested ones after the one they are in."""
        if depth > MOST_NESTED:
            self._frames.refuse(scope, f"models are nested deeper than {MOST_NESTED}; flatten them")
        for part in self._frames.named(scope).values():
            if part.tag != "frame":
                self._frames.pose(part)
        for part in scope:
            tag, name = part.tag.rpartition("}")[2], part.get("name", "")
            if tag in ("include", "population"):
                self._frames.refuse(part, f"<{tag}> cannot be taken over; write its models out, or remove it")
            if tag == "actor":
                self._noted["actors"][name] = 0.0
            if tag not in ("model", "link", "actor", "plugin") and part.find(".//collision") is not None:
                self._frames.refuse(part, f"<{tag}> holds models, which is not SDFormat; expand the file, or remove it")
            if tag == "model":
                left = self._without.intersection((self._frames.label(part), name))
                self._noted["left"].update(dict.fromkeys(left, 0.0))
                if not left:
                    yield part
                    yield from self._models(part, depth + 1)

    def _geometry(self, collision: ET.Element) -> ET.Element:
        known = ", ".join((*_SHAPES, "mesh"))
        shapes = collision.findall("geometry/*")
        if len(shapes) != 1:
            self._frames.refuse(collision, f"its <geometry> has {len(shapes)} shapes; write one of {known}")
        if shapes[0].tag not in (*_SHAPES, "mesh", "plane", "empty"):
            uri = (shapes[0].findtext("uri") or "").strip()
            which = f"<{shapes[0].tag}>" + (f" {uri!r}" if uri else "")
            self._frames.refuse(collision, f"it is a {which}; replace it by one of {known}, or remove it")
        return shapes[0]

    def _solids(self, name: str, collision: ET.Element, shape: ET.Element) -> Iterator[Solid]:
        """Yield the solids of a shape that stand in the way of a robot."""
        pose = self._frames.pose(collision)
        if shape.tag == "mesh":
            scale = self._measure(collision, shape, "scale", 3) if shape.findtext("scale") else np.ones(3)
            submesh, centred = shape.findtext("submesh/name") or "", is_true(shape.findtext("submesh/center"))
            path, hull = Path(shape.findtext("uri") or ""), shape.get("optimization") == "convex_hull"
            parts, rough = self._split(path, tuple(scale.tolist()), submesh.strip(), centred=centred, hull=hull)
            if rough:
                self._noted["rough"][name] = rough
            solids = [part_solid(name, pose, corners) for corners in parts]
        else:
            size = np.concatenate([self._measure(collision, shape, *one) for one in _SHAPES[shape.tag]])
            solids = [Solid(name=name, shape=shape.tag, size=size * _HALVES.get(shape.tag, 1.0), pose=pose)]
        for solid in solids:
            if np.any(np.abs(solid.pose) > FARTHEST):
                self._noted["lost"][name] = 0.0
            elif 0 < solid.top <= LOWEST:
                self._noted["low"][name] = 0.0
            else:
                yield solid

    def _measure(self, collision: ET.Element, shape: ET.Element, measure: str, count: int) -> Array:
        """Read a measure of a shape, which is positive; but for a scale, which may mirror."""
        values = numbers(shape.findtext(measure), count)
        if values is None or not np.all((np.abs(values) if measure == "scale" else values) >= FINEST):
            text = (shape.findtext(measure) or "").strip()[:60]
            must = f"{count} {'positive ' * (measure != 'scale')}number(s) from {FINEST:g} to {FARTHEST:g}"
            self._frames.refuse(collision, f"its <{shape.tag}> has <{measure}> {text!r}; write {must}")
        return values

    def _ground(self, collision: ET.Element, plane: ET.Element) -> list[Array]:
        """Return the rectangle of a ground plane, if it has one; other planes are refused."""
        normal, pose = numbers(plane.findtext("normal") or "0 0 1", 3), self._frames.pose(collision)
        if normal is None or np.linalg.norm(normal) < _LEVEL:
            self._frames.refuse(collision, "its <plane> has no <normal>; write 0 0 1")
        up = pose[:3, :3] @ normal / np.linalg.norm(normal)
        if up[2] < 1 - _LEVEL or abs(pose[2, 3]) > _LEVEL:
            self._frames.refuse(collision, "it is a plane other than the ground z = 0; write a box, or remove it")
        size = numbers(plane.findtext("size"), 2)
        if size is None or not np.all(size > 0):
            return []
        (x, y), (a, b) = pose[:2, 3], size / 2
        return [np.array([x - a, x + a, y - b, y + b])]
