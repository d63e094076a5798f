"""Recordings read back: what is in them, what they cost, and what happens when a run or a viewer dies."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import rerun as rr
from drives import MAX_TIME, Drive, columns, record, rerun
from rerun.chunk import RrdReader

from sim.drawing import strokes
from sim.recording import geoms
from sim.recording.layout import layout
from sim.recording.options import Look
from sim.recording.subject import Subject, telling

STATIC_BYTES = 510_000  # scene, robot, tree, legend, the last picture, and 215 kB of blueprint


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("recording") / "slit.rrd"
    return file, *record(file)


def test_every_step_is_a_row_with_the_numbers_of_its_frame(recorded):
    file, frames, _ = recorded
    steps = columns(file)["/steps"]
    assert steps["step"] == [frame.step for frame in frames]
    assert np.allclose([t.total_seconds() for t in steps["sim_time"]], [f.time for f in frames], atol=2e-6)
    assert np.array_equal(steps["state"], [frame.plan.state for frame in frames])
    assert np.array_equal(steps["control"], [frame.plan.control for frame in frames])
    assert np.array_equal(steps["noise"], [frame.advance.noise.sum(axis=0) for frame in frames])
    assert np.array_equal(np.ravel(steps["cost"]), [frame.cost for frame in frames])
    assert np.array_equal(np.ravel(steps["clearance"]), [frame.clearance for frame in frames])
    assert np.array_equal(np.ravel(steps["value"]), [frame.plan.estimate.value for frame in frames])
    assert np.array_equal(np.ravel(steps["value_error"]), [frame.plan.estimate.value_error for frame in frames])
    assert np.array_equal(steps["control_error"], [frame.plan.estimate.control_error for frame in frames])
    for i, frame in enumerate(frames):
        named = dict(zip(steps["classes"][i], steps["weights"][i], strict=True))
        assert named == frame.plan.estimate.class_weights
        assert steps["ess"][i] == list(frame.plan.estimate.class_ess.values())


def test_the_scene_the_plan_and_the_argument_are_there_on_two_timelines(recorded):
    file, frames, news = recorded
    table = columns(file)
    robot = table["/world/robot"]
    assert np.allclose(np.array(robot["Transform3D:translation"])[-1, 0, :2], frames[-1].state, atol=1e-6)
    assert robot["step"] == [0, *range(len(frames) + 1)]  # it is placed before there is anything to see
    assert [text for line in table["/log"]["TextLog:text"] for text in line] == news
    plots = ("weight", "value", "ess", "arriving", "clearance", "control", "cost")
    for path in ("/world/path", *(f"/why/{name}" for name in plots)):
        assert len(table[path]["step"]) == len(frames), path
    assert len(table["/timing/plan"]["Scalars:scalars"]) == len(frames)
    for path in ("/world/references", "/world/ways", "/why/page", "/tree/1/references", "/world/samples/dead"):
        assert 2 <= len(table[path]["step"]) <= 2 + 5 * MAX_TIME, path
    entities = {chunk.entity_path for chunk in RrdReader(str(file)).stream()}
    scene = {"/world/scene/obstacles/boxes", "/world/robot/body/cylinders", "/tree/2/edges", "/about"}
    assert scene | {"/world/eyes/above", "/world/eyes/following"} <= entities
    timelines = {name for chunk in RrdReader(str(file)).stream() for name in chunk.timeline_names}
    assert timelines == {"step", "sim_time"}
    assert RrdReader(str(file)).blueprints()


def test_the_page_tells_the_moment_of_its_plan(recorded):
    file, _, _ = recorded
    pages = columns(file)["/why/page"]
    for when, text in zip(pages["sim_time"], pages["TextDocument:text"], strict=True):
        assert f"Plan and samples of {when.total_seconds():.2f} s" in text[0]
        assert "between upper wall and lower wall" in text[0].lower()


def test_a_closed_recording_is_whole(recorded):
    result = rerun("rrd", "verify", recorded[0])
    assert result.returncode == 0, result.stderr


def test_two_runs_of_one_seed_differ_in_wall_time_only(recorded, tmp_path):
    again = tmp_path / "again.rrd"
    record(again)
    timeless = []
    for file in (recorded[0], again):
        timeless.append(tmp_path / f"{file.stem}-timeless.rrd")
        assert rerun("rrd", "filter", "--drop-entity", "/timing/plan", file, "-o", timeless[-1]).returncode == 0
    result = rerun("rrd", "compare", *timeless)
    assert result.returncode == 0, result.stderr[-2000:]


def test_its_size_stays_within_bounds(recorded):
    file, frames, _ = recorded
    assert file.stat().st_size <= STATIC_BYTES + 450_000 * frames[-1].end_time


def test_a_lifted_reference_begins_at_its_signature_and_ends_at_the_goals_side():
    drive = Drive()
    homology = drive.space.homology
    for reference in drive.tree.references(drive.scene.start[:2]):
        line = strokes.even(reference.trajectory.points, 32)
        for k in range(homology.M):
            height = strokes.remaining(homology, reference, line, k)
            assert height[0] == reference.signature[k]
            assert height[-1] == pytest.approx(1.0 + homology.base(line[-1])[k], abs=1e-9)
            assert np.abs(np.diff(height)).max() < 0.25


def test_a_tree_is_lifted_by_what_tells_the_shortest_classes_apart_or_by_what_one_chooses(tmp_path):
    drive = Drive()
    x = drive.scene.start[:2]
    lengths = drive.tree.lengths(x)
    first, second, *_ = sorted(lengths, key=lambda winding: lengths[winding])
    found = telling(drive.tree, x)
    assert first[found[0]] != second[found[0]]
    assert sorted(found) == [0, 1]
    with drive.recorder(tmp_path / "chosen.rrd", lift=[2]) as recorder:
        for frame in drive.frames(0.02):
            recorder.log(frame)
    paths = {chunk.entity_path for chunk in RrdReader(str(tmp_path / "chosen.rrd")).stream()}
    assert "/tree/2/edges" in paths
    assert "/tree/1/edges" not in paths


MESHES = """<mujoco>
  <asset><mesh name="m" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .6"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <geom name='my box/1 "x"' type="mesh" mesh="m" pos="0 0 .1"/>
    <geom name='my box\\/1 "x"' type="mesh" mesh="m" pos="0 1 .1"/>
    <geom name="3" type="mesh" mesh="m" pos="1 1 .1"/>
    <geom type="mesh" mesh="m" pos="0 -1.5 .1"/>
  </worldbody>
