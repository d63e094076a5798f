"""At any size the clearance field errs as little as in a small world, or says which size it can do."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discs import block, disc, scene_of
from solved import around_post

from pirrht import FreeSpace, Obstacle, Sampling, Scene, SceneError, path_integral
from pirrht.geometry.disc import certify_piece
from pirrht.geometry.field import LEVEL_BITS, LEVELS, REACH, Field, clearance
from pirrht.geometry.passages import find_passages
from pirrht.geometry.space import FREE

ROBOT = 0.2
ROUNDING = 1e-6  # the field is kept in single precision [m]


def hall(width: float, depth: float, obstacles: list[Obstacle]) -> Scene:
    """A workspace from the origin, start and goal half way up at its ends."""
    ends = {"start": (1.0, 0.5 * depth), "goal": (width - 1.0, 0.5 * depth, 0.3)}
    return scene_of(obstacles, **ends, side=(width, depth), radius=ROBOT, name="hall")


def pillars(size: float, count: int) -> list[Obstacle]:
    """Round and square ones of all widths, turned at random, some of which touch."""
    rng = np.random.default_rng(int(size))
    found = []
    for k in range(count):
        (x, y), half = rng.uniform(4.0, size - 4.0, 2), np.exp(rng.uniform(-2.5, 1.0, 2))
        round_one = k % 2 == 0
        found.append(disc(f"p{k}", x, y, half[0]) if round_one else block(f"p{k}", x, y, half, rng.uniform(0.0, np.pi)))
    return found


@cache
def space_of(kind: str) -> FreeSpace:
    size, count = {"60 m": (60.0, 40), "200 m": (200.0, 150), "2 km": (2000.0, 150)}[kind]
    return FreeSpace.of(hall(size, size, pillars(size, count)))


def places(space: FreeSpace, count: int) -> np.ndarray:
    """Half of them anywhere, half around the obstacles."""
    rng, scene = np.random.default_rng(4), space.scene
    spots = rng.choice(np.array([o.position[:2] for o in scene.obstacles]), count // 2)
    around = spots + rng.normal(0.0, 1.2, spots.shape)
    points = np.vstack([rng.uniform(scene.lower, scene.upper, (count - count // 2, 2)), around])
    return points[np.all((points > scene.lower) & (points < scene.upper), axis=1)]


def field_at(field: Field, points: np.ndarray) -> np.ndarray:
    return np.array([clearance(field, x, y) for x, y in points])


@pytest.mark.parametrize("kind", ["60 m", "200 m", "2 km"])
def test_the_field_is_never_too_high_and_near_walls_hardly_too_low_at_any_size(kind: str):
    space = space_of(kind)
    points, h = places(space, 10_000), space.field.spacing
    exact, found = space.collision.clearance(points), field_at(space.field, points)
    shallow = exact > -0.5 * ROBOT
    assert h == ROBOT / 8.0
    assert "table" in space.field.held
    assert np.all(found[shallow] <= exact[shallow] + ROUNDING)
    assert np.all(found[~shallow] < -0.4 * ROBOT)
    near = shallow & (exact < 2.0 * h)
    lost = (exact - found)[near]
    assert near.sum() > 100
    assert np.median(lost) < 2.0 * h**2 / (4.0 * ROBOT)
    assert lost.max() < h
    far = exact > 0.05
    assert np.all((np.minimum(exact, REACH) - found)[far] < 0.25 * exact[far] + 1.5 * h)


def test_no_segment_through_a_thin_wall_is_free_in_a_long_corridor():
    """With a spacing that grows with the workspace, a path went 0.15 m through such walls."""
    walls = [block(f"wall{k}", 20.0 * (k + 1), 2.0, (0.05, 2.0)) for k in range(120)]
    field = FreeSpace.of(hall(2500.0, 6.0, walls)).field
    rng = np.random.default_rng(0)
    for wall in walls:
        x, y = wall.position[0], rng.uniform(0.3, 4.0 + 0.9 * ROBOT)
        assert certify_piece(field, (x - 1.0, y), (x + 1.0, y)) != FREE
        assert certify_piece(field, (x - 1.0, 4.3), (x + 1.0, 4.3)) == FREE


@pytest.mark.parametrize("size", [(200_000.0, 6.0), (5000.0, 5000.0)])
def test_a_workspace_beyond_single_precision_is_refused_with_the_size_that_works(size: tuple[float, float]):
    with pytest.raises(
        SceneError, match=r"hall: the workspace of .* m is too large for a robot of radius 0.2 m"
    ) as told:
        FreeSpace.of(hall(*size, []))
    assert "\n" not in str(told.value)
    works = float(re.search(r"up to (\d+) m works", str(told.value)).group(1))
    space = FreeSpace.of(hall(works, 6.0, []))
    assert clearance(space.field, 0.5 * works, 2.0) == pytest.approx(2.0)
    assert find_passages(space.field, space.collision).count == 0


def packed(field: Field, space: FreeSpace) -> Field:
    """The same grid in blocks of 8 cells, all of them of the finest level."""
    cells, arrays = 8, []
    rows, columns = (-(-(n - 1) // (cells << (LEVELS - 1))) << (LEVELS - 1) for n in (field.nx, field.ny))
    for values in field.held.values():
        wide = np.pad(values, [(0, rows * cells + 1 - field.nx), (0, columns * cells + 1 - field.ny)], mode="edge")
        blocks = np.lib.stride_tricks.sliding_window_view(wide, (cells + 1, cells + 1))[::cells, ::cells]
        arrays.append(np.ascontiguousarray(blocks.reshape(-1, cells + 1, cells + 1)))
    table = (np.arange(rows * columns, dtype=np.int32) << LEVEL_BITS).reshape(rows, columns)
    return Field.of(space.scene.world, field.spacing, (arrays[0], arrays[1], arrays[2]), table)


def test_paths_are_the_same_bit_for_bit_whether_a_grid_lies_in_columns_or_in_blocks():
    solved = around_post(0.3)
    weights = []
    for field in (solved.space.field, packed(solved.space.field, solved.space)):
        integral = path_integral(solved.problem, replace(solved.space, field=field), Sampling(dt=0.1, samples=700))
        weights.append(integral.estimate(integral.rollout(solved.batch(integral, 700, 700), 5)).rollouts.log_weight)
    np.testing.assert_array_equal(*weights)
