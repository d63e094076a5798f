"""Recordings of scenes with moving bodies: where plans take them to be, and the tab with time upward."""

from types import SimpleNamespace

import numpy as np
import pytest
from drives import Moving, columns, logged
from plants import body, moving_scene, rows

from pirrht.plotting.colors import ClassColors
from pirrht.plotting.strokes import outline
from pirrht.plotting.tuning import TUNING as PLOTTING
from sim.drawing.strokes import timed as in_time
from sim.recording.plan_view import Pictures
from sim.recording.reasons import reasons, words_of
from sim.recording.subject import Subject
from sim.recording.viewer import Look

MAX_TIME = 0.6
ROUNDING = 0.5 / 256 + 1e-6
RISE = 1.0  # m/s: the best speed sqrt(2 q / r) of q = 1, r = 2


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("space_time") / "drive.rrd"
    drive = Moving("closing_door", vertices=100, samples=60)
    frames = logged(drive.recorder(file), drive.frames(MAX_TIME))
    return columns(file), drive, frames


def pictures(known: dict[str, list], frames: list):
    """The strips of an entity, with the frame of each picture."""
    cells = zip(known["step"], known["LineStrips3D:strips"], strict=True)
    return [(frames[step], [np.array(strip, dtype=float) for strip in strips]) for step, strips in cells]


def test_samples_that_hit_a_moving_obstacle_are_reported_to_have_hit_it():
    drive = Moving("crossing", vertices=100, samples=200)
    start = drive.scene.start[:2]
    drive.controller.begin(start)
    plan = drive.controller.plan(start)
    found = reasons(plan, drive.controller.path_integral, (), words_of(plan, drive.controller.path_integral, ()))
    assert {reason.where for reason in found} - {""} == {"crosser"}


def test_outlines_on_the_map_are_where_the_body_is_going_to_be(recorded):
    table, drive, frames = recorded
    known = table["/world/foreseen"]
    assert len(known["step"]) == 1 + round(5 * MAX_TIME)
    (mover,) = drive.scene.movers
    for frame, drawn in pictures(known, frames):
        times = [after for after in PLOTTING.moments if frame.time + after - PLOTTING.moments[0] < mover.motion.last]
        assert len(drawn) == len(times)
        for ring, after in zip(drawn, times, strict=True):
            (solid,) = mover.at(frame.time + after)
            np.testing.assert_allclose(ring[:-1, :2], outline(solid), atol=ROUNDING)


def test_braids_are_the_references_of_all_classes_with_their_times_upward(recorded):
    table, drive, frames = recorded
    for frame, drawn in pictures(table["/spacetime/braids"], frames):
        assert len(drawn) == len(frame.plan.references)
        for line, reference in zip(drawn, frame.plan.references, strict=True):
            way = in_time(reference, frame.time)
            np.testing.assert_allclose(line[0], [*frame.plan.state, RISE * frame.time], atol=ROUNDING)
            assert line[-1, 2] == pytest.approx(RISE * way[-1, 2], abs=ROUNDING)
            assert way[-1, 2] - frame.time == pytest.approx(reference.trajectory.durations.sum())
            assert np.linalg.norm(line[-1, :2] - drive.scene.goal.center) <= drive.scene.goal.radius + 0.02
            assert np.all(np.diff(line[:, 2]) >= 0.0)


def test_the_thread_is_the_driven_path_in_time_and_now_is_at_its_end(recorded):
    table, _, frames = recorded
    known = table["/spacetime/path"]
    assert known["step"] == list(range(len(frames)))
    for frame, (piece,) in pictures(known, frames):
        np.testing.assert_allclose(piece[0], [*frame.plan.state, RISE * frame.time], atol=ROUNDING)
        np.testing.assert_allclose(piece[-1], [*frame.advance.states[-1], RISE * frame.end_time], atol=ROUNDING)
    heights = [cell[0][2] for cell in table["/spacetime/now"]["Transform3D:translation"]]
    times = [frame.time for frame in frames] + [frames[-1].end_time]
    np.testing.assert_allclose(heights, RISE * np.array(times), atol=1e-5)


def test_a_drive_that_takes_longer_lets_the_tubes_go_on_where_they_ended(tmp_path):
    world = body("b", 'type="box" size=".3 .1 .2"', "2 2 0.1")
    drive = Moving(moving_scene(tmp_path, world, rows("b", "0 2 2 0  0.4 3 2 3", repeat=True)))
    logged = []
    stream = SimpleNamespace(log=lambda path, *rest: logged.append((path, rest[-1])))
    integral = drive.controller.path_integral
    subject = Subject(loaded=drive.loaded, tree=drive.tree, path_integral=integral, look=Look(), settings={})
    shown = Pictures(stream, subject, ClassColors())
    for time in (1.3, 1.9, 3.2):
        shown.reach(time)
    tubes = [picture for path, picture in logged if path == "/spacetime/bodies/b"]
    spans = [np.array(one.vertex_positions.as_arrow_array().to_pylist())[:, 2] / RISE for one in tubes]
    assert [(span.min(), span.max()) for span in spans] == [(0.0, 2.0), (2.0, 4.0)]


def test_a_moving_body_has_its_pose_at_every_step_and_at_the_end(tmp_path):
    world = body("spin", 'type="box" size=".3 .1 .2"', "2 2 0.1")
    custom = rows("spin", "0 2 2 0  0.15 2.5 2 2  0.3 2 2 0", repeat=True)
    drive, file = Moving(moving_scene(tmp_path, world, custom)), tmp_path / "drive.rrd"
    frames = logged(drive.recorder(file), drive.frames(0.4))
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
