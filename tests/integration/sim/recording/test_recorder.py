"""Recordings read back: what is in them, what they cost, and what happens when a run or a viewer dies."""

import mujoco
import numpy as np
import pytest
from drives import MAX_TIME, Drive, Moving, columns, record, rerun, static
from rerun.chunk import RrdReader

from pirrht.plotting.strokes import even
from sim.drawing import strokes
from sim.recording import geoms
from sim.recording.stage import layout
from sim.recording.subject import Subject, telling
from sim.recording.viewer import Look

STATIC_BYTES = 510_000  # scene, robot, tree, legend, the last picture, and 215 kB of blueprint


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("recording") / "slit.rrd"
    return file, *record(file)


def test_a_whole_recording_of_bounded_size_has_scene_key_plan_and_argument_on_two_timelines(recorded):
    file, frames, news = recorded
    table = columns(file)
    robot = table["/world/robot"]
    assert np.allclose(np.array(robot["Transform3D:translation"])[-1, 0, :2], frames[-1].state, atol=1e-6)
    assert robot["step"] == [0, *range(len(frames) + 1)]  # it is placed before there is anything to see
    assert [text for line in table["/log"]["TextLog:text"] for text in line] == news
    plots = ("weight", "value", "ess", "arriving", "risk", "clearance", "control", "cost")
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
    (key,) = static(file, "/key", "TextDocument:text")
    assert static(file, "/world/scene/names", "Points3D:labels") == ["goal", "1 upper wall", "2 lower wall"]
    assert all(f"**{sign}** {name}" in key for sign, name in ((1, "upper wall"), (2, "lower wall")))
    assert rerun("rrd", "verify", file).returncode == 0
    assert file.stat().st_size <= STATIC_BYTES + 450_000 * frames[-1].end_time
    for when, text in zip(table["/why/page"]["sim_time"], table["/why/page"]["TextDocument:text"], strict=True):
        assert f"Plan and samples of {when.total_seconds():.2f} s" in text[0]
        assert "between upper wall and lower wall" in text[0].lower()


def test_two_runs_of_one_seed_differ_in_wall_time_only(recorded, tmp_path):
    again = tmp_path / "again.rrd"
    record(again)
    timeless = []
    for file in (recorded[0], again):
        timeless.append(tmp_path / f"{file.stem}-timeless.rrd")
        assert rerun("rrd", "filter", "--drop-entity", "/timing/plan", file, "-o", timeless[-1]).returncode == 0
    result = rerun("rrd", "compare", *timeless)
    assert result.returncode == 0, result.stderr[-2000:]


def test_a_lifted_reference_begins_at_its_signature_and_ends_at_the_goals_side():
    drive = Drive()
    homology = drive.space.homology
    for reference in drive.tree.references(drive.scene.start[:2]):
        line = even(reference.trajectory.points, 32)
        for k in range(homology.M):
            height = strokes.remaining(homology, reference, line, k)
            assert height[0] == reference.signature[k]
            assert height[-1] == pytest.approx(1.0 + homology.base(line[-1])[k], abs=1e-9)
            assert np.abs(np.diff(height)).max() < 0.25


def test_a_tree_is_lifted_by_what_tells_the_shortest_classes_apart():
    drive = Drive()
    lengths = drive.tree.lengths(drive.scene.start[:2])
    first, second, *_ = sorted(lengths, key=lambda winding: lengths[winding])
    found = telling(drive.tree, drive.scene.start[:2])
    assert first[found[0]] != second[found[0]]
    assert sorted(found) == [0, 1]


MESHES = """<mujoco>
  <asset><mesh name="m" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .6"/></asset>
  <worldbody>
    <geom name='my box/1 "x"' type="mesh" mesh="m"/>
    <geom name='my box\\/1 "x"' type="mesh" mesh="m"/>
    <geom type="mesh" mesh="m"/>
  </worldbody>
</mujoco>"""


def test_meshes_have_entity_paths_of_their_own_whatever_their_names():
    model = mujoco.MjModel.from_xml_string(MESHES)
    drawn = geoms.solids(model, geoms.shown(model))
    assert len(drawn) == 3
    for path in drawn:
        assert len(path.replace("\\\\", "").replace("\\/", "").split("/")) == 2  # `meshes` and one part, escaped


def test_a_file_opens_at_its_first_plan_a_viewer_follows_and_time_upward_takes_the_place_of_an_unasked_tree():
    moving = Moving("closing_door")
    for drive, lift, tabs in (
        (moving, None, ["Space-time"]), (moving, (1,), ["Space-time", "Tree"]), (Drive(), None, ["Tree"])
    ):  # fmt: skip
        integral, look = drive.controller.path_integral, Look(lift=lift)
        subject = Subject(loaded=drive.loaded, tree=drive.tree, path_integral=integral, look=look, settings={})
        for live, state in ((False, "paused"), (True, "following")):
            found = layout(subject, live=live)
            assert [tab.name for tab in found.root_container.contents] == ["Drive", "Why", *tabs, "About"]
            assert found.time_panel.play_state == state
