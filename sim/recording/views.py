"""The eyes of views that bear labels, and what is always drawn there; for a window of 1280 x 720 pixels."""

from __future__ import annotations

from math import hypot, radians, tan

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.scene import Scene
from pirrht.plotting.ground import outline
from sim.drawing import strokes
from sim.drawing.labels import Eye, Labels, Sheet
from sim.drawing.strokes import lift
from sim.recording.camera import HEIGHT, MARGIN
from sim.recording.subject import Subject

UPPER, WHOLE = 362.0, 597.0  # heights of the upper views of the tab Drive and of the other tabs [px]
WIDTH = 1280.0
COLUMNS = (5.0, 5.0, 2.0)  # shares of the robot, the map and the key in the tab Drive
OPENING = radians(55.0)  # of Rerun's eyes, upwards
FAINT = 0.3  # weight of a tree's branches
BRANCHES, ALONG = 4000, np.linspace(0.0, 1.0, 6)[:, None, None]


def from_above(scene: Scene) -> Eye:
    """Return the eye over the map."""
    extent = MARGIN * (scene.upper - scene.lower)
    size = WIDTH * COLUMNS[1] / sum(COLUMNS), UPPER
    height, pixels = HEIGHT * float(extent.max()), float(np.min(size / extent))
    x, y = (float(v) for v in 0.5 * (scene.lower + scene.upper))
    return Eye(position=(x, y, height), target=(x, y, 0.0), up=(0.0, 1.0, 0.0), size=size, focal=pixels * height)


def on_tree(scene: Scene, turn: float, trees: int) -> Eye:
    """Return the eye to the south of a lifted tree, high enough to see what is below it; one of several trees."""
    extent = scene.upper - scene.lower
    distance = 1.25 * max(float(extent.max()), 1.2 * turn)
    x, y = (float(v) for v in 0.5 * (scene.lower + scene.upper))
    z = 0.75 * turn
    return _slanted((x + 0.45 * distance, y - distance, z + 0.55 * distance), (x, y, z), WIDTH / trees)


def in_time(scene: Scene) -> Eye:
    """Return the eye on space and time."""
    height = hypot(*(scene.goal.center - scene.start[:2]))  # of the straight way at the best speed
    far = 1.25 * max(float((scene.upper - scene.lower).max()), height)
    x, y = (float(v) for v in 0.5 * (scene.lower + scene.upper))
    return _slanted((x + 0.5 * far, y - far, 0.85 * far), (x, y, 0.35 * height), WIDTH)


def _slanted(position: tuple[float, float, float], target: tuple[float, float, float], width: float) -> Eye:
    focal = 0.5 * WHOLE / tan(0.5 * OPENING)
    return Eye(position=position, target=target, up=(0.0, 0.0, 1.0), size=(width, WHOLE), focal=focal)


def map_labels(scene: Scene) -> Labels:
    """Return labels of the map, off what is in the scene."""
    eye = from_above(scene)
    sheet = Sheet(*eye.size)
    for solid in scene.obstacles:
        sheet.fill(eye.pixels(lift(outline(solid), 0.0)))
    return Labels(eye, sheet)


def tree_labels(subject: Subject, obstacle: int, levels: Array) -> Labels:
    """Return labels of a lifted tree, off its branches, its levels (k, 3, 3) [m], and the scene below it."""
    assert subject.tree is not None
    scene, turn = subject.space.scene, subject.turn
    eye = on_tree(scene, turn, len(subject.lifted))
    sheet = Sheet(*eye.size)
    (x0, y0), (x1, y1) = scene.lower, scene.upper
    sheet.fill(eye.pixels(np.array([(x0, y0, 0.0), (x1, y0, 0.0), (x1, y1, 0.0), (x0, y1, 0.0)])))
    ends, _ = strokes.tree_edges(subject.tree, obstacle, BRANCHES)
    if len(ends):
        raised = lift(ends, turn * ends[..., 2])
        between = (1.0 - ALONG) * raised[None, :, 0] + ALONG * raised[None, :, 1]
        sheet.dot(eye.pixels(between.reshape(-1, 3)), weight=FAINT)
    for corner in eye.pixels(levels[:, 2]):  # where the levels have their names
        box = corner + np.array([(-36.0, 0.0), (36.0, 0.0), (36.0, 26.0), (-36.0, 26.0)])
        sheet.fill(box)
    return Labels(eye, sheet)


def time_labels(scene: Scene) -> Labels:
    """Return labels of space and time, off the map that is the floor."""
    eye = in_time(scene)
    return Labels(eye, Sheet(*eye.size))
