"""Find passages: two obstacles, or an obstacle and the border, face each other and the robot fits between.

A saddle of the clearance field says about where; the middle of the free chord there, and the line along which this
chord is shortest, say exactly where and how wide. A passage also has an axis: the line through it along which the
clearance is greatest, until both sides are wide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array, BoolArray
from pirrht.geometry.arcs import FREE, certify_segment
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import REACH, Field, border, clearance, value_at
from pirrht.geometry.narrow_passages import narrow_places
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import kernel

BORDER = "border"  # its name next to those of solids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Passages:
    """The P open passages of a world, narrowest first, and their axes."""

    place: Array  # (P, 2) middle of the narrowest chord [m]
    heading: Array  # (P,) along the passage, at right angles to that chord [rad]
    width: Array  # (P,) of a straight corridor that leaves the robot as much clearance [m]
    axis: Array  # (l, 3) points on the axes [m], [m] and headings there [rad]; all middles come first, in their order

    @property
    def count(self) -> int:
        """Count the passages, P."""
        return len(self.width)

    def chords(self) -> tuple[Array, Array]:
        """Return both ends of the narrowest chords, 2 x (P, 2) [m]; a path through a passage crosses its chord."""
        across = 0.5 * self.width[:, None] * np.column_stack([-np.sin(self.heading), np.cos(self.heading)])
        return self.place - across, self.place + across

    def crossed(self, line: Array) -> BoolArray:
        """Return through which passages a polyline (l, 2) [m] leads, (P,)."""
        left, right = self.chords()
        ends = _side(left, right, line)
        pieces = _side(line[:-1], line[1:], np.vstack([left, right]))
        over = (ends[:, :-1] > 0.0) != (ends[:, 1:] > 0.0)
        within = ((pieces[:, : self.count] > 0.0) != (pieces[:, self.count :] > 0.0)).T
        crossed: BoolArray = (over & within).any(axis=1)
        return crossed

    def between(self, k: int, collision: Collision) -> list[str]:
        """Return the names of two solids, or of one and "border", between which passage k leads."""
        world, ends = collision.world, np.array([chord[k] for chord in self.chords()])
        every = range(len(world.obstacles))
        nearest = collision.nearest_walls(ends, every, collision.footprint.radius).which.tolist()
        return [
            world.obstacles[i].name if world.contains(end) and i >= 0 else BORDER
            for end, i in zip(ends, nearest, strict=True)
        ]


def _side(tails: Array, heads: Array, points: Array) -> Array:
    """Return on which side of lines 2 x (k, 2) points (l, 2) lie: (k, l), positive to the left [m^2]."""
    along, to = heads - tails, points[None] - tails[:, None]
    side: Array = along[:, :1] * to[..., 1] - along[:, 1:] * to[..., 0]
    return side


def find_passages(field: Field, collision: Collision) -> Passages:
    """Find every passage that a robot can use by the clearance field; FCL decides where that is unsure."""
    radius = collision.footprint.radius
    middles: list[Array] = []
    walks, work = [], np.empty((2 * TUNING.walk_steps + 2, 3))
    middle = np.empty(4)  # x, y, heading, clearance
    stride, places = narrow_places(field, radius)
    for row, column in places.tolist():
        _best_of_block(field, row, column, stride, middle)
        if not _centre(field, radius, middle) or middle[3] > REACH or _known(middles, middle, radius):
            continue
        if middle[3] < field.spacing and not collision.free(middle[None, :2])[0]:
            continue
        middles.append(middle.copy())
        walks.append(work[: _walk(field, radius, middle, work)].copy())
    found = np.array(middles).reshape(-1, 4)
    order = np.argsort(found[:, 3], kind="stable")
    found = found[order]
    return Passages(
        place=found[:, :2],
        heading=found[:, 2],
        width=2.0 * (found[:, 3] + radius),
        axis=np.vstack([found[:, :3], *(walks[i] for i in order)]),
    )


def _known(middles: list[Array], middle: Array, radius: float) -> bool:
    """Return whether one of the passages so far leads through this chord."""
    if not middles:
        return False
    others = np.array(middles)
    near = np.hypot(*(others[:, :2] - middle[:2]).T) < radius
    return bool(np.any(near & (np.abs(np.sin(others[:, 2] - middle[2])) < 0.7)))


@kernel
def _best_of_block(field, row, column, stride, middle):  # type: ignore[no-untyped-def]
    """Write the point of a block that has the greatest clearance."""
    best = -np.inf
    for i in range(row * stride, min((row + 1) * stride, field.nx)):
        for j in range(column * stride, min((column + 1) * stride, field.ny)):
            x, y = field.x0 + i * field.spacing, field.y0 + j * field.spacing
            c = min(border(field, x, y), value_at(field, i, j))
            if c > best:
                best = c
                middle[0], middle[1], middle[3] = x, y, c


@kernel
def _end_of_chord(field, x, y, ux, uy, most):  # type: ignore[no-untyped-def]
    """Return the distance from (x, y) along (ux, uy) to where the clearance falls to -h, `most` if it does not [m].

    Below 0 the walls' slopes have not met yet and the field is as fine as anywhere, so this is exact where the
    clearance at the axis itself is cut off between grid points.
    """
    level, low, high = -field.spacing, 0.0, 0.0
    while True:
        c = clearance(field, x + high * ux, y + high * uy)
        if c <= level:
            break
        if high >= most:
            return most
        low = high
        high += max(0.7 * (c - level), 0.25 * field.spacing)
    for _ in range(TUNING.chord_halvings):
        s = 0.5 * (low + high)
        if clearance(field, x + s * ux, y + s * uy) > level:
            low = s
        else:
            high = s
    return 0.5 * (low + high)


@kernel
def _chord(field, x, y, angle, most):  # type: ignore[no-untyped-def]
    """Return the length of the chord through (x, y) at an angle [rad], and how far its middle is from there [m]."""
    ux, uy = math.cos(angle), math.sin(angle)
    ahead, behind = _end_of_chord(field, x, y, ux, uy, most), _end_of_chord(field, x, y, -ux, -uy, most)
    return ahead + behind, 0.5 * (ahead - behind)


@kernel
def _centre(field, radius, middle):  # type: ignore[no-untyped-def]
    """Move x, y, heading, clearance (4,) to the middle of the shortest chord; return whether the robot fits."""
    most = 3.0 * (max(middle[3], 0.0) + radius)
    angle, step, length = 0.0, np.pi / TUNING.chord_angles, np.inf
    for _ in range(TUNING.chord_turns):
        shortest, base = np.inf, angle
        for k in range(TUNING.chord_angles):
            trial = base + (k - TUNING.chord_angles // 2) * step
            length = _chord(field, middle[0], middle[1], trial, most)[0]
            if length < shortest:
                shortest, angle = length, trial
        length = _narrowest(field, radius, middle, angle, most)
        step *= 0.25
    middle[2], middle[3] = angle + 0.5 * np.pi, 0.5 * length - field.spacing
    return middle[3] > -0.5 * field.spacing**2 / radius


@kernel
def _narrowest(field, radius, middle, angle, most):  # type: ignore[no-untyped-def]
    """Move (x, y) to the middle of the shortest chord at an angle [rad], to both sides of it; return its length [m]."""
    ux, uy, move = math.cos(angle), math.sin(angle), radius
    best, shift = _chord(field, middle[0], middle[1], angle, most)
    middle[0] += shift * ux
    middle[1] += shift * uy
    for _ in range(TUNING.chord_moves):
        shorter = False
        for side in (-move, move):
            x, y = middle[0] - side * uy, middle[1] + side * ux
            if clearance(field, x, y) <= -field.spacing:  # where the passage bends, this is in a wall
                continue
            length, shift = _chord(field, x, y, angle, most)
            if length < best - TUNING.chord_gain * move:
                best, shorter = length, True
                middle[0], middle[1] = x + shift * ux, y + shift * uy
        if not shorter:
            move *= 0.5
    return best


@kernel
def _walk(field, radius, middle, out):  # type: ignore[no-untyped-def]
    """Write the corners of a passage's axis but for its middle, and their headings; return their number."""
    if middle[3] > TUNING.wide * radius:
        return 0
    count = _walk_to(field, radius, middle, 1.0, out, 0)
    return _walk_to(field, radius, middle, -1.0, out, count)


