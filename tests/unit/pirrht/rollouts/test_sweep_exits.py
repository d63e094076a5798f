"""Steps that are swept never pass through a wall, and judge as FCL does."""

from __future__ import annotations

import numpy as np
from rooms import walled as room

from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE, sweep_exit


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


def test_a_sweep_agrees_with_fcl_wherever_the_segment_is_not_grazing():
    space = room()
    arena = space.world
    rng = np.random.default_rng(6)
    exits = []
    for _ in range(1500):
        tail, head = rng.uniform(-0.2, 4.2, (2, 2))
        if not space.collision.free(tail[None])[0] or space.scene.goal.contains(tail):
            continue
        exit, share, _ = sweep_exit(arena, *tail, *head)
        exits.append(exit)
        line = tail + np.linspace(0, share if exit == GOAL else 1.0, 200)[:, None] * (head - tail)
        gap = space.collision.clearance(line).min()
        if gap > 0.01:
            assert exit != COLLISION
        if gap <= 0:
            assert exit == COLLISION
    assert min(exits.count(outcome) for outcome in (INSIDE, GOAL, COLLISION)) > 20


def test_a_sweep_of_a_step_that_turns_agrees_with_fcl_along_the_arc():
    """600 arcs along the wall of up to 1.5 m and 0.4 rad; where chord and arc differ in what they touch, it decides."""
    space = room()
    rng = np.random.default_rng(7)
    told_apart = 0
    for _ in range(600):
        tail, length = rng.uniform([1.8, 0.2], [2.2, 2.2]), rng.uniform(0.8, 1.5)
        turn = rng.uniform(0.2, 0.4) * rng.choice([-1.0, 1.0])
        theta = 0.5 * np.pi - 0.5 * turn + rng.normal(scale=0.02)
        headings = theta + turn * np.linspace(0.0, 1.0, 301)
        arc = tail + length / turn * np.stack(
            [np.sin(headings) - np.sin(theta), np.cos(theta) - np.cos(headings)], axis=-1
        )
        chord = tail + np.linspace(0.0, 1.0, 301)[:, None] * (arc[-1] - tail)
        if min(np.hypot(*(line - space.scene.goal.center).T).min() for line in (arc, chord)) < space.world.radius:
            continue
        gap, straight = (space.collision.clearance(line).min() for line in (arc, chord))
        if abs(gap) < 0.005:
            continue
        exit, _, _ = sweep_exit(space.world, *tail, *arc[-1], turn)
        assert exit == (INSIDE if gap > 0.0 else COLLISION)
        told_apart += (gap > 0.0) != (straight > 0.0)
    assert told_apart > 10
