"""Ways of paths in space, in words: what they go through, over, under or past.

A loop of solids that leaves an opening is gone through or not: a path goes through as often as it pierces the fan of
triangles over the loop's polygon, forwards less backwards, which its class decides. Any other loop, and one that is not
gone through, is passed on a side, as seen along the straight way from the start to the goal.
"""

from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.polyline import even
from pirrht.planner.references import Reference
from pirrht.topology.nerve import WORKSPACE, Loop
from sim.drawing.colors import FEW, LEFT, RIGHT, SIDES, numbered, telling, title
from sim.text import shared

HEIGHTS = ("over", "under")
POINTS = 200  # of a path that are examined
STEP = 1e-4  # by which a point is moved to see where a solid is [m]


def ways_in(space: FreeSpace | None, references: Sequence[Reference], names: Sequence[str]) -> list[str]:
    """Say of each of several paths what it goes through, over, under or past; of the plane nothing.

    No two classes are called alike. Those of M loops are named, by `names` (M,), that set a path apart from the others,
    or else the nearest solid.
    """
    if space is None or space.scene.dimension != 3:
        return []
    called = numbered(names)
    rivals = [reference.winding for reference in references]
    texts = [_text(one, telling(one.winding, rivals), space, called) for one in references]
    owners = dict[str, set[str]]()
    for text, one in zip(texts, references, strict=True):
        owners.setdefault(text, set()).add(one.id)
    pairs = zip(texts, references, strict=True)
    return [text if len(owners[text]) == 1 else f"{text} ({title(one.id)})" for text, one in pairs]


def _text(reference: Reference, chosen: Sequence[int], space: FreeSpace, called: Sequence[str]) -> str:
    groups: dict[str, list[str]] = {}
    for k in chosen:
        how, what = _way(reference, k, space, called[k])
        groups.setdefault(how, []).append(what)
    solids = space.scene.obstacles
    if not groups and solids:
        nearest, side = _side(reference, range(len(solids)), space)
        groups[side] = [solids[nearest].name]
    if len(called) == 2 and groups.keys() == {LEFT, RIGHT}:  # of many it need not lead through the gap
        return f"between {groups[LEFT][0]} and {groups[RIGHT][0]}"
    return ", ".join(f"{how} {_joined([*dict.fromkeys(what)])}" for how, what in groups.items()) or "the only way"


def _joined(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def label_places(space: FreeSpace) -> Array:
    """Return where labels of M obstacles go, (M, d) [m]: to markers, in space to the first solid of each loop."""
    markers = space.homology.markers
    if space.scene.dimension == 2:
        return markers
    parts = zip(space.obstacles, markers, strict=True)
    solids = space.scene.obstacles
    found = [solids[part.members[0]].position if part.members else marker for part, marker in parts]
    return np.clip(np.reshape(found, (-1, 3)), space.scene.lower, space.scene.upper)


def through(reference: Reference, k: int, space: FreeSpace) -> int:
    """Count how often a path pierces the fan over the polygon of loop k, forwards less backwards."""
    loop, ends = space.homology.static.loops[k], (reference.trajectory.points[0], space.homology.static.goal)  # type: ignore[attr-defined]  # classes in space are about loops
    return round(float(reference.signature[k]) - 1.0 - (_spanned(loop, ends[1]) - _spanned(loop, ends[0])))


def _spanned(loop: Array, place: Array) -> float:
    """Return the signed share of all directions from a place (3,) [m] in which the fan over a polygon (k, 3) is."""
    a = loop - place
    b = np.roll(a, -1, axis=0)
    c = loop.mean(axis=0) - place
    la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
    below = la * lb * lc + np.sum(a * b, axis=1) * lc + b @ c * la + a @ c * lb
    return float(np.arctan2(np.cross(a, b) @ c, below).sum() / (2.0 * np.pi))


def _way(reference: Reference, k: int, space: FreeSpace, name: str) -> tuple[str, str]:
    """Return how a path passes loop k, called by a name, and what of it: an opening, the loop or a solid."""
    part = space.obstacles[k]
    assert isinstance(part, Loop)
    often = abs(through(reference, k, space))
    around = [one for one in part.names if one != WORKSPACE]
    named = len(around) == 1 or bool(shared(around))
    if often and len(around) > 1:
        around += ["the border"] * (len(around) < len(part.names))
        around = around if len(around) <= FEW else [*around[:FEW], f"{len(around) - FEW} more"]
        how = "through the opening" if often == 1 else f"{often} times through the opening"
        return how, f"in {name}" if named else f"between {_joined(around)}"
    if len(part.members) == 1 and len(part.names) > 1:  # the fan is between it and the border, on one side of it
        fan = part.corners.mean(axis=0) - space.scene.obstacles[part.members[0]].position
        side = _called(fan if often else -fan, reference.trajectory.points)
        if side in (*SIDES, *HEIGHTS):
            return side, name
    solid, side = _side(reference, part.members, space)
    return side, name if named else space.scene.obstacles[solid].name


def _side(reference: Reference, members: Sequence[int], space: FreeSpace) -> tuple[int, str]:
    """Return the solid that a path passes closely, and on which side of the straight way it is where it is abreast."""
    line = even(reference.trajectory.points, POINTS)
    gaps = np.array([space.collision.obstacle_distance(i, line) for i in members])
    row, _ = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    solid = members[int(row)]
    near = line[gaps[row] <= gaps[row].min() + space.scene.robot_radius]
    moved = near[:, None] + STEP * np.vstack([np.eye(3), -np.eye(3)])
    gap = space.collision.obstacle_distance(solid, moved.reshape(-1, 3)).reshape(-1, 6)
    away = gap[:, :3] - gap[:, 3:]

    return solid, _called(away, line)


def _called(directions: Array, line: Array) -> str:
    """Return what the side is called that the most sideward of directions (..., 3) show, as seen along a path."""
    ahead = line[-1] - line[0]
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    along = (directions @ ahead).reshape(-1)
    aside = directions.reshape(-1, 3) - along[:, None] * ahead
    k = np.argmax(np.linalg.norm(aside, axis=1))
    x, y, z = aside[k]
    if np.linalg.norm(aside[k]) < abs(along[k]):  # the path is nowhere abreast of it
        return "away from" if along[k] > 0.0 else "this side of"
    if abs(z) >= np.hypot(x, y):
        return HEIGHTS[int(z < 0.0)]
    return LEFT if ahead[0] * y - ahead[1] * x > 0.0 else RIGHT
