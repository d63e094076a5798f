"""Moving obstacles in front of a lidar are tracked, and are no part of the map."""

import numpy as np
from rays import scan_of

from pirrht.geometry.solids import boxes, discs
from pirrht.mapping.occupancy import OccupancyMap
from pirrht.mapping.scan import Scan
from pirrht.mapping.tracker import Tracker

ROOM = boxes([[-0.1, -0.1, 8.1, 0.12], [-0.1, 5.88, 8.1, 6.1], [-0.1, -0.1, 0.12, 6.1], [7.88, -0.1, 8.1, 6.1]], 1.0)
POSE = np.array([1.0, 3.0, 0.0])


class Watch:
    """A lidar that looks on, ten times a second, whose rays may come in descending order."""

    def __init__(self, *, descending: bool = False) -> None:
        self.order = slice(None, None, -1 if descending else 1)
        self.map = OccupancyMap((0, 0), (8, 6))
        self.tracks = Tracker()
        self.rng = np.random.default_rng(1)
        self.time = 0.0

    def see(self, *rows: tuple[float, float, float], pose: np.ndarray = POSE, walls=()) -> None:
        solids = [*ROOM, *walls, *(discs(rows, 1.0) if rows else ())]
        scan = scan_of(solids, pose, fov=np.radians(270))
        ranges = scan.ranges + 0.001 * self.rng.standard_normal(len(scan.ranges))
        order = self.order
        scan = Scan(pose=pose, angles=scan.angles[order], ranges=ranges[order], most=scan.most, time=self.time)
        self.map.integrate(scan, passing=self.tracks.see(scan, self.map))
        self.time += 0.1

    def walls_near(self, x: float, y: float, radius: float) -> int:
        """Occupied cells within a radius of a place."""
        rows, columns = np.nonzero(self.map.occupied)
        centres = 0.05 * (np.column_stack([columns, rows]) + 0.5)
        return int(np.count_nonzero(np.hypot(*(centres - (x, y)).T) < radius))


def test_what_crosses_is_tracked_with_its_velocity_and_leaves_no_wall():
    for radius, speed in ((0.5, 1.2), (0.25, 0.7), (0.3, 1.7)):
        watch = Watch()
        for _ in range(3):
            watch.see()
        y = 1.0
        while y < 4.8:
            watch.see((4.0, y, radius))
            y += 0.1 * speed
        (track,) = watch.tracks.moving
        assert np.hypot(*(track.state[2:] - (0.0, speed))) < 0.1 * speed
        assert np.hypot(*(track.state[:2] - (4.0, y - 0.1 * speed))) < 0.1
        assert abs(track.radius - radius) < 0.06
        assert watch.walls_near(4.0, 3.0, 2.6) == 0


def test_the_order_of_the_rays_does_not_matter():
    watches = Watch(), Watch(descending=True)
    for watch in watches:
        for k in range(20):
            watch.see((4.0, 1.0 + 0.12 * k, 0.5))
    (one,), (other,) = (watch.tracks.moving for watch in watches)
    assert np.allclose(one.state, other.state, atol=1e-6)
    assert np.array_equal(watches[0].map.occupied, watches[1].map.occupied)


def test_what_moves_from_the_first_scan_on_is_tracked_and_leaves_no_wall():
    watch = Watch()
    for k in range(30):
        watch.see((6.0 - 0.08 * k, 3.5, 0.4))
    (track,) = watch.tracks.moving
    assert np.hypot(*(track.state[2:] - (-0.8, 0.0))) < 0.08
    assert watch.walls_near(5.0, 3.5, 1.8) == 0


def test_what_has_come_to_stand_becomes_a_wall_and_may_go_on():
    watch = Watch()
    for _ in range(3):
        watch.see()
    for k in range(25):
        watch.see((4.0, 1.0 + 0.08 * k, 0.3))
    assert len(watch.tracks.moving) == 1
    for _ in range(20):
        watch.see((4.0, 2.92, 0.3))
    assert not watch.tracks.moving
    assert watch.walls_near(4.0, 2.92, 0.4) > 5
    for k in range(20):
        watch.see((4.0, 2.92 + 0.08 * k, 0.3))
    assert len(watch.tracks.moving) == 1
    assert watch.walls_near(4.0, 2.92, 0.4) == 0


def test_a_thing_that_stands_is_a_wall_at_once_and_stays_one_as_the_robot_drives():
    watch = Watch()
    for k in range(40):
        rows = [(4.0, 3.5, 0.3), (5.0, 1.5, 0.075), (5.0, 2.0, 0.075), (5.2, 2.4, 0.075)]
        watch.see(*rows[: 1 if k < 20 else 4], pose=np.array([1.0 + 0.04 * k, 3.0 - 0.02 * k, 0.0]))
        assert not watch.tracks.moving
        assert watch.walls_near(4.0, 3.5, 0.35) > 5
    assert watch.walls_near(5.0, 1.5, 0.15) > 1


def test_a_thin_wall_around_whose_end_the_robot_drives_is_neither_tracked_nor_lost():
    """From afar, rays pass the cells of its far side before they hit them."""
    wall = boxes([[2.2, 3.3, 3.8, 3.42]], 1.0)
    watch = Watch()
    every = np.arange(8)
    turns = np.linspace(0, 7, 22)
    x = np.interp(turns, every, [1.36, 1.556, 1.749, 1.987, 2.228, 2.481, 2.784, 3.1])
    y = np.interp(turns, every, [3.1, 3.3, 3.475, 3.641, 3.733, 3.782, 3.81, 3.81])
    yaw = np.interp(turns, every, [0.86, 0.77, 0.68, 0.48, 0.25, 0.1, 0.05, 0.0])
    for pose in np.column_stack([x, y, yaw]):
        watch.see(pose=pose, walls=wall)
        assert not watch.tracks.known
    assert watch.walls_near(3.0, 3.42, 0.7) >= 20


def test_two_that_cross_keep_their_identity():
    watch = Watch()
    for _ in range(3):
        watch.see()
    numbers = []
    for k in range(35):
        watch.see((4.0, 1.0 + 0.1 * k, 0.3), (5.2, 4.5 - 0.1 * k, 0.3))
        if k in (10, 34):
            moving = watch.tracks.moving
            numbers.append({np.sign(one.state[3]): one.number for one in moving})
    assert len(numbers[0]) == 2
    assert numbers[0] == numbers[1]


def test_a_track_is_born_after_a_few_scans_and_forgotten_once_it_is_out_of_sight():
    watch = Watch()
    for _ in range(3):
        watch.see()
    born = next(k for k in range(20) if watch.see((4.0, 1.0 + 0.12 * k, 0.3)) or watch.tracks.moving)
    assert 2 <= born <= 7
    gone = next(k for k in range(20) if watch.see() or not watch.tracks.known)
    assert 7 <= gone <= 10