@kernel
def _walk_to(field, radius, middle, side, out, count):  # type: ignore[no-untyped-def]
    """Walk along the axis to one side until it is wide; corners are written only where the axis bends."""
    ux, uy = side * math.cos(middle[2]), side * math.sin(middle[2])
    x, y, step, least = middle[0], middle[1], TUNING.walk_step * radius, middle[3]
    from_x, from_y, heading = x, y, middle[2]
    for _ in range(TUNING.walk_steps):
        next_x, next_y = x + step * ux, y + step * uy
        most = 2.0 * (max(clearance(field, x, y), 0.0) + radius)
        length, shift = _chord(field, next_x, next_y, math.atan2(ux, -uy), most)
        if length < 2.0 * most - step:
            shift = min(max(shift, -step), step)
            next_x, next_y = next_x - shift * uy, next_y + shift * ux
        c = clearance(field, next_x, next_y)
        if c < min(least, 0.0) - 0.5 * field.spacing:
            break
        if certify_segment(field, from_x, from_y, next_x, next_y, False) != FREE and (x != from_x or y != from_y):
            out[count, 0], out[count, 1], out[count, 2] = x, y, heading
            from_x, from_y = x, y
            count += 1
        gap = math.hypot(next_x - x, next_y - y)
        ux, uy = (next_x - x) / gap, (next_y - y) / gap
        x, y, heading = next_x, next_y, math.atan2(side * uy, side * ux)
        if c > least + TUNING.walk_wider * radius:
            break
    if x != from_x or y != from_y:
        out[count, 0], out[count, 1], out[count, 2] = x, y, heading
        count += 1
    return count
