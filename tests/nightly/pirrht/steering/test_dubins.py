"""The long tests of unit/pirrht/steering/test_dubins.py."""

from __future__ import annotations

import numpy as np
from unit.pirrht.steering.test_dubins import CAR, pairs
from windings_by_angle import turns_of_curve

from pirrht.arrays import Array
from pirrht.geometry.arcs import TWO_PI, along


def fine(start: Array, curvature: Array, length: Array, spacing: float) -> Array:
    points, pose = [start[:2]], tuple(start)
    for kappa, total in zip(curvature, length, strict=True):
        steps = int(np.ceil(total / spacing))
        points += [np.array(along(*pose, kappa, total * i / steps)[:2]) for i in range(1, steps + 1)]
        pose = along(*pose, kappa, total)
    return np.array(points)


def test_signatures_of_turning_curves_equal_those_of_fine_polylines() -> None:
    rng = np.random.default_rng(12)
    tails, heads = pairs(30, 13, span=3.0)
    curves = CAR.connect(tails, heads)
    for i in range(30):
        line = fine(curves.start[i], curves.curvature[i], curves.length[i], 2e-3)
        middle = line[rng.integers(len(line), size=12)]
        markers = np.vstack([rng.uniform(-4, 4, (20, 2)), middle + rng.normal(0, 0.05, (12, 2))])
        markers = markers[np.array([np.hypot(*(line - m).T).min() for m in markers]) > 4e-3]
        seen = np.unwrap(np.arctan2(*(line[:, None] - markers).transpose(2, 0, 1)[::-1]), axis=0)
        # The paper's contour integral, by the midpoint rule.
        offset = 0.5 * (line[1:] + line[:-1])[:, None] - markers
        step = np.diff(line, axis=0)[:, None]
        integrand = (offset[..., 0] * step[..., 1] - offset[..., 1] * step[..., 0]) / (offset**2).sum(axis=-1)
        out = np.empty(len(markers))
        turns_of_curve(curves.start[i], curves.curvature[i], curves.length[i], markers, out)
        np.testing.assert_allclose(out, (seen[-1] - seen[0]) / TWO_PI, atol=1e-9)
        np.testing.assert_allclose(out, integrand.sum(axis=0) / TWO_PI, atol=0.05)
