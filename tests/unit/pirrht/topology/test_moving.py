"""Turns about moving obstacles, by fine angles and edge by edge, and the classes that follow from them."""

from dataclasses import replace

import numpy as np
import pytest
from discs import block, disc
from moving import SCENES, hall, moved

from pirrht import FreeSpace, Homology
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Footprint, Scene
from pirrht.steering.in_time import InTime
from pirrht.steering.motion import copied
from pirrht.topology.tracks import markers_of

FOOT = Footprint.disc(0.1)
GOAL = np.array([5.5, 2.5])


def homology(*movers: Mover) -> Homology:
    return Homology(markers=np.zeros((0, 2)), goal=GOAL).with_moving(movers, FOOT)


def wanderer(seed: int, repeat: bool = False) -> Mover:
    rng = np.random.default_rng(seed)
    rows = np.column_stack([np.cumsum(rng.uniform(0.2, 0.9, 6)), rng.uniform(0.5, 4.5, (6, 2)), rng.uniform(-4, 4, 6)])
    rows[0, 0] = 0.0
    if repeat:
        rows[-1, 1:] = rows[0, 1:]
    return moved("wanderer", rows, disc("disc", 0.6, 0.2, 0.2), repeat=repeat)


def path_of(seed: int, count: int = 9) -> np.ndarray:
    rng = np.random.default_rng([seed, 1])
    times = np.concatenate([[0.3], 0.3 + np.cumsum(rng.uniform(0.0, 0.8, count - 1))])
    return np.column_stack([rng.uniform(0.0, 5.0, (count, 2)), times])


def fine(path: np.ndarray, mover: Mover, point: np.ndarray) -> float:
    """The sum of many small angles seen from a point of a body [turns]."""
    t = np.linspace(path[0, 2], path[-1, 2], 400_001)
    x, y = (np.interp(t, path[:, 2], path[:, k]) for k in (0, 1))
    pose = mover.motion.pose(t)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    dx = x - pose[:, 0] - c * point[0] + s * point[1]
    dy = y - pose[:, 1] - s * point[0] - c * point[1]
    cross, dot = dx[:-1] * dy[1:] - dy[:-1] * dx[1:], dx[:-1] * dx[1:] + dy[:-1] * dy[1:]
    return float(np.sum(np.arctan2(cross, dot)) / 2 / np.pi)


