"""The long tests of unit/pirrht/planner/test_chain.py."""

from __future__ import annotations

import numpy as np
import pytest
from discs import scattered
from unit.pirrht.planner.test_chain import Foreign, by_class, grown

from pirrht.freespace import FreeSpace
from pirrht.steering.dubins import Dubins


@pytest.mark.parametrize("seed", range(3))
def test_curves_of_a_foreign_steering_are_pulled_taut_by_its_own_connections(seed: int):
    """Free, of the same class, never longer, and hardly longer than what is made for Dubins curves."""
    space = FreeSpace.of(scattered(seed))
    car = Dubins(rho=0.4)
    tree = grown(space, Foreign(car), 250)
    x = space.scene.start[:3]
    rough, fine = tree.references(x, shortened=False), by_class(tree.references(x))
    special = grown(space, car, 250).references(x)
    assert len(rough) >= 2
    for before in rough:
        after = fine[before.winding]
        points = after.trajectory.points
        assert after.length <= before.length * (1 + 1e-9)
        assert space.collision.clearance(points).min() > -1e-3
        assert space.homology.winding(points) == before.winding
    lengths = {reference.winding: reference.length for reference in special}
    ratios = [fine[w].length / lengths[w] for w in fine.keys() & lengths.keys()]
    assert np.median(ratios) < 1.02
    assert max(ratios) < 1.15
