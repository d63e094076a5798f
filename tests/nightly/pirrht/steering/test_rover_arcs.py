"""Arcs of a rover: the cost chooses speed and radius, the nearest are found, and paths are driven as they are told."""

from __future__ import annotations

import numpy as np
import pytest
from discs import disc, scene_of

from pirrht import FreeSpace, HomologyTree, OptionError, Problem, Unicycle
from pirrht.shortening.shorten import polish
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.rover import RADII, RoverSteering
from pirrht.steering.trajectory import running_cost
from pirrht.systems.rover import Rover

STEERING = RoverSteering(q=1.3, r_v=2.0, r_w=0.5)
SCENE = scene_of([disc("post", 3.0, 3.1, 0.5)], start=(0.6, 3.0), goal=(5.4, 3.0))
R = np.diag([2.0, 0.5])


def poses(count: int, seed: int, side: float = 3.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0.0, side, (count, 2)), rng.uniform(-np.pi, np.pi, count)])


def problem(b: float = 0.1) -> Problem:
    return Problem(dynamics=Rover(b=b), scene=SCENE, R=R)


def test_straight_ahead_it_drives_at_the_speed_that_balances_time_and_effort():
    tail, head = np.array([[0.0, 0.0, 0.3]]), np.array([[2.0 * np.cos(0.3), 2.0 * np.sin(0.3), 0.3]])
    found = STEERING.trajectory(STEERING.connect(tail, head))
    driven = found.controls[found.durations > 1e-9]  # turns are rounding
    np.testing.assert_allclose(driven, [[np.sqrt(2.0 * 1.3 / 2.0), 0.0]], atol=1e-9)
    assert found.cost == pytest.approx(2.0 * np.sqrt(2.0 * 1.3 * 2.0))


@pytest.mark.parametrize("seed", range(4))
def test_a_path_costs_what_its_controls_cost_and_no_other_speed_costs_less(seed):
    tails, heads = poses(1, seed), poses(1, seed + 50)
    found = STEERING.trajectory(STEERING.connect(tails, heads))
    weights = 0.5 * np.array([2.0, 0.5])

    def cost(share: float) -> float:
        u = share * found.controls
        return float(np.sum((1.3 + u**2 @ weights) * found.durations / share))

    assert found.cost == pytest.approx(cost(1.0), rel=1e-9)
    assert cost(1.0) < min(cost(0.95), cost(1.05))


@pytest.mark.parametrize("seed", range(4))
def test_the_controls_drive_along_the_path_to_its_end(seed):
    tails, heads = poses(1, seed), poses(1, seed + 50)
    found, x = STEERING.trajectory(STEERING.connect(tails, heads)), tails[0].copy()
    for (v, w), T in zip(found.controls, found.durations, strict=True):
        h = T / 2000
        for _ in range(2000):
            x = x + h * np.array([v * np.cos(x[2] + 0.5 * h * w), v * np.sin(x[2] + 0.5 * h * w), w])
    np.testing.assert_allclose(x[:2], heads[0, :2], atol=1e-5)
    assert np.cos(x[2] - heads[0, 2]) == pytest.approx(1.0, abs=1e-9)


def test_no_motion_is_cheaper_than_straight_there_while_turning_evenly():
    tails, heads = poses(400, 1), poses(400, 2)
    cost = STEERING.distance(tails, heads)
    gap, turn = heads - tails, np.remainder(heads[:, 2] - tails[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    least = np.sqrt(2.0 * 1.3 * (2.0 * np.sum(gap[:, :2] ** 2, axis=1) + 0.5 * turn**2))
    assert np.all(cost > least * (1.0 - 1e-12))
    np.testing.assert_allclose(STEERING.connect(tails, heads).cost, cost, rtol=1e-12)


def test_a_turn_is_all_but_on_the_spot_where_the_way_leads_back():
    path = STEERING.connect(np.array([[0.0, 0.0, 0.0]]), np.array([[-1.0, 0.0, np.pi]]))
    assert np.abs(path.curvature).max() == pytest.approx(1.0 / (RADII[0] * 0.5))
    assert path.cost[0] < np.sqrt(5.2) + (np.pi + 0.3) * np.sqrt(1.3)


@pytest.mark.parametrize("forward", [True, False])
def test_the_nearest_are_those_that_cost_least(forward):
    states, x = poses(300, 3), poses(1, 4)[0]
    cost = STEERING.distance(x, states) if forward else STEERING.distance(states, x)
    found = STEERING.nearest(states, x, 12, forward=forward)
    np.testing.assert_array_equal(found, np.argsort(cost, kind="stable")[:12])


def test_a_path_into_the_goal_is_paid_for_up_to_its_rim_piece_by_piece():
    space = FreeSpace.of(SCENE)
    steering = RoverSteering.of(problem())
    tail, head = np.array([[5.0, 2.0, 0.0]]), np.array([[5.4, 3.0, 2.0]])
    motions = steering.connect(tail, head)
    edges = EdgeChecker(space=space, motion=steering.motion).inspect(motions, np.array([True]))
    cut = EdgeChecker(space=space, motion=steering.motion).until_goal(motions)
    assert edges.cost[0] == pytest.approx(cut.cost[0], rel=1e-12)
    assert cut.cost[0] == pytest.approx(np.sum(np.sqrt(4.0 + cut.curvature**2) * cut.length))
    assert cut.length.sum() < motions.length.sum() - 0.05


def test_references_lead_around_both_sides_and_shortening_keeps_the_class_and_costs_no_more():
    space, posed = FreeSpace.of(SCENE), problem()
    steering = RoverSteering.of(posed)
    tree = HomologyTree(space, steering, limit=0.8, rng=np.random.default_rng(0))
    tree.grow(250)
    x = np.array([0.6, 3.0, 0.0])
    rough, taut = ({r.winding: r for r in tree.references(x, polished=p)} for p in (False, True))
    assert len(taut) >= 2
    assert set(taut) == set(rough)
    for winding, reference in taut.items():
        assert reference.cost <= rough[winding].cost * (1.0 + 1e-9)
        assert running_cost(posed, x, reference.trajectory) == pytest.approx(reference.cost, rel=1e-9)
        assert space.collision.clearance(reference.trajectory.points).min() > -1e-3
    again = polish(rough[min(rough)].trajectory.path, steering, space)
    assert again.cost.sum() <= rough[min(rough)].cost


def test_what_it_cannot_steer_is_refused_by_name():
    with pytest.raises(OptionError, match=r"^a rover's arcs steer a Rover, not Unicycle; bring a Steering$"):
        RoverSteering.of(Problem(dynamics=Unicycle(), scene=SCENE, R=np.eye(1)))
    with pytest.raises(OptionError, match=r"^r_w is -1; it must be a positive number$"):
        RoverSteering(r_w=-1.0)
    with pytest.raises(OptionError, match=r"^turning is 0; it must be a positive number$"):
        Rover(turning=0.0)
