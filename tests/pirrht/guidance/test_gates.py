"""Gates: where noisy paths of a class pass the corners of its reference."""

import numpy as np
import pytest
from scipy.integrate import quad

from pirrht.guidance.gates import gates_of
from pirrht.rollouts.gates import Gates, aim, heading, mean_offset

CORNER = np.array([1.0, 0.0])


def unit_towards(place, decay, x):
    out = np.empty(2)
    stage = heading(Gates(np.array([len(place)]), place[None], decay), 0, 0, x[0], x[1], out)
    return out, stage


def around_a_corner(decay):
    """From (0, -1) around an obstacle above (1, 0)... to (2, -1): a right turn at the corner, obstacle below."""
    return gates_of(np.array([CORNER, [2.0, -1.0]]), np.array([0.0, -1.0]), decay)


@pytest.mark.parametrize("a", [-8.0, -3.3, -0.7, 0.0, 1.1, 4.0, 8.0, 50.0])
def test_the_mean_offset_is_that_of_the_density_cut_off_at_the_corner(a):
    def moment(n):
        # Relative to its greatest exponent, or nothing is left of it far to the left.
        return quad(lambda s: s**n * np.exp(-0.5 * s * s + a * s), 0.0, max(a, 0.0) + 12.0, limit=200)[0]

    if a < 20.0:
        assert mean_offset(a) == pytest.approx(moment(2) / moment(1), rel=1e-2)
    else:
        assert mean_offset(a) == pytest.approx(a, rel=5e-3)


def test_without_noise_samples_head_for_the_corner_itself():
    unit, stage = unit_towards(around_a_corner(1e9), 1e9, np.array([0.0, -1.0]))
    assert stage == 0
    np.testing.assert_allclose(unit, np.array([1.0, 1.0]) / np.sqrt(2.0), atol=1e-3)


def test_with_noise_they_keep_off_it_the_more_the_noisier():
    slopes = []
    for decay in (100.0, 25.0, 11.0):
        unit, _ = unit_towards(around_a_corner(decay), decay, np.array([0.0, -1.0]))
        slopes.append(unit[1] / unit[0])
    assert 1.0 < slopes[0] < slopes[1] < slopes[2]


def test_where_the_corner_is_not_in_the_way_they_head_straight_for_what_follows():
    gates = around_a_corner(1e4)
    high = np.array([0.0, 3.0])
    unit, _ = unit_towards(gates, 1e4, high)
    ahead, outward, (far, beside) = gates[0, 2:].reshape(3, 2)
    follows = CORNER + far * ahead + beside * outward
    straight = follows - high
    np.testing.assert_allclose(unit, straight / np.hypot(*straight), atol=2e-3)


def test_a_gate_opens_away_from_the_obstacle_that_the_reference_bends_around():
    gates = around_a_corner(10.0)
    np.testing.assert_allclose(gates[0, 4:6], [0.0, 1.0], atol=1e-12)  # a turn to the right: it lies below
    mirrored = gates_of(np.array([[1.0, 0.0], [2.0, 1.0]]), np.array([0.0, 1.0]), 10.0)
    np.testing.assert_allclose(mirrored[0, 4:6], [0.0, -1.0], atol=1e-12)


def test_behind_its_gate_a_sample_heads_for_the_next_one():
    unit, stage = unit_towards(around_a_corner(10.0), 10.0, np.array([1.2, 0.1]))
    assert stage == 1
    straight = np.array([0.8, -1.1])
    np.testing.assert_allclose(unit, straight / np.hypot(*straight), atol=1e-12)


def test_corners_of_one_turn_close_together_are_one_gate():
    bend = np.array([[1.0, 0.0], [1.02, 0.0], [1.04, -0.01], [2.0, -1.0]])
    assert len(gates_of(bend, np.array([0.0, -1.0]), 11.0)) == 2
    assert len(gates_of(bend, np.array([0.0, -1.0]), 1e6)) == 4


def test_the_aim_is_the_mean_of_the_second_order_density_and_close_to_that_of_the_lengths_themselves():
    k, along, side, far, beside = 11.0, 0.8, -0.3, 1.1, 0.2

    def weight(s):
        return s * np.exp(-k * (np.hypot(along, s - side) + np.hypot(far, beside - s)))

    exact = quad(lambda s: s * weight(s), 0, 6)[0] / quad(weight, 0, 6)[0]
    assert aim(along, side, far, beside, k) == pytest.approx(exact, rel=0.1)
