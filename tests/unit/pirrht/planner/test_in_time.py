"""Trees and taut paths in space and time, against closed forms, dynamic programming and FCL."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from discs import disc
from moving import SCENES, hall, moved
from spaces import guarded
from trees import grown

from pirrht import FreeSpace, HomologyTree, OptionError, Problem, Reference
from pirrht.moving.collision import MovingObstacles
from pirrht.steering.in_time import InTime
from pirrht.steering.motion import Legs
from pirrht.systems.ball import Ball
from sim.tree_file import load, save

START = np.array([1.0, 2.5, 0.0])
WAYS = {"crossing": ["0", "1"], "closing_door": ["0,0", "-1,0"], "pincer": ["0,0", "1,0", "0,-1"]}  # that matter


def in_time(space: FreeSpace, seed: int, vertices: int = 250) -> HomologyTree:
    return grown(space, InTime(), vertices, seed=seed)


def collides(space: FreeSpace, found: Reference) -> bool:
    """What FCL says of the whole path."""
    crowd, path = MovingObstacles(space.scene.movers, space.scene.footprint), found.path.path
    moving = any(crowd.meets(row[:2], float(row[2]), row[3:5], float(row[5])) for row in path)
    return moving or not space.collision.segments_free(path[:, :2], path[:, 3:5]).all()


@pytest.mark.parametrize("name", WAYS)
def test_all_ways_past_are_found_whatever_the_seed_and_cost_the_same(name):
    """Before and behind; through the gap and around; between, below and above: within a hundredth, at 20 seeds."""
    space, costs = FreeSpace.of(SCENES[name]()), []
    for seed in range(20):
        found = {one.id: one.cost for one in in_time(space, seed, 200).references(START)}
        costs.append([found[way] for way in WAYS[name]])
    assert np.all(np.ptp(costs, axis=0) < 0.012 * np.min(costs, axis=0))


def test_no_state_is_too_fast_for_a_tree_whose_vertices_have_no_speed():
    space = FreeSpace.of(SCENES["crossing"]())
    assert not HomologyTree(space, InTime(), limit=0.8, rng=np.random.default_rng(0)).too_fast(START[:2])


@pytest.mark.slow
def test_references_in_space_are_free_of_what_moves_and_wait_or_hurry_for_it():
    """Of the tree and shortened; FCL judges; the straight path at the best speed is blocked."""
    space = FreeSpace.of(guarded())
    problem = Problem(dynamics=Ball(b=0.2), scene=space.scene, R=2.0 * np.eye(3))
    tree = grown(space, InTime.of(problem), 500, limit=1.0)
    start = tree.at(space.scene.start, 0.0)
    crowd = MovingObstacles(space.scene.movers, space.scene.footprint)
    assert crowd.meets(start[:3], 0.0, space.scene.goal.center, 4.4)
    plain = tree.references(start, shortened=False)
    short = tree.references(start)
    assert {one.id for one in short} == {one.id for one in plain} == {"0", "-1"}
    for one in (*plain, *short):
        path, knots = one.path.path, one.path.knots
        assert knots[0] == pytest.approx(start)
        assert np.linalg.norm(knots[-1, :3] - space.scene.goal.center) == pytest.approx(0.3, abs=2e-3)
        assert space.collision.segments_free(path[:, :3], path[:, 4:7]).all()
        assert not any(crowd.meets(row[:3], float(row[3]), row[4:7], float(row[7])) for row in path)
        assert np.linalg.norm(np.diff(knots[:, :3], axis=0), axis=1) / np.diff(knots[:, 3]) == pytest.approx(
            np.linalg.norm(one.trajectory.controls, axis=1)
        )
        assert tree.homology.winding(knots) == one.winding
    best = {one.id: one.cost for one in plain}
    assert all(one.cost <= best[one.id] for one in short)
    assert 8.2 < short[0].cost < 9.0  # 4.1 m cost 8.2 unhindered


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("shortened", [True, False])
def test_references_are_free_forward_in_time_and_of_the_class_they_are_named_after(name, shortened):
    space = FreeSpace.of(SCENES[name]())
    tree = in_time(space, 3)
    references = tree.references(START, shortened=shortened)
    for one in references:
        knots = one.path.knots
        assert knots[0] == pytest.approx(START)
        assert np.hypot(*(knots[-1, :2] - space.scene.goal.center)) == pytest.approx(0.3, abs=2e-3)
        assert np.all(np.diff(knots[:, 2]) > 0.0)
        speed = np.hypot(*np.diff(knots[:, :2], axis=0).T) / np.diff(knots[:, 2])
        assert speed.max() <= tree.steering.limit * (1.0 + 1e-6)
        assert tree.homology.winding(knots) == one.winding
        assert one.signature == pytest.approx(tree.homology.signature(START, one.winding))
        assert np.all(np.abs(1.0 - one.signature) <= tree.limit)
        assert not collides(space, one)
        durations = one.trajectory.durations
        assert one.cost == pytest.approx(np.sum((1.0 + speed**2) * np.diff(knots[:, 2])))
        assert START[:2] + one.trajectory.controls.T @ durations == pytest.approx(knots[-1, :2])
    assert [one.cost for one in references] == sorted(one.cost for one in references)
    assert len({one.winding for one in references}) == len(references)


def test_where_nothing_moves_the_best_way_is_the_taut_line_at_the_best_speed():
    found = in_time(FreeSpace.of(hall("standing", [], [disc("post", 3.0, 2.6, 0.4)])), 0, 400).references(START)
    assert {one.id for one in found} == {"0", "1"} or {one.id for one in found} == {"0", "-1"}
    a, b, c = np.array([1.0, 2.5]), np.array([3.0, 2.6]), np.array([5.5, 2.5])
    reach = [np.sqrt(np.sum((p - b) ** 2) - 0.25) for p in (a, c)]
    angle = np.arctan2(*(a - b)[::-1]) - np.arctan2(*(c - b)[::-1])
    bend = abs(angle) % (2 * np.pi) - sum(np.arctan2(r, 0.5) for r in reach)
    below = [2 * np.pi - abs(angle) % (2 * np.pi) - sum(np.arctan2(r, 0.5) for r in reach), bend]
    lengths = sorted(sum(reach) + 0.5 * max(turn, 0.0) - 0.3 for turn in below)
    assert found[0].cost == pytest.approx(2.0 * lengths[0], rel=3e-3)


def test_far_bodies_do_not_multiply_the_classes_that_count():
    """Twelve bodies that circle in the corners change neither the best ways nor their order."""
    crossing, rng = SCENES["crossing"](), np.random.default_rng(0)
    corners = [(0.4, 0.4), (5.6, 0.4), (0.4, 4.6), (5.6, 4.6)]
    far = []
    for k in range(12):
        spots = np.array(corners[k % 4]) + rng.normal(0.0, 0.1, (5, 2))
        far.append(
            moved(f"far{k}", np.column_stack([np.arange(5) * 0.8, spots, np.zeros(5)]), disc("disc", 0.0, 0.0, 0.1))
        )
    alone = in_time(FreeSpace.of(crossing), 0, 300).references(START)
    found = in_time(FreeSpace.of(replace(crossing, movers=(*crossing.movers, *far))), 0, 300).references(START)
    assert [one.winding for one in found[:2]] == [(w, *[0] * 12) for (w,) in (alone[0].winding, alone[1].winding)]
    assert [one.cost for one in found[:2]] == pytest.approx([one.cost for one in alone], rel=2e-3)


def test_a_tree_in_time_comes_back_from_a_file_and_only_among_the_same_bodies():
    space, kept = FreeSpace.of(SCENES["pincer"]()), BytesIO()
    tree = in_time(space, 2, 120)
    save(tree, kept)
    kept.seek(0)
    assert [one.cost for one in load(kept, space, InTime()).references(START)] == [
        one.cost for one in tree.references(START)
    ]
    kept.seek(0)
    later = space.with_movers([replace(mover, motion=mover.motion.after(0.1)) for mover in space.scene.movers])
    with pytest.raises(OptionError, match="moving obstacles"):
        load(kept, later, InTime())


@pytest.mark.parametrize("name", SCENES)
def test_references_do_not_depend_on_the_number_of_threads(name):
    """Neither the first nor those that go on from them a little further on."""
    tree = in_time(FreeSpace.of(SCENES[name]()), 2, 600)
    found = []
    for threads in (1, 3):
        first = tree.references(START, threads=threads)
        later = tree.references(
            START + np.array([0.1, 0.01, 0.1]), before={one.winding: one.path for one in first}, threads=threads
        )
        found.append([(one.winding, one.path.knots.tolist()) for one in [*first, *later]])
    assert found[0] == found[1]


def test_who_is_pressed_goes_on_with_earlier_paths_and_shortens_no_others():
    tree = in_time(FreeSpace.of(SCENES["pincer"]()), 0, 400)
    first = {one.winding: one for one in tree.references(START)}
    place = START + np.array([0.1, 0.0, 0.1])
    known = {winding: one.path for winding, one in list(first.items())[:1]}
    raw = {one.winding: one.cost for one in tree.references(place, shortened=False)}
    slow = {one.winding: one.cost for one in tree.references(place, before=known)}
    fast = {one.winding: one.cost for one in tree.references(place, before=known, over_budget=lambda: True)}
    old = next(iter(known))
    assert fast[old] == slow[old] <= raw[old]
    assert all(fast[winding] == raw[winding] for winding in raw if winding != old)
    assert sum(slow[winding] < raw[winding] for winding in raw if winding != old) == 1


STEERING = InTime()


def taut(space: FreeSpace, knots: np.ndarray) -> Legs:
    """The shortened path."""
    checker = STEERING.checker(space)
    return STEERING.shorten(checker.until_goal(STEERING.connect(knots[:-1], knots[1:])), checker)


def cost_of(knots: np.ndarray) -> float:
    step = np.diff(knots, axis=0)
    return float(np.sum(step[:, 2] + (step[:, 0] ** 2 + step[:, 1] ** 2) / step[:, 2]))


def test_with_nothing_in_the_way_a_crooked_path_becomes_the_straight_one_at_the_best_speed():
    knots = np.array([[1.0, 2.5, 0.0], [1.2, 4.0, 2.0], [3.0, 1.0, 5.0], [4.0, 2.0, 5.6], [5.5, 2.5, 9.0]])
    found = taut(FreeSpace.of(hall("empty", [])), knots).knots
    assert cost_of(found) == pytest.approx(2.0 * 4.2, rel=1e-4)
    assert found[-1] == pytest.approx([5.2, 2.5, 4.2], abs=0.02)


def least_cost(space: FreeSpace, side: int, x0: float, width: float) -> float:
    """Dynamic programming in space and time past one body that crosses, on one side of it.

    A path is two straight ways at constant speeds with a short stretch beside the body's column in between, whose
    places and times are all tried: a bound from above that is as fine as the grid.
    """
    crosser, start, goal = space.scene.movers[0].motion, np.array([1.0, 2.5]), np.array([5.5, 2.5])
    xs, times, ys = np.linspace(x0, x0 + width, 25), np.linspace(1.4, 3.4, 201), np.linspace(-0.9, 0.9, 361)
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
    return float(np.min(best + (2.0 * (np.hypot(goal[0] - X, goal[1] - Y) - 0.3))))


def _free(crosser, x: float, y: np.ndarray, t: np.ndarray, side: int) -> np.ndarray:
    """Whether a place is free of the disc, and not on its other side."""
    pose = crosser.pose(t[:, 0])
    dy = y - pose[:, 1:2]
    return (np.hypot(x - pose[:, :1], dy) >= 0.4) & (side * dy >= 0.0)


@pytest.mark.parametrize(("side", "winding", "via"), [(1, (0,), (3.25, 3.1, 2.2)), (-1, (1,), (3.25, 2.0, 2.6))])
def test_before_and_behind_cost_what_dynamic_programming_finds(side, winding, via):
    space = FreeSpace.of(SCENES["crossing"]())
    found = taut(space, np.array([[1.0, 2.5, 0.0], via, [5.5, 2.5, 5.0]])).knots
    assert STEERING.homology(space).winding(found) == winding
    assert cost_of(found) == pytest.approx(least_cost(space, side, 2.85, 0.8), rel=4e-3)
    assert cost_of(found) > 2.0 * 4.2


def later(via: tuple[float, float, float], aside: tuple[float, float]) -> tuple[FreeSpace, Legs, np.ndarray]:
    """`crossing`, a taut path over a place and a time, and where a robot is that was put aside on it a little later."""
    space = FreeSpace.of(SCENES["crossing"]())
    path = taut(space, np.array([[1.0, 2.5, 0.0], via, [5.5, 2.5, 5.0]]))
    place = [np.interp(0.4, path.knots[:, 2], path.knots[:, k]) for k in (0, 1)]
    return space, path, np.array([*np.add(place, aside), 0.4])


@pytest.mark.parametrize("via", [(3.25, 3.1, 2.2), (3.25, 2.0, 2.6)])
@pytest.mark.parametrize("aside", [(0.0, 0.0), (-0.02, 0.03)])
def test_a_path_that_goes_on_from_an_earlier_one_is_as_good_as_one_made_anew(via, aside):
    space, path, x = later(via, aside)
    checker = STEERING.checker(space)
    found = STEERING.resume(x, path, checker)
    anew = taut(space, np.vstack([x, path.knots[path.knots[:, 2] > 0.5]])).knots
    assert np.array_equal(found.knots[0], x)
    assert checker.inspect(found, np.arange(len(found.cost)) == len(found.cost) - 1).free.all()
    homology = STEERING.homology(space)
    assert homology.winding(found.knots) == homology.winding(anew)
    assert found.cost.sum() == pytest.approx(cost_of(anew), rel=2e-3)
