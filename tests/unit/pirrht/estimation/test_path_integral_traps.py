"""The traps of the paper, paths that end otherwise than at the goal, and settings that cannot work."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from batches import batch_of
from closed_forms import (
    at_strip,
    strip,
    strip_space,
)

from pirrht.arrays import Array
from pirrht.errors import NoSurvivingSample, OptionError
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate, Rollouts
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene
from pirrht.problem import Problem
from pirrht.steering.dubins import Dubins
from pirrht.systems.unicycle import Unicycle


@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_the_first_increment_has_the_variance_of_its_step(dt):
    """Trap 1: it is sqrt(dt) Z_0, so the control carried is b Z_0 / sqrt(dt); 20000 samples, errors of 0.5 %."""
    sampling = Sampling(dt=dt, samples=20000, guide="open-loop")
    integral = path_integral(strip(0.5, 0.5), strip_space(0.5), sampling)
    paths = at_strip(integral, 0.0, (), 0).rollouts.paths
    inside = paths.span == dt  # samples that leave in this step carry no noise from there on
    assert np.mean(inside) > 0.9
    now = paths.now[inside] / dt
    np.testing.assert_allclose(now.std(axis=0), 0.5 / np.sqrt(dt), rtol=0.02)
    np.testing.assert_allclose(now.mean(axis=0), 0.0, atol=4.0 * 0.5 / np.sqrt(dt * 20000))


def drifting_right() -> tuple[PathIntegral, Rollouts, Estimate]:
    integral = path_integral(strip(0.5, 0.5), strip_space(0.5), Sampling(dt=0.1, samples=200, exit="endpoint"))
    estimate = at_strip(integral, 0.2, (1,), 5)
    return integral, estimate.rollouts, estimate


def test_the_tape_is_the_weighted_mean_of_what_samples_carried_before_their_exit():
    """Trap 7. With exit at step ends a path is the sum of what it carried, so its states are the oracle."""
    integral, rollouts, estimate = drifting_right()
    states, steps = integral.replay.trace(rollouts, np.arange(rollouts.size))
    np.testing.assert_array_equal(steps, rollouts.paths.steps)
    carried = np.diff(states, axis=1) / 0.1
    carried[np.arange(carried.shape[1]) >= steps[:, None]] = 0.0
    tape, alive = integral.replay.tape(estimate.parts)
    np.testing.assert_allclose(tape, np.einsum("s,sti->ti", estimate.weight, carried), atol=1e-4)
    under_way = np.arange(carried.shape[1]) < steps[:, None]
    np.testing.assert_allclose(alive, estimate.weight @ under_way, atol=1e-4)


def test_noise_after_the_exit_does_not_leak_into_the_tape():
    for exit_rule in ("bridge", "endpoint"):
        integral = path_integral(strip(0.5, 0.5), strip_space(0.5), Sampling(dt=0.1, samples=200, exit=exit_rule))
        estimate = at_strip(integral, 0.2, (1,), 5)
        last = int(estimate.rollouts.paths.steps[estimate.weight > 1e-6].max())
        tape, alive = integral.replay.tape(estimate.parts)
        assert 1 < last < len(tape)
        assert np.all(tape[last:] == 0.0)
        assert np.all(alive[last:] == 0.0)
        assert np.all(tape[:last].any(axis=1))


def test_no_surviving_sample_counts_how_they_ended(slit):
    integral = path_integral(slit.problem, slit.space, Sampling(samples=100))
    still_tape = np.zeros((1, 3, 2))
    with pytest.raises(NoSurvivingSample) as caught:
        integral.estimate(integral.rollout(batch_of(integral, slit.start, np.arange(4) * 0.1, still_tape), 0))
    assert (caught.value.collisions, caught.value.timeouts) == (0, 100)
    ramming = np.tile([0.0, 20.0], (1, 30, 1))
    with pytest.raises(NoSurvivingSample) as caught:
        integral.estimate(integral.rollout(batch_of(integral, slit.start, np.arange(31) * 0.1, ramming), 0))
    assert (caught.value.collisions, caught.value.timeouts) == (100, 0)
    assert "100 collided" in str(caught.value)


@cache
def car() -> tuple[Problem, FreeSpace]:
    """A unicycle before a post, its goal straight behind it; lambda is 0.0009 and phi / lambda 1.1e6."""
    post = Obstacle(
        name="post", kind=Kind.CYLINDER, size=np.array([0.3, 0.2, 0.0]), position=np.array([2.0, 0.0, 0.1]),
        rotation=np.eye(3),
    )  # fmt: skip
    scene = Scene(
        name="car", lower=np.array([-1.0, -3.0]), upper=np.array([5.0, 3.0]), obstacles=(post,), robot_radius=0.15,
        goal=Goal(center=np.array([4.0, 0.0]), radius=0.4), start=np.zeros(3),
    )  # fmt: skip
    return Problem(dynamics=Unicycle(), scene=scene, R=np.eye(1), phi=1000.0), FreeSpace.of(scene)


def driven(states: list[Array], samples: int = 300, seed: int = 0) -> Estimate:
    """Around the Dubins curves through some states."""
    problem, space = car()
    steering = Dubins.of(problem)
    integral = path_integral(problem, space, Sampling(samples=samples))
    path = steering.trajectory(steering.connect(np.array(states[:-1]), np.array(states[1:])))
    times = integral.grid(path.cost)
    batch = batch_of(integral, np.zeros(3), times, path.tape(times)[None])
    estimate = integral.estimate(integral.rollout(batch, seed))
    assert np.all(np.isfinite(integral.replay.tape(estimate.parts)[0]))
    return estimate


@pytest.mark.parametrize(
    "wrong",
    [
        {"dt": 0.0},
        {"dt": np.nan},
        {"first": -1.0},
        {"samples": 0},
        {"exit": "no"},
        {"weights": "no"},
        {"guide": "no"},
        {"allocation": "no"},
        {"target": 0.0},
        {"budget": 100},
    ],
)
def test_sampling_refuses_by_name(wrong):
    with pytest.raises(OptionError, match=next(iter(wrong))):
        Sampling(**wrong)
