"""Tuning numbers of the estimator."""

from __future__ import annotations

from typing import NamedTuple


class EstimationTuning(NamedTuple):
    """Numbers that trade accuracy of estimates against time; found on random scenes and drives unless stated."""

    tail: float = 40.0  # paths are cut at the cheapest reference plus so many lambda: exp(-40) is below rounding
    parallel: int = 4096  # samples that several threads weigh: waking a thread takes as long as weighing so many
    negligible: float = 1e-6  # weights below this add nothing to a control sequence, so that few samples are replayed

    filled: float = 0.6  # share of the time left for the next round of samples; the rest is for rounds that take longer
    first_round: float = 0.1  # share of samples drawn first among moving obstacles: the rest of a plan takes time too
    first_plan: int = 64  # multiple of a plan's samples for the first plan of an episode, at most (`Sampling.least`)
    most: int = 150_000  # samples of a plan at any time limit: weighing more takes longer than it is worth
    hopeless: float = 16.0  # nats below another class from which a class gets few samples: less than a sample's weight

    least_step: float = 1.0 / 300.0  # share of a step that is split, at least: the bias of larger steps is negligible
    least_move: float = 0.01  # among moving obstacles, share of the robot's radius by which the shortest step moves
    moments: int = 8  # equal shares of the averaging window at which the clearance of a guide is evaluated
    rim: float = 0.2  # share of the goal's radius that is left where its rim is set back for exits at ends of steps
    bend: float = 1e-3  # bends of a path below this are dropped; a path that cuts corners by more leads into them [m]

    few: float = 10.0  # effective samples below which standard errors are unreliable
    # Largest terms of a sum count so many times more in its error, as larger ones are likely unseen. With 0 a twentieth
    # of plans near walls is off by more than 3 errors.
    outlying: float = 4.0
    tail_weights: int = 25  # weights from which on the tail's shape is estimated (Vehtari et al. 2024, as the next six)
    tail_share: float = 0.2  # the tail is the smaller of this share of all weights
    tail_roots: float = 3.0  # and of so many roots of their number
    prior_shape: float = 0.5  # prior of the shape
    prior_weight: int = 10  # its weight in samples
    heavy: float = 0.7  # shape from which on errors are unreliable


TUNING = EstimationTuning()
