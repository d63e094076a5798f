"""A proposal with wider noise, added as one class, leaves psi unbiased, alone and in a mixture."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks import mass_line
from benchmarks.mass_on_line import mass_on_line
from guides import best
from wider import Wider

from pirrht.proposals.guide import LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal
from pirrht.steering.double_integrator import MassSteering
from pirrht.steering.motion import running_cost

B, SEED, STATE = 0.3, 5, (0.5, 0.3)  # noise, seed of the samples, position and velocity on the line


@pytest.mark.parametrize("counts", [(0, 6000), (3000, 3000)], ids=["alone", "mixture"])
def test_wider_noise_leaves_psi_unbiased(counts):
    """Value at one state of a mass on a line against the grid; 6 000 samples, seed 5, 4 standard errors."""
    integral, (p, v) = mass_line.sampler(B, threads=1), STATE
    x, steering = np.array([p, 0.0, v, 0.0]), MassSteering.of(integral.problem)
    way = steering.trajectory(steering.connect(x, np.array([1.0, 0.0, np.nan, np.nan])))
    times = integral.grid(running_cost(integral.problem, x, way))
    guide = best(integral.guidance, x, times, 0, way)
    leads = LinearFeedback(guide), Wider(LinearFeedback(guide), 1.1)
    proposals = tuple(Proposal(lead=lead, count=n) for lead, n in zip(leads, counts, strict=True) if n > 0)
    rollouts = integral.rollout(Batch(state=x, times=times, proposals=proposals), SEED)
    estimate = integral.estimate(rollouts)
    exact = mass_on_line(b=B, r=mass_line.R, spacing=0.01).value(p, v)
    assert estimate.ess > 200.0
    assert estimate.value == pytest.approx(exact, abs=4.0 * estimate.value_error)
    assert 0.0 < estimate.value_error < 0.02 * exact
    assert np.ptp(rollouts.paths.log_ratio[:, -1]) > 1.0
