"""The long tests of unit/sim/test_tree_file.py."""

from __future__ import annotations

import numpy as np
import pytest
from unit.sim.test_tree_file import again, assert_equal_references, packed, repacked, unpacked

from pirrht.errors import OptionError
from sim import tree_file
from sim.scenario import prepare


def test_roots_at_any_velocity_survive_and_nothing_else_is_left_open():
    scenario = prepare("slit", robot="hover", given={"vertices": 60})
    tree = scenario.grown_tree()
    copy = again(tree)
    assert np.isnan(copy.states[0, 2:]).all()
    assert packed(copy) == packed(tree)
    assert_equal_references(tree, copy, scenario.start)
    arrays = unpacked(packed(tree))
    for vertex, component in ((0, 0), (len(arrays["in_goal"]) - 1, 2)):
        states = arrays["states"].copy()
        states[vertex, component] = np.nan
        with pytest.raises(OptionError, match="states and costs are not numbers"):
            tree_file.load(repacked({**arrays, "states": states}), tree.space, tree.steering)
