"""Tuning numbers of rollouts."""

from __future__ import annotations

from typing import NamedTuple


class RolloutTuning(NamedTuple):
    """Numbers that trade accuracy of rollouts against time; measured on the scenes of the benchmarks."""

    # Share of the goal's radius: steps nearer to the rim than that get no finer, since psi is smooth there.
    rim: float = 0.3
    # Determinant of a covariance over the square of its trace below which noise counts as along a line; rounding.
    line: float = 1e-9
    # A step without position noise is swept along an arc of at most this angle; a chord beyond [rad].
    arc: float = 1.0
    # Reach of walls next to the goal, behind the last cross-section of a path, in decay lengths 1/k of psi.
    wall_reach: float = 1.0
    # Below log dQ_g/dQ_h = -20 a path of h follows a_h under g as well. The density of the mixture loses exp(-20) of
    # itself on average, since dQ_g/dQ_h is a martingale under Q_h; rounding to single precision takes more.
    negligible: float = 20.0
    # Paths of a block of points: all rows of numbers together stay within the nearest cache.
    lanes: int = 512
    # Lanes of a vector instruction: loops run over whole vectors, the last of which may hold lanes that have ended.
    vector: int = 16
    # Lanes for which numbers of a tube are looked up before they are evaluated.
    chunk: int = 64
    # Samples of a point, and of another system, that one thread simulates before a second one is awake.
    alone_points: int = 2400
    alone: int = 64


TUNING = RolloutTuning()
