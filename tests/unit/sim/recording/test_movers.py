"""Recordings show bodies that move where they are at the time, and films do."""

from __future__ import annotations

import numpy as np
import pytest
from drives import Moving, columns, static, timed
from moving_scenes import body, moving_scene, rows

from pirrht.arrays import Array
from sim.drawing.colors import MOVER

MAX_TIME = 0.4
FOLDER = "/world/scene/movers"
WORLD = (
    body("spin", 'type="box" size=".3 .1 .2"', "2 2 0.1")
    + body("slide", 'type="cylinder" size=".2 .2"', "3 -1 0.1")
    + body("late", 'type="sphere" size=".2"', "4 3 0.1")
)
CUSTOM = (
    rows("spin", "0 2 2 0  0.15 2.5 2 2  0.3 2 2 0", repeat=True)
    + rows("slide", "0 3 -1 0  0.1 4 -1 0")
    + rows("late", "0 4 3 0  9 4 3 0")
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("movers")
    drive, file = Moving(moving_scene(folder, WORLD, CUSTOM)), folder / "drive.rrd"
    with drive.recorder(file) as recorder:
        frames = []
        for frame in timed(drive.frames(MAX_TIME)):
            recorder.log(frame)
            frames.append(frame)
    return file, drive, frames


def heading(quaternion: Array) -> float:
    return 2 * float(np.arctan2(quaternion[2], quaternion[3]))


def test_a_moving_body_has_its_pose_at_every_step_and_at_the_end(recorded):
    file, drive, frames = recorded
    times = [frame.time for frame in frames] + [frames[-1].end_time]
    known = {name: cells[1:] for name, cells in columns(file)[f"{FOLDER}/spin"].items()}  # the first one places it
    assert known["step"] == list(range(len(times)))
    poses = drive.scene.movers[0].motion.pose(np.array(times))
    places = np.array([place[0] for place in known["Transform3D:translation"]])
    np.testing.assert_allclose(places, np.column_stack([poses[:, :2], np.full(len(times), 0.1)]), atol=1e-6)
    turns = [heading(np.array(one[0])) for one in known["Transform3D:quaternion"]]
    np.testing.assert_allclose(turns, poses[:, 2], atol=1e-6)


def colors_at(file, path):
    """The colours of an entity, (k, 4) from 0 to 255."""
    packed = np.array(static(file, path, "Boxes3D:colors"), np.uint32)
    return np.column_stack([packed >> shift & 255 for shift in (24, 16, 8, 0)])


def test_moving_obstacles_have_a_colour_of_their_own_and_nothing_hides_the_robot(tmp_path):
    """The file gives the wall and the moving box the same colour."""
    brown = 'rgba=".6 .4 .2 1"'
    wall = f'<geom name="wall" type="box" size=".1 .5 .2" pos="3 3 0.2" {brown}/>'
    world = wall + body("box", f'type="box" size=".3 .1 .2" {brown}', "2 2 0.1")
    drive, file = Moving(moving_scene(tmp_path, world, rows("box", "0 2 2 0  1 3 2 0"))), tmp_path / "a.rrd"
    with drive.recorder(file) as recorder:
        for frame in drive.frames(0.04):
            recorder.log(frame)
    (standing,), (moving,) = (colors_at(file, f"/world/scene/{name}/boxes") for name in ("obstacles", "movers/box"))
    assert tuple(moving[:3]) == MOVER
    assert tuple(standing[:3]) == (153, 102, 51)
    assert max(standing[3], moving[3]) < 220
