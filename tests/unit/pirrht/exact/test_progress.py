"""Who waits for an exact solution hears how far it has come."""

from __future__ import annotations

import numpy as np
from discs import disc
from moving import moved

from pirrht import FreeSpace, Goal, Problem, Scene, SingleIntegrator
from pirrht.exact.desirability import Desirability


def test_a_march_tells_the_share_that_is_done_in_order_and_to_the_end():
    scene = Scene(
        name="hall", lower=np.zeros(2), upper=np.array([2.0, 1.4]), obstacles=(), robot_radius=0.1,
        goal=Goal(center=np.array([1.6, 0.7]), radius=0.3), start=np.array([0.3, 0.7, 0.0]),
        movers=(moved("walker", [(0, 1.0, 0.3, 0), (0.06, 1.0, 0.35, 0)], disc("walker", 0.0, 0.0, 0.2)),),
    )  # fmt: skip
    problem = Problem(dynamics=SingleIntegrator(b=0.4), scene=scene, R=2.0 * np.eye(2))
    shares: list[float] = []
    Desirability.of(problem, FreeSpace.of(scene), progress=shares.append)
    assert len(shares) > 3
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
