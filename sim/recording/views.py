"""The eyes of views that bear labels, and what is always drawn there; for a window of 1280 x 720 pixels."""

from __future__ import annotations

from math import hypot, radians, tan

import numpy as np

from pirrht.geometry.scene import Scene
from pirrht.plotting.ground import outline
from sim.drawing import strokes
from sim.drawing.labels import Eye, Labels, Lines
from sim.drawing.strokes import lift
from sim.recording.camera import HEIGHT, MAP, WHOLE, WIDTH, pixels_per_metre, seen
from sim.recording.subject import Subject

OPENING = radians(55.0)  # of Rerun's eyes, upwards
BRANCHES, ALONG = 4000, np.linspace(0.0, 1.0, 6)[:, None, None]


def from_above(scene: Scene) -> Eye:
    """Return the eye over the map."""
    height = HEIGHT * float(seen(scene).max())
    size, pixels = (float(MAP[0]), float(MAP[1])), pixels_per_metre(scene)
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
    labels = Labels(from_above(scene))
    for solid in scene.obstacles:
        labels.fill(lift(outline(solid), 0.0))
    return labels


def tree_labels(subject: Subject, obstacle: int, levels: Lines) -> Labels:
    """Return labels of a lifted tree, off its branches, its levels (k, 3, 3) [m], and the scene below it."""
    assert subject.tree is not None
    scene, turn = subject.space.scene, subject.turn
    labels = Labels(on_tree(scene, turn, len(subject.lifted)))
    (x0, y0), (x1, y1) = scene.lower, scene.upper
    labels.fill(np.array([(x0, y0, 0.0), (x1, y0, 0.0), (x1, y1, 0.0), (x0, y1, 0.0)]))
    ends, _ = strokes.tree_edges(subject.tree, obstacle, BRANCHES)
    if len(ends):
        raised = lift(ends, turn * ends[..., 2])
        between = (1.0 - ALONG) * raised[None, :, 0] + ALONG * raised[None, :, 1]
        labels.dot(between.reshape(-1, 3))
    for corner in levels[:, 2]:
        labels.cover("H = 0.5", corner)
    return labels
