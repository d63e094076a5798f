"""Moving obstacles in space and time: their outlines at some moments, and the tubes that they sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array, IntArray
from pirrht.geometry.obstacle import Mover
from sim.drawing.strokes import at_most, interpolated
from sim.plotting.ground import fading, outline

CORNERS, ROUGH = 32, 20  # of what is round, of a tube and of an outline
MOST, FEWEST = 640, 8  # corners of all outlines of a picture at most, and of one outline at least
TURN = 0.15  # of an obstacle from one ring of its tube to the next at most [rad]
JUMP = 1e-6  # time over which an obstacle that starts over jumps [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube:
    """Tube that one solid of a moving obstacle sweeps while it moves without a jump."""

    times: Array  # (k,) at which the obstacle is where its outline is [s]; in between corners go straight
    rings: Array  # (k, c, 2) corners of the outline at each, counterclockwise [m]

    @property
    def faces(self) -> IntArray:
        """Triangles between the corners of all rings, row by row, (2 (k - 1) c, 3)."""
        k, c = self.rings.shape[:2]
        here = np.arange((k - 1) * c)
        beside = here - here % c + (here + 1) % c
        return np.vstack([np.column_stack([here, beside, here + c]), np.column_stack([beside, beside + c, here + c])])

    def at(self, time: float) -> Array:
        """Corners of the outline at a time [s], (c, 2) [m]."""
        return interpolated(self.rings.reshape(len(self.times), -1), self.times, np.array([time])).reshape(-1, 2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outline:
    """Predicted outline of a solid of a moving obstacle."""

    after: float  # a moment [s]
    strength: float  # from 1 for now to 0
    ring: Array  # (c + 1, 2) its corners, the first one twice [m]


def foreseen(movers: Sequence[Mover], now: float) -> list[Outline]:
    """Outline moving obstacles as they are now [s] and as predicted soon, the weaker the later; many coarsely."""
    told = [(mover, [(0.0, 1.0), *fading(mover, now)]) for mover in movers]
    count = sum(len(mover.solids) * len(moments) for mover, moments in told)
    corners = int(np.clip(MOST // max(1, count), FEWEST, ROUGH))
    found = []
    for mover, moments in told:
        for rings in outlines(mover, now + np.array([after for after, _ in moments]), corners):
            closed = np.concatenate([rings, rings[:, :1]], axis=1)
            found += [Outline(after=a, strength=s, ring=ring) for (a, s), ring in zip(moments, closed, strict=True)]
    return found


def outlines(mover: Mover, times: Array, corners: int = CORNERS) -> list[Array]:
    """Outlines of each of an obstacle's solids seen from above at times (k,) [s], (k, c, 2) [m]."""
    poses = mover.motion.pose(times)
    turns = Rotation.from_euler("z", poses[:, 2:]).as_matrix()[:, :2, :2]
    rings = [outline(solid) for solid in mover.solids]
    flat = [at_most(np.vstack([ring, ring[:1]]), corners + 1)[:-1] for ring in rings]
    return [ring @ turns.transpose(0, 2, 1) + poses[:, None, :2] for ring in flat]


def tubes(mover: Mover, begin: float, end: float, corners: int = CORNERS) -> list[Tube]:
    """Sweep a moving obstacle from one time to another [s], solid by solid, cut where it jumps.

    Args:
        corners: of what is round, at most.
    """
    rows, shift = mover.motion.rows, mover.motion.offset
    period = float(rows[-1, 0]) if mover.motion.repeat else np.inf
    first, last = np.floor((begin + shift) / period), np.ceil((end + shift) / period)
    laps = np.arange(first + 1, last) * period - shift if mover.motion.repeat else np.empty(0)
    cuts = [begin, *laps[(laps > begin) & (laps < end)], end]
    found = []
    for low, high in zip(cuts[:-1], cuts[1:], strict=True):
        lap = np.floor((0.5 * (low + high) + shift) / period) * period if mover.motion.repeat else 0.0
        knots = rows[:, 0] + lap - shift
        times = np.concatenate([[low], knots[(knots > low) & (knots < high)], [high]])
        yaw = np.interp(times - lap + shift, rows[:, 0], rows[:, 3])
        parts = np.maximum(1, np.ceil(np.abs(np.diff(yaw)) / TURN)).astype(int)
        at = np.interp(np.arange(parts.sum() + 1), np.append(0, np.cumsum(parts)), np.arange(len(times)))
        times = np.interp(at, np.arange(len(times)), times)
        seen = np.minimum(times, max(low, high - JUMP))  # at the end of a lap it is where the next one begins
        found += [Tube(times=times, rings=rings) for rings in outlines(mover, seen, corners)]
    return found
