"""Bodies that move as shapes in space and time: their outlines at some moments, and the tubes that they sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.obstacle import Motion, Mover, Obstacle
from pirrht.moving.collision import radius_of
from sim.drawing.strokes import at_most
from sim.plotting.ground import fading, outline

CORNERS = 32  # of what is round: its outline then lies within half a percent of the radius
ROUGH = 20  # corners of what is round, of an outline
MOST = 640  # corners of all outlines of a picture
FEWEST = 8  # of them that one outline has
OFF = 0.002  # that a tube may be off a corner of a body that turns [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube:
    """Tube that one solid of a moving obstacle sweeps while it goes on without a jump."""

    times: Array  # (k,) at which the body is where its outline is [s]; in between corners go straight
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
        i = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2))
        share = (time - self.times[i]) / (self.times[i + 1] - self.times[i])
        found: Array = (1.0 - share) * self.rings[i] + share * self.rings[i + 1]
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outline:
    """Predicted outline of a solid of a moving obstacle."""

    after: float  # a moment [s]
    strength: float  # from 1 for now to 0
    ring: Array  # (c + 1, 2) its corners, the first one twice [m]


def foreseen(movers: Sequence[Mover], now: float) -> list[Outline]:
    """Bodies that move as they are now [s], and where they are taken to be soon, the weaker the later.

    Of many bodies there are fewer moments and fewer corners.
    """
    told = [(mover, [(0.0, 1.0), *fading(mover, now)]) for mover in movers]
    count = sum(len(mover.solids) * len(moments) for mover, moments in told)
    if count * FEWEST > MOST:
        told = [(mover, moments[::2]) for mover, moments in told]
    corners = int(np.clip(MOST // max(1, count), FEWEST, ROUGH))
    found = []
    for mover, moments in told:
        times = now + np.array([after for after, _ in moments])
        for rings in outlines(mover, times, corners):
            closed = np.concatenate([rings, rings[:, :1]], axis=1)
            pairs = zip(moments, closed, strict=True)
            found += [Outline(after=after, strength=strength, ring=ring) for (after, strength), ring in pairs]
    return found


def outlines(mover: Mover, times: Array, corners: int = CORNERS) -> list[Array]:
    """Outlines of each of a body's solids seen from above at times (k,) [s], (k, c, 2) [m]."""
    return _turned(mover, mover.motion.pose(times), corners)


def tubes(mover: Mover, begin: float, end: float, corners: int = CORNERS) -> list[Tube]:
    """Sweep a moving obstacle from one time to another [s], solid by solid, cut where it jumps.

    Args:
        corners: of what is round, at most.
    """
    turn = np.sqrt(8.0 * OFF / max(radius_of(mover), 1e-9))
    found = []
    for times, poses in _laps(mover.motion, begin, end):
        times, poses = _finer(times, poses, turn)
        found += [Tube(times=times, rings=rings) for rings in _turned(mover, poses, corners)]
    return found


def _turned(mover: Mover, poses: Array, corners: int) -> list[Array]:
    """Outlines of a body's solids at poses (k, 3), (k, c, 2)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turns = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=1)
    return [np.einsum("kij,cj->kci", turns, _flat(solid, corners)) + poses[:, None, :2] for solid in mover.solids]


@lru_cache(maxsize=1024)  # the same solids are drawn again and again
def _flat(solid: Obstacle, corners: int) -> Array:
    """Corners of a solid's outline in the frame of its body, at most so many, (c, 2) [m]."""
    ring = outline(solid)
    return at_most(np.vstack([ring, ring[:1]]), corners + 1)[:-1]


def _laps(motion: Motion, begin: float, end: float) -> list[tuple[Array, Array]]:
    """Times and poses between which a motion is linear, lap by lap of one that starts over."""
    rows, shift = motion.rows, motion.offset
    period = float(rows[-1, 0]) if motion.repeat else np.inf
    first = max(0, int((begin + shift) // period)) if motion.repeat else 0
    last = max(first, int(np.ceil((end + shift) / period)) - 1) if motion.repeat else first
    found = []
    for lap in range(first, last + 1):
        off = (lap * period if lap else 0.0) - shift  # of the rows' clock
        low, high = begin if lap == first else off, end if lap == last else off + period
        inner = rows[:, 0] + off
        times = np.concatenate([[low], inner[(inner > low) & (inner < high)], [high]])
        poses = np.column_stack([np.interp(times - off, rows[:, 0], rows[:, k]) for k in (1, 2, 3)])
        found.append((times, poses))
    return found


def _finer(times: Array, poses: Array, turn: float) -> tuple[Array, Array]:
    """Add rows, so that from one to the next an obstacle turns by no more than an angle [rad]."""
    parts = np.maximum(1, np.ceil(np.abs(np.diff(poses[:, 2])) / turn)).astype(int)
    at = np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(parts))])
    every = np.arange(len(times))
    return np.interp(at, every, times), np.column_stack([np.interp(at, every, poses[:, k]) for k in range(3)])
