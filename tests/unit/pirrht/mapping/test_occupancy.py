"""Maps of scans hold the walls that were seen, and nothing else."""

from itertools import pairwise

import numpy as np
import pytest
from rays import ranges_to, scan_of

from pirrht import Scene, SceneError
from pirrht.mapping.occupancy import OccupancyMap
from pirrht.mapping.scan import Scan

CELL = 0.05
TASK = {"lower": (0, 0), "upper": (4, 3), "start": (0.6, 0.6), "goal": (3.4, 2.4, 0.3), "robot_radius": 0.1}
# Walls off the lines of the grid, a table askew, and one that stands free.
BOXES = [
    [-0.1, -0.1, 4.1, 0.123], [-0.1, 2.871, 4.1, 3.1], [-0.1, -0.1, 0.117, 3.1], [3.888, -0.1, 4.1, 3.1],
    [1.5, 1.0, 2.1, 1.6, 0.4], [2.7, 0.9, 2.92, 1.42],
]  # fmt: skip
WORLD = Scene.from_boxes(BOXES, **TASK)
PLACES = [(0.6, 0.6, 0.0), (3.4, 0.5, 2.0), (3.3, 2.5, -2.0), (0.5, 2.4, 1.0), (2.4, 1.9, 0.3)]


def depth(points: np.ndarray) -> np.ndarray:
    """How deep points (k, 2) lie in the deepest solid, negative outside of all, where it is a bound [m]."""
    places = np.column_stack([points, np.full(len(points), 0.1)])
    return np.max([np.min(o.size - abs((places - o.position) @ o.rotation), axis=1) for o in WORLD.obstacles], axis=0)


