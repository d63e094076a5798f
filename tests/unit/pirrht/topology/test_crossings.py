"""Turns found at the few cuts that a path crosses equal those summed over all markers, angle by angle."""

from __future__ import annotations

import numpy as np
import pytest
from windings_by_angle import turns_of_curve

from pirrht.arrays import Array
from pirrht.jit.jit import kernel
from pirrht.topology.crossings import key_of_pairs, key_of_segment, pairs_of_curve, sector, spread, summed
from pirrht.topology.homology import Homology

GOAL = np.array([20.0, 12.0])
NUMBERS = [0, 1, 3, 8, 9, 30, 300]


@kernel
def asked(cuts, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """How many markers are asked about a segment."""
    begin, end = sector(cuts, ax, ay, cx, cy)
    return end - begin


def field(M: int, seed: int = 0) -> Homology:
    return Homology(markers=np.random.default_rng(seed).uniform(0, 24, (M, 2)), goal=GOAL)


def segments(homology: Homology, count: int) -> list[tuple[Array, Array]]:
    """Segments of all lengths: anywhere, about the goal point and through it, from on and beside a cut."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(count):
        kind = rng.integers(4 if homology.M else 3)
        a = rng.uniform(0, 24, 2)
        c = a + rng.normal(0, 1, 2) * 10.0 ** rng.uniform(-4, 1)
        if kind == 1:
            a, c = GOAL + rng.normal(0, 1, 2), GOAL + rng.normal(0, 1, 2) * rng.choice([1.0, 1e-9, 0.0])
        elif kind == 2:
            c = GOAL - (a - GOAL) * rng.uniform(0, 2)
        elif kind == 3:
            marker = homology.markers[rng.integers(homology.M)]
            a = marker + (marker - GOAL) * rng.uniform(0, 2)
            c = a + rng.normal(0, 1, 2) * 10.0 ** -rng.integers(0, 12)
        found.append((a, c))
    return found


def dense(homology: Homology, start: Array, curvature: Array, length: Array) -> tuple[Array, Array]:
    """Whole turns of a curve (M,) by angles around every marker, and where it ends."""
    swept = np.empty(homology.M)
    end = np.array(turns_of_curve(start, curvature, length, homology.markers, swept))
    straight = [homology.base(point) for point in (start[:2], end)]
    return np.rint(swept + straight[1] - straight[0]), end


@pytest.mark.parametrize("M", NUMBERS)
def test_the_key_of_a_segment_is_that_of_its_winding(M: int) -> None:
    homology = field(M)
    for a, c in segments(homology, 600):
        assert key_of_segment(homology.cuts, *a, *c) == homology.key(homology.winding(np.array([a, c])))


@pytest.mark.parametrize("M", NUMBERS)
def test_the_pairs_of_a_curve_are_its_whole_turns(M: int) -> None:
    homology, rng = field(M), np.random.default_rng(2)
    marker, turn, total = np.empty(3 * M, np.int32), np.empty(3 * M, np.int16), np.zeros(M, np.int16)
    wound = 0
    for _ in range(600):
        start = np.array([*rng.uniform(0, 24, 2), rng.uniform(-9, 9)])
        if M and rng.random() < 0.3:
            start[:2] = homology.markers[rng.integers(M)] + rng.normal(0, 0.4, 2)
        curvature = rng.choice([0.0, 1 / 0.3, -1 / 0.3, 0.5], 3)
        length = rng.choice([0.0, 1.0, 1.0, 1.0], 3) * rng.uniform(0, 3, 3)
        expected, end = dense(homology, start, curvature, length)
        count = pairs_of_curve(homology.cuts, (start, curvature, length), False, tuple(end), marker, turn, 0)
        key = key_of_pairs(marker, turn, 0, count, homology.hash_weights)
        count = summed(total, marker, turn, 0, count)
        np.testing.assert_array_equal(spread(marker[:count], turn[:count], M), expected)
        assert len(set(marker[:count])) == count
        assert np.all(turn[:count] != 0)
        assert key == homology.key(expected.astype(np.int64))
        wound += count
    assert wound > 0 or M < 3


def test_short_steps_ask_a_few_of_many_markers() -> None:
    homology, rng = field(1000), np.random.default_rng(3)
    steps = [(a, a + rng.normal(0, 0.05, 2)) for a in rng.uniform(0, 24, (500, 2))]
    assert np.mean([asked(homology.cuts, *a, *c) for a, c in steps]) < 10
