"""Boxes of spans of time rule out nothing that comes near: against places looked up one by one."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.geometry.obstacle import Motion
from pirrht.geometry.spans import SPAN, boxes_of, keeps_off

TIMES = 400  # moments of a way that are looked at


def random_motion(rng: np.random.Generator, *, repeat: bool) -> Motion:
    """Up to twelve rows a random time apart, in a room of 6 m."""
    count = int(rng.integers(1, 13))
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.2, count - 1))])
    if repeat and count == 1:
        times, count = np.array([0.0, 0.7]), 2
    rows = np.column_stack([times, rng.uniform(0.0, 6.0, (count, 2)), np.zeros(count)])
    return Motion(rows=rows, repeat=repeat)


def case(seed: int, *, repeat: bool):
    """A motion, its boxes as kernels take them, a time on its clock, and a way: its places at many times."""
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, repeat=repeat)
    boxes = boxes_of(motion.rows, repeat=repeat)
    period = float(motion.rows[-1, 0]) if repeat else 0.0
    own, duration = rng.uniform(-1.0, 15.0), rng.uniform(0.0, 4.0)
    start, velocity, radius = rng.uniform(0.0, 6.0, 2), rng.normal(size=2), rng.uniform(0.1, 1.5)
    past = np.linspace(0.0, duration, TIMES)
    body = motion.pose(own + past)[:, :2]
    way = start + past[:, None] * velocity
    return boxes, (boxes.ctypes.data, len(boxes), own, period), duration, way, body, (start, velocity, radius)


@pytest.mark.parametrize("repeat", [False, True])
def test_what_surely_keeps_off_is_never_within_the_radius(repeat):
    said = 0
    for seed in range(400):
        boxes, (at, count, own, period), duration, way, body, (start, velocity, radius) = case(seed, repeat=repeat)
        if keeps_off(at, count, own, period, (*start, *velocity), duration, radius):
            said += 1
            assert np.min(np.hypot(*(way - body).T)) >= radius - 1e-6, seed
        assert boxes is not None
    assert said > 80  # and it is of use


def test_before_it_begins_and_after_it_ends_a_body_is_where_it_stands():
    rows = np.array([[0.0, 1.0, 1.0, 0.0], [1.3, 4.0, 2.0, 0.0]])
    boxes = boxes_of(rows, repeat=False)
    assert len(boxes) == 4  # three spans of motion, and the place where it stays
    np.testing.assert_allclose(boxes[0], [1.0, 1.0, 1.0 + 3.0 * SPAN / 1.3, 1.0 + SPAN / 1.3])
    np.testing.assert_array_equal(boxes[-1], [4.0, 2.0, 4.0, 2.0])
    at = boxes.ctypes.data
    assert keeps_off(at, 4, 50.0, 0.0, (4.0, 3.2, 0.0, 0.0), 100.0, 1.0)
    assert not keeps_off(at, 4, 50.0, 0.0, (4.0, 2.8, 0.0, 0.0), 100.0, 1.0)
    assert not keeps_off(at, 4, -3.0, 0.0, (1.0, 1.8, 0.0, 0.0), 1.0, 1.0)
