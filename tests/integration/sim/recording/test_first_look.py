"""What one sees of a recording at first: a key, the robot, and the moment of the choice."""

from __future__ import annotations

import pytest
from drives import Drive, record
from rerun.chunk import RrdReader

from sim.mjcf import load
from sim.recording.camera import pixels_per_metre
from sim.recording.layout import layout
from sim.recording.options import Look
from sim.recording.subject import Subject


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("first_look") / "slit.rrd"
    return file, *record(file)


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


def test_a_small_robot_is_marked_by_16_pixels_on_the_map(recorded):
    rim, disc = static(recorded[0], "/world/robot/mark", "Cylinders3D:radii")
    assert rim > disc
    assert 2 * disc * pixels_per_metre(load("slit").scene) >= 16.0


def test_a_file_opens_at_its_first_plan_and_a_viewer_follows():
    drive = Drive()
    subject = Subject(
        loaded=drive.loaded, tree=drive.tree, path_integral=drive.controller.path_integral, look=Look(), settings={}
    )
    states = {live: layout(subject, live=live).time_panel.play_state for live in (False, True)}
    assert states == {False: "paused", True: "following"}
