"""The obstacles of a Gazebo world: collision shapes of its models, where the file has them.

Models that move in Gazebo are static obstacles where they start. Poses follow SDFormat 1.4 to 1.11: nested and included
models, links, collisions, frames, `relative_to` and `placement_frame`. Poses of a state block take precedence, as in
Gazebo: those of models and links are in world coordinates.
"""

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import NoReturn

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.importing.meshes import split
from sim.importing.sdf_files import read_world
from sim.importing.solids import LOW, Solid, World, is_low, part_solid, transform
from sim.mjcf.convex import Budget
from sim.mjcf.library import FARTHEST, FINEST, MOST_NESTED, listed, refused

_SHAPES = {  # measures of a geometry, and how many numbers each has
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
}
_HALVES = {"box": 0.5, "cylinder": [1.0, 0.5], "capsule": [1.0, 0.5]}  # MuJoCo's sizes in units of these
_SHORTEST = 1e-9  # quaternion that still has a direction
_LEVEL = 1e-6  # how far a ground plane may be off [m] and [1]
_NOTES = {
    "moving": "not static in Gazebo, here obstacles that stay where they start (or leave them out by name): ",
    "actors": "actors have no collisions and are left out: ",
    "low": LOW,
    "rough": "meshes too intricate to split, whose hulls stick out by up to {:.2g} m: ",
}


def read_sdf(path: Path, folders: Sequence[Path], without: Sequence[str]) -> World:
    """Read the obstacles of an SDF file, with folders to search and names of models to leave out."""
    with refused(f"{path}: poses refer to each other in too long a chain; shorten it", "", RecursionError, most=0):
        return _Reader(read_world(path, folders), path, frozenset(without)).world()


def is_true(text: str | None) -> bool:
    """SDF's booleans."""
    return (text or "").strip().lower() in ("1", "true")


def numbers(text: str | None, count: int) -> Array | None:
    """Read so many numbers, none beyond `FARTHEST`, or None."""
    with suppress(ValueError):
        values = np.array((text or "").split(), dtype=float)
        if len(values) == count and "_" not in (text or "") and np.all(np.abs(values) <= FARTHEST):
            return values  # Python reads 4_0 as 40, and nobody else does
    return None


