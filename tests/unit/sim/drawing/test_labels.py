"""Labels keep off walls, off lines and off each other, inside the picture, and stay where they are."""

from __future__ import annotations

import numpy as np
import pytest

from sim.drawing.labels import BELOW, HEIGHT, LETTER, PADDING, Labels, dense, inside
from sim.mjcf import load
from sim.plotting.ground import outline

SCALE = 60.0  # px/m
SCENE = load("slit").scene  # 6 m x 5 m
NONE = np.zeros((0, 2))


def box(text: str, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half size of a label, without the margin that placing keeps [m]."""
    half = np.array([0.5 * (LETTER * len(text) + PADDING), 0.5 * HEIGHT]) / SCALE
    return point - (0.0, half[1] + BELOW / SCALE), half - 4.0 / SCALE


def placed(labels, near, drawn, **options):
    texts = {name: f"class {name}: cost 9.41" for name in near}
    points = labels.place(texts, near, drawn, NONE, **options)
    return [box(text, point) for text, point in zip(texts.values(), points, strict=True)]


def covers(label, points) -> bool:
    middle, half = label
    return bool(np.any(np.all(np.abs(points - middle) < half, axis=1)))


@pytest.mark.parametrize("at", [(0.02, 0.02), (5.98, 0.02), (5.98, 4.98), (0.02, 4.98), (3.4, 2.5)])
def test_a_label_is_near_its_line_off_it_off_walls_and_inside_the_map(at):
    line = np.linspace(at, (3.0, 1.0), 30)
    ((middle, half),) = placed(Labels(SCENE, SCALE), {"0,0": line}, [line])
    assert not covers((middle, half), dense(line, 0.02))
    assert np.all(middle - half >= SCENE.lower)
    assert np.all(middle + half <= SCENE.upper)
    assert not any(covers((middle, half), inside(outline(solid), 0.02)) for solid in SCENE.obstacles)
    assert np.linalg.norm(line - middle, axis=1).min() < 80.0 / SCALE


@pytest.mark.parametrize("count", [2, 6])
def test_labels_of_lines_that_end_together_do_not_cover_each_other(count):
    lines = {str(k): np.linspace((0.5, 1.5), (2.5, 0.3 + 0.6 * k), 9) for k in range(count)}
    found = placed(Labels(SCENE, SCALE), lines, lines.values())
    for i, (one, half) in enumerate(found):
        assert all(np.any(np.abs(one - other) > half + more) for other, more in found[:i])


def test_a_label_stays_where_it_is_unless_something_comes_in_its_way():
    labels, line = Labels(SCENE, SCALE), np.linspace((0.5, 1.0), (2.5, 1.0), 30)
    ((first, half),) = placed(labels, {"a": line}, [line])
    moved = line + np.array([0.02, -0.02])
    ((second, _),) = placed(labels, {"a": moved}, [moved])
    assert np.hypot(*(second - first)) < 0.1
    ((third, _),) = placed(labels, {"a": line}, [line, np.array([first - half, first + half])])
    assert np.hypot(*(third - first)) > 0.1


def test_what_stays_may_lie_on_a_wall_and_others_keep_off_it():
    labels, place = Labels(SCENE, SCALE), np.array([[3.4, 2.85]])
    ((fixed, half),) = placed(labels, {"1": place}, [], stay=True)
    assert np.abs(fixed - place).max() < 0.5
    ((other, more),) = placed(labels, {"0,0": place}, [])
    assert np.any(np.abs(other - fixed) > half + more)
