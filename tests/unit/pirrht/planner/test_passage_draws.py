"""The tree draws in passages first: no class is missing because its way is narrow, and the rest stays uniform."""

from __future__ import annotations

import numpy as np
import pytest
from discs import block, scattered, scene_of

from pirrht.freespace import FreeSpace
from pirrht.planner.expand import PassageSampler
from pirrht.planner.tree import HomologyTree
from pirrht.steering.straight_line import StraightLine

FEW = 300  # vertices


@pytest.fixture(scope="module")
def double_slit() -> FreeSpace:
    """A wall from border to border with two slits of 1.25 robot diameters."""
    blocks = [block("below", 5.0, 2.0, (0.25, 2.0)), block("middle", 5.0, 5.0, (0.25, 0.75)),
              block("above", 5.0, 8.0, (0.25, 2.0))]  # fmt: skip
    return FreeSpace.of(scene_of(blocks, start=(0.5, 5.0), goal=(9.5, 5.0), side=10.0))


def tree_of(space: FreeSpace, seed: int) -> HomologyTree:
    return HomologyTree(space, StraightLine(), limit=0.8, rng=np.random.default_rng(seed))


def has_vertex(tree: HomologyTree) -> np.ndarray:
    """Which passages have a vertex in their middle, (P,)."""
    vertices = {tuple(x) for x in tree.states[: tree.size, :2].tolist()}
    return np.array([tuple(place) in vertices for place in tree.passages.place.tolist()])


@pytest.mark.parametrize("seed", range(8))
def test_few_vertices_find_both_slits_whatever_the_seed(double_slit: FreeSpace, seed: int):
    tree = tree_of(double_slit, seed)
    tree.grow(FEW)
    assert len(tree.lengths(np.array([0.5, 5.0]))) == 2
    assert has_vertex(tree).all()


@pytest.mark.parametrize("seed", range(4))
def test_every_open_passage_gets_a_vertex(seed: int):
    tree = tree_of(FreeSpace.of(scattered(seed)), seed)
    tree.grow(FEW)
    assert tree.passages.count > 3
    assert has_vertex(tree).all()


def test_at_least_every_second_draw_is_uniform_and_none_is_offered_twice_in_a_period():
    states = np.random.default_rng(0).random((100, 2))
    offers = PassageSampler(states)
    for first in (0, 64, 5):
        many = offers.together(first)
        drawn = [offers.at(first + k) for k in range(many)]
        offered = [tuple(x) for x in drawn if x is not None]
        assert len(offered) <= (many + 1) // 2
        assert len(offered) == len(set(offered))
    assert {tuple(x) for k in range(offers.together(0)) if (x := offers.at(k)) is not None} == set(map(tuple, states))
