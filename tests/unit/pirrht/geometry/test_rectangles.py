"""Cells become few rectangles whose union they are, in time that grows with their number."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from pirrht.geometry.rectangles import cover, union


@pytest.mark.parametrize("seed", range(12))
def test_the_union_of_the_rectangles_is_the_set_of_cells(seed: int):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 40, size=2))
    cells = rng.random(shape) < rng.uniform(0.05, 0.95)
    pieces = cover(cells)
    np.testing.assert_array_equal(union(pieces, shape) > 0, cells)
    runs = int(np.sum(np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(int), axis=1) == 1))
    assert len(pieces) <= runs  # no more than rows cut at every gap


@pytest.mark.parametrize("seed", range(6))
def test_no_rectangle_could_be_left_out(seed: int):
    cells = np.random.default_rng(seed).random((25, 25)) < 0.7
    pieces = cover(cells)
    for i in range(len(pieces)):
        assert np.any((union(np.delete(pieces, i, axis=0), cells.shape) > 0) != cells)


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


def ragged(size: int) -> np.ndarray:
    """Cells of a hall of pillars whose walls are as ragged as a lidar leaves them."""
    rng = np.random.default_rng(0)
    near = np.arange(size) % 50 < 10
    walls = near[:, None] & near
    frayed = walls != np.roll(walls, 1, axis=0)
    return walls ^ (frayed & (rng.random(walls.shape) < 0.3)) | (rng.random(walls.shape) < 0.003)


def test_ragged_walls_take_hardly_more_rectangles_than_there_are_pieces():
    cells = ragged(400)
    pieces = cover(cells)
    np.testing.assert_array_equal(union(pieces, cells.shape) > 0, cells)
    assert len(pieces) < 1.7 * ndimage.label(cells)[1]


def test_four_times_the_cells_take_about_four_times_as_long():
    """Ragged walls, and a block with a ragged rim, of whose rectangles each holds most of all cells."""

    def block(size: int) -> np.ndarray:
        cells = np.ones((size, size), bool)
        for rim in (cells[:2], cells[-2:], cells.T[:2], cells.T[-2:]):
            rim &= np.random.default_rng(1).random(rim.shape) < 0.5
        return cells

    def seconds(cells: np.ndarray) -> float:
        began = time.process_time()
        cover(cells)
        return time.process_time() - began

    for make in (ragged, block):
        cover(make(50))  # compiles
        small, large = (min(seconds(make(size)) for _ in range(3)) for size in (400, 1600))
        assert large < 3 * 16 * small


@settings(max_examples=60)
@given(cells=arrays(np.bool_, st.tuples(st.integers(1, 14), st.integers(1, 14))))
def test_any_set_of_cells_survives_as_rectangles(cells):
    pieces = cover(cells)
    np.testing.assert_array_equal(union(pieces, cells.shape) > 0, cells)
    assert np.all(pieces[:, ::2] < pieces[:, 1::2])
