"""The long tests of unit/pirrht/planner/test_passage_draws.py."""

from __future__ import annotations

import numpy as np
import pytest
from discs import scattered
from unit.pirrht.planner.test_passage_draws import tree_of

from pirrht.freespace import FreeSpace


@pytest.mark.parametrize("seed", range(3))
def test_classes_of_few_vertices_are_those_of_many_and_their_references_no_longer(seed: int):
    space = FreeSpace.of(scattered(seed))
    few, many = tree_of(space, seed), tree_of(space, seed + 100)
    few.grow(1000)
    many.grow(6000)
    start = space.scene.start[:2]
    short = {r.winding: r.length for r in few.references(start)}
    shorter = {r.winding: r.length for r in many.references(start)}
    most = max(short.values()) if len(short) == few.classes else np.inf
    assert {winding for winding, length in shorter.items() if length < 0.95 * most} <= set(short)
    for winding, length in short.items():
        assert length < 1.005 * shorter.get(winding, np.inf)
