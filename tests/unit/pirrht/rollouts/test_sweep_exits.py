"""Steps that are swept never pass through a wall, and judge as FCL does."""

from __future__ import annotations

import numpy as np
import pytest
from walled_room import room

from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE, sweep_exit


def test_a_sweep_never_passes_through_a_thin_wall():
    """2000 random segments across a wall of 2 cm, up to 4 m long, all of them longer than it is thick."""
    space = room()
    arena = space.world
    rng = np.random.default_rng(5)
    for _ in range(2000):
        tail, head = rng.uniform([0.01, 0.01], [1.9, 3.99]), rng.uniform([2.1, 0.01], [3.99, 3.99])
        if rng.random() < 0.5:
            tail, head = head, tail
        if space.scene.goal.contains(tail):
            continue
        exit, share, _ = sweep_exit(arena, *tail, *head)
        assert exit != INSIDE
        where = tail + share * (head - tail)
        if exit == COLLISION:
            assert space.collision.clearance(where[None])[0] < 0.02
        else:
            assert np.hypot(*(where - np.array(space.world.goal))) == pytest.approx(space.world.radius)


def test_a_path_that_remembers_its_room_ends_where_one_does_that_is_swept_step_by_step():
    """400 walks of steps up to 0.3 m that turn by up to 0.5 rad; they differ by 5 mm at a wall, or along it."""
    space = room()
    arena, rng, compared = space.world, np.random.default_rng(8), []
    for _ in range(400):
        at, theta, known = np.array([1.0, 2.0]), rng.uniform(-np.pi, np.pi), 0.0
        for _ in range(60):
            turn, length = rng.uniform(-0.5, 0.5), rng.uniform(0.02, 0.3)
            head = at + length * np.array([np.cos(theta + turn / 2), np.sin(theta + turn / 2)])
            found, share, known = sweep_exit(arena, *at, *head, turn, known)
            exit, wanted, _ = sweep_exit(arena, *at, *head, turn)
            assert known <= space.collision.clearance(head[None])[0] + 1e-9 or found != INSIDE
            if found != exit:
                way = at + np.linspace(0.0, 1.0, 200)[:, None] * (head - at)
                assert space.collision.clearance(way).min() < 0.005 + abs(turn) * length / 8.0
            elif exit == COLLISION:
                assert abs(share - wanted) * length < 0.005
            else:
                assert share == wanted
            compared.append(exit)
            if exit != INSIDE or found != INSIDE:
                break
            at, theta = head, theta + turn
    assert min(compared.count(outcome) for outcome in (GOAL, COLLISION)) > 20
