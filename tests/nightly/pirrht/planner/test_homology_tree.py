"""The long tests of unit/pirrht/planner/test_homology_tree.py."""

from __future__ import annotations

import numpy as np
import pytest
from unit.pirrht.planner.test_homology_tree import check_shortened, posts, tree_in


@pytest.mark.parametrize("seed", range(3))
def test_polishing_keeps_class_and_freedom_and_never_lengthens(seed: int):
    space = posts()
    tree = tree_in(space, limit=0.9, vertices=250, seed=seed)
    states = np.random.default_rng(seed).uniform([0.2, 0.2], [1.0, 4.0], (5, 2))
    assert max(check_shortened(space, tree, x) for x in states) > 0.02
