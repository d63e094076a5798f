"""Cross-sections of a reference: their places, and their extent to the walls on both sides.

A cross-section is a straight line across the reference, square to it, or along the bisector of a corner. It ends at a
wall, or where noise does not carry a path that goes on to the goal. They are dense near walls, sparse in the open.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import Field, clearance
from pirrht.jit.jit import kernel
from pirrht.proposals.tuning import TUNING


class Sections(NamedTuple):
    """Cross-sections of one reference, C of them, the first through the start, the last before the goal."""

    point: Array  # (C, 2) on the reference [m]
    ahead: Array  # (C, 2) unit normal in the direction of travel
    ends: Array  # (C, 2) offset of their ends to the left and to the right [m]


def sections_of(field: Field, line: Array, x: Array, radius: float, decay: float) -> Sections:
    """Place cross-sections of a reference from x (n,) [m] over corners to the goal point, line (k, 2) [m].

    Args:
        radius: of the goal's disc [m].
        decay: k, of psi per meter [1/m].
    """
    whole = np.ascontiguousarray(np.vstack([x[None, :2], line]), dtype=float)
    legs = np.hypot(*np.diff(whole, axis=0).T)
    room = 2 + len(whole) + int(legs.sum() / TUNING.section_least)
    out = Sections(np.empty((room, 2)), np.empty((room, 2)), np.empty((room, 2)))
    count = _place(field, whole, radius, decay, out)
    return Sections(out.point[:count], out.ahead[:count], out.ends[:count])


@kernel
def _march(field, x, y, ux, uy, far):  # type: ignore[no-untyped-def]
    """Return the free length from (x, y) along a unit vector, `far` at most [m], and whether a wall ends it."""
    s = max(clearance(field, x, y), TUNING.stride)  # a reference touches walls
    while s < far:
        c = clearance(field, x + s * ux, y + s * uy)
        if c <= TUNING.touching:
            return s, True
        s += max(c, TUNING.stride)
    return far, False


@kernel
def _write(field, spread, x, y, ux, uy, c, out):  # type: ignore[no-untyped-def]
    """Make cross-section c at (x, y) across (ux, uy), up to `spread` [m]; return whether walls end both sides."""
    point, ahead, ends = out
    ends[c, 0], left = _march(field, x, y, -uy, ux, spread)
    ends[c, 1], right = _march(field, x, y, uy, -ux, spread)
    point[c, 0], point[c, 1], ahead[c, 0], ahead[c, 1] = x, y, ux, uy
    return left and right


@kernel
def _place(field, line, radius, decay, out):  # type: ignore[no-untyped-def]
    """Walk along a reference (k, 2) and write its cross-sections to `Sections`; return their number."""
    last, whole = line.shape[0] - 2, 0.0
    for i in range(last + 1):
        whole += math.hypot(line[i + 1, 0] - line[i, 0], line[i + 1, 1] - line[i, 1])
    count, s, since, apart, ux, uy = 0, 0.0, math.inf, TUNING.section_apart, 1.0, 0.0
    for i in range(last + 1):
        x, y = line[i, 0], line[i, 1]
        dx, dy = line[i + 1, 0] - x, line[i + 1, 1] - y
        leg = math.hypot(dx, dy)
        if leg <= 0.0:
            continue
        vx, vy = dx / leg, dy / leg
        bx, by = (ux + vx, uy + vy) if count > 0 else (vx, vy)
        size = math.hypot(bx, by)
        bx, by = (bx / size, by / size) if size > TUNING.touching else (vx, vy)
        ux, uy = vx, vy
        end = leg - radius if i == last else leg
        t = 0.0
        while t < end or (count == 0):
            if since >= apart or count == 0:
                here = s + t  # noise is that of a bridge
                spread = math.sqrt(max(here * (whole - here) / whole, TUNING.section_shortest) / decay)
                across = TUNING.section_deviations * spread + TUNING.section_extra
                cx, cy = (bx, by) if t == 0.0 else (ux, uy)
                channel = _write(field, across, x + t * ux, y + t * uy, cx, cy, count, out)
                room = max(clearance(field, x + t * ux, y + t * uy) - across, 0.0)
                stride = min(TUNING.section_stride + TUNING.section_widening * room, TUNING.section_widest)
                apart = TUNING.section_apart
                if channel:
                    width = out.ends[count, 0] + out.ends[count, 1]
                    stride = min(stride, max(TUNING.section_channel * decay * width * width, TUNING.section_least))
                    apart = min(apart, stride)
                count, since = count + 1, 0.0
            else:
                stride = apart - since
            left = end - t
            stride = left if stride >= left else min(stride, max(0.5 * left, apart))
            t, since = t + stride, since + stride
        s += leg
    return count
