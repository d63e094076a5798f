"""Cells become few rectangles whose union they are, in time that grows with their number."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pirrht.geometry.rectangles import cover, union


@pytest.mark.parametrize(
    ("picture", "count"),
    [
        (("###", "###"), 1),
        (("...", "..."), 0),
        ((".#.", "###", ".#."), 2),
        (("#..", "#..", "###"), 2),
        (("#####", "#...#", "#...#", "#####"), 4),
        (("#.#", ".#.", "#.#"), 5),
    ],
)
def test_simple_shapes_take_as_few_as_they_can(picture: tuple[str, ...], count: int):
    assert len(cover(np.array([[c == "#" for c in row] for row in picture]))) == count


@settings(max_examples=60)
@given(cells=arrays(np.bool_, st.tuples(st.integers(1, 14), st.integers(1, 14))))
def test_any_set_of_cells_survives_as_rectangles(cells):
    pieces = cover(cells)
    np.testing.assert_array_equal(union(pieces, cells.shape) > 0, cells)
    runs = np.sum(np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(int), axis=1) == 1)
    assert len(pieces) <= runs  # no more than rows cut at every gap
    assert np.all(pieces[:, ::2] < pieces[:, 1::2])
