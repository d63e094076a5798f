"""Signatures obey the calculus that the integers behind them promise."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from pirrht.arrays import Array
from pirrht.topology.homology import Homology

MARKERS = np.array([[2.0, 1.0], [3.0, -0.5], [1.0, -1.5]])
GOAL = np.array([5.0, 0.0])


@pytest.fixture
def homology() -> Homology:
    return Homology(markers=MARKERS, goal=GOAL)


def random_path(rng: np.random.Generator, tail: Array, head: Array, corners: int = 30) -> Array:
    return np.vstack([tail, rng.uniform([-1, -4], [6, 4], (corners, 2)), head])


def turns_by_rays(path: Array, marker: Array, goal: Array) -> int:
    """Signed crossings of the ray that leaves the marker away from the goal, an integer by other means."""
    ahead = goal - marker
    relative = path - marker
    side = relative[:, 0] * ahead[1] - relative[:, 1] * ahead[0]
    total = 0
    for i in range(len(path) - 1):
        if (side[i] > 0) != (side[i + 1] > 0):
            share = side[i] / (side[i] - side[i + 1])
            if (relative[i] + share * (relative[i + 1] - relative[i])) @ ahead < 0:
                total += 1 if side[i + 1] > 0 else -1
    return total


def test_winding_from_rays_equals_winding_from_angles(homology):
    rng = np.random.default_rng(9)
    found = []
    for _ in range(100):
        path = random_path(rng, *rng.uniform(-1, 6, (2, 2)))
        found.append(homology.winding(path))
        assert found[-1] == tuple(turns_by_rays(path, marker, GOAL) for marker in MARKERS)
    assert len(set(found)) > 30


def test_the_straight_line_is_class_zero_and_turns_less_than_half(homology):
    points = np.random.default_rng(1).uniform(-3, 8, (500, 2))
    straight = np.array([homology.base(point) for point in points])
    assert np.all(np.abs(straight) <= 0.5)
    for point, expected in zip(points, straight, strict=True):
        line = np.vstack([point, GOAL])
        np.testing.assert_allclose(homology.turns(line), expected, atol=1e-9)
        assert homology.winding(line) == (0, 0, 0)


@pytest.mark.parametrize("turns", [-2, -1, 1, 3])
def test_a_circle_counts_its_turns_around_what_it_encloses(homology, turns):
    angle = np.linspace(0, 2 * np.pi * turns, 50 * abs(turns))
    circle = MARKERS[0] + 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(homology.turns(circle), [turns, 0, 0], atol=1e-9)


# -- near-degenerate ---------------------------------------------------------------------------------------------


def behind(marker: Array, distance: float) -> Array:
    """A point on the cut: the marker lies between it and the goal."""
    away = marker - GOAL
    return marker + distance * away / np.hypot(*away)


@pytest.mark.parametrize("marker", MARKERS)
def test_two_ways_around_a_marker_differ_by_one_turn_from_on_and_beside_its_cut(homology, marker):
    k = int(np.flatnonzero((marker == MARKERS).all(axis=1))[0])
    away = marker - GOAL
    left = np.array([-away[1], away[0]]) / np.hypot(*away)
    for shift in (-1e-9, 0.0, 1e-9):
        x = behind(marker, 0.4) + shift * left
        one, other = (homology.winding(np.array([x, marker + side * 0.2 * left, GOAL])) for side in (1.0, -1.0))
        difference = np.array(one) - np.array(other)
        expected = np.zeros(3, int)
        expected[k] = 1
        np.testing.assert_array_equal(np.abs(difference), expected)


# -- names and keys ----------------------------------------------------------------------------------------------


def test_keys_add_as_classes_do():
    homology = Homology(markers=np.zeros((5, 2)), goal=GOAL)
    rng = np.random.default_rng(2)
    for _ in range(200):
        one, other = rng.integers(-50, 50, (2, 5))
        with np.errstate(over="ignore"):
            assert np.int64(homology.key(one)) + np.int64(homology.key(other)) == homology.key(one + other)


def test_keys_of_different_classes_differ():
    homology = Homology(markers=np.zeros((6, 2)), goal=GOAL)
    classes = list(product(range(-2, 3), repeat=6))
    assert len({homology.key(winding) for winding in classes}) == len(classes)
    assert homology.key((0,) * 6) == 0
