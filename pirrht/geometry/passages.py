"""Find passages: two obstacles, or an obstacle and the border, face each other and the robot fits between.

Saddles of the clearance field say about where. The points with more clearance than c fall into parts, and those with
less as well. At a saddle two parts meet: two rooms with c falling (a doorway), or two obstacles with c rising (the last
gap between them). Every passage is one or the other, also where both sides belong to one component. A sweep in the
order of clearance finds them (union-find); that the shallower of two parts must be of some depth tells a passage from
the grain of the grid. Squares of grid points lie in pages: one in a small world, one for every coarsest block near a
solid in a large one. Away from all solids a page is one room of the field's greatest clearance, and all around the
workspace is one obstacle.

The middle of the free chord at a saddle, and the line along which this chord is shortest, say exactly where and how
wide a passage is. It also has an axis: the line through it along which the clearance is greatest, until both sides are
wide.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.geometry.collision import Collision
from pirrht.geometry.disc import certify_piece
from pirrht.geometry.field import LEVEL_BITS, LEVELS, REACH, Field, border, cell_of, clearance, interpolate
from pirrht.geometry.rectangles import root_of
from pirrht.geometry.space import FREE
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, kernel

BORDER = "border"  # its name next to those of solids


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Passages:
    """The P open passages of a world, narrowest first, and their axes."""

    place: Array  # (P, 2) middle of the narrowest chord [m]
    heading: Array  # (P,) along the passage, at right angles to that chord [rad]
    width: Array  # (P,) of a straight corridor that leaves the robot as much clearance [m]
    axis: Array  # (l, 3) points on the axes [m], [m] and headings there [rad]; all middles come first, in their order
    extent: Array  # (P,) distance of the farther end of the axis from the middle [m]
    opening: Array  # (P,) clearance at its narrower end [m]

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
        ends, pieces = _side(left, right, line), _side(line[:-1], line[1:], np.vstack([left, right])).T
        over = (ends[:, :-1] > 0.0) != (ends[:, 1:] > 0.0)
        return np.asarray((over & ((pieces[: self.count] > 0.0) != (pieces[self.count :] > 0.0))).any(axis=1))

    def between(self, k: int, collision: Collision) -> list[str]:
        """Return the names of two solids, or of one and "border", between which passage k leads."""
        world, ends = collision.world, np.array([chord[k] for chord in self.chords()])
        nearest = collision.nearest_walls(ends, range(len(world.obstacles)), collision.footprint.radius).which.tolist()
        return [
            world.obstacles[i].name if world.contains(end) and i >= 0 else BORDER
            for end, i in zip(ends, nearest, strict=True)
        ]


# In space there are none.
NO_PASSAGES = Passages(
    place=np.empty((0, 2)), heading=np.empty(0), width=np.empty(0), axis=np.empty((0, 3)), extent=np.empty(0),
    opening=np.empty(0),
)  # fmt: skip


def _side(tails: Array, heads: Array, points: Array) -> Array:
    """Return on which side of lines 2 x (k, 2) points (l, 2) lie: (k, l), positive to the left [m^2]."""
    along = heads - tails
    to = points[None] - tails[:, None]

    return np.asarray(along[:, :1] * to[..., 1] - along[:, 1:] * to[..., 0])


def find_passages(field: Field, collision: Collision) -> Passages:
    """Find every passage that a robot can use by the clearance field; FCL decides where that is unsure."""
    radius = collision.footprint.radius
    found = np.empty((0, 4))  # x, y, heading, clearance
    walks = []
    work = np.empty((2 * TUNING.walk_steps + 2, 4))
    ends = []  # distance and clearance of both ends of an axis
    stride, places = narrow_places(field, radius)
    for row, column in places.tolist():
        c, x, y = _greatest(field, row * stride, column * stride, stride)
        middle = np.array([x, y, 0.0, c])
        if not _centre(field, radius, middle) or middle[3] > REACH:
            continue
        if np.any(
            (np.hypot(*(found[:, :2] - middle[:2]).T) < radius) & (np.abs(np.sin(found[:, 2] - middle[2])) < 0.7)
        ):  # it leads through a known chord
            continue
        if middle[3] < field.spacing and not collision.free(middle[None, :2])[0]:
            continue
        found = np.vstack([found, middle])
        ahead, count = _walk(field, radius, middle, work)
        both = work[[ahead - 1, count - 1]] if 0 < ahead < count else middle[None]
        ends.append((np.hypot(*(both[:, :2] - middle[:2]).T).max(), both[:, 3].min()))
        walks.append(work[:count, :3].copy())
    order = np.argsort(found[:, 3], kind="stable")
    found = found[order]
    width = 2.0 * (found[:, 3] + radius - collision.waived(found[:, :2]))
    axis = np.vstack([found[:, :3], *(walks[i] for i in order)])
    extent, opening = np.array(ends).reshape(-1, 2)[order].T
    return Passages(
        place=found[:, :2], heading=found[:, 2], width=width, axis=axis, extent=extent, opening=opening
    )  # fmt: skip


@kernel
def _greatest(field, i, j, stride):  # type: ignore[no-untyped-def]
    """Return the greatest clearance [m] in the square that begins at grid point (i, j), and where, (x, y) [m]."""
    h = field.spacing
    best = -np.inf
    at_x, at_y = 0.0, 0.0

    wide = cell_of(field, field.x0 + (i + 0.5) * h, field.y0 + (j + 0.5) * h)[3] * h * 4.0 <= 1.0
    step = stride if wide else 1  # if its cells hold whole squares the greatest value is at a corner
    for k in range(i, min(i + stride + (1 if wide else 0), field.nx), step):
        for m in range(j, min(j + stride + (1 if wide else 0), field.ny), step):
            x, y = field.x0 + k * h, field.y0 + m * h
            c = min(border(field, x, y), interpolate(field, field.nearest, x, y))
            if c > best:
                best, at_x, at_y = c, x, y
    return best, at_x, at_y


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
        low, high = (s, high) if clearance(field, x + s * ux, y + s * uy) > level else (low, s)
    return 0.5 * (low + high)


@kernel
def _chord(field, x, y, angle, most):  # type: ignore[no-untyped-def]
    """Return the length of the chord through (x, y) at an angle [rad], and how far its middle is from there [m]."""
    ux, uy = math.cos(angle), math.sin(angle)
    ahead = _end_of_chord(field, x, y, ux, uy, most)
    behind = _end_of_chord(field, x, y, -ux, -uy, most)

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
    middle[2:] = (angle + 0.5 * np.pi, 0.5 * length - field.spacing)

    return middle[3] > -0.5 * field.spacing**2 / radius


@kernel
def _narrowest(field, radius, middle, angle, most):  # type: ignore[no-untyped-def]
    """Move (x, y) to the middle of the shortest chord at an angle [rad], to both sides of it; return its length [m]."""
    ux, uy = math.cos(angle), math.sin(angle)
    move = radius
    best, shift = _chord(field, middle[0], middle[1], angle, most)
    middle[0] += shift * ux
    middle[1] += shift * uy
    for _ in range(TUNING.chord_moves):
        shorter = False
        for side in (-move, move):
            x = middle[0] - side * uy
            y = middle[1] + side * ux

            if clearance(field, x, y) <= -field.spacing:  # where the passage bends, this is in a wall
                continue
            length, shift = _chord(field, x, y, angle, most)
            if length < best - TUNING.chord_gain * move:
                best, shorter = length, True
                middle[:2] = (x + shift * ux, y + shift * uy)
        if not shorter:
            move *= 0.5
    return best


@kernel
def _walk(field, radius, middle, out):  # type: ignore[no-untyped-def]
    """Write the corners of a passage's axis but for its middle: x, y, heading and clearance.

    Return the number of those ahead, and of all.
    """
    if middle[3] > TUNING.wide * radius:
        return 0, 0
    ahead = _walk_to(field, radius, middle, 1.0, out, 0)
    return ahead, _walk_to(field, radius, middle, -1.0, out, ahead)


@kernel
def _walk_to(field, radius, middle, side, out, count):  # type: ignore[no-untyped-def]
    """Walk along the axis to one side until it is wide; corners are written only where the axis bends."""
    ux = side * math.cos(middle[2])
    uy = side * math.sin(middle[2])

    x, y = middle[0], middle[1]
    step = TUNING.walk_step * radius
    least = middle[3]

    from_x, from_y, heading = x, y, middle[2]
    for _ in range(TUNING.walk_steps):
        next_x = x + step * ux
        next_y = y + step * uy
        most = 2.0 * (max(clearance(field, x, y), 0.0) + radius)
        length, shift = _chord(field, next_x, next_y, math.atan2(ux, -uy), most)
        if length < 2.0 * most - step:
            shift = min(max(shift, -step), step)
            next_x = next_x - shift * uy
            next_y = next_y + shift * ux
        c = clearance(field, next_x, next_y)
        if c < min(least, 0.0) - 0.5 * field.spacing:
            break
        sure = certify_piece(field, (from_x, from_y), (next_x, next_y), False) == FREE
        if not sure and (x != from_x or y != from_y):
            out[count] = (x, y, heading, clearance(field, x, y))
            from_x, from_y = x, y
            count += 1
        gap = math.hypot(next_x - x, next_y - y)
        ux = (next_x - x) / gap
        uy = (next_y - y) / gap
        x, y, heading = next_x, next_y, math.atan2(side * uy, side * ux)
        if c > least + TUNING.walk_wider * radius:
            break
    if x != from_x or y != from_y:
        out[count] = (x, y, heading, clearance(field, x, y))
        count += 1
    return count


class Pages(NamedTuple):
    """Squares of the field by pages: those near solids first, then the empty pages, then the surroundings."""

    first: IntArray  # (rows, columns) first square of each page, or the only one
    place: IntArray  # (k, 2) row and column of the k pages near solids
    near: int  # k
    side: int  # squares along a side of a page
    empty: int  # index of the first empty page's square
    value: Array  # (n,) greatest clearance in each square [m]


def narrow_places(field: Field, radius: float) -> tuple[int, IntArray]:
    """Return squares in which two rooms or two obstacles meet and a robot of a radius [m] may pass, narrowest first.

    Returns: the side of a square in grid points, and (row, column) of the squares (k, 2). The first point of a square
        is that many times (row, column).
    """
    stride = max(1, int(radius / (TUNING.squares_per_radius * field.spacing)))
    squares = _pages_of(field, stride, radius)
    value, surroundings = squares.value, len(squares.value) - 1
    near = np.flatnonzero(value[: squares.empty] < REACH)
    level = np.rint((value[near] + radius) * (65535.0 / max(value.max() + radius, 1e-9))).astype(np.uint16)
    rising = near[np.argsort(level, kind="stable")].astype(np.int32)  # a radix sort
    open_space = np.flatnonzero(value[:-1] >= REACH).astype(np.int32)

    found = np.zeros(len(value), dtype=np.bool_)
    root = np.full(len(value), -1, dtype=np.int32)
    steps = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]])  # four meet at sides
    _sweep(squares, open_space, steps, np.inf, root, found)
    _sweep(squares, np.ascontiguousarray(rising[::-1]), steps, TUNING.room_depth * field.spacing, root, found)
    root[:] = -1
    root[surroundings] = surroundings
    _sweep(squares, rising, steps[:4], TUNING.solid_depth * radius, root, found)  # blocked: no meeting at corners
    at = np.flatnonzero(found & (value > -field.spacing))  # a gap on whose axis no grid point lies may look closed
    at = at[np.argsort(value[at], kind="stable")]
    page, square = np.divmod(at, squares.side**2)
    return stride, squares.place[page] * squares.side + np.column_stack(np.divmod(square, squares.side))


def _pages_of(field: Field, stride: int, radius: float) -> Pages:
    blocks = field.held.get("table")
    if blocks is None:
        side = max(-(-field.nx // stride), -(-field.ny // stride))
        near = np.ones((1, 1), dtype=np.bool_)
    else:
        side = ((field.stride - 1) << (LEVELS - 1)) // stride
        near = (blocks[:: 1 << (LEVELS - 1), :: 1 << (LEVELS - 1)] >> LEVEL_BITS) != 0
    place = np.argwhere(near)
    lonely = np.argwhere(~near)
    first = np.empty(near.shape, dtype=np.int64)
    empty = len(place) * side**2
    first[near] = np.arange(len(place)) * side**2
    first[~near] = empty + np.arange(len(lonely))
    value = np.append(np.full(empty + len(lonely), REACH), -radius)
    _fill(field, place, side, stride, radius, value)
    return Pages(first, np.vstack((place, lonely)), len(place), side, empty, value)


@kernel
def _fill(field, place, side, stride, radius, value):  # type: ignore[no-untyped-def]
    """Write the greatest clearance [m] of every square of the pages near solids."""
    at = 0
    for page in range(len(place)):
        for a in range(side):
            for b in range(side):
                i = (place[page, 0] * side + a) * stride
                value[at] = min(
                    max(_greatest(field, i, (place[page, 1] * side + b) * stride, stride)[0], -radius), REACH
                )
                at += 1


@inlined
def _next_square(squares, p, di, dj):  # type: ignore[no-untyped-def]
    """Return the square (di, dj) from square p; -1 where an empty page meets another kind."""
    side, (rows, columns), empty = squares.side, squares.first.shape, squares.empty
    if p >= empty:
        page = squares.near + p - empty
        a = side * di
        b = side * dj
    else:
        page = p // (side * side)
        square = p % (side * side)
        a = square // side + di
        b = square % side + dj

    i = squares.place[page, 0] + a // side
    j = squares.place[page, 1] + b // side

    if not (0 <= i < rows and 0 <= j < columns):
        return len(squares.value) - 1
    q = squares.first[i, j]
    if q >= empty:
        return q
    return -1 if p >= empty else q + (a % side) * side + b % side


@kernel
def _sweep(squares, order, steps, least, root, found):  # type: ignore[no-untyped-def]
    """Add squares in an order and mark where two parts meet that are both deeper than `least` [m] there."""
    value = squares.value
    for k in range(order.shape[0]):
        p = order[k]
        root[p] = p
        for s in range(len(steps)):
            q = _next_square(squares, p, steps[s, 0], steps[s, 1])
            if q < 0 or root[q] < 0:
                continue
            one = root_of(root, p)
            other = root_of(root, q)

            if one == other:
                continue
            deep = abs(value[one] - value[p])
            deeper = abs(value[other] - value[p])

            if min(deep, deeper) > least:
                found[p] = True
            if deep < deeper:
                root[one] = other
            else:
                root[other] = one
