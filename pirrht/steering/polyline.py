"""Shorten polylines inside their homology class: shortcuts between corners, and corners blunted where they touch."""

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import Curves
from pirrht.geometry.space import FREE, SpaceKernels
from pirrht.jit.jit import borrowing, inlined, kernel
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.steering.chain import Connect, shortcut_with
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.legs import entered
from pirrht.steering.tuning import POLYLINE as TUNING
from pirrht.topology.signature import SignatureKernels


def taut_lines(path: Curves, connect: Connect, checker: EdgeChecker) -> Any:
    """Shorten consecutive straight motions into the goal inside their class, and connect the corners that are left."""
    length = path.length[-1].sum()
    x, y, theta = path.start[-1]
    short = taut_polyline(
        np.vstack([path.start[:, :2], np.array([x + length * np.cos(theta), y + length * np.sin(theta)])]), checker
    )
    return connect(short[:-1], short[1:])


def taut_polyline(points: Array, checker: EdgeChecker) -> Array:
    """Shorten a polyline (k, 2) [m] that ends in the goal's disc inside its class, (l, 2) [m]; never longer."""
    capacity = max(TUNING.capacity, TUNING.capacity_per_corner * len(points))
    out = np.empty((capacity + TUNING.loose_capacity, 2))
    around = checker.around
    short = out[
        : tautening(around.static.kernels, around.classes.kernels)(around, np.ascontiguousarray(points), capacity, out)
    ].copy()
    return short if _length(short, len(short)) <= _length(points, len(points)) else points


@kernel
def _length(points, count):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(count - 1):
        total += math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
    return total


@cache
def tautening(space: SpaceKernels, classes: SignatureKernels) -> Any:
    """Build the kernel (around, points (k, 2), capacity, out (l, 2)) that shortens a polyline.

    It takes kernels of a footprint and of a signature.
    """
    place, certify_piece = space.place, space.certify_piece
    key_of_step = classes.key

    @borrowing
    def key_of(around, a, b, last):  # type: ignore[no-untyped-def]
        """Additive key of the segment from a (2,) to b (2,)."""
        return key_of_step(around.classes, (a[0], a[1]), (b[0], b[1]))

    @borrowing
    def joins(around, numbers, a, b, last, key):  # type: ignore[no-untyped-def]
        """Return whether the segment from a (2,) to b (2,) has a key, and is free up to the goal's disc."""
        if key_of(around, a, b, last) != key:
            return False
        share = min(1.0, entered(around, a[0], a[1], b[0], b[1]))
        x = a[0] + share * (b[0] - a[0])

        return certify_piece(around.static, (a[0], a[1]), (x, a[1] + share * (b[1] - a[1])), False) == FREE

    shortcut = shortcut_with(key_of, joins)

    @borrowing
    def cut(around, corner, first, last, halvings):  # type: ignore[no-untyped-def]
        """Cut a corner (before, corner, after), (3, 2), as far as the piece across stays free; the share of its legs.

        Rows 0 and 2 become the ends of the piece; of these, `first` and `last` tell which come from the corner.
        """
        x, y = corner[1, 0], corner[1, 1]

        ax = corner[0, 0] - x
        ay = corner[0, 1] - y
        bx = corner[2, 0] - x
        by = corner[2, 1] - y

        low, high, share = 0.0, 1.0, 0.5
        for k in range(halvings + 1):
            share = low if k == halvings else 0.5 * (low + high)
            s = share if first else 1.0
            r = share if last else 1.0

            corner[0] = (x + s * ax, y + s * ay)
            corner[2] = (x + r * bx, y + r * by)

            if k == halvings:
                break
            key = key_of(around, corner[0], corner[1], False) + key_of(around, corner[1], corner[2], False)
            low, high = (share, high) if joins(around, 0, corner[0], corner[2], False, key) else (low, share)
        return low

    @inlined
    def touches(around, x, y):  # type: ignore[no-untyped-def]
        """Return whether something keeps a corner at (x, y) [m] from being cut."""
        return place(around.static, (x, y)) <= TUNING.touching

    @kernel
    def blunt_corners(around, points, count, least, capacity, out):  # type: ignore[no-untyped-def]
        """Blunt corners that turn more than `least` [rad], or touch nothing; number of points, under `capacity`."""
        copy_row(points[0], out[0])
        n, corner = 1, np.empty((3, 2))
        for i in range(1, count - 1):
            copy_row(out[n - 1], corner[0])
            copy_rows(points[i : i + 2], corner[1:])
            ax = corner[1, 0] - corner[0, 0]
            ay = corner[1, 1] - corner[0, 1]
            bx = corner[2, 0] - corner[1, 0]
            by = corner[2, 1] - corner[1, 1]
            t, turn = 0.0, abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
            wanted = turn > least or (turn > TUNING.straight_turn and not touches(around, points[i, 0], points[i, 1]))
            if wanted and n + 2 + count - i < capacity:
                t = cut(around, corner, True, True, TUNING.halvings)
            if t > 0.0:
                copy_rows(corner[::2], out[n : n + 2])
                n += 2
            else:
                copy_row(points[i], out[n])
                n += 1
        copy_row(points[count - 1], out[n])
        return n + 1

    @kernel
    def slide_corners(around, points, count):  # type: ignore[no-untyped-def]
        """Slide every corner that touches nothing along both of its legs until it does; whether there was one."""
        loose, corner = False, np.empty((3, 2))
        for i in range(1, count - 1):
            for end in (2, 0):
                if not touches(around, points[i, 0], points[i, 1]):
                    loose = True
                    copy_rows(points[i - 1 : i + 2], corner)
                    cut(around, corner, end == 0, end == 2, TUNING.slide_halvings)
                    copy_row(corner[end], points[i])
        return loose

    @kernel
    def taut(around, points, capacity, out):  # type: ignore[no-untyped-def]
        """Shortcut and blunt corners in turn until nothing is gained; number of points written to out."""
        count = points.shape[0] + 1
        before = np.inf
        work = np.empty((out.shape[0], 2))

        copy_rows(points, out[: count - 1])
        out[count - 1] = around.goal
        for k in range(TUNING.rounds):
            count = shortcut(around, 0, out[:count], count if k == 0 else TUNING.patience)
            length = _length(out, count)
            if before - length < TUNING.gain * length:
                break
            before, count = length, blunt_corners(around, out, count, TUNING.flat_turn, capacity, work)
            copy_rows(work[:count], out[:count])
        for _ in range(TUNING.loose_rounds):
            if not slide_corners(around, out, count):
                break
            count = shortcut(around, 0, out[:count], TUNING.patience)
            count = blunt_corners(around, out, count, np.pi, out.shape[0], work)
            copy_rows(work[:count], out[:count])
        for i in range(count - 1):
            ax, ay = out[i, 0], out[i, 1]
            dx = out[i + 1, 0] - out[i, 0]
            dy = out[i + 1, 1] - out[i, 1]

            share = entered(around, ax, ay, ax + dx, ay + dy)
            if share < np.inf:
                out[i + 1] = (ax + share * dx, ay + share * dy)
                return i + 2
        return count

    return taut
