"""A controller among what scans show: obstacles come, split and merge, and classes keep their identity."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from trees import grown

from pirrht import Controller, FreeSpace, Goal, Mppi, Problem, Sampling, Scene, SingleIntegrator, StraightLine
from pirrht.control.mapped import Mapped
from pirrht.errors import NoReference, PirrhtError
from pirrht.mapping.scan import Scan
from pirrht.mapping.tracker import Track
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.rover import Rover
from pirrht.topology.driven import shift
from pirrht.topology.homology import Homology

TASK = {"lower": (0, 0), "upper": (6, 4), "start": (0.5, 2.0), "goal": (5.5, 2.0, 0.3), "robot_radius": 0.15}
START = np.array([0.5, 2.0])
GRAIN = 0.05


def mapped(*, unknown: float = 0.0, seed: int = 1, vertices: int = 200, **more) -> Mapped:
    """A puck that knows nothing yet."""
    scene = Scene.from_boxes(np.empty((0, 4)), **TASK)
    problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
    space = FreeSpace.of(scene, GRAIN)
    tree = grown(space, StraightLine.of(problem), vertices, limit=0.8)
    sampling = Sampling(samples=100)
    controller = Controller(problem, space, tree, sampling, rng=np.random.default_rng(seed), **more)
    return Mapped(controller, unknown=unknown)


def looked(boxes: list[list[float]], place: np.ndarray, rays: int = 2000) -> Scan:
    """A perfect scan of boxes x0, y0, x1, y1 all around."""
    angles = np.linspace(-np.pi, np.pi, rays, endpoint=False)
    along = np.column_stack([np.cos(angles), np.sin(angles)])
    ranges = np.full(rays, np.inf)
    for box in np.array(boxes):
        with np.errstate(divide="ignore"):
            low, high = (box[:2] - place) / along, (box[2:] - place) / along
        near, far = np.minimum(low, high).max(axis=1), np.maximum(low, high).min(axis=1)
        ranges = np.where((near <= far) & (near > 0.0), np.minimum(ranges, near), ranges)
    return Scan(pose=np.append(place, 0.0), angles=angles, ranges=ranges, most=30.0)


def look(policy: Mapped, boxes: list[list[float]], *places: tuple[float, float]) -> None:
    for place in places:
        policy.see(looked(boxes, np.array(place)))


CRATE = [2.5, 1.5, 3.0, 2.5]


def test_what_nobody_has_seen_is_free_and_a_scan_makes_two_classes_of_one():
    policy = mapped()
    policy.begin(START)
    assert len(policy.plan(START).ids) == 1
    look(policy, [CRATE], (0.5, 2.0))
    policy.observe(START[None], 0.0)
    found = policy.plan(START)
    assert len(found.ids) == 2
    assert not policy.space.free(np.array([2.52, 2.0]))
    assert policy.space.free(np.array([2.8, 2.0]))  # behind the face that was seen


def test_a_tree_that_holds_no_path_in_the_map_grows_until_it_does_or_is_four_times_as_large():
    gap, shut = [2.5, -0.1, 3.0, 3.3], [2.5, -0.1, 3.0, 4.1]
    policy = mapped(vertices=4)
    policy.begin(START)
    look(policy, [gap], (0.5, 2.0))
    assert policy.plan(START).fallback is None
    assert 4 < policy.tree.size <= 16

    policy.begin(START)
    look(policy, [shut], (0.5, 2.0))
    with pytest.raises(NoReference):
        policy.plan(START)
    assert policy.tree.size == 16


def test_a_begun_run_forgets_the_map():
    policy = mapped()
    policy.begin(START)
    look(policy, [CRATE], (0.5, 2.0))
    assert len(policy.plan(START).ids) == 2
    policy.begin(START)
    assert not policy.map.occupied.any()
    assert len(policy.plan(START).ids) == 1


def watched(dynamics: Dynamics, R: tuple[float, float]) -> Mapped:
    """MPPI of a system that knows nothing yet."""
    scene = Scene.from_boxes(np.empty((0, 4)), **{**TASK, "start": (0.5, 2.0, 0.0)})
    problem = Problem(dynamics=dynamics, scene=scene, R=np.diag(R))
    sampling = Sampling(samples=10, guide="open-loop")
    found = Mapped(Mppi(problem, FreeSpace.of(scene), sampling, horizon=0.3, rng=np.random.default_rng(0)))
    found.begin(problem.dynamics.state_of(scene.start))
    return found


def test_robots_that_turn_on_the_spot_look_where_they_reverse_and_others_need_not():
    puck = watched(SingleIntegrator(b=0.1), R=(2.0, 2.0))
    look(puck, [CRATE], (0.5, 2.0))
    assert puck.controller.blind is None

    before = watched(Rover(b=0.05), R=(2.0, 0.5))
    after = watched(Rover(b=0.05), R=(2.0, 0.5))
    look(before, [CRATE], (0.5, 2.0))
    assert before.controller.blind.scan is before._last
    assert after.controller.blind.scan is None
    after.go_on(before)
    assert after.controller.blind.grid is after.map is before.map


def passes_above(plan, name: str, x: float, y: float) -> bool:
    """Whether the way of a class passes above a place."""
    path = np.vstack(dict(zip(plan.ids, plan.references, strict=True))[name].trajectory.path.points(0.02))
    return float(np.interp(x, path[:, 0], path[:, 1])) > y


def test_names_of_classes_stay_with_their_ways_while_the_other_sides_of_obstacles_are_seen():
    policy = mapped()
    policy.begin(START)
    look(policy, [CRATE], (0.5, 2.0))
    first = policy.plan(START)
    above = {name: passes_above(first, name, 2.75, 2.0) for name in first.ids}
    assert sorted(above.values()) == [False, True]
    for place in [(1.5, 3.5), (2.8, 3.5), (4.0, 2.0), (2.8, 0.5)]:
        look(policy, [CRATE], place)
        policy.observe(START[None], 0.01)
        plan = policy.plan(START)
        assert {name: passes_above(plan, name, 2.75, 2.0) for name in plan.ids[:2]} == above


def test_a_wall_that_turns_out_to_have_a_gap_splits_and_old_names_go_on():
    policy = mapped()
    policy.begin(START)
    low, high = [2.5, 1.0, 2.7, 1.7], [2.5, 2.3, 2.7, 3.0]
    look(policy, [low, [2.5, 1.7, 2.7, 2.3], high], (0.5, 2.0))
    whole = policy.plan(START)
    above = {name: passes_above(whole, name, 2.6, 2.0) for name in whole.ids}
    assert len(above) == 2
    for _ in range(6):
        look(policy, [low, high], (0.5, 2.0), (0.6, 2.0))
    policy.observe(START[None], 0.01)
    split = policy.plan(START)
    assert len(split.ids) == 3
    ways = {name: passes_above(split, name, 2.6, 2.65) for name in split.ids}
    upper = next(name for name, is_above in above.items() if is_above)
    heirs = [name for name, is_above in ways.items() if is_above]
    assert heirs == [upper]
    below = next(name for name, is_above in above.items() if not is_above)
    assert sorted(name for name in split.ids if name != upper) == [below, f"{below},1"]  # through the gap, and below it


def test_a_marker_that_moves_within_its_wall_changes_no_turns_of_paths_around_the_wall():
    """Against turns by angle about both markers of random paths that stay off the segment between them."""
    rng = np.random.default_rng(4)
    goal = np.array([5.0, 0.0])
    judged = 0
    for _ in range(300):
        one, other, x = rng.uniform(-1.0, 1.0, 2), rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0, 2)
        path = np.vstack([x, rng.uniform(-4.0, 4.0, (3, 2)), goal])
        homologies = [Homology(markers=marker[None], goal=goal) for marker in (one, other)]
        segments = zip(path[:-1], path[1:], strict=True)
        if any(crosses(a, b, one, other) for a, b in segments):
            continue
        judged += 1
        about = [int(homology.along(path)[0]) for homology in homologies]
        assert about[1] - about[0] == shift(one, other, x, goal)
    assert judged > 100


def crosses(a, b, c, d) -> bool:
    """Whether two segments cross."""

    def side(p, q, r) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0


def cover_the_goal(policy: Mapped) -> None:
    block = [5.0, 1.5, 6.0, 2.5]
    sides = [(4.0, 2.0), *((x, y) for x in np.arange(5.0, 6.0, 0.2) for y in (1.0, 3.0))]
    look(policy, [block], *sides)
    policy.map._odds[30:50, 102:120] = 1.0  # and its inside
    policy.map.version += 1
    policy.observe(START[None], 0.01)


def test_the_robot_waits_while_the_map_covers_its_goal():
    policy = mapped()
    policy.begin(START)
    policy.plan(START)
    space = policy.space
    cover_the_goal(policy)
    plan = policy.plan(START)
    assert plan.fallback == "no reference"
    assert np.hypot(*plan.control) < 0.2
    assert policy.space is space
    policy.map._odds[:] = 0.0  # it is taken away
    policy.map.version += 1
    policy.observe(START[None], 0.01)
    assert policy.plan(START).fallback is None


def test_a_robot_that_waits_while_its_goal_is_covered_gives_way_no_faster_than_it_can_stop():
    """Next to a wall it moves off, and at a deceleration of nearly none every way leads into something."""
    speeds = []
    for deceleration in (0.0, 100.0, 0.01):
        policy = mapped(deceleration=deceleration)
        policy.begin(START)
        look(policy, [[0.0, 2.2, 1.5, 2.3], [0.0, 1.2, 1.5, 1.3]], START)
        policy.plan(START)
        cover_the_goal(policy)
        plan = policy.plan(START)
        assert plan.fallback == "no reference"
        speeds.append(np.hypot(*plan.control))
    assert speeds[0] > 0.3
    assert speeds[1] == pytest.approx(speeds[0])
    assert speeds[2] < 0.5 * speeds[0]


def test_moving_obstacles_are_predicted_anew_only_after_a_scan_or_in_another_map():
    policy = mapped()
    policy.begin(START)
    place = np.array([4.0, 3.0, 0.0, -0.2])
    policy.tracks.known = [
        Track(number=1, state=place, cov=np.eye(4), radius=0.2, origin=place[:2], born=0.0, seen=0.0, moves=True)
    ]
    integrals = list[object]()
    for shown in (None, None, [], None, [CRATE], None):  # seen before each plan
        if shown is not None:
            policy.see(replace(looked(shown, START), time=0.1))
        policy.observe(START[None], 0.01)
        plan = policy.plan(START)
        assert [mover.name for mover in plan.movers] == ["track 1"]
        assert policy.space.scene.movers == plan.movers
        integrals.append(policy.path_integral)
    assert [one is other for one, other in pairwise(integrals)] == [True, False, True, False, True]


def test_a_metre_that_nobody_has_seen_costs_what_it_is_said_to():
    free, costly = mapped(), mapped(unknown=0.05)
    plans = []
    for policy in (free, costly):
        policy.begin(START)
        look(policy, [CRATE], (0.5, 2.0), (1.5, 3.5))  # what lies above has been seen
        policy.map._seen[:40] = False
        plans.append(policy.plan(START))
    one, other = plans
    unseen = {
        name: costly.map.unseen_length(reference.trajectory.points)
        for name, reference in zip(other.ids, other.references, strict=True)
    }
    assert max(unseen.values()) > 1.0
    weight = one.estimate.class_weights
    charged = {name: weight[name] * np.exp(-0.05 * unseen[name] / costly.problem.temperature) for name in unseen}
    expected = {name: value / sum(charged.values()) for name, value in charged.items()}
    assert other.estimate.class_weights == pytest.approx({**expected, "other": 0.0}, abs=0.02)


def test_equal_seeds_and_scans_give_equal_plans():
    plans = []
    for _ in range(2):
        policy = mapped()
        policy.begin(START)
        look(policy, [CRATE], (0.5, 2.0))
        plans.append(policy.plan(START))
    assert plans[0].estimate.value == plans[1].estimate.value


def test_a_coarse_space_claims_no_more_clearance_than_there_is():
    rng = np.random.default_rng(3)
    boxes = np.array(
        [[x, y, x + w, y + h] for x, y, w, h in rng.uniform((1, 0, 0.1, 0.1), (5, 3.5, 0.6, 0.6), (12, 4))]
    )
    scene = Scene.from_boxes(
        boxes, **{**TASK, "goal": Goal(center=np.array([5.9, 3.9]), radius=0.3), "start": (0.3, 0.3)}
    )
    coarse, exact = FreeSpace.of(scene, GRAIN), FreeSpace.of(scene)
    places = rng.uniform((0.1, 0.1), (5.9, 3.9), (2000, 2))
    claimed = np.array([coarse.static.kernels.clearance(coarse.static, tuple(place)) for place in places.tolist()])
    known = np.array([exact.clearance(place) for place in places])
    outside = known > -0.1  # inside of a solid distances are not known
    assert np.max(claimed[outside] - known[outside]) < 1e-6
    assert np.mean(np.abs(claimed - known)[(known > 0.1) & (known < 0.8)]) < 0.5 * GRAIN
    assert not any(coarse.free(place) and not exact.free(place) for place in places)


def test_a_map_of_another_goal_is_refused():
    policy = mapped()
    with pytest.raises(PirrhtError, match="keeps the goal"):
        policy.controller.update(Scene.from_boxes(np.empty((0, 4)), **{**TASK, "goal": (5.0, 1.0, 0.3)}))
