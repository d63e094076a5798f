"""Passages are found and as wide as they are; starts within margins and covered goals are fitted to walls."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from discs import block, disc, scattered, scene_of
from trees import grown

from pirrht import FreeSpace, Goal, Scene, SceneError, StraightLine
from pirrht.geometry.collision import Collision
from pirrht.geometry.passages import Passages, find_passages
from pirrht.geometry.scene import Waiver
from pirrht.geometry.space import clearances_of

RADIUS = 0.1


def passages_of(scene: Scene) -> tuple[Passages, FreeSpace]:
    space = FreeSpace.of(scene)
    return find_passages(space.field, space.collision), space


def two_blocks(gap: float, yaw: float) -> tuple[Scene, np.ndarray]:
    """Two long blocks with a gap between their ends; the line through them is at an angle [rad]."""
    along = np.array([np.cos(yaw), np.sin(yaw)])
    at = [np.array([3.0, 3.1]) + side * (0.8 + 0.5 * gap) * along for side in (-1, 1)]
    blocks = [block(f"block{i}", *place, (0.8, 0.2), yaw) for i, place in enumerate(at)]
    return scene_of(blocks, start=(0.5, 0.5), goal=(5.5, 5.5)), np.array([3.0, 3.1])


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.1, np.pi / 2, 2.5])
@pytest.mark.parametrize("diameters", [1.02, 1.2, 2.0, 4.0])
def test_a_gap_between_two_blocks_is_a_passage_of_its_width_across_their_line(diameters: float, yaw: float):
    gap = 2.0 * RADIUS * diameters
    scene, middle = two_blocks(gap, yaw)
    found, _ = passages_of(scene)
    k = int(np.argmin(np.hypot(*(found.place - middle).T)))
    assert abs((found.place[k] - middle) @ [np.cos(yaw), np.sin(yaw)]) < 2e-3
    assert found.width[k] == pytest.approx(gap, abs=2e-3)
    assert abs(np.cos(found.heading[k] - yaw)) < 0.05
    assert sorted(found.between(k, FreeSpace.of(scene).collision)) == ["block0", "block1"]


@pytest.mark.parametrize("gap", [-0.1, 0.0, 0.1, 0.19])
def test_a_gap_narrower_than_the_robot_is_none(gap: float):
    scene, middle = two_blocks(gap, 0.4)
    found, _ = passages_of(scene)
    assert not np.any(np.hypot(*(found.place - middle).T) < 0.3)


def test_a_doorway_whose_jambs_belong_together_is_a_passage():
    walls = [block("left", 1.4, 3.0, (1.45, 0.1)), block("right", 4.6, 3.0, (1.45, 0.1))]
    found, space = passages_of(scene_of(walls, start=(3.0, 1.0), goal=(3.0, 5.0)))
    assert space.homology.M == 0
    assert found.count == 1
    np.testing.assert_allclose(found.place[0], [3.0, 3.0], atol=0.1)
    assert found.width[0] == pytest.approx(0.3, abs=2e-3)


@pytest.mark.parametrize("seed", range(6))
def test_every_two_discs_with_none_between_them_have_a_passage_midway(seed: int):
    """The saddles of the distance from discs are the middles of gaps to which no third disc is nearer."""
    found, space = passages_of(scattered(seed))
    rows = [(o.position[:2], o.size[0]) for o in space.scene.obstacles]
    for (a, r), (b, s) in combinations(rows, 2):
        gap = np.hypot(*(b - a)) - r - s
        middle = a + (b - a) * (r + 0.5 * gap) / np.hypot(*(b - a))
        least = min(np.hypot(*(c - middle)) - t for c, t in rows)
        if least < 0.5 * gap - 1e-9 or min(*middle, *(6.0 - middle)) < 0.5 * gap or gap > 1.2:
            continue
        near = np.hypot(*(found.place - middle).T)
        assert near.min() < 0.02
        assert found.width[np.argmin(near)] == pytest.approx(gap, abs=3e-3)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_found_is_free_and_as_wide_as_fcl_says_narrowest_first(seed: int):
    found, space = passages_of(scattered(seed))
    assert np.all(np.diff(found.width) >= 0.0)
    np.testing.assert_allclose(space.collision.clearance(found.place), 0.5 * found.width - RADIUS, atol=3e-3)
    assert np.all(space.collision.free(found.axis[:, :2]))
    np.testing.assert_array_equal(found.axis[: found.count, :2], found.place)


MARGIN = 0.2
POCKET = [block("left", 1.0, 3.7, (1.0, 0.5)), block("right", 1.0, 2.3, (1.0, 0.5))]  # 0.4 m wide, open at x = 2


def beside_wall(start: tuple[float, float] = (2.0, 1.2), **more) -> Scene:
    scene = scene_of([block("wall", 2.5, 0.5, (2.0, 0.5))], start=start, goal=(5.5, 3.0), radius=0.1 + MARGIN)
    return replace(scene, margin=MARGIN, **more)


def pocket() -> Scene:
    return replace(scene_of(POCKET, start=(0.5, 3.0), goal=(5.0, 1.0), radius=0.1 + MARGIN), margin=MARGIN)


def shelf(*, center: tuple[float, float], radius: float, pillar: float | None = None) -> Scene:
    solid = disc("pillar", *center, pillar) if pillar else block("shelf", 5.0, 2.0, (0.5, 0.8))
    return replace(scene_of([solid], start=(0.5, 2.0), goal=center), goal=Goal(center=np.array(center), radius=radius))


def line(space: FreeSpace) -> np.ndarray:
    """The cheapest reference from the start, as points a centimetre apart or less (k, 2) [m]."""
    corners = grown(space, StraightLine(), 300).references(space.scene.start[:2])[0].trajectory.points
    return np.concatenate([np.linspace(a, b, 500) for a, b in zip(corners, corners[1:], strict=False)])


@pytest.mark.parametrize("scene", [beside_wall(), pocket()], ids=["beside a wall", "in a pocket"])
def test_a_reference_leads_out_of_the_margin_and_keeps_it_from_there_on(scene: Scene) -> None:
    space = FreeSpace.of(scene)
    (waiver,) = space.scene.waivers
    points = line(space)
    full = Collision(scene.world, scene.footprint).clearance(points)
    outside = np.hypot(*(points - scene.start[:2]).T) > waiver.radius
    assert full[0] < 0.0 < full[-1]
    assert full[outside].min() > -1e-9
    assert full.min() > -MARGIN + 1e-3


@pytest.mark.parametrize("scene", [beside_wall(), pocket()], ids=["beside a wall", "in a pocket"])
def test_clearance_with_a_waiver_changes_no_faster_than_places_do_and_the_field_stays_below_it(scene: Scene) -> None:
    space, rng = FreeSpace.of(scene), np.random.default_rng(1)
    around = scene.start[:2] + rng.uniform(-1.5, 1.5, (3000, 2))
    around = around[np.all((around > 0.0) & (around < 6.0), axis=1)]
    near = np.clip(around + rng.normal(0.0, 0.02, around.shape), 0.0, 6.0)
    here, there = space.collision.clearance(around), space.collision.clearance(near)
    counts = np.minimum(here, there) > -0.05  # in obstacles clearance is one number
    assert np.all((np.abs(here - there) <= np.hypot(*(around - near).T) + 1e-9)[counts])
    sampled = np.empty(len(around))
    clearances_of(space.field.kernels)(space.field, around, sampled)
    free = here > 0.0
    assert np.all(sampled[free] <= here[free] + 1e-6)
    assert np.median(here[free] - sampled[free]) < 0.02


def test_a_floor_that_reaches_into_the_margin_everywhere_is_named() -> None:
    floor = replace(
        block("floor", 3.0, 3.0, (9.0, 9.0)), size=np.array([9.0, 9.0, 0.001]), position=np.array([3, 3, 0])
    )
    scene = replace(scene_of([floor], start=(1.0, 1.0), goal=(5.0, 5.0)), margin=0.01)
    with pytest.raises(SceneError, match=r'obstacle "floor" lies under or over the robot at \(1, 1\).*0.099 m'):
        FreeSpace.of(scene)


def test_segments_in_and_out_of_narrow_passages_are_free_where_their_clearance_is_positive() -> None:
    posts = [disc("one", 2.0, 2.0, 0.5), disc("two", 3.3, 2.0, 0.5), disc("three", 4.6, 2.0, 0.5)]
    narrow = (Waiver(2.65, 2.0, 0.7, 0.04), Waiver(3.95, 2.0, 0.6, 0.045))
    scene = replace(scene_of(posts, start=(0.5, 0.5), goal=(5.5, 5.5), radius=0.16), margin=0.06, narrow=narrow)
    collision, rng = FreeSpace.of(scene).collision, np.random.default_rng(2)
    tails = rng.uniform((1.0, 1.0), (5.5, 3.0), (400, 2))
    heads = tails + rng.normal(0.0, 0.5, tails.shape)
    share = np.linspace(0.0, 1.0, 2001)[:, None, None]
    least = collision.clearance((tails + share * (heads - tails)).reshape(-1, 2)).reshape(2001, -1).min(axis=0)
    sure = np.abs(least) > 1e-3
    np.testing.assert_array_equal(collision.segments_free(tails, heads)[sure], (least > 0.0)[sure])
    through = collision.segments_free(np.array([[2.65, 1.0], [3.95, 1.0]]), np.array([[2.65, 3.0], [3.95, 3.0]]))
    assert through.all()
    assert not Collision(replace(scene, narrow=()).world, scene.footprint).free(np.array([[2.65, 2.0]]))[0]
    assert len(FreeSpace.of(scene).obstacles) == 3
    assert len(FreeSpace.of(replace(scene, narrow=())).obstacles) == 1
    assert find_passages(FreeSpace.of(scene).field, collision).width[:2] == pytest.approx(0.3, abs=2e-3)


def test_a_start_that_touches_is_refused_whatever_the_margin() -> None:
    with pytest.raises(SceneError, match=r"start \(2, 1.05\) is in .* of radius 0.1 \(it lacks 0.05 m"):
        FreeSpace.of(beside_wall((2.0, 1.05)))


def test_a_partly_covered_goal_becomes_the_disc_in_its_free_part() -> None:
    goal = FreeSpace.of(shelf(center=(4.6, 2.0), radius=0.4)).scene.goal
    np.testing.assert_allclose(goal.center, (4.35, 2.0), atol=0.02)
    assert goal.radius == pytest.approx(0.15, abs=0.02)


def test_a_goal_that_is_free_in_its_centre_stays_as_it_is_and_one_that_is_covered_is_refused() -> None:
    scene = shelf(center=(4.3, 2.0), radius=0.4)
    assert FreeSpace.of(scene).scene.goal is scene.goal
    with pytest.raises(SceneError, match="everywhere in its disc"):
        FreeSpace.of(shelf(center=(5.0, 2.0), radius=0.4))
