import numpy as np
import pytest

from pirrht.errors import OptionError
from pirrht.geometry.scene import Scene
from sim.mjcf.library import MOST_PIXELS
from sim.ros.frames import Frames, Unconnected, composed, inverse, planar, quaternion_of, yaw_of
from sim.ros.grids import Grid, grid_of
from sim.ros.messages import (
    Header,
    MapMetaData,
    OccupancyGrid,
    Point,
    Pose,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
)  # fmt: skip


def joined(parent, child, pose):
    x, y, yaw = pose
    return TransformStamped(Header(frame_id=parent), child, Transform(Vector3(x, y, 0.0), quaternion_of(yaw)))


def matrix(pose):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])


def test_poses_compose_as_matrices_do_and_an_inverse_undoes_them():
    rng = np.random.default_rng(1)
    for first, second in rng.uniform(-3, 3, (20, 2, 3)):
        np.testing.assert_allclose(matrix(composed(first, second)), matrix(first) @ matrix(second), atol=1e-12)
        np.testing.assert_allclose(matrix(composed(first, inverse(first))), np.eye(3), atol=1e-12)
        assert np.isclose(np.exp(1j * yaw_of(quaternion_of(first[2]))), np.exp(1j * first[2]))


def test_a_pose_goes_up_and_down_the_tree_of_frames_and_is_as_old_as_its_oldest_part():
    frames = Frames()
    map_to_odom, odom_to_base, base_to_laser, map_to_dock = np.random.default_rng(2).uniform(-2, 2, (4, 3))
    frames.hear(TFMessage([joined("map", "odom", map_to_odom)]), 5.0)
    frames.hear(TFMessage([joined("odom", "base_link", odom_to_base)]), 7.0)
    frames.hear(TFMessage([joined("base_link", "laser", base_to_laser), joined("map", "dock", map_to_dock)]), np.inf)
    pose, time = frames.pose("dock", "laser")
    expected = np.linalg.inv(matrix(map_to_dock)) @ matrix(map_to_odom) @ matrix(odom_to_base) @ matrix(base_to_laser)
    np.testing.assert_allclose(matrix(pose), expected, atol=1e-12)
    assert time == 5.0
    assert frames.pose("map", "map")[1] == np.inf


def test_frames_that_do_not_connect_are_named_with_those_that_are_known():
    frames = Frames()
    frames.hear(TFMessage([joined("odom", "base_link", (0, 0, 0))]), 0.0)
    with pytest.raises(Unconnected, match=r"no transforms join base_link to map; frames known: base_link"):
        frames.pose("map", "base_link")


def test_transforms_in_a_circle_end_and_transforms_that_are_no_poses_change_nothing():
    frames = Frames()
    frames.hear(TFMessage([joined("a", "b", (1, 0, 0)), joined("b", "a", (1, 0, 0))]), 0.0)
    before = frames.pose("a", "b")[0]
    assert np.hypot(*before[:2]) == 1.0
    with pytest.raises(OptionError, match="the transform of b is at nan"):
        frames.hear(TFMessage([joined("a", "b", (np.nan, 0, 0))]), 1.0)
    with pytest.raises(OptionError, match="is no rotation"):
        planar(Pose(orientation=Quaternion(w=0.0)), "a pose")
    assert frames.pose("a", "b")[0].tolist() == before.tolist()


def test_the_map_of_a_scene_is_occupied_where_obstacles_are_and_nowhere_else():
    boxes = np.array([[1.0, 0.5, 1.5, 2.0], [2.52, 1.0, 2.9, 1.3]])
    scene = Scene.from_boxes(
        boxes, lower=(0, 0), upper=(4, 3), start=(0.5, 0.5), goal=(3.5, 0.5, 0.2), robot_radius=0.1
    )
    grid = Grid.of(grid_of(scene, 0.1, Header(frame_id="map")))
    rows, columns = np.indices(grid.walls.shape)
    x, y = (grid.cell * (one + 0.5) for one in (columns, rows))
    away = np.full(x.shape, np.inf)
    for x0, y0, x1, y1 in boxes:
        gap = np.hypot(np.maximum(np.maximum(x0 - x, x - x1), 0), np.maximum(np.maximum(y0 - y, y - y1), 0))
        away = np.minimum(away, gap)
    assert grid.walls[away < 0.049].all()
    assert not grid.walls[away > 0.051].any()


def of_map(data=(0, 100), width=2, height=1, cell=0.5, yaw=0.0, x=0.0):
    origin = Pose(Point(x, 0.0, 0.0), quaternion_of(yaw))
    return OccupancyGrid(info=MapMetaData(resolution=cell, width=width, height=height, origin=origin), data=list(data))


def test_cells_count_as_walls_if_they_are_occupied_or_unknown():
    assert Grid.of(of_map((0, 64, 65, 100, -1, 20), 3, 2)).walls.tolist() == [[False, False, True], [True, True, False]]


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (of_map(width=40_000, height=25_000), f"40000 x 25000 cells, and at most {MOST_PIXELS:,}"),
        (of_map(width=3), "it has 2 cells, and says 3 x 1"),
        (of_map(data=(), width=0), "it has 0 cells"),
        (of_map(cell=0.0), "the side of a cell is 0 m"),
        (of_map(cell=np.nan), "the side of a cell is nan m"),
        (of_map(yaw=0.3), "turned by 0.3 rad"),
        (of_map(x=np.nan), "the origin of the map is at nan"),
    ],
)
def test_a_map_that_cannot_be_is_refused(message, why):
    with pytest.raises(OptionError, match=why):
        Grid.of(message)
