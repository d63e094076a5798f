"""Draw whether and when a Brownian bridge meets a flat wall within a step.

Between two times a path is a Brownian bridge. It crosses a flat wall at distances c0 and c1 with probability
exp(-2 c0 c1 / variance); the time of the first crossing is then drawn exactly.
"""

from __future__ import annotations

import math

from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import normals, uniform

FAR = 12.0  # exponents beyond this are taken as certain survival
SIDEWAYS = 0.02  # share of noise along a line that counts as towards a wall next to it at least, since lines turn
MIN_VARIANCE = 1e-12  # variances are kept above this, where noise does not act towards a wall


@kernel
def first_crossing(c0, c1, deviation, state):  # type: ignore[no-untyped-def]
    """Draw the share of the step at which a bridge from distance c0 > 0 first meets the wall, given that it does.

    In the clock s = t / (1 - t) the bridge is a Brownian motion with drift, so s is inverse Gaussian (drawn as by
    Michael, Schucany and Haas, The American Statistician 1976); an end on the near side counts as its mirror image.
    Args: distances at both ends (the second may be negative) and the standard deviation of the whole step [m],
        and the random sequence. Returns: next state of the sequence, share.
    """
    shape = (c0 / deviation) ** 2
    state, z, _ = normals(state)
    state, u = uniform(state)
    slope = abs(c1) / c0  # one over the mean of s
    half = 0.5 * z * z / shape
    s = 1.0 / (slope + half + math.sqrt(half * (half + 2.0 * slope)))
    if slope > 0.0 and u * (1.0 + slope * s) > 1.0:
        s = 1.0 / (slope * slope * s)
    return state, s / (1.0 + s)


@inlined
def survival(c0, c1, variance):  # type: ignore[no-untyped-def]
    """Return the probability that a bridge between two positive distances misses the wall."""
    if c1 <= 0.0:
        return 0.0
    exponent = 2.0 * c0 * c1 / variance
    return 1.0 if exponent > FAR else 1.0 - math.exp(-exponent)
