"""What one sees of a recording at first: a key, the robot, labels off everything, and the moment of the choice."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from drives import Drive, columns, record
from rerun.chunk import RrdReader

from sim.drawing.labels import BELOW, CELL, HEIGHT, LETTER, PADDING
from sim.drawing.strokes import lift
from sim.mjcf import load
from sim.plotting.ground import outline
from sim.recording.camera import from_above, pixels_per_metre
from sim.recording.layout import layout
from sim.recording.options import Look
from sim.recording.subject import Subject
from sim.recording.writer import LINE


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


def boxes(known, eye, picture):
    """Middle and half size of every label of a picture, without the margin that placing keeps [px]."""
    pixels = eye.pixels(np.array(known["Points3D:positions"][picture]))
    texts = known["Points3D:labels"][picture]
    middles = pixels + np.array([0.0, BELOW + 0.5 * HEIGHT])
    halves = np.array([(0.5 * (LETTER * len(text) + PADDING) - CELL, 0.5 * HEIGHT - CELL) for text in texts])
    return list(zip(middles, halves, strict=True))


def test_labels_of_the_map_lie_inside_it_and_off_walls(recorded):
    scene = load("slit").scene
    eye, known = from_above(scene), columns(recorded[0])["/world/names"]
    walls = [eye.pixels(lift(outline(solid), 0.0)) for solid in scene.obstacles]
    for picture in range(len(known["Points3D:labels"])):
        for middle, half in boxes(known, eye, picture):
            assert np.all(middle - half >= 0.0)
            assert np.all(middle + half <= eye.size)
            for wall in walls:
                assert np.any((middle + half < wall.min(axis=0)) | (middle - half > wall.max(axis=0)))


def test_labels_of_the_map_lie_off_the_paths_of_all_classes(recorded):
    eye, table = from_above(load("slit").scene), columns(recorded[0])
    lines = [eye.pixels(np.array(line)) for line in table["/world/references"]["LineStrips3D:strips"][0]]
    fine = np.vstack([np.linspace(a, b, 50) for line in lines for a, b in pairwise(line)])
    for middle, half in boxes(table["/world/names"], eye, 0):
        assert not np.any(np.all(abs(fine - middle) < half, axis=1))


def test_a_file_opens_at_its_first_plan_and_a_viewer_follows():
    drive = Drive()
    subject = Subject(
        loaded=drive.loaded, tree=drive.tree, path_integral=drive.controller.path_integral, look=Look(), settings={}
    )
    states = {live: layout(subject, live=live).time_panel.play_state for live in (False, True)}
    assert states == {False: "paused", True: "following"}


def test_what_happened_is_said_in_lines_that_a_viewer_shows_whole(recorded):
    lines = [line for cell in columns(recorded[0])["/log/happenings"]["TextLog:text"] for line in cell]
    assert len(lines) > 1
    assert max(map(len, lines)) <= LINE
