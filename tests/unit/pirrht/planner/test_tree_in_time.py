"""Trees in space and time: which ways they find past bodies that move, and that those are what they say."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from discs import disc
from moving import SCENES, hall, moved

from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.moving.collision import MovingObstacles
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.steering.in_time import InTime
from sim.tree_file import load, save

START = np.array([1.0, 2.5, 0.0])
WAYS = {  # classes that matter
    "crossing": ["0", "1"],
    "closing_door": ["0,0", "-1,0"],
    "pincer": ["0,0", "1,0", "0,-1"],
}


def grown(space: FreeSpace, seed: int, vertices: int = 250, steering: InTime | None = None) -> HomologyTree:
    tree = HomologyTree(space, steering or InTime(), limit=0.8, rng=np.random.default_rng(seed))
    tree.grow(vertices)
    return tree


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
        found = {one.id: one.cost for one in grown(space, seed, 200).references(START)}
        costs.append([found[way] for way in WAYS[name]])
    assert np.all(np.ptp(costs, axis=0) < 0.012 * np.min(costs, axis=0))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("shortened", [True, False])
def test_references_are_free_forward_in_time_and_of_the_class_they_are_named_after(name, shortened):
    space = FreeSpace.of(SCENES[name]())
    tree = grown(space, 3)
    homology, references = tree.homology, tree.references(START, shortened=shortened)
    for one in references:
        knots = one.path.knots
        assert knots[0] == pytest.approx(START)
        assert np.hypot(*(knots[-1, :2] - space.scene.goal.center)) == pytest.approx(0.3, abs=2e-3)
        assert np.all(np.diff(knots[:, 2]) > 0.0)
        speed = np.hypot(*np.diff(knots[:, :2], axis=0).T) / np.diff(knots[:, 2])
        assert speed.max() <= tree.steering.limit * (1.0 + 1e-6)
        assert homology.winding(knots) == one.winding
        assert one.signature == pytest.approx(homology.signature(START, one.winding))
        assert np.all(np.abs(1.0 - one.signature) <= tree.limit)
        assert not collides(space, one)
        durations = one.trajectory.durations
        assert one.cost == pytest.approx(np.sum((1.0 + speed**2) * np.diff(knots[:, 2])))
        assert START[:2] + one.trajectory.controls.T @ durations == pytest.approx(knots[-1, :2])
    assert [one.cost for one in references] == sorted(one.cost for one in references)
    assert len({one.winding for one in references}) == len(references)


def test_where_nothing_moves_the_best_way_is_the_taut_line_at_the_best_speed():
    block = [disc("post", 3.0, 2.6, 0.4)]
    space = FreeSpace.of(hall("standing", [], block))
    found = grown(space, 0, 400).references(START)
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
        rows = np.column_stack(
            [np.arange(5) * 0.8, np.array(corners[k % 4]) + rng.normal(0.0, 0.1, (5, 2)), np.zeros(5)]
        )
        far.append(moved(f"far{k}", rows, disc("disc", 0.0, 0.0, 0.1)))
    alone = grown(FreeSpace.of(crossing), 0, 300).references(START)
    found = grown(FreeSpace.of(replace(crossing, movers=(*crossing.movers, *far))), 0, 300).references(START)
    assert [one.winding for one in found[:2]] == [(w, *[0] * 12) for (w,) in (alone[0].winding, alone[1].winding)]
    assert [one.cost for one in found[:2]] == pytest.approx([one.cost for one in alone], rel=2e-3)


def test_a_tree_in_time_comes_back_from_a_file_and_only_among_the_same_bodies():
    space, kept = FreeSpace.of(SCENES["pincer"]()), BytesIO()
    tree = grown(space, 2, 120)
    save(tree, kept)
    kept.seek(0)
    again = load(kept, space, InTime())
    assert [one.cost for one in again.references(START)] == [one.cost for one in tree.references(START)]
    kept.seek(0)
    later = space.with_movers([replace(mover, motion=mover.motion.after(0.1)) for mover in space.scene.movers])
    with pytest.raises(OptionError, match="moving obstacles"):
        load(kept, later, InTime())


@pytest.mark.parametrize("name", SCENES)
def test_references_do_not_depend_on_the_number_of_threads(name):
    """Neither the first nor those that go on from them a little further on."""
    tree = grown(FreeSpace.of(SCENES[name]()), 2, 600)
    found = []
    for threads in (1, 3):
        first = tree.references(START, threads=threads)
        before = {one.winding: one.path for one in first}
        later = tree.references(START + np.array([0.1, 0.01, 0.1]), before=before, threads=threads)
        found.append([(one.winding, one.path.knots.tolist()) for one in [*first, *later]])
    assert found[0] == found[1]


def test_who_is_pressed_goes_on_with_earlier_paths_and_shortens_no_others():
    tree = grown(FreeSpace.of(SCENES["pincer"]()), 0, 400)
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
