"""What a way says about psi of its class, against Bessel functions, the slowest mode of a channel and exact grids.

b sets the decay of psi in the open, k = 1 / b^2 here. Nothing is drawn but the states at which it is compared.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from solved import Solved, around_corner, around_post, in_channel, slope

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.proposals.desirability_tube import DesirabilityAscent

Made = Callable[..., Solved]


def way(known: Solved) -> tuple[PathIntegral, DesirabilityAscent]:
    """The way of the first reference from the start."""
    integral = path_integral(known.problem, known.space, Sampling())
    return integral, integral.proposals.climbing(known.x, known.lines[0])


def beside(known: Solved, seed: int, count: int = 300) -> Array:
    """States within about 5 cm of the first reference, 3 cm from walls and 20 cm from the goal at least, (., 2) [m]."""
    rng = np.random.default_rng(seed)
    whole = np.vstack([known.x, known.lines[0]])
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(whole, axis=0).T))])
    at = ends[-1] * rng.uniform(0.02, 0.9, count)
    states = np.stack([np.interp(at, ends, whole[:, i]) for i in range(2)], axis=1)
    states += 0.05 * rng.standard_normal((count, 2))
    far = np.hypot(*(states - known.space.scene.goal.center).T) > 0.2
    return states[far & (known.space.collision.clearance(states) > 0.03)]


@pytest.mark.parametrize(
    ("b", "width", "off"),
    [(0.3, 0.3, 0.02), (0.3, 0.5, 0.02), (0.3, 1.0, 0.02), (0.5, 0.5, 0.02), (0.5, 1.0, 0.02), (0.7, 0.5, 0.04)],
    ids=["kw 3.3", "kw 5.6", "kw 11", "kw 2", "kw 4", "kw 1"],
)
def test_in_a_straight_channel_transfers_settle_to_its_slowest_mode(b, width, off):
    """sin(pi y / w) exp(-sqrt(k^2 + (pi / w)^2) x), from a few widths before the goal on: at 200 places of seed 0.

    Median errors, and nine of ten: the normals of the clearance field are tilted here and there, by up to 10 degrees.
    """
    known = in_channel(b, width)
    integral, lead = way(known)
    rate, mode = np.hypot(1.0 / b**2, np.pi / width), np.pi / width
    x, share = np.random.default_rng(0).uniform([1.0, 0.15], [3.0, 0.85], (200, 2)).T
    places = np.column_stack((x, 1.0 + width * (share - 0.5)))
    found = np.array([slope(integral, lead, place) for place in places])
    along, across = np.abs(found - np.column_stack((np.full(200, rate), mode / np.tan(np.pi * share)))).T
    assert np.median(along) < off * rate
    assert np.quantile(along, 0.9) < 4.0 * off * rate
    assert np.median(across) < 0.02 * mode
    assert np.quantile(across, 0.9) < 0.1 * mode


# -- against the grid --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [around_corner, around_post])
@pytest.mark.parametrize(("b", "middling", "most"), [(0.15, 0.01, 0.04), (0.2, 0.02, 0.07), (0.3, 0.05, 0.15)])
def test_beside_a_reference_the_control_of_a_way_is_that_of_the_grid(make: Made, b, middling, most):
    """Relative error at random states (seed 0): its median, and what nine of ten stay below."""
    known = make(b)
    integral, lead = way(known)
    states = beside(known, 0)
    exact = known.truth.control(states) / b**2
    found = np.array([slope(integral, lead, x) for x in states])
    error = np.hypot(*(found - exact).T) / np.hypot(*exact.T)
    assert np.median(error) < middling
    assert np.quantile(error, 0.9) < most


@pytest.mark.parametrize("make", [around_corner, around_post])
@pytest.mark.parametrize("b", [0.15, 0.2, 0.3, 0.5])
def test_what_a_way_promises_is_log_psi_of_the_grid(make: Made, b):
    """Within 0.45 nats, of 10 to 90; less where psi falls faster than rooms are wide."""
    known = make(b)
    assert way(known)[1].promise == pytest.approx(known.truth.log_psi(known.x), abs=0.45 if b > 0.3 else 0.2)
