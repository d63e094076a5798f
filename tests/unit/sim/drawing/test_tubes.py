"""Tubes and outlines of moving bodies are where the bodies are."""

from dataclasses import replace

import numpy as np
import pytest
from discs import block
from moving import moved, oblique

from pirrht.moving.collision import radius_of
from pirrht.plotting.strokes import outline
from pirrht.plotting.tuning import TUNING as PLOTTING
from sim.drawing.strokes import CORNERS, TURN, foreseen, tubes

PATROL = moved("patrol", [(0, 1, 1, 0), (1, 3, 1, 2), (1.5, 3, 2, 2)], block("b", 0.2, 0, (0.5, 0.1)), repeat=True)
BODIES = [*oblique().movers, PATROL, replace(PATROL, motion=PATROL.motion.after(0.7))]


def gap(ring: np.ndarray, true: np.ndarray) -> float:
    """How far corners of a true outline are from a drawn one at most [m]."""
    side = np.roll(ring, -1, axis=0) - ring
    share = np.clip(np.sum((true[:, None] - ring) * side, axis=2) / np.sum(side**2, axis=1), 0.0, 1.0)
    return float(np.linalg.norm(true[:, None] - ring - share[..., None] * side, axis=2).min(axis=1).max())


@pytest.mark.parametrize("mover", BODIES)
def test_a_tube_is_where_its_body_is_at_every_time(mover):
    found = tubes(mover, 0.3, 7.0)
    assert (found[0].times[0], found[-1].times[-1]) == (0.3, 7.0)
    tolerance = radius_of(mover.solids) * (2.0 - np.cos(np.pi / CORNERS) - np.cos(0.5 * TURN)) + 1e-6
    for time in np.random.default_rng(0).uniform(0.3, 7.0, 200):
        (tube,) = [one for one in found if one.times[0] <= time <= one.times[-1]]
        (solid,) = mover.at(float(time))
        assert gap(tube.at(float(time)), outline(solid)) <= tolerance


def test_a_tube_is_cut_where_its_body_starts_over_elsewhere():
    found = tubes(PATROL, 0.0, 4.0)
    assert [(one.times[0], one.times[-1]) for one in found] == [(0.0, 1.5), (1.5, 3.0), (3.0, 4.0)]
    np.testing.assert_allclose(found[1].rings[0], found[0].rings[0], atol=1e-5)
    assert np.abs(found[0].rings[-1] - found[1].rings[0]).max() > 1.0


def test_outlines_ahead_are_where_the_motion_leads_and_the_later_the_weaker():
    mover, now = moved("m", [(0, 1, 1, 0), (9, 10, 1, 3)], block("b", 0, 0, (0.4, 0.1))), 0.7
    found = foreseen([mover], now)
    assert [one.after for one in found] == [0.0, *PLOTTING.moments]
    strengths = [one.strength for one in found]
    assert (strengths, strengths[0]) == (sorted(strengths, reverse=True), 1.0)
    assert min(strengths) > 0.1
    for one in found:
        (solid,) = mover.at(now + one.after)
        np.testing.assert_allclose(one.ring[0], one.ring[-1])
        assert gap(one.ring[:-1], outline(solid)) < 1e-9
