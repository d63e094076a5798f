"""Ways of paths in space, in words: what they go through, over, under or past.

A loop of solids that leaves an opening is gone through or not: a path goes through as often as it pierces the fan of
triangles over the loop's polygon, forwards less backwards, which its class decides. Any other loop, and one that is not
gone through, is passed on the side on which the path is where it comes nearest to it.
"""

from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.plotting.strokes import even
from pirrht.topology.nerve import WORKSPACE
from pirrht.topology.obstacles import Component
from sim.drawing.colors import FEW, LEFT, RIGHT, numbered, telling, title
from sim.text import shared

POINTS = 200  # of a path that are examined
STEP = 1e-4  # by which a point is moved to see where a solid is [m]
STEEP = 0.7  # upward part of the direction away from a solid from which on a path is over or under it
ONLY = "the only way"


def ways_in(space: FreeSpace | None, references: Sequence[Reference], names: Sequence[str]) -> list[str]:
    """Say of each of several paths what it goes through, over, under or past, no two alike; of the plane nothing.

    Those of M loops are named, by `names` (M,), that set it apart from the other paths.
    """
    if space is None or space.scene.dimension != 3:
        return []
    called = numbered(names)
    rivals = [reference.winding for reference in references]
    texts = list[str]()
    for reference in references:
        alone = len({*rivals}) < 2 and len(names) <= FEW
        chosen = range(len(names)) if alone else telling(reference.winding, rivals)
        found = [_way(reference, k, space, called[k]) for k in chosen]
        texts.append(", ".join(dict.fromkeys(found)) or ONLY)
    twice = {text for text in texts if texts.count(text) > 1}
    return [f"{t} ({title(r.id)})" if t in twice else t for t, r in zip(texts, references, strict=True)]


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


def _way(reference: Reference, k: int, space: FreeSpace, name: str) -> str:
    part = space.obstacles[k]
    often = abs(through(reference, k, space))
    named = shared([one for one in part.names if one != WORKSPACE])
    if often and len(part.members) > 1:
        around = ["the border" if one == WORKSPACE else one for one in part.names]
        more = f" and {len(around) - FEW} more" if len(around) > FEW else ""
        opening = f"in {name}" if named else f"between {', '.join(around[:FEW])}{more}"
        return f"through the opening {opening}" + (f" {often} times" if often > 1 else "")
    solid, side = _side(reference, part, space)
    return f"{side} {name if named or len(part.members) == 1 else space.scene.obstacles[solid].name}"


def _side(reference: Reference, part: Component, space: FreeSpace) -> tuple[int, str]:
    """Return the solid of a loop that a path comes nearest to, and on which side of it the path is there."""
    line = even(reference.trajectory.points, POINTS)
    gaps = np.array([space.collision.obstacle_distance(i, line) for i in part.members])
    row, at = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    solid = part.members[int(row)]
    moved = line[at] + STEP * np.vstack([np.eye(3), -np.eye(3)])
    gap = space.collision.obstacle_distance(solid, moved)
    away = gap[:3] - gap[3:]
    away /= max(float(np.linalg.norm(away)), 1e-12)
    if abs(away[2]) >= STEEP:
        return solid, "over" if away[2] > 0.0 else "under"
    ahead = np.gradient(line, axis=0)[at]
    return solid, LEFT if ahead[0] * away[1] - ahead[1] * away[0] > 0.0 else RIGHT

