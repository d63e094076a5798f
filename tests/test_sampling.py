"""How samples are shared out and what the estimates say about their own errors.

The strip |x| < L, left at no cost, has a closed form (see test_path_integral). Its estimates here come from seeds
0, 1, ...; "within so many standard errors" refers to the spread over these seeds.
"""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.dynamics import SingleIntegrator
from pirrht.estimate import Estimate
from pirrht.freespace import FreeSpace
from pirrht.path_integral import PathIntegral
from pirrht.problem import Problem
from pirrht.sampling import Sampling
from pirrht.scene import Array, Goal, Scene
from pirrht.steering import StraightLine
from pirrht.tree import HomologyTree
from sim.scenarios import Scenario

HALF, NOISE = 0.5, 0.5  # of the strip: half its width L [m], b [m/sqrt(s)]
X = np.array([0.2, 0.0])


@pytest.fixture(scope="module")
def strip() -> tuple[Problem, FreeSpace]:
    """A corridor with a goal that nobody finds."""
    scene = Scene(
        name="strip", lower=np.array([-HALF, -25.0]), upper=np.array([HALF, 25.0]), obstacles=(),
        goal=Goal(center=np.array([0.45, 24.9]), radius=5e-4), start=np.zeros(3), robot_radius=0.1,
    )  # fmt: skip
    return Problem(dynamics=SingleIntegrator(b=NOISE), scene=scene, R=2.0 * np.eye(2), q=1.0, phi=0.0), FreeSpace.of(
        scene
    )


def to_both_sides(integral: PathIntegral, seed: int, **options) -> Estimate:
    """Around a reference to each side of the strip."""
    times = integral.grid(2.0 * (HALF - X[0]))
    steering, ends = StraightLine(pace=1.0), [np.array([side * HALF, 0.0]) for side in (1.0, -1.0)]
    tapes = np.array([steering.trajectory(steering.connect(X, end)).tape(times) for end in ends])
    corners = [np.array([X + 20.0 * (end - X)]) for end in ends]
    return integral.estimate(integral.rollout(X, times, tapes, seed, corners=corners, **options))


def spread_and_error(estimates: list[Estimate]) -> tuple[Array, Array]:
    """Standard deviation over estimates of v, u_1, u_2, and the mean of what they report, (3,)."""
    found = np.array([[e.value, *e.control] for e in estimates])
    errors = np.array([[e.value_error, *e.control_error] for e in estimates])
    return found.std(axis=0, ddof=1), errors.mean(axis=0)


# -- standard errors ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("counts", [[400, 400], [400, 150]], ids=["equal counts", "unequal counts"])
@pytest.mark.parametrize(
    ("guide", "weights"), [("feedback", "balance"), ("open-loop", "balance"), ("open-loop", "average")]
)
def test_the_reported_error_is_the_spread_of_300_repeats(strip, guide, weights, counts):
    sampling = Sampling(dt=0.05, first=0.0125, guide=guide, weights=weights)
    integral = PathIntegral(*strip, sampling)
    spread, error = spread_and_error([to_both_sides(integral, seed, counts=counts) for seed in range(300)])
    np.testing.assert_allclose(error, spread, rtol=0.15)


def test_the_reported_error_is_the_spread_of_300_plans_in_the_slit(slit: Scenario, slit_tree: HomologyTree):
    controller = slit.with_settings(noise=0.1, samples=200).controller(slit_tree)
    estimates = [controller.plan(slit.start).estimate for _ in range(300)]
    spread, error = spread_and_error([e for e in estimates if e is not None])
    np.testing.assert_allclose(error, spread, rtol=0.15)


def test_a_single_sample_knows_its_value_up_to_lambda(strip):
    integral = PathIntegral(*strip, Sampling(dt=0.05, guide="open-loop", threads=1))
    estimate = to_both_sides(integral, 0, counts=[1, 1])
    assert 0.5**0.5 * integral.temperature <= estimate.value_error <= integral.temperature
    assert np.all(np.isfinite(estimate.control_error))
