"""Signatures obey the calculus of the integers behind them; turns at few cuts equal those by angle."""

from itertools import product

import numpy as np
import pytest
from windings_by_angle import turns_of_curve

from pirrht.arrays import Array
from pirrht.jit.jit import kernel
from pirrht.topology.crossings import pairs_of_curve, sector
from pirrht.topology.homology import RAYS, Homology
from pirrht.topology.pairs import key_of_pairs, spread, summed

MARKERS = np.array([[2.0, 1.0], [3.0, -0.5], [1.0, -1.5]])
GOAL = np.array([5.0, 0.0])


@pytest.fixture
def homology() -> Homology:
    return Homology(markers=MARKERS, goal=GOAL)


def random_path(rng: np.random.Generator, tail: Array, head: Array, corners: int = 30) -> Array:
    return np.vstack([tail, rng.uniform([-1, -4], [6, 4], (corners, 2)), head])


def turns_by_rays(path: Array, marker: Array, goal: Array) -> int:
    """Signed crossings of the ray that leaves the marker away from the goal, an integer by other means."""
    ahead, relative, total = goal - marker, path - marker, 0
    side = relative[:, 0] * ahead[1] - relative[:, 1] * ahead[0]
    for i in range(len(path) - 1):
        if (side[i] > 0) != (side[i + 1] > 0):
            share = side[i] / (side[i] - side[i + 1])
            if (relative[i] + share * (relative[i + 1] - relative[i])) @ ahead < 0:
                total += 1 if side[i + 1] > 0 else -1
    return total


def test_winding_from_rays_equals_winding_from_angles(homology):
    rng, found = np.random.default_rng(9), []
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


@pytest.mark.parametrize("marker", MARKERS)
def test_two_ways_around_a_marker_differ_by_one_turn_from_on_and_beside_its_cut(homology, marker):
    away = (marker - GOAL) / np.hypot(*(marker - GOAL))
    left = np.array([-away[1], away[0]])
    for shift in (-1e-9, 0.0, 1e-9):
        x = marker + 0.4 * away + shift * left  # the marker lies between it and the goal
        one, other = (homology.winding(np.array([x, marker + side * 0.2 * left, GOAL])) for side in (1.0, -1.0))
        np.testing.assert_array_equal(np.abs(np.subtract(one, other)), (marker == MARKERS).all(axis=1))


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


CORNER = np.array([20.0, 12.0])
NUMBERS = [0, 1, 3, 8, 9, 30, 300]


@kernel
def asked(cuts, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """How many markers are asked about a segment."""
    begin, end = sector(cuts, ax, ay, cx, cy)
    return end - begin


def field(M: int, seed: int = 0) -> Homology:
    return Homology(markers=np.random.default_rng(seed).uniform(0, 24, (M, 2)), goal=CORNER)


def segments(homology: Homology, count: int) -> list[tuple[Array, Array]]:
    """Segments of all lengths: anywhere, about the goal point and through it, from on and beside a cut."""
    rng, found = np.random.default_rng(1), []
    for _ in range(count):
        kind = rng.integers(4 if homology.M else 3)
        a = rng.uniform(0, 24, 2)
        c = a + rng.normal(0, 1, 2) * 10.0 ** rng.uniform(-4, 1)
        if kind == 1:
            a, c = CORNER + rng.normal(0, 1, 2), CORNER + rng.normal(0, 1, 2) * rng.choice([1.0, 1e-9, 0.0])
        elif kind == 2:
            c = CORNER - (a - CORNER) * rng.uniform(0, 2)
        elif kind == 3:
            marker = homology.markers[rng.integers(homology.M)]
            a = marker + (marker - CORNER) * rng.uniform(0, 2)
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
        assert RAYS.key(homology.table, a, c) == homology.key(homology.winding(np.array([a, c])))


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
