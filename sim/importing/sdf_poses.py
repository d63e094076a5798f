"""Frames of an SDF file: where its models, links and collisions are, whatever their poses refer to."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.mjcf.limits import FARTHEST, MOST_NESTED

_NAMED = ("model", "link", "frame")
_LOST = 1e12  # worlds saved while running hold models that fell off the ground and are as far down [m]
_SHORTEST = 1e-9  # quaternion that still has a direction


def label_of(element: ET.Element) -> str:
    """How messages call an element."""
    return f'{element.tag} "{element.get("name", "")}"'


def is_true(text: str | None) -> bool:
    """SDF's booleans."""
    return (text or "").strip().lower() in ("1", "true")


def numbers(text: str | None, count: int, most: float = FARTHEST) -> Array | None:
    """Read so many numbers, none of a greater size than the most, or None."""
    words = (text or "").split()
    try:
        values = np.array(words, dtype=float)
    except ValueError:
        return None
    if len(values) != count or any("_" in word for word in words):  # Python reads 4_0 as 40, and nobody else does
        return None
    return values if np.all(np.abs(values) <= most) else None


def transform(values: Array, *, degrees: bool = False) -> Array:
    """The matrix (4, 4) of x, y, z [m] and roll, pitch, yaw (6,) about fixed axes, or a quaternion x, y, z, w (7,)."""
    by_angles = len(values) == 6
    turn = Rotation.from_euler("xyz", values[3:], degrees=degrees) if by_angles else Rotation.from_quat(values[3:])
    matrix = np.eye(4)
    matrix[:3, 3], matrix[:3, :3] = values[:3], turn.as_matrix()
    return matrix


@dataclass(slots=True, eq=False)
class Scope:
    """A world, a model or a link with the frames that can be named in it."""

    element: ET.Element
    path: Path  # of the file, for messages
    own: Array  # (4, 4) its frame in the world
    label: str = ""  # names from the world down, joined by ::
    static: bool = False
    state: ET.Element | None = None  # what a <state> block says of it
    parent: Scope | None = None
    depth: int = 0
    _parts: dict[str, ET.Element] = field(default_factory=dict)
    _known: dict[str, Array | None] = field(default_factory=dict)  # None: being resolved

    def __post_init__(self) -> None:
        """Register the frames declared inside, whose names must differ."""
        if self.depth > MOST_NESTED:
            self.refuse(f"models are nested deeper than {MOST_NESTED}; flatten them")
        for part in (part for part in self.element if part.tag in _NAMED):
            name = part.get("name")
            if not name or name in self._parts:
                self.refuse(f'{label_of(part)} needs a name of its own; write name="..."')
            self._parts[name] = part

    @classmethod
    def of_world(cls, world: ET.Element, path: Path) -> Scope:
        """The outermost scope."""
        state = world.find("state")
        scope = cls(element=world, path=path, own=np.eye(4), state=state)
        for change in ("insertions", "deletions"):
            if state is not None and len(state.findall(f"{change}/*")):
                scope.refuse(f"<state> has <{change}>; save the world anew or remove them")
        return scope

    def refuse(self, reason: str) -> NoReturn:
        """Raise the SceneError of something in this scope."""
        where = f'in "{self.label}" ' if self.label else ""
        raise SceneError(f"{self.path}: " + " ".join(f"{where}{reason}".split()))

    def child(self, model: ET.Element) -> Scope:
        """The scope of a model declared here."""
        return self._inner(model, self.static or is_true(model.findtext("static")))

    def link(self, link: ET.Element) -> Scope:
        """The scope of a link declared here; names in it are looked up in its model."""
        return self._inner(link, self.static)

    def pose(self, element: ET.Element) -> Array:
        """Where an element declared here is in the world, (4, 4)."""
        pose, base = element.find("pose"), ""
        raw = np.eye(4) if pose is None else self._transform(pose, label_of(element))
        if pose is not None:
            base = pose.get("relative_to", "")
            if pose.get("frame"):
                self.refuse(f'{label_of(element)} has a pose in frame="{pose.get("frame")}"; write relative_to')
        base = base or element.get("attached_to", "")
        placed: Array = (self.resolve(base) if base else self.own) @ raw
        frame = element.get("placement_frame") if element.tag == "model" else None
        if frame:  # the pose is that of a frame inside
            inside = self._inner(element, self.static, np.eye(4))
            inside.state = None  # it speaks of the world
            placed = placed @ np.linalg.inv(inside.resolve(frame))
        return placed

    def resolve(self, name: str) -> Array:
        """The frame of that name in the world, (4, 4)."""
        if self.element.tag == "link" and self.parent is not None:
            return self.parent.resolve(name)
        if name in ("__model__", "world"):
            return self.own if name == "__model__" else np.eye(4)
        first, _, rest = name.partition("::")
        part = self._parts.get(first)
        if part is None or (rest and part.tag != "model"):
            known = ", ".join(self._parts) or "none"
            self.refuse(f'a pose is relative to "{name}", which is not declared there ({known}); fix it')
        return self.child(part).resolve(rest) if rest else self._place(part)

    def _inner(self, part: ET.Element, static: bool, own: Array | None = None) -> Scope:
        return Scope(
            element=part,
            path=self.path,
            own=self._place(part) if own is None else own,
            label="::".join(filter(None, (self.label, part.get("name", "")))),
            static=static,
            state=self._state_of(part),
            parent=self,
            depth=self.depth + 1,
        )

    def _place(self, part: ET.Element) -> Array:
        """A model, link or frame declared here in the world; the state block has the last word."""
        name = part.get("name", "")
        if name not in self._known:
            self._known[name] = None
            state = self._state_of(part)
            pose = None if state is None else state.find("pose")
            self._known[name] = self.pose(part) if pose is None else self._transform(pose, label_of(part))
        known = self._known[name]
        if known is None:
            self.refuse(f"the pose of {label_of(part)} is relative to itself; fix its relative_to")
        return known

    def _state_of(self, part: ET.Element) -> ET.Element | None:
        if self.state is None or part.tag == "frame":
            return None
        name = part.get("name", "")
        names = (name, f"{self.label}::{name}")
        state = next((s for s in self.state.findall(part.tag) if s.get("name") in names), None)
        scale = None if state is None else state.findtext("scale")
        if scale is not None and not np.array_equal(numbers(scale, 3), [1, 1, 1]):  # type: ignore[arg-type]
            self.refuse(f"<state> scales {label_of(part)} by {scale.strip()!r}; scale its sizes and write 1 1 1")
        return state

    def _transform(self, pose: ET.Element, what: str) -> Array:
        """The matrix of a pose element, (4, 4)."""
        quaternion = pose.get("rotation_format") == "quat_xyzw"
        text = (pose.text or "").strip() or ("0 0 0 0 0 0 1" if quaternion else "0 0 0 0 0 0")
        values = numbers(text, 7 if quaternion else 6, _LOST)
        turn = None if values is None else numbers(" ".join(text.split()[3:]), len(values) - 3)
        if values is None or turn is None or (quaternion and np.linalg.norm(turn) < _SHORTEST):
            self.refuse(f"{what} has <pose> {text[:60]!r}; write x y z and roll pitch yaw, none beyond {FARTHEST:g}")
        return transform(values, degrees=not quaternion and is_true(pose.get("degrees")))
