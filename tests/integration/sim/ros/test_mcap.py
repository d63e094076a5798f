"""An exported file of MCAP: two foreign libraries read what the recording holds, by ROS's own definitions."""

from collections import defaultdict

import numpy as np
import pytest
from drives import Drive, Moving

pytest.importorskip("cyclonedds")
pytest.importorskip("rosbags")
reader = pytest.importorskip("mcap_ros2.reader")

from rosbags.highlevel import AnyReader  # noqa: E402

from sim.cli import main  # noqa: E402
from sim.recording import export  # noqa: E402
from sim.ros import mcap  # noqa: E402

pytestmark = pytest.mark.slow

TOPICS = {"/tf", "/tf_static", "/odom", "/cmd_vel", "/diagnostics", "/plan", "/pirrht/classes", "/pirrht/samples",
          "/pirrht/scene"}  # fmt: skip


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    file, drive = tmp_path_factory.mktemp("mcap") / "slit.rrd", Drive()
    with drive.recorder(file) as recorder:
        frames = []
        for frame in drive.frames(max_time=0.2):
            frames.append(frame)
            recorder.log(frame)
    out = file.with_suffix(".mcap")
    assert main(["export", str(file), "-o", str(out)]) == 0
    return file, out, frames


def held(file):
    """Times [ns] and messages by topic, as rosbags reads them."""
    found = defaultdict(list)
    with AnyReader([file]) as bag:
        for connection, time, data in bag.messages():
            found[connection.topic].append((time, bag.deserialize(data, connection.msgtype)))
    return found


def same(one, two) -> None:
    """Assert that messages of both libraries are equal, field by field."""
    if hasattr(one, "__msgtype__"):
        for name in [name for name in one.__dataclass_fields__ if name != "__msgtype__" and not name.isupper()]:
            same(getattr(one, name), getattr(two, name))
    elif isinstance(one, list):
        assert len(one) == len(two)
        for pair in zip(one, two, strict=True):
            same(*pair)
    elif isinstance(two, bytes) and isinstance(one, int):
        assert bytes([one]) == two
    else:
        np.testing.assert_array_equal(one, list(two) if isinstance(two, (bytes, tuple)) else two)


def test_two_libraries_read_equal_messages_with_times_of_the_simulation(drive):
    by_rosbags = held(drive[1])
    by_mcap = defaultdict(list)
    for one in reader.read_ros2_messages(drive[1]):
        by_mcap[one.channel.topic].append((one.log_time_ns, one.ros_msg))
        assert one.schema.encoding == "ros2msg"
    assert by_rosbags.keys() == by_mcap.keys() == TOPICS
    for topic, messages in by_rosbags.items():
        assert [time for time, _ in messages] == [time for time, _ in by_mcap[topic]]
        for (_, one), (_, two) in zip(messages, by_mcap[topic], strict=True):
            same(one, two)


def test_messages_hold_what_the_frames_held(drive):
    file, out, frames = drive
    found = held(out)
    assert len(found["/cmd_vel"]) == len(found["/diagnostics"]) == len(frames) == len(found["/odom"]) - 1
    states = [(*one.plan.state, *one.plan.control) for one in frames]
    poses = [one.pose.pose.position for _, one in found["/odom"]]
    commands = [one.linear for _, one in found["/cmd_vel"]]
    sent = [(p.x, p.y, u.x, u.y) for p, u in zip(poses, commands, strict=False)]
    np.testing.assert_allclose(sent, states, atol=1e-6)
    np.testing.assert_allclose([t * 1e-9 for t, _ in found["/odom"]], [*(f.time for f in frames), frames[-1].end_time],
                               atol=1e-6)  # fmt: skip
    moved = [one.twist.twist.linear for _, one in found["/odom"][:-1]]
    after = np.cumsum(
        [(v.x * f.advance.time, v.y * f.advance.time) for v, f in zip(moved, frames, strict=True)], axis=0
    )
    np.testing.assert_allclose(after + frames[0].plan.state, [frame.state for frame in frames], atol=1e-4)
    for (_, one), frame in zip(found["/diagnostics"], frames, strict=True):
        values = {pair.key: float(pair.value or "nan") for pair in one.status[0].values if pair.key != "outcome"}
        assert values["clearance"] == pytest.approx(frame.clearance)
        assert values["effective samples"] == pytest.approx(sum(frame.plan.estimate.class_ess.values()))
    plan = frames[0].plan
    best = plan.references[plan.ids.index(plan.favourite)].trajectory.points
    path = [(p.pose.position.x, p.pose.position.y) for p in found["/plan"][0][1].poses]
    np.testing.assert_allclose([path[0], path[-1]], best[[0, -1], :2], atol=1 / 256)  # as finely as it is drawn
    classes = [m for m in found["/pirrht/classes"][0][1].markers if m.ns == "classes"]
    assert [len(m.points) > 1 and m.color.a == 1.0 for m in classes] == [True] * len(plan.ids)
    recorded = export.shown(file)["/world/references"][0].cells
    packed = [int(sum(round(255 * getattr(m.color, c)) << s for c, s in zip("rgba", (24, 16, 8, 0), strict=True)))
              for m in classes]  # fmt: skip
    assert packed == recorded["LineStrips3D:colors"].tolist()
    scene = [m for m in found["/pirrht/scene"][0][1].markers if m.ns.startswith("scene/obstacles")]
    obstacles = Drive().scene.obstacles
    np.testing.assert_allclose(sorted((m.pose.position.x, m.pose.position.y, m.scale.x, m.scale.y) for m in scene),
                               sorted((*o.position[:2], *(2 * o.size[:2])) for o in obstacles), atol=1e-6)  # fmt: skip
    for _, array in found["/pirrht/samples"]:
        assert all(len(m.points) == len(m.colors) and len(m.points) % 2 == 0 for m in array.markers)


