"""Paths in space and time that are pulled taut, against closed forms, dynamic programming and models by differences."""

from __future__ import annotations

import numpy as np
import pytest
from moving import SCENES, hall

from pirrht.freespace import FreeSpace
from pirrht.planner.shorten import resume, shorten
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.in_time import InTime
from pirrht.steering.motion import Legs
from pirrht.topology.homology import Homology

STEERING = InTime()


def taut(space: FreeSpace, knots: np.ndarray, steering: InTime = STEERING) -> np.ndarray:
    """Knots of the shortened path."""
    path = EdgeChecker.of(space, steering).until_goal(steering.connect(knots[:-1], knots[1:]))
    return np.asarray(shorten(path, steering, EdgeChecker.of(space, steering)).knots)


def cost_of(knots: np.ndarray) -> float:
    step = np.diff(knots, axis=0)
    return float(np.sum(step[:, 2] + (step[:, 0] ** 2 + step[:, 1] ** 2) / step[:, 2]))


def test_with_nothing_in_the_way_a_crooked_path_becomes_the_straight_one_at_the_best_speed():
    knots = np.array([[1.0, 2.5, 0.0], [1.2, 4.0, 2.0], [3.0, 1.0, 5.0], [4.0, 2.0, 5.6], [5.5, 2.5, 9.0]])
    found = taut(FreeSpace.of(hall("empty", [])), knots)
    assert cost_of(found) == pytest.approx(2.0 * 4.2, rel=1e-4)
    assert found[-1] == pytest.approx([5.2, 2.5, 4.2], abs=0.02)


def least_cost(space: FreeSpace, side: int, x0: float, width: float) -> float:
    """Dynamic programming in space and time past one body that crosses, on one side of it.

    A path is two straight ways at constant speeds with a short stretch beside the body's column in between, whose
    places and times are all tried: a bound from above that is as fine as the grid.
    """
    crosser = space.scene.movers[0].motion
    start, goal = np.array([1.0, 2.5]), np.array([5.5, 2.5])
    xs = np.linspace(x0, x0 + width, 25)
    times = np.linspace(1.4, 3.4, 201)
    ys = np.linspace(-0.9, 0.9, 361)
    best = np.full((len(times), len(ys)), np.inf)
    X, T, Y = xs[0], times[:, None], ys[None, :] + 2.5
    best = T + ((X - start[0]) ** 2 + (Y - start[1]) ** 2) / T
    best = np.where(_free(crosser, X, Y, T, side), best, np.inf)
    for x in xs[1:]:
        new = np.full_like(best, np.inf)
        dx = x - X
        for dk in range(1, 16):
            dt = dk * (times[1] - times[0])
            for dy_k in range(-6, 7):
                dy = dy_k * (ys[1] - ys[0])
                moved = np.full_like(best, np.inf)
                rows = slice(dk, None), slice(max(dy_k, 0), len(ys) + min(dy_k, 0))
                from_ = slice(0, -dk), slice(max(-dy_k, 0), len(ys) + min(-dy_k, 0))
                moved[rows] = best[from_] + dt + (dx * dx + dy * dy) / dt
                new = np.minimum(new, moved)
        X = x
        best = np.where(_free(crosser, X, Y, T, side), new, np.inf)
    rest = 2.0 * (np.hypot(goal[0] - X, goal[1] - Y) - 0.3)
    return float(np.min(best + rest))


def _free(crosser, x: float, y: np.ndarray, t: np.ndarray, side: int) -> np.ndarray:
    """Whether a place is free of the disc, and not on its other side."""
    pose = crosser.pose(t[:, 0])
    dy = y - pose[:, 1:2]
    return (np.hypot(x - pose[:, :1], dy) >= 0.4) & (side * dy >= 0.0)


@pytest.mark.parametrize(("side", "winding", "via"), [(1, (0,), (3.25, 3.1, 2.2)), (-1, (1,), (3.25, 2.0, 2.6))])
def test_before_and_behind_cost_what_dynamic_programming_finds(side, winding, via):
    space = FreeSpace.of(SCENES["crossing"]())
    found = taut(space, np.array([[1.0, 2.5, 0.0], via, [5.5, 2.5, 5.0]]))
    ways: Homology = STEERING.homology(space)
    assert ways.winding(found) == winding
    truth = least_cost(space, side, 2.85, 0.8)
    assert cost_of(found) == pytest.approx(truth, rel=4e-3)
    assert cost_of(found) > 2.0 * 4.2


def later(via: tuple[float, float, float], aside: tuple[float, float]) -> tuple[FreeSpace, Legs, np.ndarray]:
    """`crossing`, a taut path over a place and a time, and where a robot is that was put aside on it a little later."""
    space = FreeSpace.of(SCENES["crossing"]())
    knots = np.array([[1.0, 2.5, 0.0], via, [5.5, 2.5, 5.0]])
    path = shorten(
        EdgeChecker.of(space, STEERING).until_goal(STEERING.connect(knots[:-1], knots[1:])),
        STEERING,
        EdgeChecker.of(space, STEERING),
    )
    place = [np.interp(0.4, path.knots[:, 2], path.knots[:, k]) for k in (0, 1)]
    return space, path, np.array([*np.add(place, aside), 0.4])


@pytest.mark.parametrize("via", [(3.25, 3.1, 2.2), (3.25, 2.0, 2.6)])
@pytest.mark.parametrize("aside", [(0.0, 0.0), (-0.02, 0.03)])
def test_a_path_that_goes_on_from_an_earlier_one_is_as_good_as_one_made_anew(via, aside):
    space, path, x = later(via, aside)
    checker = EdgeChecker.of(space, STEERING)
    found = resume(x, path, STEERING, checker)
    anew = taut(space, np.vstack([x, path.knots[path.knots[:, 2] > 0.5]]))
    assert np.array_equal(found.knots[0], x)
    assert checker.inspect(found, np.arange(len(found.cost)) == len(found.cost) - 1).free.all()
    homology = STEERING.homology(space)
    assert homology.winding(found.knots) == homology.winding(anew)
    assert found.cost.sum() == pytest.approx(cost_of(anew), rel=2e-3)
