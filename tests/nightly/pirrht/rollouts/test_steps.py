"""Steps of a car and of a mass: fitted ones say what finer ones do, and are drawn as in continuous time."""

from __future__ import annotations

import numpy as np
import pytest
from discs import scene_of
from guides import best
from unit.pirrht.rollouts.test_car_steps import STEP, case

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.proposals.guide import LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.steering.motion import running_cost
from pirrht.systems.double_integrator import DoubleIntegrator, into_goal

# -- a car -------------------------------------------------------------------------------------------------------


def value(x: Array, dt: float, steps: str, samples: int = 4000, seed: int = 0) -> tuple[float, float]:
    """v and its standard error."""
    problem, space, tree = case(0.03)
    integral = path_integral(problem, space, Sampling(dt=dt, steps=steps, samples=samples))
    references = tree.references(x)
    times = integral.grid(max(running_cost(problem, x, r.trajectory) for r in references))
    found = [best(integral.guidance, x, times, space.homology.key(one.winding), one.trajectory) for one in references]
    proposals = tuple(Proposal(lead=LinearFeedback(guide), count=samples) for guide in found if guide is not None)
    estimate = integral.estimate(integral.rollout(Batch(state=x, times=times, proposals=proposals), seed))
    return estimate.value, estimate.value_error


# In the open; and with 6 cm of clearance next to the post, towards it.
@pytest.mark.parametrize("x", [(0.0, 0.0, 2.6), (1.6, -0.1, 1.0)], ids=["open", "next to it"])
def test_fitted_steps_of_a_car_say_what_steps_a_tenth_as_long_do_and_uniform_ones_say_more(x):
    """Within 4 standard errors (below 0.0001) and 0.0001; uniform steps are off by 0.001 and 0.014. Seed 0."""
    x = np.array(x)
    (fitted, error), (fine, other) = value(x, STEP, "fitted"), value(x, 0.1 * STEP, "uniform")
    allowed = 4.0 * np.hypot(error, other) + 0.0001
    assert np.hypot(error, other) < 0.0001
    assert abs(fitted - fine) < allowed
    assert value(x, STEP, "uniform")[0] - fine > 2.0 * allowed


# -- a mass ------------------------------------------------------------------------------------------------------


def test_within_fitted_steps_a_masss_position_is_the_integral_of_its_velocity():
    """Covariances b^2 (t, t^2/2, t^3/3) after one and two steps; 40 000 paths, seed 1, 4 deviations."""
    scene, b = scene_of([], start=(9.0, 9.0), goal=(17.0, 17.0), side=18.0), 0.3
    problem = Problem(dynamics=DoubleIntegrator(b=b), scene=scene, R=np.eye(2))
    integral = path_integral(problem, FreeSpace.of(scene), Sampling(dt=STEP, draws="independent"))
    times, count, x = STEP * np.arange(3), 40_000, np.array([9.0, 9.0, 0.5, -0.2])
    proposal = Proposal(lead=Tape(times, np.zeros((2, 2))), count=count)
    rollouts = integral.rollout(Batch(state=x, times=times, proposals=(proposal,)), 1)
    states = integral.replay.trace(rollouts, np.arange(count))[0]
    for k in (1, 2):
        t = k * STEP
        off = states[:, k] - x - t * np.array([0.5, -0.2, 0.0, 0.0])
        moments = {(2, 2): t, (0, 2): t**2 / 2, (0, 0): t**3 / 3, (1, 1): t**3 / 3, (1, 3): t**2 / 2, (0, 1): 0.0}
        for (i, j), exact in moments.items():
            product = off[:, i] * off[:, j]
            assert product.mean() == pytest.approx(b**2 * exact, abs=4.0 * product.std() / np.sqrt(count))


@pytest.mark.parametrize(
    "x", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.5), (1.5, 0.9, 1.0, 0.0), (1.9, 1.7, 0.0, -2.0)]
)
def test_homing_brings_a_mass_into_the_goal_from_anywhere(x):
    """Noise 0.1, q / lambda = 50, as with R = 2: the disc around (2, 1) of radius 0.3 within 6 s."""
    state, a, h = np.array(x, dtype=float), np.zeros(2), 0.01
    for _ in range(600):
        into_goal(state, np.zeros(0), 0.1 * np.eye(2), (2.0, 1.0), 0.3, 50.0, a)
        state[:2] += h * state[2:]
        state[2:] += h * 0.1 * a
        if np.hypot(state[0] - 2.0, state[1] - 1.0) < 0.3:
            return
    pytest.fail(f"still at {state}")
