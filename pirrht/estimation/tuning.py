"""Tuning numbers of the estimator."""

from __future__ import annotations

from typing import NamedTuple


class EstimationTuning(NamedTuple):
    """Numbers that trade accuracy of estimates against time; found on random scenes and drives unless stated."""

    # Paths longer than the cheapest reference plus so many lambda are cut: they weigh exp(-40), below rounding.
    tail: float = 40.0
    # Samples from which on several threads weigh them: waking a thread takes as long as weighing so many.
    parallel: int = 4096
    # Normalised weights below this add nothing to a control sequence, so that few samples are replayed.
    negligible: float = 1e-6

    # Share of the time left that the next round of samples takes; the rest allows for rounds that take longer.
    filled: float = 0.6
    # Share of a plan's samples that come first among moving obstacles, since the rest of a plan takes time as well.
    first_round: float = 0.1
    # Multiple of a plan's samples that the first plan of an episode draws at most (`Sampling.least`).
    first_plan: int = 64
    # Samples of a plan at any time limit: weighing more takes longer than it is worth.
    most: int = 150_000

    # Classes that promise so many nats less than another get few samples: exp(-16) is below a sample's weight.
    hopeless: float = 16.0

    # Least share of a step that is split near walls and goal: smaller steps reduce a bias that is negligible by then.
    least_step: float = 1.0 / 300.0
    # Among moving obstacles, share of the robot's radius over which noise carries a point in the shortest step.
    least_move: float = 0.01
    # Deviations of noise, and multiples of a guide's longest step, that steps hardly ever exceed.
    deviations: float = 6.0
    faster: float = 1.5
    # Moments, equal shares of the averaging window, at which the clearance of a guide is evaluated.
    moments: int = 8
    # Share of the goal's radius that is left where its rim is set back for exits at ends of steps.
    rim: float = 0.2
    # Bends of a path below this are dropped; a path that cuts corners by more leads into them [m].
    bend: float = 1e-3

    # Effective samples below which standard errors are unreliable.
    few: float = 10.0
    # Largest terms of a sum count so many times more in its error, as larger ones are likely unseen. With 0 a twentieth
    # of plans near walls is off by more than 3 errors.
    outlying: float = 4.0
    # Weights from which on the shape of their tail is estimated (Vehtari et al. 2024, as the next six).
    tail_weights: int = 25
    # The tail is the smaller of this share of all weights and so many roots of their number.
    tail_share: float = 0.2
    tail_roots: float = 3.0
    # Prior of the shape, and its weight in samples.
    prior_shape: float = 0.5
    prior_weight: int = 10
    # Shape from which on errors are unreliable.
    heavy: float = 0.7


TUNING = EstimationTuning()
