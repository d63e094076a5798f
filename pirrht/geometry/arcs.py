"""Trace planar curves of arcs and straight pieces, find their entry of the goal and turns.

A batch of k curves has P pieces each; a straight piece has curvature 0 and a missing piece length 0. Entries and turns
are exact: no curve is divided into steps.
"""

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import inlined, kernel

TWO_PI = 2.0 * np.pi


class Curves(NamedTuple):
    """k planar curves that a steering method proposes, one row each."""

    start: Array  # (k, 3) x, y [m], heading of travel [rad]
    curvature: Array  # (k, P) counter-clockwise positive [1/m]
    length: Array  # (k, P) [m]
    cost: Array  # (k,) steering cost of the whole curve [cost]
    tails: Array  # (k, n) first states
    heads: Array  # (k, n) last states

    def points(self, spacing: float) -> list[Array]:
        """Each curve as a polyline (l, 2) [m]: ends of pieces, points at most `spacing` [m] apart on arcs."""
        return [trace(self.start[i], self.curvature[i], self.length[i], spacing) for i in range(self.start.shape[0])]


@inlined
def point_along(x, y, theta, ux, uy, curvature, s):  # type: ignore[no-untyped-def]
    """Point (x, y) [m] after arc length s [m] on a piece that sets out along (ux, uy) = (cos theta, sin theta)."""
    if abs(curvature) * abs(s) < 1e-9:
        return x + s * ux, y + s * uy
    end = theta + curvature * s
    return x + (math.sin(end) - uy) / curvature, y - (math.cos(end) - ux) / curvature


@kernel
def along(x, y, theta, curvature, s):  # type: ignore[no-untyped-def]
    """Pose (x, y, theta) [m, m, rad] after arc length s [m] on a piece of a curvature [1/m]."""
    px, py = point_along(x, y, theta, math.cos(theta), math.sin(theta), curvature, s)
    return px, py, theta + curvature * s


@inlined
def center_of(x, y, theta, curvature):  # type: ignore[no-untyped-def]
    """Centre (x, y) [m] of the circle that an arc of curvature not 0 [1/m] is part of."""
    return x - math.sin(theta) / curvature, y + math.cos(theta) / curvature


@inlined
def turns_of_chord(ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Angle [turns] from (ax, ay) to (bx, by) [m] seen from the origin, of least magnitude (paper, section IV-A)."""
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by) / TWO_PI


@kernel
def turns_of_piece(x, y, theta, curvature, length, mx, my):  # type: ignore[no-untyped-def]
    """Angle [turns] that a piece turns through as seen from the marker (mx, my) [m]; exact off the marker.

    Less than a whole circle closed by its chord is the border of a part of the disc, so from outside the
    circle chord and arc turn through the same angle. From inside, the angle of an arc never turns back, and it has
    the sign of the curvature.
    """
    if length <= 0.0:
        return 0.0
    bx, by, _ = along(x, y, theta, curvature, length)
    chord = turns_of_chord(x - mx, y - my, bx - mx, by - my)
    bend = abs(curvature) * length
    if bend < 1e-9:
        return chord
    cx, cy = center_of(x, y, theta, curvature)
    if (mx - cx) ** 2 + (my - cy) ** 2 >= 1.0 / curvature**2:
        return chord
    sign = math.copysign(1.0, curvature)
    circles = math.floor(bend / TWO_PI + 1e-9)
    if chord * sign < 0.0 and bend - circles * TWO_PI > 1e-9:
        circles += 1.0
    return chord + sign * circles


@kernel
def entry_of_piece(x, y, theta, curvature, length, gx, gy, radius):  # type: ignore[no-untyped-def]
    """Arc length [m] at which a piece first touches the disc about (gx, gy) of a radius [m], or infinity."""
    dx, dy = x - gx, y - gy
    gap = dx * dx + dy * dy - radius * radius
    if gap <= 0.0:
        return 0.0
    if abs(curvature) * length < 1e-9:
        along_ray = dx * math.cos(theta) + dy * math.sin(theta)
        root = along_ray * along_ray - gap
        if root < 0.0 or along_ray > 0.0:
            return np.inf
        s = -along_ray - math.sqrt(root)
        return s if s <= length else np.inf
    r = 1.0 / abs(curvature)
    cx, cy = center_of(x, y, theta, curvature)
    d = math.sqrt((gx - cx) ** 2 + (gy - cy) ** 2)
    if d > r + radius or d < abs(r - radius) or d == 0.0:
        return np.inf
    half = math.acos(min(1.0, max(-1.0, (r * r + d * d - radius * radius) / (2.0 * r * d))))
    to_goal = math.atan2(gy - cy, gx - cx)
    from_start = math.atan2(y - cy, x - cx)
    best = np.inf
    for angle in (to_goal - half, to_goal + half):
        best = min(best, (((angle - from_start) * math.copysign(1.0, curvature)) % TWO_PI) * r)
    return best if best <= length else np.inf


@kernel
def entry_of_curve(start, curvature, length, gx, gy, radius):  # type: ignore[no-untyped-def]
    """Arc length [m] at which a curve, (3,), (P,), (P,), first touches the disc about (gx, gy) [m], or infinity."""
    x, y = start[0], start[1]
    theta = start[2]
    done = 0.0
    for p in range(length.shape[0]):
        s = entry_of_piece(x, y, theta, curvature[p], length[p], gx, gy, radius)
        if s < np.inf:
            return done + s
        x, y, theta = along(x, y, theta, curvature[p], length[p])
        done += length[p]
    return np.inf


@kernel
def truncate(length, limit, out):  # type: ignore[no-untyped-def]
    """Piece lengths (P,) [m] of the part of a curve before arc length `limit` [m], written to out (P,)."""
    left = limit
    for p in range(length.shape[0]):
        out[p] = max(0.0, min(length[p], left))
        left -= length[p]


def trace(start: Array, curvature: Array, length: Array, spacing: float) -> Array:
    """One curve, (3,), (P,), (P,), as a polyline (l, 2) [m]; points on arcs are at most `spacing` [m] apart."""
    x, y, theta = (float(v) for v in start)
    points = [(x, y)]
    for kappa, total in zip(curvature, length, strict=True):
        if total > 0:
            parts = 1 if kappa == 0 else max(1, int(np.ceil(total / spacing)))
            points += [along(x, y, theta, kappa, total * i / parts)[:2] for i in range(1, parts + 1)]
            x, y, theta = along(x, y, theta, kappa, total)
    return np.array(points)


@inlined
def wrapped(angle):  # type: ignore[no-untyped-def]
    """Return an angle in [-pi, pi)."""
    return angle - TWO_PI * math.floor((angle + math.pi) / TWO_PI)


@inlined
def turns_of(way, before, after):  # type: ignore[no-untyped-def]
    """Return the angle that a heading along a line, between two others, takes at its ends [rad]."""
    return abs(wrapped(way - before)) + abs(wrapped(after - way))


@inlined
def backwards(way, before, after, reverses):  # type: ignore[no-untyped-def]
    """Return whether driving a line backwards takes less turning."""
    return bool(reverses) and turns_of(way + math.pi, before, after) < turns_of(way, before, after)
