"""The long tests of unit/pirrht/exact/test_walls.py."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.scenes import scene_of
from unit.pirrht.exact.test_walls import disc, exact

from pirrht.errors import OptionError
from pirrht.exact.grid import Domain


@pytest.mark.parametrize(("which", "b"), [("disc", 0.1), ("13", 0.2), ("9", 0.2)])
def test_around_grid_points_that_touch_walls_the_control_grows_as_one_over_the_distance(which, b):
    """log psi behaves as log(distance): u . normal x distance = b^2, to a tenth so close to a wall."""
    scene = disc() if which == "disc" else scene_of(int(which))
    grid = exact(scene, b)
    h, clearance = grid.spacing, grid.space.collision.clearance
    nodes = scene.lower + h * grid.grid.place
    near = Domain.of(grid.space).clearance(nodes) < 0.01 * h
    assert np.any(near)
    angles = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    for node in nodes[near]:
        around = node + 0.3 * h * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        x = around[np.argmax(clearance(around))]
        normal = (clearance(x + 1e-5 * np.eye(2)) - clearance(x - 1e-5 * np.eye(2))) / 2e-5
        c = float(clearance(x[None])[0])
        assert grid.control(x) @ normal * c == pytest.approx(b**2, rel=0.1)


def test_a_grid_that_does_not_resolve_the_obstacles_is_still_refused():
    with pytest.raises(OptionError, match="too coarse for this scene"):
        exact(scene_of(9), 0.1, spacing=0.15)
