"""Rays in MuJoCo end where solids are, and at nothing of the robot."""

import mujoco
import numpy as np
import pytest
from plants import scene_file
from rays import ranges_to

from pirrht import OptionError
from sim.mjcf import load
from sim.mjcf.obstacles import Mocap
from sim.sensing.lidar import Lidar, LidarSensor

EXACT = {"sigma": 0.0, "least": 0.0}


def at_start(loaded, time: float = 0.0) -> mujoco.MjData:
    """MuJoCo's data with the robot at the start, and bodies where they are at a time."""
    data = mujoco.MjData(loaded.model)
    mujoco.mj_resetDataKeyframe(loaded.model, data, 0)
    if loaded.scene.movers:
        Mocap(loaded.model, loaded.scene.movers).place(data, time)
    mujoco.mj_kinematics(loaded.model, data)
    return data


def scan_at(loaded, pose, time: float = 0.0, **lidar):
    sensor = LidarSensor(loaded, Lidar(**{**EXACT, **lidar}))
    return sensor.scan(at_start(loaded, time), np.asarray(pose, float), time, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("scene", "robot", "time", "height"),
    [
        ("house", "diffdrive", 0.0, None), ("house", "diffdrive", 0.0, 0.05), ("barn", "puck", 0.0, None),
        ("warehouse", "rover", 0.0, None), ("crossing", "puck", 0.0, None), ("crossing", "puck", 2.3, None),
        ("pincer", "unicycle", 1.1, None), ("closing_door", "car", 3.0, None),
    ],
)  # fmt: skip
def test_ranges_are_those_of_closed_forms_to_solids_and_not_to_the_robot(scene, robot, time, height):
    loaded = load(scene, robot=robot)
    world = [*loaded.scene.obstacles, *(solid for mover in loaded.scene.movers for solid in mover.at(time))]
    for turn in (0.0, 1.0, -2.5):
        pose = np.add(loaded.scene.start, (0.0, 0.0, turn))
        scan = scan_at(loaded, pose, time, z=height, fov=360.0)
        exact = ranges_to(world, scan.pose, scan.angles, height or loaded.scene.robot_height)
        exact[exact > 30.0] = np.inf
        np.testing.assert_allclose(scan.ranges, exact, atol=1e-6)
        assert np.isfinite(exact).sum() > 20


def test_only_what_collides_is_seen_even_if_it_is_transparent(tmp_path):
    world = (
        '<geom name="glass" type="box" size=".1 3 .3" pos="4 0 .3" rgba="1 1 1 0"/>'
        '<geom name="curtain" type="box" size=".1 3 .3" pos="2 0 .3" contype="0" conaffinity="0"/>'
        '<geom name="lamp" type="sphere" size=".3" pos="3 0 2"/>'
        '<site name="mark" type="sphere" size=".3" pos="1 0 .1"/>'
    )
    loaded = load(scene_file(tmp_path, world=world))
    scan = scan_at(loaded, (0, 0, 0), rays=11, fov=90.0)
    np.testing.assert_allclose(scan.ranges[::5], [np.inf, 3.9, np.inf])
    assert np.all(scan_at(loaded, (0, 0, 0), most=3.8).ranges == np.inf)


def test_a_mount_shifts_and_turns_the_rays(tmp_path):
    loaded = load(scene_file(tmp_path, world='<geom name="wall" type="box" size=".1 3 .3" pos="4 0 .3"/>'))
    scan = scan_at(loaded, (1.0, 0.5, np.pi / 2), x=0.02, y=0.03, yaw=-np.pi / 2, rays=3, fov=2.0)
    np.testing.assert_allclose(scan.pose, [0.97, 0.52, 0.0], atol=1e-12)
    np.testing.assert_allclose(scan.points[1], [3.9, 0.52])


def test_noise_has_its_deviation_and_what_is_too_near_is_no_free_ray(tmp_path):
    loaded = load(scene_file(tmp_path, world='<geom name="wall" type="box" size=".1 3 .3" pos="1 0 .3"/>'))
    exact, noisy, near = (
        scan_at(loaded, (0, 0, 0), fov=120.0, **given) for given in ({}, {"sigma": 0.02}, {"least": 1})
    )
    off = noisy.ranges - exact.ranges
    assert abs(np.std(off) - 0.02) < 0.02 * 3 / np.sqrt(2 * 720)  # three standard deviations
    np.testing.assert_array_equal(near.ranges, np.where(exact.ranges < 1.0, -np.inf, exact.ranges))
    assert 0 < np.isfinite(near.ranges).sum() < 720


def test_the_default_is_the_lidar_of_barn():
    lidar = Lidar()
    assert (np.ptp(np.rad2deg(lidar.angles)).round(9), len(lidar.angles), lidar.period) == (270.0, 720, 0.1)
    assert Lidar.of("") == lidar
    assert Lidar.of("rays=360, fov=360 z=0.2") == Lidar(rays=360, fov=360.0, z=0.2)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("ray=3", "no 'ray'"), ("rays=many", "rays is 'many'"), ("rays=1.5", "rays is 1.5; .* whole"),
        ("fov=nan", "fov"), ("rays=0", "rays is 0"), ("least=40", "below the most, 30"),
        ("fov=0", "fov is 0.0; .* above 0"), ("rays=1", "rays is 1; .* from 2"), ("rays=27", "write rays=28"),
        ("rays=5", "67.5 degrees apart.* write rays=28 or more"),
        ("sigma=-1", "sigma"), ("z=inf", "z is inf"), ("rate=0", "rate"), ("rays", "rays is ''"),
        ("fov=90,fov=180", "fov is given twice"),
    ],
)  # fmt: skip
def test_a_text_that_is_no_lidar_is_refused_with_a_reason(text, why):
    with pytest.raises(OptionError, match=why):
        Lidar.of(text)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"z": 3.0}, "at z=3 the lidar sees no obstacle; one is there at z=0.3"),
        ({"z": -0.1}, "at z=-0.1 the lidar sees no obstacle"),
        ({"x": 0.3, "y": -0.4}, r"at x=0.3, y=-0.4; on this robot it is within 0.\d+ m"),
        ({"most": 0.05}, "most is 0.05 m; it must be above the robot's reach"),
    ],
)
def test_a_lidar_that_sees_nothing_from_where_it_is_is_refused_with_one_that_would_work(tmp_path, given, why):
    wall = '<geom name="wall" type="box" size=".3 3 .1" pos="4 0 .3" euler="0 90 0"/>'  # from the ground to 0.6 m
    loaded = load(scene_file(tmp_path, world=wall))
    with pytest.raises(OptionError, match=why) as caught:
        scan_at(loaded, (0, 0, 0), **given)
    assert "\n" not in str(caught.value)
    assert np.isfinite(scan_at(loaded, (0, 0, 0), z=0.55).ranges).any()


def test_a_lidar_may_look_over_a_field_without_obstacles(tmp_path):
    assert np.all(scan_at(load(scene_file(tmp_path)), (0, 0, 0), z=3.0).ranges == np.inf)
