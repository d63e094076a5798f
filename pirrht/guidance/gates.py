"""Gates: how a noisy path of a class passes the corners of its reference.

At a corner the taut reference touches an obstacle; where noise matters the optimal law keeps off it. The gate of a
corner is the half-line that leaves it away from the obstacle. A path through the point at s on it is longer than the
reference, so that psi over the gate goes like exp(-k l(s)), k the decay per meter in free space, l the length
from the state over the gate to what follows; it vanishes at the corner itself, about like s. With l to second order,
l(s) = l* + (s - s*)^2 l''/2, the mean of s exp(-k l) over s > 0 has a closed form: that is what samples head for.
Without noise (k to infinity) it is the corner, or the straight line to what follows where the corner is not in the way.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.rollouts.gates import PASSED

AHEAD = math.sqrt(0.5 * math.pi)  # mean of s under s exp(-s^2 / 2)
MERGED = 0.5  # corners of one turn that are closer than this share of the noise's width are one gate


def gates_of(line: Array, x: Array, decay: float) -> Array:
    """Gates of one reference, (C, 8) as a row of `Gates.place`; there may be fewer of them than corners.

    Args:
        line: its corners (k, 2) [m] after x, the goal point as the last; none: no gates.
        x: state that the reference starts from, (n,).
        decay: of psi per meter [1/m].
    """
    line = _merged(np.asarray(line, dtype=float), x[:2], decay)
    place = np.zeros((len(line), 8))
    place[:, 2] = 1.0
    if len(line):
        place[:, :2] = line
        _place(line, x[:2], decay, place)
    return place


def _place(line: Array, x: Array, decay: float, place: Array) -> None:
    """Write the directions of gates, and what follows each: the mean place on the next gate."""
    ahead, outward, target = place[:, 2:4], place[:, 4:6], place[:, 6:8]
    legs = np.diff(np.vstack([x[None, :], line]), axis=0)
    units = legs / np.maximum(np.hypot(*legs.T), 1e-12)[:, None]
    follows = line[-1]
    for c in range(len(line) - 2, -1, -1):
        bisector, turn = units[c] + units[c + 1], units[c] - units[c + 1]
        ahead[c] = bisector / max(float(np.hypot(*bisector)), 1e-12)
        across = np.array([-ahead[c, 1], ahead[c, 0]])
        outward[c] = across if across @ turn >= 0.0 else -across
        gap = follows - line[c]
        target[c] = max(float(gap @ ahead[c]), PASSED), float(gap @ outward[c])
        width = math.sqrt(float(np.hypot(*gap)) / (2.0 * decay))
        follows = line[c] + width * AHEAD * outward[c]


def _merged(line: Array, x: Array, decay: float) -> Array:
    """Corners of one turn that are close together as one, in their middle."""
    if len(line) == 0:
        return line
    points = [x, *line]
    out: list[Array] = []
    group: list[Array] = []
    side = 0.0
    for i in range(1, len(points) - 1):
        before, after = points[i] - points[i - 1], points[i + 1] - points[i]
        turn = math.copysign(1.0, before[0] * after[1] - before[1] * after[0])
        near = bool(group) and float(np.hypot(*(points[i] - group[0]))) < MERGED / math.sqrt(decay)
        if group and not (near and turn == side):
            out.append(np.mean(group, axis=0))
            group = []
        group.append(points[i])
        side = turn
    if group:
        out.append(np.mean(group, axis=0))
    return np.array([*out, points[-1]])
