"""Labels keep off walls, off lines and off each other, inside the picture, and stay where they are."""

from __future__ import annotations

import numpy as np
import pytest

from sim.drawing.labels import BELOW, HEIGHT, LETTER, PADDING, Eye, Labels, Sheet

WIDE, HIGH = 400.0, 300.0
EYE = Eye(position=(2.0, 1.5, 90.0), target=(2.0, 1.5, 0.0), up=(0.0, 1.0, 0.0), size=(WIDE, HIGH), focal=9000.0)


def box(text: str, point) -> tuple[float, float, float, float]:
    """Left, right, upper and lower edge of a label, without the margin that placing keeps [px]."""
    half = 0.5 * (LETTER * len(text) + PADDING) - 4.0
    return point[0] - half, point[0] + half, point[1] + BELOW + 2.0, point[1] + BELOW + HEIGHT - 2.0


def apart(one, other) -> bool:
    return one[1] < other[0] or other[1] < one[0] or one[3] < other[2] or other[3] < one[2]


def covers(edges, points) -> bool:
    left, right, upper, lower = edges
    return any(left < x < right and upper < y < lower for x, y in points)


def test_a_label_lies_next_to_its_line_and_off_it():
    sheet, line = Sheet(WIDE, HIGH), np.linspace((0.0, 150.0), (400.0, 150.0), 100)
    sheet.stroke(line)
    edges = box("0,0   93 %", sheet.place("0,0   93 %", line))
    assert not covers(edges, line)
    assert min(abs(edges[2] - 150.0), abs(edges[3] - 150.0)) < 15.0


def test_a_label_keeps_off_a_wall_and_inside_the_picture():
    sheet = Sheet(WIDE, HIGH)
    sheet.fill(np.array([(0.0, 0.0), (390.0, 0.0), (390.0, 120.0), (0.0, 120.0)]))
    for corner in ((2.0, 2.0), (398.0, 2.0), (398.0, 298.0), (2.0, 298.0), (200.0, 60.0)):
        left, right, upper, lower = box("upper wall", sheet.place("upper wall", np.array([corner])))
        assert left >= 0.0
        assert right <= WIDE
        assert upper >= 118.0
        assert lower <= HIGH


def test_a_number_fits_on_its_solid_and_goes_beside_a_thin_one():
    sheet = Sheet(WIDE, HIGH)
    table = np.array([(100.0, 100.0), (180.0, 100.0), (180.0, 180.0), (100.0, 180.0)])
    wall = np.array([(300.0, 20.0), (306.0, 20.0), (306.0, 280.0), (300.0, 280.0)])
    sheet.fill(table)
    sheet.fill(wall)
    left, right, upper, lower = box("7", sheet.place("7", np.array([[140.0, 140.0]]), inside=True))
    assert (left > 100.0, right < 180.0, upper > 100.0, lower < 180.0) == (True,) * 4
    left, right, *_ = box("3", sheet.place("3", np.array([[303.0, 150.0]]), inside=True))
    assert right <= 304.0 or left >= 302.0


@pytest.mark.parametrize("count", [2, 6])
def test_labels_of_lines_that_end_together_do_not_cover_each_other(count):
    labels = Labels(EYE)
    lines = {str(k): np.linspace((0.5, 1.5, 0.0), (3.5, 0.3 + 0.4 * k, 0.0), 9) for k in range(count)}
    texts = {name: f"class {name}: cost 9.41" for name in lines}
    points = labels.placed(texts, lines, lines.values())
    edges = [box(text, pixel) for text, pixel in zip(texts.values(), EYE.pixels(np.array(points)), strict=True)]
    assert all(apart(edges[i], edges[j]) for i in range(count) for j in range(i))


def test_a_label_stays_where_it_is_unless_something_comes_in_its_way():
    labels, line = Labels(EYE), np.linspace((0.5, 1.0, 0.0), (3.5, 1.0, 0.0), 30)
    texts, own = {"a": "a class"}, {"a": line}
    (first,) = labels.placed(texts, own, [line])
    moved = line + np.array([0.02, -0.02, 0.0])
    (second,) = labels.placed(texts, {"a": moved}, [moved])
    np.testing.assert_allclose(second[:2], first[:2], atol=1e-9)
    middle = EYE.pixels(first[None])[0] + (0.0, BELOW + 0.5 * HEIGHT)
    across = np.array([EYE.point(middle + shift, line[0]) for shift in ((-30.0, 0.0), (30.0, 0.0))])
    (third,) = labels.placed(texts, own, [line, across])
    assert np.hypot(*(third - first)[:2]) > 0.1


def test_an_eye_sees_a_point_where_it_puts_it():
    eye = Eye(position=(6.0, -5.0, 6.0), target=(3.0, 2.5, 2.0), up=(0.0, 0.0, 1.0), size=(640.0, 597.0), focal=573.0)
    np.testing.assert_allclose(eye.pixels(np.array([[3.0, 2.5, 2.0]])), [[320.0, 298.5]])
    near = np.array([1.0, 4.0, 0.5])
    pixel = eye.pixels(near[None])[0]
    np.testing.assert_allclose(eye.point(pixel, near), near, atol=1e-9)
    assert eye.pixels(near[None] + (0.0, 0.0, 1.0))[0, 1] < pixel[1]  # up in space is up in the picture