class Frames:
    """Where the elements below a world, or a model that is the origin, are; the path of the file is for messages."""

    def __init__(self, root: ET.Element, path: Path) -> None:
        self.root, self._path = root, path
        self._parents = {part: parent for parent in root.iter() for part in parent}
        self._poses: dict[ET.Element, Array | None] = {root: np.eye(4)}  # None: being found

        self.named = cache(self._named)
        self._state = cache(self._state_of)
        self._states = cache(self._states_in)

        for change in ("insertions", "deletions"):
            if root.find(f"state[1]/{change}/*") is not None:
                self.refuse(root, f"<state> has <{change}>; save the world anew or remove them")

    def refuse(self, element: ET.Element, reason: str) -> NoReturn:
        """Raise the SceneError of an element."""
        what = "" if element is self.root else f'{element.tag} "{self.label(element)}": '
        raise SceneError(f"{self._path}: " + " ".join(f"{what}{reason}".split()))

    def label(self, element: ET.Element) -> str:
        """Join the names from the root down to an element by ::."""
        if element is self.root:
            return ""
        return "::".join(filter(None, (self.label(self._parents[element]), element.get("name", ""))))

    def static(self, model: ET.Element) -> bool:
        """Whether a model, or one that it is in, is said to stay."""
        return model is not self.root and (is_true(model.findtext("static")) or self.static(self._parents[model]))

    def _named(self, scope: ET.Element) -> dict[str, ET.Element]:
        """Return the models, links and frames declared in a world or model, whose names must differ."""
        found: dict[str, ET.Element] = {}
        for part in (part for part in scope if part.tag in ("model", "link", "frame")):
            name = part.get("name")
            if not name or name in found:
                self.refuse(part, 'it needs a name of its own; write name="..."')
            found[name] = part
        return found

    def pose(self, element: ET.Element) -> Array:
        """Return where an element is in the world, (4, 4)."""
        if element not in self._poses:
            self._poses[element] = None
            self._poses[element] = self._placed(element)
        known = self._poses[element]
        if known is None:
            self.refuse(element, "its pose is relative to itself; fix its relative_to")
        return known

    def resolve(self, name: str, scope: ET.Element) -> Array:
        """Return the frame of a name used in a world, model or link, (4, 4)."""
        scope = self._parents[scope] if scope.tag == "link" else scope
        if name in ("__model__", "world"):
            return self.pose(scope) if name == "__model__" else np.eye(4)
        first, _, rest = name.partition("::")
        part = self.named(scope).get(first)
        if part is None or (rest and part.tag != "model"):
            known = ", ".join(self.named(scope)) or "none"
            self.refuse(scope, f'a pose in it is relative to "{name}", which is not declared there ({known}); fix it')
        return self.resolve(rest, part) if rest else self.pose(part)

    def _placed(self, element: ET.Element) -> Array:
        """Work out a pose, in which the state block has the last word."""
        parent = self._parents[element]
        state = self._state(element)
        known = None if state is None else state.find("pose")
        if known is not None:
            return self._matrix(known, element)
        pose = element.find("pose")
        pose = ET.Element("pose") if pose is None else pose
        if pose.get("frame"):
            self.refuse(element, f'its pose is in frame="{pose.get("frame")}"; write relative_to')
        base = pose.get("relative_to") or element.get("attached_to")
        placed = (self.resolve(base, parent) if base else self.pose(parent)) @ self._matrix(pose, element)
        frame = element.get("placement_frame") if element.tag == "model" else None
        return placed @ np.linalg.inv(Frames(element, self._path).resolve(frame, element)) if frame else placed

    def _state_of(self, element: ET.Element) -> ET.Element | None:
        """Find what a state block says of a model or link."""
        if element is self.root:
            return element.find("state")
        around = self._state(self._parents[element]) if element.tag in ("model", "link") else None
        if around is None:
            return None
        states = self._states(around)
        names = (element.get("name", ""), self.label(element))
        state = next((states[element.tag, name] for name in names if (element.tag, name) in states), None)
        scale = None if state is None else state.findtext("scale")
        if scale is not None and (numbers(scale, 3) is None or np.any(numbers(scale, 3) != 1.0)):
            self.refuse(element, f"<state> scales it by {scale.strip()!r}; scale its sizes and write 1 1 1")
        return state

    def _states_in(self, around: ET.Element) -> dict[tuple[str, str], ET.Element]:
        """Return what a state block says, by tag and name; the first of several counts."""
        return {(one.tag, one.get("name", "")): one for one in reversed(around)}

    def _matrix(self, pose: ET.Element, element: ET.Element) -> Array:
        quaternion = pose.get("rotation_format") == "quat_xyzw"
        text = (pose.text or "").strip() or ("0 0 0 0 0 0 1" if quaternion else "0 0 0 0 0 0")
        values = numbers(text, 7 if quaternion else 6)
        if values is None or (quaternion and np.linalg.norm(values[3:]) < _SHORTEST):
            must = f"write x y z and roll pitch yaw, none beyond {FARTHEST:g}, or leave the model out by name"
            self.refuse(element, f"its <pose> is {text[:60]!r}; {must}")
        return transform(values, degrees=not quaternion and is_true(pose.get("degrees")))