</mujoco>"""


def test_meshes_have_entity_paths_of_their_own_whatever_their_names(capfd):
    model = mujoco.MjModel.from_xml_string(MESHES)
    drawn = geoms.solids(model, geoms.shown(model))
    assert len(drawn) == 4
    stream = rr.RecordingStream("meshes")
    for path, solid in drawn.items():
        assert len(path.replace("\\\\", "").replace("\\/", "").split("/")) == 2  # `meshes` and one part, escaped
        stream.log(f"/world/{path}", solid)
    assert "WARN" not in capfd.readouterr().err


def static(file, path, column):
    """What is said once of an entity."""
    for chunk in RrdReader(str(file)).stream():
        batch = chunk.to_record_batch()
        if chunk.is_static and chunk.entity_path == path and column in batch.schema.names:
            return batch.column(column).to_pylist()[0]
    raise AssertionError(path)


def test_a_key_names_what_the_map_numbers(recorded):
    (key,) = static(recorded[0], "/key", "TextDocument:text")
    names = static(recorded[0], "/world/scene/names", "Points3D:labels")
    assert names == ["goal", "1 upper wall", "2 lower wall"]
    assert all(f"**{sign}** {name}" in key for sign, name in ((1, "upper wall"), (2, "lower wall")))


def test_a_file_opens_at_its_first_plan_and_a_viewer_follows():
    drive = Drive()
    subject = Subject(
        loaded=drive.loaded, tree=drive.tree, path_integral=drive.controller.path_integral, look=Look(), settings={}
    )
    states = {live: layout(subject, live=live).time_panel.play_state for live in (False, True)}
    assert states == {False: "paused", True: "following"}
