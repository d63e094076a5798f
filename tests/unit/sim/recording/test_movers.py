"""Recordings show bodies that move where they are at the time."""

import numpy as np
from drives import Moving, columns, timed
from plants import body, moving_scene, rows

WORLD = body("spin", 'type="box" size=".3 .1 .2"', "2 2 0.1")
CUSTOM = rows("spin", "0 2 2 0  0.15 2.5 2 2  0.3 2 2 0", repeat=True)


def test_a_moving_body_has_its_pose_at_every_step_and_at_the_end(tmp_path):
    drive, file, frames = Moving(moving_scene(tmp_path, WORLD, CUSTOM)), tmp_path / "drive.rrd", []
    with drive.recorder(file) as recorder:
        for frame in timed(drive.frames(0.4)):
            recorder.log(frame)
            frames.append(frame)
    times = [frame.time for frame in frames] + [frames[-1].end_time]
    table = columns(file)["/world/scene/movers/spin"]
    known = {name: cells[1:] for name, cells in table.items()}  # the first one places it
    assert known["step"] == list(range(len(times)))
    poses = drive.scene.movers[0].motion.pose(np.array(times))
    places = np.array([place[0] for place in known["Transform3D:translation"]])
    np.testing.assert_allclose(places, np.column_stack([poses[:, :2], np.full(len(times), 0.1)]), atol=1e-6)
    x, y, z, w = np.array([one[0] for one in known["Transform3D:quaternion"]]).T
    np.testing.assert_allclose(2.0 * np.arctan2(z, w), poses[:, 2], atol=1e-6)
    assert not np.any([x, y])
