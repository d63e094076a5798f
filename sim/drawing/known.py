"""What a robot knows of its scene, from above, in the same colours everywhere."""

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.mapping.believed import Believed
from pirrht.mapping.scan import Scan
from pirrht.plotting.colors import Color
from sim.drawing.strokes import at_most

OCCUPIED: Color = (16, 18, 22)
UNKNOWN: Color = (150, 154, 158)
FREE: Color = (247, 247, 245)
SCAN: Color = (224, 58, 70)

Shades = NDArray[np.uint8]


def shades(known: Believed, free: Color = FREE, unknown: Color = UNKNOWN, occupied: Color = OCCUPIED) -> Shades:
    """Return the colours of the cells of a map, (rows, columns, 3), the uppermost row first."""
    kinds = np.where(known.occupied, 2, known.unknown.astype(np.uint8))
    return np.array([free, unknown, occupied], np.uint8)[kinds[::-1]]


def seen_area(scan: Scan, rays: int, lower: Array, upper: Array) -> Array:
    """Return the pose of a scan's sensor, then where rays leave what was seen, (k, 2) [m], all within a box.

    So many rays at most are taken.
    """
    chosen = at_most(np.column_stack([scan.angles, np.clip(scan.ranges, 0.0, scan.most)]), rays)
    along = chosen[:, 0] + scan.pose[2]
    ends = scan.pose[:2] + chosen[:, 1:] * np.column_stack([np.cos(along), np.sin(along)])
    shares = [np.ones(len(ends))]
    for ahead, border in ((ends - scan.pose[:2], upper - scan.pose[:2]), (scan.pose[:2] - ends, scan.pose[:2] - lower)):
        shares += list(np.where(ahead > border, border / np.maximum(ahead, 1e-9), 1.0).T)
    inside = np.clip(np.min(shares, axis=0), 0.0, 1.0)[:, None]
    return np.vstack([scan.pose[:2], scan.pose[:2] + inside * (ends - scan.pose[:2])])
