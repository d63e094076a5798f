"""Steps of a mass: under fitted ones position and velocity are drawn as in continuous time; homing reaches the goal."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.systems.double_integrator import DoubleIntegrator, into_goal

STEP, NOISE = 0.1, 0.3


def test_within_fitted_steps_a_masss_position_is_the_integral_of_its_velocity():
    """Covariances b^2 (t, t^2/2, t^3/3) after one and two steps; 40 000 paths, seed 1, 4 deviations."""
    scene = Scene(
        name="open", lower=np.array([-9.0, -9.0]), upper=np.array([9.0, 9.0]), obstacles=(),
        goal=Goal(center=np.array([8.0, 8.0]), radius=0.4), start=np.zeros(3), robot_radius=0.15,
    )  # fmt: skip
    problem = Problem(dynamics=DoubleIntegrator(b=NOISE), scene=scene, R=np.eye(2))
    integral = path_integral(problem, FreeSpace.of(scene), Sampling(dt=STEP, draws="independent"))
    times, count = STEP * np.arange(3), 40_000
    proposal = Proposal(lead=Tape(times, np.zeros((2, 2))), count=count)
    x = np.array([0.0, 0.0, 0.5, -0.2])
    states = integral.replay.trace(
        integral.rollout(Batch(state=x, times=times, proposals=(proposal,)), 1), np.arange(count)
    )[0]
    for k in (1, 2):
        t = k * STEP
        off = states[:, k] - x - t * np.array([0.5, -0.2, 0.0, 0.0])
        for i, j, exact in (
            (2, 2, t),
            (0, 2, t**2 / 2),
            (0, 0, t**3 / 3),
            (1, 1, t**3 / 3),
            (1, 3, t**2 / 2),
            (0, 1, 0.0),
        ):
            product = off[:, i] * off[:, j]
            assert product.mean() == pytest.approx(NOISE**2 * exact, abs=4.0 * product.std() / np.sqrt(count))


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