class _Reader(Frames):
    def __init__(self, root: ET.Element, path: Path, without: frozenset[str]) -> None:
        super().__init__(root, path)
        self._without, self._split = without, cache(partial(split, budget=Budget()))
        self._noted: dict[str, dict[str, float]] = defaultdict(dict)  # names by note

    def world(self) -> World:
        solids: list[Solid] = []
        grounds: list[Array] = []
        for model in self._models(self.root):
            found = [(one, self._geometry(one)) for one in model.iterfind("link/collision")]
            several = sum(geometry.tag not in ("plane", "empty") for _, geometry in found)
            if several and not self.static(model):
                self._noted["moving"][self.label(model).partition("::")[0]] = 0.0
            for collision, geometry in found:
                if geometry.tag == "plane":
                    grounds += self._ground(collision, geometry)
                elif geometry.tag != "empty":
                    name = " ".join(self.label(model if several == 1 else collision).split())
                    solids += self._solids(name, collision, geometry)
        unknown = self._without.difference(self._noted["left"])
        if unknown:
            names = listed([part.get("name", "") for part in self.root.findall("model")])
            self.refuse(self.root, f"there is no model {listed(sorted(unknown))} to leave out; models are {names}")
        notes = tuple(
            words.format(max(self._noted[note].values())) + listed([*self._noted[note]])
            for note, words in _NOTES.items()
            if self._noted[note]
        )
        return World(solids=tuple(solids), ground=grounds[0] if grounds else None, notes=notes)

    def _models(self, scope: ET.Element, depth: int = 0) -> Iterator[ET.Element]:
        """Yield the models of a world or model, nested ones after the one they are in."""
        if depth > MOST_NESTED:
            self.refuse(scope, f"models are nested deeper than {MOST_NESTED}; flatten them")
        self.named(scope)
        for part in scope:
            tag = part.tag.rpartition("}")[2]
            name = part.get("name", "")

            if tag in ("include", "population"):
                self.refuse(part, f"<{tag}> cannot be taken over; write its models out, or remove it")
            if tag == "actor":
                self._noted["actors"][name] = 0.0
            if tag not in ("model", "link", "actor", "plugin") and part.find(".//collision") is not None:
                self.refuse(part, f"<{tag}> holds models, which is not SDFormat; expand the file, or remove it")
            if tag == "model":
                left = self._without.intersection((self.label(part), name))
                self._noted["left"].update(dict.fromkeys(left, 0.0))
                if not left:
                    yield part
                    yield from self._models(part, depth + 1)

    def _geometry(self, collision: ET.Element) -> ET.Element:
        known = ", ".join((*_SHAPES, "mesh"))
        shapes = collision.findall("geometry/*")
        if len(shapes) != 1:
            self.refuse(collision, f"its <geometry> has {len(shapes)} shapes; write one of {known}")
        if shapes[0].tag not in (*_SHAPES, "mesh", "plane", "empty"):
            uri = (shapes[0].findtext("uri") or "").strip()
            which = f"<{shapes[0].tag}>" + (f" {uri!r}" if uri else "")
            self.refuse(collision, f"it is a {which}; replace it by one of {known}, or remove it")
        return shapes[0]

    def _solids(self, name: str, collision: ET.Element, shape: ET.Element) -> Iterator[Solid]:
        """Yield the solids of a shape that stand in the way of a robot."""
        pose = self.pose(collision)
        if shape.tag == "mesh":
            scale = self._measure(collision, shape, "scale", 3) if shape.findtext("scale") else np.ones(3)
            if shape.find("submesh") is not None:
                self.refuse(collision, "it is a <submesh>; write a file of its own for it")
            path = Path(shape.findtext("uri") or "")
            hull = shape.get("optimization") == "convex_hull"
            parts, rough = self._split(path, tuple(scale.tolist()), hull=hull)
            if rough:
                self._noted["rough"][name] = rough
            solids = [part_solid(name, pose, corners) for corners in parts]
        else:
            size = np.concatenate([self._measure(collision, shape, *one) for one in _SHAPES[shape.tag]])
            solids = [Solid(name, shape.tag, size * _HALVES.get(shape.tag, 1.0), pose)]
        for solid in solids:
            if is_low(solid):
                self._noted["low"][name] = 0.0
            else:
                yield solid

    def _measure(self, collision: ET.Element, shape: ET.Element, measure: str, count: int) -> Array:
        """Read a measure of a shape, which is positive; but for a scale, which may mirror."""
        values = numbers(shape.findtext(measure), count)
        if values is None or not np.all((np.abs(values) if measure == "scale" else values) >= FINEST):
            text = (shape.findtext(measure) or "").strip()[:60]
            must = f"{count} {'positive ' * (measure != 'scale')}number(s) from {FINEST:g} to {FARTHEST:g}"
            self.refuse(collision, f"its <{shape.tag}> has <{measure}> {text!r}; write {must}")
        return values

    def _ground(self, collision: ET.Element, plane: ET.Element) -> list[Array]:
        """Return the rectangle of a ground plane, if it has one; other planes are refused."""
        normal = numbers(plane.findtext("normal") or "0 0 1", 3)
        pose = self.pose(collision)

        if normal is None or np.linalg.norm(normal) < _LEVEL:
            self.refuse(collision, "its <plane> has no <normal>; write 0 0 1")
        up = pose[:3, :3] @ normal / np.linalg.norm(normal)
        if up[2] < 1 - _LEVEL or abs(pose[2, 3]) > _LEVEL:
            self.refuse(collision, "it is a plane other than the ground z = 0; write a box, or remove it")
        size = numbers(plane.findtext("size"), 2)
        if size is None or not np.all(size > 0):
            return []
        x, y = pose[:2, 3]
        a, b = size / 2

        return [np.array([x - a, x + a, y - b, y + b])]