def test_frames_of_moving_obstacles_follow_them(tmp_path):
    drive = Moving("crossing")
    with drive.recorder(tmp_path / "a.rrd") as recorder:
        for frame in drive.frames(max_time=0.1):
            recorder.log(frame)
    found = held_of(tmp_path / "a.rrd")
    (mover,) = drive.scene.movers
    for time, message in [(time, message) for time, topic, message in found if topic == "/tf"]:
        robot, body = message.transforms
        assert (robot.header.frame_id, robot.child_frame_id) == ("odom", "base_link")
        assert (body.header.frame_id, body.child_frame_id) == ("map", f"moving/{mover.name}")
        place = body.transform.translation
        np.testing.assert_allclose([place.x, place.y], mover.motion.pose_at(time)[:2], atol=1e-6)
    (scene,) = [message for _, topic, message in found if topic == "/pirrht/scene"]
    assert any(m.header.frame_id == f"moving/{mover.name}" and m.frame_locked for m in scene.markers)


def held_of(file):
    return list(mcap.sent(export.read(file), export.shown(file)))


def row(time: float, **cells) -> export.Row:
    return export.Row(time, {name.replace("_", ":", 1): value for name, value in cells.items()})


def test_the_map_of_a_lidar_is_a_grid_from_its_lowest_row_on_and_space_has_heights():
    free, unknown, occupied = (247, 247, 245), (150, 154, 158), (16, 18, 22)
    picture = np.array([[free, unknown, occupied], [occupied, free, free]], np.uint8)
    pose = {
        "Transform3D_translation": np.array([[1.0, 2.0, 3.0]]),
        "Transform3D_quaternion": np.array([[0, 0, 0, 1.0]]),
    }
    line = np.array([[1.0, 2.0, 3.0], [4.0, 2.0, 5.0]], np.float32)
    shown = {
        "/world/robot": [row(0.0, **pose), row(0.5, **pose)],
        "/world/map/cells": [row(0.0, Mesh3D_vertex_positions=np.array([[-1.0, 0, 0], [2, 0, 0], [2, 2, 0]]))],
        "/map/cells": [row(0.5, Image_buffer=[picture.ravel()], Image_format=[{"width": 3, "height": 2}])],
        "/world/references": [row(0.5, LineStrips3D_strips=[line])],
    }
    cells = {"state": [1.0, 2.0, 3.0], "control": [0.1, 0.2, 0.3]}
    recording = export.Recording(settings={"states": "x y z"}, steps=[(0, 0.0, cells)], plan_ms={})
    sent = {topic: message for _, topic, message in mcap.sent(recording, shown)}
    grid = sent["/map"]
    assert grid.data == [100, 0, 0, 0, -1, 100]
    assert (grid.info.resolution, grid.info.origin.position.x) == (1.0, -1.0)
    assert [one.pose.position.z for one in sent["/plan"].poses] == [3.0, 5.0]
    assert sent["/cmd_vel"].linear.z == 0.3


def test_the_speed_of_a_robot_that_only_turns_is_that_of_its_arrow():
    pose = {"Transform3D_translation": np.zeros((1, 3)), "Transform3D_quaternion": np.array([[0, 0, 0, 1.0]])}
    turn, speed = 1.5, 0.8
    ways = [speed * 0.1 * np.array([np.cos(a), np.sin(a), 0.0]) for a in turn * 0.1 * np.arange(5)]
    shown = {"/world/robot": [row(0.0, **pose, Arrows3D_vectors=np.sum(ways, axis=0)[None])]}
    steps = [(0, 0.0, {"state": [0.0, 0.0, 0.0], "control": [turn]})]
    sent = {topic: m for _, topic, m in mcap.sent(export.Recording(settings={}, steps=steps, plan_ms={}), shown)}
    assert sent["/cmd_vel"].linear.x == pytest.approx(speed)
    assert sent["/cmd_vel"].angular.z == turn


def test_a_file_that_cannot_be_written_costs_one_line_and_the_old_one_stays(drive, tmp_path, refused):
    refused(["export", str(drive[0]), "-o", str(tmp_path / "no" / "a.mcap")], "does not exist")
    (tmp_path / "text.rrd").write_text("hello")
    (tmp_path / "a.mcap").write_text("old")
    refused(["export", str(tmp_path / "text.rrd"), "-o", str(tmp_path / "a.mcap")], "no Rerun recording")
    assert (tmp_path / "a.mcap").read_text() == "old"


def test_obstacles_of_an_exported_run_can_be_imported(drive, tmp_path):
    scene = tmp_path / "again.xml"
    words = ["--workspace", "0", "6", "0", "5"]
    assert main(["import", str(drive[1]), "-o", str(scene), *words]) == 0
