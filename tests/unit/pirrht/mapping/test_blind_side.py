"""What a lidar never showed on its blind side is hidden, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest
from rays import scan_of

from pirrht import Footprint, Scene
from pirrht.mapping.blind_side import BlindSide
from pirrht.mapping.occupancy import OccupancyMap

TASK = {"lower": (0, 0), "upper": (8, 6), "start": (0.6, 0.6), "goal": (7.4, 5.4, 0.3), "robot_radius": 0.1}
POST = Scene.from_boxes([[2.0, 2.9, 2.1, 3.1]], **TASK).obstacles
FOV = 1.5 * np.pi
AHEAD, BACK = 0.3, -0.3  # [m]


def looked(*poses: tuple[float, float, float], fov: float = FOV) -> BlindSide:
    """Of a cart after scans from poses among a post."""
    found = BlindSide(grid=OccupancyMap((0, 0), (8, 6)), footprint=Footprint.rectangle(0.5, 0.4))
    for pose in poses:
        found.scan = scan_of(POST, pose, rays=720, fov=fov)
        found.grid.integrate(found.scan)
    return found


def along(pose: tuple[float, float, float], far: float) -> np.ndarray:
    """Poses of a straight way from a pose, forwards or backwards [m]."""
    x, y, yaw = pose
    return np.array([(x + s * np.cos(yaw), y + s * np.sin(yaw), yaw) for s in np.linspace(0.0, far, 8)])


@pytest.mark.parametrize("yaw", np.linspace(-3.0, 3.0, 7))
def test_the_way_back_is_hidden_and_the_way_ahead_is_not(yaw: float):
    pose = (4.0, 3.0, yaw)
    assert looked(pose).hides(along(pose, BACK))
    assert not looked(pose).hides(along(pose, AHEAD))


def test_nothing_is_hidden_from_a_lidar_that_looks_all_around_or_of_which_no_scan_has_come():
    pose = (4.0, 3.0, 0.5)
    around = looked(pose, fov=2.0 * np.pi)
    assert not around.hides(along(pose, BACK))
    around.grid = looked().grid
    around.scan = replace(around.scan, angles=np.linspace(0.0, 2.0 * np.pi, 720))
    assert not around.hides(along(pose, BACK))
    assert not looked().hides(along(pose, BACK))


def test_what_was_seen_before_is_not_hidden():
    pose = (4.0, 3.0, 0.0)
    turned = looked((4.0, 3.0, 1.2), (4.0, 3.0, -1.2), pose)
    assert not turned.hides(along(pose, -1.5))
    assert turned.hides(along(pose, -2.5))  # behind the post


def test_a_robot_that_does_not_move_enters_nothing_and_the_outside_of_the_map_is_not_hidden():
    pose = (4.0, 3.0, 0.0)
    spot = np.column_stack([np.full((8, 2), pose[:2]), np.linspace(0.0, 3.0, 8)])
    assert not looked(pose).hides(spot)
    edge = (8.2, 3.0, np.pi)
    assert not replace(looked(pose), scan=scan_of(POST, edge, rays=720, fov=FOV)).hides(along(edge, BACK))
