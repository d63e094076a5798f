"""Tuning numbers of rollouts."""

from typing import NamedTuple


class RolloutTuning(NamedTuple):
    """Numbers that trade accuracy of rollouts against time; measured on the scenes of the benchmarks."""

    rim: float = 0.3  # share of the goal's radius: steps nearer to the rim get no finer, since psi is smooth there
    stretch: float = 0.0041  # time over which exposure to walls is judged, between fine steps: less varies more [s]
    arc: float = 1.0  # a step without position noise is swept along an arc of at most this angle; a chord beyond [rad]
    wall_reach: float = 1.0  # reach of walls next to the goal, behind the last cross-section, in decay lengths 1/k
    push_cutoff: float = 3.0  # moving walls count within so many distances at which walls push: e^-3 is left there
    least_change: float = 1e-6  # a step is no shorter than this where motions of obstacles change [s]
    # Below log dQ_g/dQ_h = -16 a path of h follows a_h under g as well. The density of the mixture loses exp(-16) of
    # itself on average, since dQ_g/dQ_h is a martingale under Q_h; rounding to single precision takes as much.
    negligible: float = 16.0
    law_rows: int = 4  # rows of a law per step of the grid: more follow the guide closer and take memory
    abreast: int = 8  # steps whose noise is drawn at once, where no other draws come between
    entering: float = 1.5  # times the way at the best speed within which of the goal a step may enter it
    deviations: float = 6.0  # of noise, beyond that way
    lanes: int = 512  # paths of a block of points: fewer take more time between loops, more leave the cache
    vector: int = 16  # lanes of a vector instruction; the last vector of a loop may hold lanes that have ended
    alone_points: int = 2400  # samples of a point that one thread simulates before a second one is awake
    alone: int = 64  # those of another system


TUNING = RolloutTuning()
