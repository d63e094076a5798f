"""Scenes whose value and control have closed forms, and how tests estimate in them.

Statistical tests compare the mean over independent seeds (0, 1, ...) with the exact value, in units of the
standard error of that mean; "within 3" is wrong for one stream of random numbers in two hundred.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from batches import batch_of
from discs import scene_of
from scipy.special import k0, k1

from pirrht import Estimate, FreeSpace, PathIntegral, Problem, Sampling, SingleIntegrator, StraightLine, path_integral

SEEDS = 24
SPEED = 1.0  # of straight references, optimal for q = 1 and R = 2 I [m/s]


@cache
def strip_space(L: float) -> FreeSpace:
    """A corridor |x| < L whose ends are out of reach, with a goal that nobody finds."""
    goal, lower, side = (0.9 * L, 49.9 * L, 1e-3 * L), (-L, -50.0 * L), (L, 50.0 * L)
    return FreeSpace.of(scene_of(start=(0.0, 0.0), goal=goal, lower=lower, side=side, radius=0.2 * L))


def strip(b: float, L: float) -> Problem:
    """Exit from (-L, L) at no final cost."""
    return Problem(dynamics=SingleIntegrator(b=b), scene=strip_space(L).scene, R=2.0 * np.eye(2), q=1.0, phi=0.0)


def in_strip(**settings: Any) -> PathIntegral:
    """Samples in |x| < 0.5 under noise of 0.5."""
    return path_integral(strip(0.5, 0.5), strip_space(0.5), Sampling(**settings))


def wave_number(problem: Problem, b: float) -> float:
    return float(np.sqrt(2.0 * problem.least_rate / (problem.temperature * b * b)))


def interval_exit(problem: Problem, b: float, L: float, x: float) -> tuple[float, float]:
    """v and u* of psi = cosh(kx) / cosh(kL)."""
    temperature, k = problem.temperature, wave_number(problem, b)
    return -temperature * np.log(np.cosh(k * x) / np.cosh(k * L)), temperature / 2.0 * k * np.tanh(k * x)


def annulus(b: float, radius: float = 0.3) -> tuple[Problem, FreeSpace]:
    """A goal disc in an empty workspace whose border is out of reach."""
    scene = scene_of(start=(1.2, 0.0), goal=(0.0, 0.0, radius), lower=(-15.0, -15.0), side=15.0)
    return Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2), q=1.0), FreeSpace.of(scene)


def disc_entry(problem: Problem, b: float, radius: float, r: float) -> tuple[float, float]:
    """v and the speed of u* towards the disc, psi = K0(k r) / K0(k radius)."""
    temperature, k = problem.temperature, wave_number(problem, b)
    return -temperature * np.log(k0(k * r) / k0(k * radius)), temperature / 2.0 * k * k1(k * r) / k0(k * r)


def straight(x: np.ndarray, ends: Sequence[np.ndarray], times: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Tapes that lead straight to some points and are zero from there on; and corners far beyond them."""
    steering = StraightLine(pace=SPEED)
    tapes = [steering.trajectory(steering.connect(x, end)).tape(times) for end in ends]
    return np.array(tapes), [np.array([x + 20.0 * (end - x)]) for end in ends]


def at_strip(integral: PathIntegral, x: float, sides: Sequence[int], seed: int, **options) -> Estimate:
    """Around references to the chosen sides of a strip, or none."""
    state, L = np.array([x, 0.0]), integral.setup.world.static.right
    times = integral.grid(2.0 * (L - abs(x)))
    if sides:
        tapes, corners = straight(state, [np.array([side * L, 0.0]) for side in sides], times)
    else:
        tapes, corners = np.zeros((1, len(times) - 1, 2)), None
    batch = batch_of(integral, state, times, tapes, corners=corners, **options)
    return integral.estimate(integral.rollout(batch, seed))


def within(samples: np.ndarray, exact: np.ndarray | float, *, errors: float = 3.0) -> bool:
    """Whether the mean over the first axis is `exact` up to so many standard errors."""
    samples = np.asarray(samples)
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    assert np.all(error > 0)
    return bool(np.all(np.abs(samples.mean(axis=0) - exact) <= errors * error))
