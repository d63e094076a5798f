"""The long tests of unit/pirrht/estimation/test_antithetic.py."""

from __future__ import annotations

import numpy as np
from batches import batch_of
from unit.pirrht.estimation.test_antithetic import PLANS, TIMES, of

from pirrht.arrays import Array
from pirrht.planner.tree import HomologyTree
from sim.scenario import Scenario


def around(slit: Scenario, slit_tree: HomologyTree) -> tuple[Array, list[Array]]:
    """Tapes of the references from the start, and the corners that samples head for."""
    trajectories = [r.trajectory for r in slit_tree.references(slit.start)]
    goal = slit.space.scene.goal.center
    corners = [np.vstack([t.path.start[1:, :2], goal]) for t in trajectories]
    return np.array([t.tape(TIMES) for t in trajectories]), corners


def test_standard_errors_of_pairs_cover_what_repeated_plans_show(slit, slit_tree):
    """A standard deviation from 60 plans (seeds 0 to 59) has a relative standard error of 9 %; b = 0.1, N = 600.

    The largest pair counts several times: with more noise it all hangs on rare heavy samples, that no standard error
    knows of before they come.
    """
    source, (tapes, corners) = of(slit, samples=600), around(slit, slit_tree)
    batch = batch_of(source, slit.start, TIMES, tapes, corners=corners)
    found = [source.estimate(source.rollout(batch, seed)) for seed in range(PLANS)]
    claimed = np.sqrt(np.mean([e.value_error**2 for e in found]))
    assert 0.8 < claimed / np.std([e.value for e in found], ddof=1) < 1.9
    claimed = np.sqrt(np.mean([np.sum(e.control_error**2) for e in found]))
    assert 0.8 < claimed / np.sqrt(np.var([e.control for e in found], axis=0, ddof=1).sum()) < 1.9
