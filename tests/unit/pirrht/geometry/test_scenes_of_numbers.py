"""Scenes and motions from plain numbers are those that files describe, and hold what was given and nothing else."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from trees import point

from pirrht import Goal, Kind, Obstacle, Scene, SceneError
from pirrht.geometry.collision import Collision
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.rectangles import blocks, cover, union
from sim.mjcf import load

ROOM = {"lower": (0, 0), "upper": (6, 5), "start": (0.5, 2.5), "goal": (5.5, 2.4, 0.25), "robot_radius": 0.15}
BOXES = [[1.5, 0.75, 2.0, 2.25], [1.5, 2.75, 2.0, 4.25], [3.5, 1.5, 4.25, 3.0]]
DISCS = [[2.0, 1.5, 0.5], [2.0, 3.5, 0.75], [4.0, 2.25, 0.3125]]
U_SHAPE = [(2, 1), (4, 1), (4, 4), (2, 4), (2, 3.5), (3.5, 3.5), (3.5, 1.5), (2, 1.5)]
GEOMS = {
    "boxes": [
        f'<geom type="box" pos="{(a + c) / 2} {(b + d) / 2} 0.25" size="{(c - a) / 2} {(d - b) / 2} 0.25"/>'
        for a, b, c, d in BOXES
    ],
    "discs": [f'<geom type="cylinder" pos="{x} {y} 0.25" size="{r} 0.25"/>' for x, y, r in DISCS],
}
MADE = {"boxes": partial(Scene.from_boxes, BOXES), "discs": partial(Scene.from_discs, DISCS)}


def clearance(scene: Scene, points: np.ndarray) -> np.ndarray:
    return Collision(scene.world, scene.footprint).clearance(points)


def to_outline(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance from points (k, 2) to the area of a simple polygon (l, 2), 0 inside."""
    a, b = corners, np.roll(corners, -1, axis=0)
    gap, side = points[:, None] - a, b - a
    t = np.clip(np.sum(gap * side, axis=-1) / np.sum(side**2, axis=-1), 0.0, 1.0)
    far = np.linalg.norm(gap - t[..., None] * side, axis=-1).min(axis=1)
    above = (a[:, 1] > points[:, None, 1]) != (b[:, 1] > points[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a[:, 0] + (points[:, None, 1] - a[:, 1]) * side[:, 0] / side[:, 1]
    return np.where(np.sum(above & (points[:, None, 0] < x), axis=1) % 2, 0.0, far)


def star(seed: int) -> np.ndarray:
    """A polygon about (3, 2.5) that is hardly ever convex."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9))
    return np.array([3.0, 2.5]) + rng.uniform(0.4, 2.0, (9, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])


@pytest.mark.parametrize("kind", ["boxes", "discs"])
def test_a_scene_by_constructor_gives_bit_by_bit_the_plan_of_the_same_scene_by_file(kind: str, tmp_path):
    file = tmp_path / "room.xml"
    file.write_text(
        f'<mujoco><worldbody>{"".join(GEOMS[kind])}<site name="start" pos="0.5 2.5 0"/>'
        '<site name="goal" type="cylinder" pos="5.5 2.4 0" size="0.25 0.01"/>'
        '<site name="workspace" type="box" pos="3 2.5 0.5" size="3 2.5 0.5"/></worldbody></mujoco>'
    )
    read = load(file).scene
    made = MADE[kind](**ROOM | {"robot_radius": read.robot_radius, "robot_height": read.robot_height})
    one, other = (point(scene, 0.2, 200, limit=0.6, samples=50).plan(scene.start[:2]) for scene in (made, read))
    assert len(one.ids) > 1
    assert one.ids == other.ids
    assert one.estimate.value == other.estimate.value
    np.testing.assert_array_equal(one.tape, other.tape)
    for here, there in zip(one.references, other.references, strict=True):
        np.testing.assert_array_equal(here.trajectory.points, there.trajectory.points)


@pytest.mark.parametrize("corners", [U_SHAPE, [(1, 1), (3, 1), (1, 3)], *(star(seed) for seed in range(8))])
@pytest.mark.parametrize("turned", [1, -1])
def test_a_polygon_is_as_far_away_as_its_outline(corners, turned: int):
    polygon = np.array(corners, dtype=float)[::turned]
    room = ROOM | {"start": (0.2, 0.2), "goal": (5.8, 4.8, 0.1)}
    points = np.random.default_rng(1).uniform([1.0, 0.8], [5.0, 4.2], (300, 2))
    expected = np.minimum(np.minimum(points, [6, 5] - points).min(axis=1), to_outline(polygon, points) - 0.15)
    np.testing.assert_allclose(clearance(Scene.from_polygons([polygon], **room), points), expected, atol=1e-5)


def test_a_grid_is_occupied_where_it_says_and_free_elsewhere():
    occupied = np.random.default_rng(3).random((12, 20)) < 0.3
    occupied[:2, :2] = occupied[-2:, -2:] = False
    task = {"start": (-0.8, 2.2), "goal": (8.8, 7.8, 0.1), "robot_radius": 1e-3}
    scene = Scene.from_grid(occupied, 0.5, origin=(-1, 2), **task)
    np.testing.assert_array_equal([scene.lower, scene.upper], [[-1, 2], [9, 8]])
    rows, columns = np.indices(occupied.shape)
    centres = np.column_stack([-1 + 0.5 * (columns.ravel() + 0.5), 2 + 0.5 * (rows.ravel() + 0.5)])
    np.testing.assert_array_equal(clearance(scene, centres) <= 0.0, occupied.ravel())
    assert len(scene.obstacles) < occupied.sum()


VAST = np.broadcast_to(np.zeros((1, 1), dtype=bool), (40_000, 30_000))  # takes no memory
CORNERED = {key: value for key, value in ROOM.items() if key not in ("lower", "upper")}


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: Scene.from_boxes([[0, 1, 2, 3], [1, 2, 0, 3]], **ROOM), "box 2 is .*x0 must be less than x1"),
        (lambda: Scene.from_boxes([[0, 1, 2]], **ROOM), r"boxes: row 1 is \[0, 1, 2\]; .* x0, y0, x1, y1 \[m\]"),
        (lambda: Scene.from_boxes([[0, 1, 2, np.nan]], **ROOM), "boxes: row 1 .* finite"),
        (lambda: Scene.from_discs([[3, 2, 0]], **ROOM), "disc 1 is .* radius must be positive"),
        (lambda: Scene.from_discs([[3, 2, "wide"]], **ROOM), "discs: row 1 .* x, y, radius"),
        (lambda: Scene.from_polygons([U_SHAPE, [(0, 0), (1, 1), (2, 2)]], **ROOM), "polygon 2 has no inside"),
        (lambda: Scene.from_polygons([[(0, 0), (1, 1), (1, 0), (0, 1)]], **ROOM), "polygon 1 crosses itself"),
        (lambda: Scene.from_grid(np.zeros((3, 3)), 1.0, **CORNERED), "the grid is of float64 .*grid > 50"),
        (lambda: Scene.from_grid(np.zeros(3, bool), 1.0, **CORNERED), r"shape \(3,\)"),
        (lambda: Scene.from_grid(np.zeros((5, 6), bool), 0.0, **CORNERED), "the resolution is 0"),
        (lambda: Scene.from_grid(VAST, 0.05, **CORNERED), "40000 x 30000 cells.*at most 25,000,000.*join 7 x 7 cells"),
        (
            lambda: Scene.from_voxels(np.zeros((3, 3), bool), 1.0, **CORNERED),
            r"shape \(3, 3\).*booleans \(nx, ny, nz\)",
        ),
        (lambda: Scene.from_voxels(VAST[None], 0.1, **CORNERED), "1 x 40000 x 30000 cells.*join 4 x 4 x 4 cells"),
        (
            lambda: Scene.from_voxels(np.zeros((7, 7, 2), bool), 1.0, **CORNERED),
            r"the goal is .*it must be x, y, z, rad",
        ),
        (lambda: Scene.from_boxes([], **ROOM | {"goal": (1, 2)}), r"the goal is \(1, 2\); it must be x, y, radius"),
        (lambda: Scene.from_boxes([], **ROOM | {"start": (9, 2)}), "the start .* outside the workspace"),
    ],
)
def test_what_cannot_be_a_scene_is_refused_in_one_line(made, words: str):
    with pytest.raises(SceneError, match=words) as caught:
        made()
    assert "\n" not in str(caught.value)


HOSTILE = (
    *(None, "abc", b"x", np.nan, np.inf, -np.inf, 1e160, 1e17, True, 1j, 10**400, object(), [None], {1: 2}),
    *(np.ma.masked_array([1.0, 2.0, 0.3], [0, 1, 0]), [[1.0], [2.0, 3.0]], [1.0, "2", 0.3], [1.0, np.nan, 0.3]),
)
NO_OBSTACLE = {"name": "o", "kind": Kind.BOX, "size": np.ones(3), "position": np.ones(3), "rotation": np.eye(3)}
TETRAHEDRON = {"vertices": np.eye(4, 3), "faces": np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])}
PLAIN = {"lower": np.zeros(2), "upper": np.ones(2), "start": np.full(3, 0.5), "robot_radius": 0.1, "obstacles": ()}
GOAL = Goal(center=np.full(2, 0.5), radius=0.1)
MAKERS = {
    **{
        key: (lambda v, key=key: Scene.from_boxes([[1, 1, 2, 2]], **ROOM | {key: v})) for key in (*ROOM, "robot_height")
    },
    "boxes": lambda v: Scene.from_boxes(v, **ROOM),
    "discs": lambda v: Scene.from_discs([v], **ROOM),
    "polygons": lambda v: Scene.from_polygons(v, **ROOM),
    "polygon": lambda v: Scene.from_polygons([v], **ROOM),
    "corner": lambda v: Scene.from_polygons([[(1, 1), (2, 1), v]], **ROOM),
    "grid": lambda v: Scene.from_grid(v, 1.0, **CORNERED),
    "resolution": lambda v: Scene.from_grid(np.zeros((5, 6), bool), v, **CORNERED),
    "voxels": lambda v: Scene.from_voxels(v, 1.0, **CORNERED),
    "size": lambda v: Scene.from_voxels(np.zeros((7, 7, 7), bool), v, **CORNERED),
    "origin": lambda v: Scene.from_grid(np.zeros((5, 6), bool), 1.0, origin=v, **CORNERED),
    "center": lambda v: Goal(center=v, radius=0.3),
    "radius": lambda v: Goal(center=np.ones(2), radius=v),
    **{
        key: (lambda v, key=key: Obstacle(**NO_OBSTACLE | {key: v})) for key in ("kind", "size", "position", "rotation")
    },
    **{
        key: (lambda v, key=key: Obstacle(**NO_OBSTACLE | TETRAHEDRON | {"kind": Kind.MESH, key: v}))
        for key in TETRAHEDRON
    },
    **{
        f"scene {key}": (lambda v, key=key: Scene(**{"name": "a", "goal": GOAL, **PLAIN, key: v}))
        for key in (*PLAIN, "goal", "margin", "movers", "waivers")
    },
    "rows": lambda v: Motion(rows=v),
    "offset": lambda v: Motion(rows=np.zeros((1, 4)), offset=v),
    "solids": lambda v: Mover(name="m", solids=v, motion=Motion(rows=np.zeros((1, 4)))),
}


@pytest.mark.parametrize("field", MAKERS)
def test_no_field_of_a_scene_takes_what_is_no_number_of_bearable_size(field: str):
    for value in HOSTILE:
        with pytest.raises(SceneError) as caught:
            MAKERS[field](value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: Scene.from_boxes([[1, 1, 2, 2]], **ROOM, robot_height=-1), "height of the robot's centre is -1"),
        (lambda: Scene.from_boxes([[1, 1, 2, 2]], **ROOM, robot_height=np.nan), "height of the robot's centre is nan"),
        (lambda: Scene.from_polygons([1e160 * np.array(U_SHAPE)], **ROOM), "polygon 1: row 1 is .* at most 1e\\+06"),
        (lambda: Scene.from_discs([[2, 2, 1e17]], **ROOM), "discs: row 1 is .* at most 1e\\+06"),
        (lambda: Scene.from_boxes((row for row in BOXES), **ROOM), "boxes is <generator .* a sequence of rows"),
        (lambda: Scene.from_grid(np.zeros((5, 6), bool), None, **CORNERED), "the resolution is None"),
        (lambda: Scene.from_boxes(BOXES, **ROOM, name=3), "the name of a scene is 3"),
        (lambda: Obstacle(**NO_OBSTACLE | {"size": np.array([1, 1, 0])}), "obstacle 'o': size is .* positive"),
        (lambda: Obstacle(**NO_OBSTACLE | {"rotation": np.ones((3, 3))}), "obstacle 'o': rotation is"),
        (lambda: Scene.from_grid(np.ma.masked_array(np.zeros((5, 6), bool), True), 1, **CORNERED), "with masked cells"),
    ],
)
def test_what_would_make_walls_vanish_is_named(made, words: str):
    with pytest.raises(SceneError, match=words):
        made()


@pytest.mark.parametrize(
    ("picture", "count"),
    [
        (("###", "###"), 1),
        (("...", "..."), 0),
        ((".#.", "###", ".#."), 2),
        (("#..", "#..", "###"), 2),
        (("#####", "#...#", "#...#", "#####"), 4),
        (("#.#", ".#.", "#.#"), 5),
    ],
)
def test_simple_shapes_take_as_few_as_they_can(picture: tuple[str, ...], count: int):
    assert len(cover(np.array([[c == "#" for c in row] for row in picture]))) == count


@settings(max_examples=60)
@given(cells=arrays(np.bool_, st.tuples(st.integers(1, 14), st.integers(1, 14))))
def test_any_set_of_cells_survives_as_rectangles(cells):
    pieces = cover(cells)
    np.testing.assert_array_equal(union(pieces, cells.shape) > 0, cells)
    runs = np.sum(np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(int), axis=1) == 1)
    assert len(pieces) <= runs  # no more than rows cut at every gap
    assert np.all(pieces[:, ::2] < pieces[:, 1::2])


@settings(max_examples=60)
@given(voxels=arrays(np.bool_, st.tuples(*[st.integers(1, 7)] * 3)))
def test_any_set_of_voxels_is_covered_once_by_boxes(voxels):
    depth = np.zeros(voxels.shape, dtype=int)
    pieces = blocks(voxels)
    for x0, y0, z0, x1, y1, z1 in pieces:
        depth[x0:x1, y0:y1, z0:z1] += 1
    np.testing.assert_array_equal(depth, voxels)
    runs = [
        np.sum(np.diff(np.pad(voxels, [(k == axis, 0) for k in range(3)]).astype(int), axis=axis) == 1)
        for axis in range(3)
    ]
    assert len(pieces) <= min(runs)


def test_voxels_make_a_scene_in_space_that_is_solid_where_they_are():
    voxels = np.random.default_rng(3).random((6, 5, 4)) < 0.3
    voxels[0, 0, 0] = voxels[-1, -1, -1] = False
    origin = np.array([-1.0, 2.0, 0.5])
    upper = origin + np.array([3.0, 2.5, 2.0])
    task = {"start": origin + 0.2, "goal": [*(upper - 0.2), 0.1], "robot_radius": 1e-3}
    scene = Scene.from_voxels(voxels, 0.5, origin=origin, **task)
    np.testing.assert_array_equal([scene.lower, scene.upper], [origin, upper])
    centres = origin + 0.5 * (np.argwhere(np.ones(voxels.shape)) + 0.5)
    np.testing.assert_array_equal(clearance(scene, centres) <= 0.0, voxels.ravel())


ROWS = np.array([[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [3.0, 1.0, 2.0, 1.0]])


def test_a_pose_lies_between_its_rows_and_a_body_stands_still_after_the_last():
    motion = Motion(rows=ROWS)
    np.testing.assert_allclose(
        motion.pose(np.array([-1.0, 0.5, 2.0, 9.0])), [[0, 0, 0], [0.5, 0, 0], [1, 1, 0.5], [1, 2, 1]]
    )
    assert motion.last == 3.0


def test_a_motion_that_starts_over_has_the_period_of_its_last_row():
    motion = Motion(rows=ROWS, repeat=True)
    times = np.linspace(0.1, 2.9, 7)
    np.testing.assert_allclose(motion.pose(times + 6.0), motion.pose(times), atol=1e-12)
    assert np.isinf(motion.last)


def test_the_solids_of_a_body_turn_and_move_with_it():
    solid = Obstacle(name="o", kind=Kind.BOX, size=np.ones(3), position=np.array([1.0, 0.0, 0.2]), rotation=np.eye(3))
    (there,) = Mover(name="m", solids=(solid,), motion=Motion(rows=np.array([[0.0, 2.0, 3.0, 0.5 * np.pi]]))).at(5.0)
    np.testing.assert_allclose(there.position, [2.0, 4.0, 0.2], atol=1e-12)
    np.testing.assert_allclose(there.rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("rows", "repeat", "words"),
    [
        ([[0.5, 0, 0, 0]], False, "must be at 0"),
        ([[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0]], False, "row 3 of a motion is at 1 s after one at 1 s"),
        ([[0, 0, 0, 0], [1, np.nan, 0, 0]], False, "row 2"),
        ([[0, 0, 0]], False, "a yaw"),
        ([[0, 0, 0, 0]], True, "two or more"),
    ],
)
def test_rows_that_are_no_motion_are_refused(rows, repeat, words):
    with pytest.raises(SceneError, match=words):
        Motion(rows=np.array(rows, dtype=float), repeat=repeat)