@pytest.mark.parametrize("repeat", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_turns_are_the_sum_of_small_angles_seen_from_the_moving_marker(seed, repeat):
    """The marker is off the body's origin and turns with it: its way is replaced by chords within its shape.

    So at its ends a path is seen from a place a little off, but never on another side.
    """
    mover, path = wanderer(seed, repeat), path_of(seed)
    ways, (point,) = homology(mover), markers_of(mover, FOOT)
    assert point == pytest.approx([0.6, 0.2], abs=1e-3)
    assert ways.turns(path)[0] == pytest.approx(fine(path, mover, point), abs=0.01)
    late = replace(mover, motion=mover.motion.after(0.45))
    assert homology(late).turns(path)[0] == pytest.approx(fine(path, late, point), abs=0.01)


@pytest.mark.parametrize("seed", range(8))
def test_paths_with_equal_ends_differ_by_whole_turns_whenever_they_arrive(seed):
    """Closed by waiting at the goal until both are there."""
    ways = homology(wanderer(seed), wanderer(seed + 50, repeat=True))
    early, late = path_of(seed), path_of(seed + 100, 14)
    late[0] = early[0]
    early[-1, :2] = late[-1, :2] = GOAL
    until = max(early[-1, 2], late[-1, 2])
    whole = [ways.turns(np.vstack([path, [*GOAL, until]])) for path in (early, late)]
    difference = whole[0] - whole[1]
    assert difference == pytest.approx(np.rint(difference), abs=1e-9)
    assert np.array_equal(np.subtract(ways.winding(early), ways.winding(late)), np.rint(difference))


def test_solids_of_a_body_that_touch_are_one_obstacle_and_others_are_two():
    one = moved("one", [(0.0, 1.0, 1.0, 0.0)], disc("disc", 0.0, 0.0, 0.2), block("box", 0.3, 0.0, (0.2, 0.1)))
    two = moved("two", [(0.0, 1.0, 1.0, 0.0)], disc("disc", 0.0, 0.0, 0.2), block("box", 0.9, 0.0, (0.2, 0.1)))
    assert markers_of(one, FOOT) == pytest.approx(np.array([[0.0, 0.0]]), abs=1e-3)
    assert len(markers_of(two, FOOT)) == 2
    assert homology(one, two).names == ("one", "two", "two")


STEERING = InTime()


def busy(seed: int) -> Scene:
    """Bodies that go anywhere, also over the goal, one of which starts over and one that jumps when it does."""
    rng, movers = np.random.default_rng(seed), []
    for k in range(5):
        times = np.cumsum(rng.uniform(0.3, 1.2, 6)) - 0.3
        rows = np.column_stack([times - times[0], rng.uniform(0.2, 4.8, (6, 2)), rng.uniform(-4.0, 4.0, 6)])
        if k == 3:
            rows[-1, 1:] = rows[0, 1:]
        solid = disc("disc", 0.3, 0.1, 0.2) if k == 1 else disc("disc", 0.0, 0.0, 0.2)
        movers.append(moved(f"body{k}", rows, solid, repeat=k >= 3))
    movers[0] = replace(movers[0], motion=movers[0].motion.after(0.7))
    return hall("busy", movers, [block("block", 2.0, 2.2, (0.2, 0.3)), disc("post", 4.0, 3.6, 0.3)])


def random_path(rng: np.random.Generator, count: int = 7) -> np.ndarray:
    """Knots whose times grow; the last one is on the rim of the goal's disc."""
    knots = np.column_stack([rng.uniform(0.2, 4.8, (count, 2)), np.cumsum(rng.uniform(0.1, 1.0, count))])
    angle = rng.uniform(0.5 * np.pi, 1.5 * np.pi)
    knots[-1, :2] = np.array([5.5, 2.5]) + 0.299 * np.array([np.cos(angle), np.sin(angle)])
    return knots


def summed_turns(space: FreeSpace, knots: np.ndarray) -> tuple[int, ...]:
    """What the edges of a path add, whether they are free or not."""
    homology, checker = STEERING.homology(space), STEERING.checker(space)
    legs = STEERING.connect(knots[:-1], knots[1:])
    record, total = copied(legs), np.zeros(homology.M, dtype=int)
    marker, turn = np.empty(homology.M, np.int32), np.empty(homology.M, np.int16)
    for i in range(len(legs.cost)):
        count = checker.kernels.pairs(record, i, checker.around, i == len(legs.cost) - 1, marker, turn, 0)
        np.add.at(total, marker[:count], turn[:count])
    return tuple(total.tolist())


@pytest.mark.parametrize("scene", [*SCENES.values(), *(lambda k=k: busy(k) for k in range(6))])
def test_turns_of_edges_sum_to_the_winding_of_the_path(scene):
    space, rng = FreeSpace.of(scene()), np.random.default_rng(5)
    homology, seen = STEERING.homology(space), set()
    for _ in range(60):
        knots = random_path(rng)
        assert summed_turns(space, knots) == homology.winding(knots)
        seen.add(homology.winding(knots))
    assert len(seen) > 2


def test_the_signature_of_a_base_is_that_of_no_whole_turn_and_classes_add_to_it():
    space = FreeSpace.of(SCENES["oblique"]())
    homology, start = STEERING.homology(space), np.array([1.0, 2.5, 0.0])
    assert homology.M == 1 + homology.J == 4
    base = homology.signature(start, (0, 0, 0, 0))
    legs = np.array([start, [*homology.goal, homology.arrival(start)]])
    assert base[1:] == pytest.approx(1.0 + homology.turns(legs)[1:])
    assert base[:1] == pytest.approx(space.homology.static.signature(start, (0,)))
    assert homology.signature(start, (1, 0, -2, 0)) == pytest.approx(base + np.array([1, 0, -2, 0]))
