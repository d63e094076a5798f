"""Sampled paths: noise through inputs, and fitted steps of a car against finer ones."""

from functools import cache

import numpy as np
import pytest
from batches import led
from by_inputs import PushedMass, driven
from guides import best
from thoroughly import thorough
from unit.pirrht.rollouts.test_blocks import STEP, case

from pirrht import FreeSpace, PathIntegral, Problem, Sampling, path_integral
from pirrht.proposals.guide import LinearFeedback
from pirrht.proposals.proposal import Tape
from pirrht.steering.motion import Trajectory, running_cost
from pirrht.systems.double_integrator import DoubleIntegrator
from sim.mjcf import load

PLAIN = Sampling(dt=0.01, exit="endpoint", steps="uniform", draws="independent", threads=1)
FINE = Sampling(dt=0.1, draws="independent", threads=1)
# (speed [m/s], turn rate [rad/s], how long [s]), held
TAPES = ((0.0, 0.0, 0.0), (1.0, 0.3, 0.4), (1.5, 0.5, 0.3))


@cache
def car(sampling: Sampling, stratonovich: bool) -> PathIntegral:
    problem = driven(stratonovich=stratonovich)
    return path_integral(problem, FreeSpace.of(problem.scene), sampling)


def drawn(integral: PathIntegral, tape, count: int, seed: int, horizon: float = 20.0):
    """Samples around a control that is held for a while."""
    times = integral.steps(horizon)
    controls = np.zeros((len(times) - 1, 2))
    controls[times[1:] <= tape[2] + 1e-9] = tape[:2]
    return led(integral, np.array([0.0, 0.0, 0.4]), times, Tape(times, controls), count=count, seed=seed)


def mean(weight: np.ndarray) -> tuple[float, float]:
    """And its standard error."""
    return float(weight.mean()), float(weight.std() / np.sqrt(len(weight)))


@pytest.mark.thorough
@pytest.mark.parametrize("tape", TAPES)
def test_psi_of_the_chain_is_plain_simulations_whatever_tape_is_followed(tape):
    """0.047975(68) of 10^7 paths: steps of 0.01 s along the heading of their start, exits at their ends."""
    psi, error = mean(np.exp(drawn(car(PLAIN, False), tape, 60_000, 3).log_weight))
    assert psi == pytest.approx(0.047975, abs=3.0 * np.hypot(error, 68e-6))


@pytest.mark.parametrize("stratonovich", [thorough(False), True])
def test_the_likelihood_ratio_integrates_to_one(stratonovich):
    rollouts = drawn(car(PLAIN if not stratonovich else FINE, stratonovich), (1.0, -0.6, 0.2), 20_000, 5)
    one, error = mean(np.exp(-rollouts.paths.log_ratio[:, 0]))
    assert one == pytest.approx(1.0, abs=3.0 * error)
    assert error < 0.02


@cache
def in_slit(partition: bool) -> PathIntegral:
    """A mass in `slit`, in one form or the other."""
    dynamics = DoubleIntegrator(b=0.1) if partition else PushedMass()
    problem = Problem(dynamics=dynamics, scene=load("slit", robot="puck").scene, R=2 * np.eye(2))
    return path_integral(problem, FreeSpace.of(problem.scene), Sampling(dt=0.1, threads=1))


@pytest.mark.thorough
def test_a_mass_is_the_same_in_input_form_as_in_the_papers_partition():
    """Guide, likelihood ratios, paths and controls agree to rounding."""
    x = np.array([1.0, 2.5, 0.0, 0.0])
    controls, found = np.array([[0.7, 0.2], [-0.2, -0.1]]), []
    push = Trajectory(controls=controls, durations=np.array([2.5, 2.5]), path=None, cost=5.0, length=5.0)
    for partition in (True, False):
        integral = in_slit(partition)
        times = integral.steps(12.0)
        key = integral.space.homology.key((0,) * len(integral.space.obstacles))
        guide = best(integral.guidance, x, times, key, push)
        rollouts = led(integral, x, times, *(LinearFeedback(guide), Tape(times, push.tape(times))), count=100, seed=7)
        found.append((guide, rollouts, integral.estimate(rollouts)))
    (one, first, told), (other, second, again) = found
    np.testing.assert_allclose(other.modes, one.modes, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(second.paths.log_ratio, first.paths.log_ratio, rtol=1e-6, atol=1e-5)
    np.testing.assert_array_equal(second.paths.outcome, first.paths.outcome)
    np.testing.assert_allclose(again.control, told.control, rtol=1e-5, atol=1e-6)
    assert again.value == pytest.approx(told.value, rel=1e-6)


def value(x: np.ndarray, dt: float, steps: str, samples: int = 4000, seed: int = 0) -> tuple[float, float]:
    """v and its standard error."""
    problem, space, tree = case(0.03)
    integral = path_integral(problem, space, Sampling(dt=dt, steps=steps, samples=samples))
    references = tree.references(x)
    times = integral.grid(max(running_cost(problem, x, r.trajectory) for r in references))
    found = [best(integral.guidance, x, times, space.homology.key(one.winding), one.trajectory) for one in references]
    leads = (LinearFeedback(guide) for guide in found if guide is not None)
    estimate = integral.estimate(led(integral, x, times, *leads, count=samples, seed=seed))
    return estimate.value, estimate.value_error


# In the open; and with 6 cm of clearance next to the post, towards it.
@pytest.mark.parametrize("x", [(0.0, 0.0, 2.6), (1.6, -0.1, 1.0)], ids=["open", "next to it"])
def test_fitted_steps_of_a_car_say_what_steps_a_tenth_as_long_do_and_uniform_ones_say_more(x):
    """Within 0.0002, which standard errors allow; uniform steps are off by 0.001 and 0.014. Seed 0."""
    x = np.array(x)
    (fitted, error), (fine, other) = value(x, STEP, "fitted"), value(x, 0.1 * STEP, "uniform")
    allowed = 0.0002
    assert np.hypot(error, other) < allowed
    assert abs(fitted - fine) < allowed
    assert value(x, STEP, "uniform")[0] - fine > 2.0 * allowed
