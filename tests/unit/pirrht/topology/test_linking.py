"""Classes in space against the line integral of the field around a polygon, and under deformation."""

import numpy as np
import pytest
from spaces import in_space, mixed, pillars, window

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Scene
from pirrht.topology.choice import obstacles_of, signature_of
from pirrht.topology.linking import Linking

NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)
PANELS = 200  # of a straight piece


def signature(scene: Scene) -> Linking:
    parts = obstacles_of(Collision(scene.world, scene.footprint))
    found = signature_of(scene, [part for part in parts if part.marker is not None])
    assert isinstance(found, Linking)
    return found


def polygons(seed: int, amount: int = 4) -> Linking:
    """Polygons of three to seven corners at random."""
    rng = np.random.default_rng(seed)
    loops = tuple(rng.uniform(0.0, 4.0, (rng.integers(3, 8), 3)) for _ in range(amount))
    return Linking(loops=loops, goal=rng.uniform(0.0, 4.0, 3))


def line_integral(loop: Array, path: Array) -> float:
    """Integral along a path of the field around a polygon (Bhattacharya, Likhachev and Kumar 2011) [turns]."""
    total = 0.0
    for tail, head in zip(path[:-1], path[1:], strict=True):
        shares = np.concatenate([(k + 0.5 + 0.5 * NODES) / PANELS for k in range(PANELS)])
        points = tail + shares[:, None] * (head - tail)
        field = np.zeros_like(points)
        for p, q in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            a, b = p - points, q - points
            la, lb = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
            size = (la + lb) / (la * lb * (la * lb + np.einsum("ki,ki->k", a, b)))
            field += np.cross(a, b) * size[:, None]
        total += 0.5 / PANELS * float(np.tile(WEIGHTS, PANELS) @ (field @ (head - tail)))
    return total / (4.0 * np.pi)


def test_turns_are_those_of_the_line_integral():
    for seed in range(6):
        links, rng = polygons(seed), np.random.default_rng([seed, 1])
        for path in rng.uniform(0.0, 4.0, (5, 3, 3)):
            expected = [line_integral(loop, path) for loop in links.loops]
            np.testing.assert_allclose(links.turns(path), expected, atol=1e-5)


def test_turns_of_closed_paths_are_whole_linking_numbers():
    numbers = []
    for seed in range(40):
        links, rng = polygons(seed), np.random.default_rng([seed, 2])
        path = rng.uniform(0.0, 4.0, (7, 3))
        closed = np.vstack([path, path[:1]])
        turns = links.turns(closed)
        numbers += links.along(closed).tolist()
        np.testing.assert_allclose(turns, numbers[-links.M :], atol=1e-9)
        assert links.along(closed[::-1]).tolist() == [-k for k in numbers[-links.M :]]
    assert len(set(numbers)) > 4


def test_crossings_of_a_path_to_the_goal_are_its_class_and_straight_lines_turn_less_than_once():
    for seed in range(40):
        links, rng = polygons(seed), np.random.default_rng([seed, 3])
        path = np.vstack([rng.uniform(0.0, 4.0, (5, 3)), links.goal])
        whole = links.along(path)
        assert links.winding(path) == tuple(whole.tolist())
        assert not links.along(np.vstack([path[0], links.goal])).any()
        assert np.all(np.abs(links.base(path[0])) < links.most_base)
        steps = zip(path[:-1], path[1:], strict=True)
        keys = [int(links.table.kernels.key(links.table, tuple(a.tolist()), tuple(b.tolist()))) for a, b in steps]
        assert sum(keys) % 2**64 == links.key(whole.tolist()) % 2**64


@pytest.mark.parametrize("axis", range(3))
def test_a_path_through_an_edge_of_the_cone_behind_a_polygon_or_with_a_corner_on_its_side_counts_once(axis):
    """Corners and sides of paths and of polygons in one plane with the goal: ties go the same way on both sides."""
    square = np.roll(np.array([[1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [1.0, -1.0, 1.0]]), axis, axis=1)
    links = Linking(loops=(square,), goal=np.zeros(3))
    for far in (2.0, 3.0):
        inside, outside, before = ([far, 0.0, 0.0], [far, 3.0 * far, 0.5 * far], [0.5, 0.0, 0.0])
        on_sides = [[far, y * far, z * far] for y, z in ((-1, 0), (1, 0), (0, -1), (0, 1), (0, 0), (1, 0.5))]
        beyond_edges = [[far, 2 * y * far, 2 * z * far] for y in (-1, 1) for z in (-1, 1)]
        for way in on_sides + beyond_edges:
            path = np.array([before, inside, way, outside, [-1.0, 3.0 * far, 0.0], before])
            assert links.along(np.roll(path, axis, axis=1)).tolist() == [1]


def test_a_path_that_is_deformed_among_obstacles_keeps_its_class():
    classes = set()
    for scene in (window(), pillars(), mixed(15)):
        collision, links, rng = Collision(scene.world, scene.footprint), signature(scene), np.random.default_rng(4)
        s, t = np.meshgrid(*[np.linspace(0.0, 1.0, 13)] * 2)
        shares = np.stack([(1 - s) * t, (1 - s) * (1 - t), s], axis=-1).reshape(-1, 3)

        def free(*triangle: Array) -> bool:
            points = shares @ np.array([*triangle, triangle[0]][:3])  # noqa: B023
            size = max(np.linalg.norm(a - b) for a in triangle for b in triangle)
            return bool(collision.clearance(points).min() > size / 12.0)  # noqa: B023

        for _ in range(4):
            path = [point for point in rng.uniform(scene.lower, scene.upper, (400, 3)) if free(point, point)][:1]
            for _ in range(400):
                point = path[-1] + rng.normal(size=3)
                if len(path) < 8 and free(path[-1], point):
                    path.append(point)
            line = np.array(path)
            before = links.winding(line)
            moved = 0
            for _ in range(200):
                k = rng.integers(1, len(line) - 1)
                point = line[k] + rng.normal(scale=0.5, size=3)
                if free(line[k - 1], line[k], point) and free(line[k], line[k + 1], point):
                    line[k] = point
                    moved += 1
            assert moved > 20
            assert links.winding(line) == before
            classes.add((scene.world.obstacles[0].name, before))
    assert len(classes) > 5


def test_the_ways_through_a_window_and_over_its_wall_differ_by_one_turn():
    links = signature(window())
    over = np.array([[0.8, 2.0, 1.0], [3.0, 2.0, 2.7], [5.2, 2.0, 1.0]])
    through = over[[0, 2]]
    assert links.winding(through) == (0,)
    assert abs(links.winding(over)[0]) == 1
    aside = over + np.outer([0.0, 1.0, 0.0], [0.0, 1.5, 0.0])
    assert links.winding(aside) == links.winding(over)
    assert links.with_goal(np.array([0.9, 2.0, 1.0])).winding(over[:2]) == (0,)
    assert repr(links) == "Linking(1 polygons, goal (5.2, 2, 1))"


def test_a_scene_without_generators_has_one_class():
    links = signature(in_space())
    assert links.M == 0
    assert links.winding(np.array([[1.0, 1.0, 1.0], [5.0, 1.0, 2.0]])) == ()
    assert links.name(()) == "-"
