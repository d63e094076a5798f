"""Backends are exchangeable: compiled rollouts and the paper's Euler steps in NumPy estimate the same."""

from __future__ import annotations

import numpy as np
import pytest
from batches import batch_of
from discs import scene_of
from euler import Euler

from pirrht import FreeSpace, Problem, Sampling, SingleIntegrator, path_integral
from pirrht.estimation.estimate import Estimate

X, SAMPLES = np.array([1.6, 1.0]), 20_000
PAPER = {"exit": "endpoint", "steps": "uniform", "guide": "open-loop", "draws": "independent", "threads": 1}


def estimated(weights: str, backend: Euler | None, seed: int) -> tuple[Estimate, np.ndarray]:
    """Estimate around two control sequences in a room whose walls end many paths; its open-loop control too."""
    scene = scene_of(start=X, goal=(2.8, 1.0, 0.4), side=(4.0, 2.0), radius=0.2)
    problem = Problem(dynamics=SingleIntegrator(b=0.4), scene=scene, R=2.0 * np.eye(2), phi=4.0)
    sampling = Sampling(**PAPER, weights=weights)
    integral = path_integral(problem, FreeSpace.of(scene), sampling, backend=backend)
    times = integral.steps(3.0)
    tapes = np.array([np.tile(u, (len(times) - 1, 1)) for u in ((1.0, 0.0), (0.5, 0.3))])
    rollouts = integral.rollout(batch_of(integral, X, times, tapes, counts=[SAMPLES // 4, 3 * SAMPLES // 4]), seed)
    estimate = integral.estimate(rollouts)
    states, steps = integral.replay.trace(rollouts, np.arange(3))
    assert states.shape == (3, len(times), 2)
    assert np.array_equal(steps, rollouts.paths.steps[:3])
    tape, alive = integral.replay.tape(estimate.parts)
    np.testing.assert_allclose(tape[0], estimate.control, atol=1e-3)
    assert alive[0] == pytest.approx(1.0, abs=1e-3)
    return estimate, tape[:5]


@pytest.mark.parametrize("weights", ["balance", "average"])
def test_compiled_rollouts_estimate_what_euler_steps_in_numpy_do(weights):
    """v and u within 4 standard errors of their difference; 20 000 samples each, seeds 1 and 2."""
    (one, early), (other, late) = estimated(weights, None, 1), estimated(weights, Euler(), 2)
    assert abs(one.value - other.value) < 4.0 * np.hypot(one.value_error, other.value_error)
    assert np.all(np.abs(one.control - other.control) < 4.0 * np.hypot(one.control_error, other.control_error))
    np.testing.assert_allclose(early, late, atol=0.15)
    assert one.survivors / SAMPLES == pytest.approx(other.survivors / SAMPLES, abs=0.03)
