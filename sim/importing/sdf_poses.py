"""Frames of an SDF file: where its models, links and collisions are, whatever their poses refer to.

Poses follow SDFormat 1.4 to 1.11: nested and included models, links, collisions, frames, `relative_to` and
`placement_frame`. Poses of a state block take precedence, as in Gazebo: those of models and links are in world
coordinates.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NoReturn

import numpy as np
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.mjcf.limits import FARTHEST

_LOST = 1e12  # worlds saved while running hold models that fell off the ground and are as far down [m]
_SHORTEST = 1e-9  # quaternion that still has a direction


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


class Frames:
    """Where the elements below a world, or a model that is the origin, are.

    Args:
        path: of the file, for messages.
    """

    def __init__(self, root: ET.Element, path: Path) -> None:
        self.root, self._path = root, path
        self._parents = {part: parent for parent in root.iter() for part in parent}
        self._poses: dict[ET.Element, Array | None] = {root: np.eye(4)}  # None: being found
        self._named: dict[ET.Element, dict[str, ET.Element]] = {}
        state = root.find("state")
        for change in ("insertions", "deletions"):
            if state is not None and len(state.findall(f"{change}/*")):
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

    def named(self, scope: ET.Element) -> dict[str, ET.Element]:
        """Return the models, links and frames declared in a world or model, whose names must differ."""
        if scope not in self._named:
            found = self._named[scope] = {}
            for part in (part for part in scope if part.tag in ("model", "link", "frame")):
                name = part.get("name")
                if not name or name in found:
                    self.refuse(part, 'it needs a name of its own; write name="..."')
                found[name] = part
        return self._named[scope]

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
        parent, state = self._parents[element], self._state(element)
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

    def _state(self, element: ET.Element) -> ET.Element | None:
        """Find what a state block says of a model or link."""
        if element is self.root:
            return element.find("state")
        around = self._state(self._parents[element]) if element.tag in ("model", "link") else None
        if around is None:
            return None
        names = (element.get("name", ""), self.label(element))
        state = next((one for one in around.findall(element.tag) if one.get("name") in names), None)
        scale = None if state is None else state.findtext("scale")
        if scale is not None and (numbers(scale, 3) is None or np.any(numbers(scale, 3) != 1.0)):
            self.refuse(element, f"<state> scales it by {scale.strip()!r}; scale its sizes and write 1 1 1")
        return state

    def _matrix(self, pose: ET.Element, element: ET.Element) -> Array:
        """Read the pose element of another element, (4, 4)."""
        quaternion = pose.get("rotation_format") == "quat_xyzw"
        text = (pose.text or "").strip() or ("0 0 0 0 0 0 1" if quaternion else "0 0 0 0 0 0")
        values = numbers(text, 7 if quaternion else 6, _LOST)
        far = values is None or np.any(np.abs(values[3:]) > FARTHEST)
        if values is None or far or (quaternion and np.linalg.norm(values[3:]) < _SHORTEST):
            must = f"write x y z and roll pitch yaw, none beyond {FARTHEST:g}"
            self.refuse(element, f"its <pose> is {text[:60]!r}; {must}")
        return transform(values, degrees=not quaternion and is_true(pose.get("degrees")))