def cells_of(grid: OccupancyMap, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    columns, rows = ((points - grid.lower) / grid.cell).astype(int).T
    return rows, columns


def grown(cells: np.ndarray) -> np.ndarray:
    """Cells and their eight neighbours."""
    padded = np.pad(cells, 1)
    rows, columns = cells.shape
    return np.any([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)


def noisy(scan: Scan, rng: np.random.Generator) -> Scan:
    ranges = scan.ranges + 0.001 * rng.standard_normal(len(scan.ranges))
    return Scan(pose=scan.pose, angles=scan.angles, ranges=ranges, most=scan.most)


def centres(grid: OccupancyMap, cells: np.ndarray) -> np.ndarray:
    return grid.lower + grid.cell * (np.argwhere(cells)[:, ::-1] + 0.5)


def mapped(solids=WORLD.obstacles, *, repeats: int = 1) -> OccupancyMap:
    grid, rng = OccupancyMap((0, 0), (4, 3)), np.random.default_rng(1)
    for place in PLACES * repeats:
        grid.integrate(noisy(scan_of(solids, np.array(place)), rng))
    return grid


@pytest.mark.parametrize("repeats", [1, 12])
def test_a_map_of_a_room_has_every_wall_that_was_seen_and_no_cell_away_from_walls(repeats):
    grid = mapped(repeats=repeats)
    seen = np.vstack([scan_of(WORLD.obstacles, np.array(place)).points for place in PLACES])
    assert grown(grid.occupied)[cells_of(grid, seen)].all()
    assert np.mean(grid.occupied[cells_of(grid, seen)]) > 0.9
    assert depth(centres(grid, grid.occupied)).min() > -CELL
    assert grid.occupied.sum() > 200


def test_what_is_behind_walls_stays_unknown_and_what_rays_passed_is_known():
    grid = mapped()
    points = centres(grid, np.ones_like(grid.unknown))
    behind = depth(points).reshape(grid.unknown.shape)
    assert grid.unknown[behind > 2 * CELL].all()
    sure = behind < -3 * CELL
    assert np.mean(grid.unknown[sure]) < 0.01
    assert not (grid.occupied & grid.unknown).any()


def test_a_wall_along_which_a_robot_drives_keeps_its_cells():
    grid, wall = OccupancyMap((0, 0), (12, 3)), Scene.from_boxes([[0.0, 2.031, 10.0, 2.2]], **TASK).obstacles
    rng = np.random.default_rng(3)
    for x in np.arange(0.5, 11.5, 0.1):
        grid.integrate(noisy(scan_of(wall, np.array([x, 1.0, 0.0])), rng))
    before = grid.version
    for x in np.arange(11.5, 0.5, -0.1):
        grid.integrate(noisy(scan_of(wall, np.array([x, 1.6, 0.0])), rng))
    assert grid.occupied[40, :200].all()
    assert grid.version <= before + 3
    assert grid.occupied[:40].sum() == 0


@pytest.mark.parametrize("speed", [0.0, 0.05])
def test_an_obstacle_that_is_gone_leaves_the_map_after_few_scans(speed):
    rng = np.random.default_rng(2)
    wall, away = WORLD.obstacles[:-1], WORLD.obstacles[-1:]
    grid = mapped(repeats=3)
    rows, columns = cells_of(grid, np.array([[2.62, 0.82], [3.0, 1.5]]))
    block = (slice(*rows), slice(*columns))
    assert grid.occupied[block].sum() > 20
    for k in range(8):
        for place in PLACES[1:]:
            grid.integrate(noisy(scan_of(wall, np.add(place, (k * speed, 0, 0))), rng))
    assert grid.occupied[block].sum() == 0
    grid.integrate(noisy(scan_of([*wall, *away], np.array(PLACES[1])), rng))
    assert grid.occupied[block].sum() > 8  # one scan shows it again


def test_a_disc_that_walks_away_leaves_no_trail():
    grid, rng = OccupancyMap((0, 0), (4, 3)), np.random.default_rng(4)
    for x in np.arange(1.0, 3.0, 0.05):
        body = Scene.from_discs([[x, 0.6, 0.2]], **TASK).obstacles
        grid.integrate(noisy(scan_of([*WORLD.obstacles[:4], *body], np.array(PLACES[0])), rng))
    places = centres(grid, grid.occupied)
    trail = (depth(places) < -CELL) & (np.hypot(*(places - (x, 0.6)).T) > 0.5)
    assert trail.sum() <= 2
    assert np.count_nonzero(np.hypot(*(places - (x, 0.6)).T) < 0.25) > 4


def test_a_scene_of_a_map_has_the_free_space_of_its_grid():
    grid = mapped()
    scene = grid.scene(WORLD)
    points = np.random.default_rng(5).uniform((0, 0), (4, 3), (4000, 2))
    places = np.column_stack([points, np.full(len(points), 0.1)])
    inside = np.any([np.all(abs(places - o.position) < o.size, axis=1) for o in scene.obstacles], axis=0)
    np.testing.assert_array_equal(inside, grid.occupied[cells_of(grid, points)])
    assert 10 < len(scene.obstacles) < grid.occupied.sum()
    assert (scene.goal, scene.name, scene.robot_radius) == (WORLD.goal, WORLD.name, WORLD.robot_radius)
    assert OccupancyMap((0, 0), (4, 3)).scene(WORLD).obstacles == ()


def test_the_version_changes_with_what_is_occupied_alone():
    grid = OccupancyMap((0, 0), (4, 3))
    scan = scan_of(WORLD.obstacles, np.array(PLACES[0]))
    before, was = grid.version, grid.occupied
    for _ in range(6):
        grid.integrate(scan)
        assert (grid.version != before) == bool((grid.occupied != was).any())
        before, was = grid.version, grid.occupied
    assert grid.version == 1
    grid.integrate(scan, free_around=0.7)
    assert grid.version == 2


def one(place, *rays: tuple[float, float], most: float = 30.0) -> Scan:
    angles, ranges = np.array(rays).T
    return Scan(pose=np.array([*place, 0.0]), angles=angles, ranges=ranges, most=most)


def test_rays_without_a_hit_clear_up_to_the_greatest_range_and_those_that_are_too_near_nothing():
    grid = OccupancyMap((0, 0), (4, 3))
    grid.integrate(one((0.52, 0.52), (0.0, 2.0), (1.0, -np.inf)))
    assert grid.occupied.sum() == 1
    known = ~grid.unknown
    assert known.sum() == 41
    for _ in range(5):
        grid.integrate(one((0.52, 0.52), (0.0, -np.inf)))
    np.testing.assert_array_equal(~grid.unknown, known)
    for most, left in ((1.9, 1), (2.5, 0)):
        for _ in range(5):
            grid.integrate(one((0.52, 0.52), (0.0, np.inf), most=most))
        assert grid.occupied.sum() == left


@pytest.mark.parametrize("place", [(-1.02, 1.52), (5.02, 1.52), (2.02, -3.02), (2.02, 4.02), (-50.02, -50.02)])
def test_a_sensor_off_the_map_sees_what_rays_cross_of_it(place):
    grid = OccupancyMap((0, 0), (4, 3))
    across, along = (2.02, 1.52) - np.array(place)
    angle = np.arctan2(along, across)
    grid.integrate(one(place, (angle, np.hypot(along, across)), (angle + 1.5, 2.0), (angle + 3.0, np.inf), most=99.0))
    assert np.argwhere(grid.occupied).tolist() == [[30, 40]]
    assert 25 < np.count_nonzero(~grid.unknown) < 80


def test_cells_that_the_robot_fills_are_free_whatever_was_seen():
    grid = OccupancyMap((0, 0), (4, 3))
    grid.integrate(one((2.0, 1.5), (0.0, 0.08), (1.5, 0.5)), free_around=0.2)
    around = np.hypot(*(centres(grid, np.ones_like(grid.unknown)) - (2.0, 1.5)).T).reshape(grid.unknown.shape)
    assert not (grid.occupied | grid.unknown)[around < 0.2].any()
    assert grid.occupied.sum() == 1


def test_unseen_length_is_that_of_points_along_a_polyline_off_the_cells_that_were_seen():
    grid = mapped()
    rng = np.random.default_rng(6)
    for _ in range(20):
        points = rng.uniform((-0.5, -0.5), (4.5, 3.5), (rng.integers(2, 6), 2))
        points[0] = points[0].round(1)  # on lines of the grid
        points[1, 0] = points[0, 0]
        shares = np.linspace(0, 1, 4001)[:-1, None]
        along = np.concatenate([a + shares * (b - a) for a, b in pairwise(points)])
        steps = np.repeat(np.hypot(*np.diff(points, axis=0).T) / 4000, 4000)
        inside = np.all((along > 0) & (along < (4, 3)), axis=1)
        rows, columns = cells_of(grid, np.clip(along, 0, (3.999, 2.999)))
        unseen = ~inside | grid.unknown[rows, columns]
        on_line = steps[0] * 4000  # of the first leg, which lies between two columns
        assert abs(grid.unseen_length(points[1:]) - steps[4000:] @ unseen[4000:]) < 0.01
        assert -1e-9 <= grid.unseen_length(points[:2]) <= on_line + 1e-9
    assert grid.unseen_length(np.array([[0.6, 0.6], [0.6, 2.0]])) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("upper", "cell", "why"),
    [
        ((4, 3, 2), 0.05, "upper corner of the map"),
        ((4, 3), 0.0, "side of a cell"),
        ((1e6, 1e6), 0.05, "at most 25,000,000"),
    ],
)
def test_a_map_that_cannot_be_is_refused_with_a_reason(upper, cell, why):
    with pytest.raises(SceneError, match=why):
        OccupancyMap((0, 0), upper, cell)


def test_closed_forms_of_rays_agree_with_points_inside_of_solids():
    pose = np.array(PLACES[0])
    angles = np.linspace(-3.0, 3.0, 50)
    ends = ranges_to(WORLD.obstacles, pose, angles, 0.1)
    for nudge, sign in ((-1e-6, -1), (1e-6, 1)):
        points = pose[:2] + (ends + nudge)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        assert np.all(np.sign(depth(points)) == sign)
