"""Guides of a rover: psi is the same whatever guide is followed, and far more samples count than open loop."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discs import disc, scene_of
from guides import best

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.steering.motion import Trajectory
from pirrht.steering.straight_line import Tracked
from pirrht.systems.rover import Rover, towards_goal

X = np.array([0.5, 1.5, 0.3])


@cache
def integral() -> PathIntegral:
    """A rover, noise 0.2, a post between start and goal; q = 1, lambda = 0.08."""
    scene = scene_of([disc("post", 1.4, 1.7, 0.25)], start=(0.5, 1.5), goal=(2.6, 1.5), side=3.0)
    problem = Problem(dynamics=Rover(b=0.2), scene=scene, R=np.diag([2.0, 0.5]))
    return path_integral(problem, FreeSpace.of(scene), Sampling(dt=0.1, draws="independent", threads=1))


def reference(corner: Array) -> Trajectory:
    """Over a pose (3,) into the goal."""
    steering = Tracked.of(integral().problem)
    places = np.vstack([X, corner, [2.6, 1.5, 0.3]])[:, :2]
    return steering.trajectory(steering.connect(places[:-1], places[1:]))


@cache
def times() -> Array:
    return integral().steps(9.0)


def guide_of(corner: tuple[float, float, float]) -> DDPGuide:
    guidance, homology = integral().guidance, integral().space.homology
    assert isinstance(guidance, DDPGuidance)
    trajectory = reference(np.array(corner))
    guide = best(guidance, X, times(), homology.key((0,)), trajectory)
    assert guide is not None
    assert guide.valid
    return guide


def drawn(lead: ProposalControl, count: int, seed: int) -> tuple[float, float, float]:
    """log psi, its standard error and the share of effective samples."""
    batch = Batch(state=X, times=times(), proposals=(Proposal(lead=lead, count=count),))
    log_weight = integral().rollout(batch, seed).log_weight
    top = log_weight.max()
    w = np.exp(log_weight - top)
    return (
        float(top + np.log(w.mean())),
        float(w.std() / w.mean() / np.sqrt(count)),
        float(w.mean() ** 2 / (w**2).mean()),
    )


def test_psi_is_the_same_whatever_guide_is_followed_and_feedback_beats_open_loop():
    """Three guides of other paths and gains: pairs agree within 3 standard errors; 8000 samples each.

    References are lines that no control drives exactly, so the open loop is that of a guide's own controls.
    """
    best = guide_of((1.4, 1.2, 0.0))
    weaker = replace(guide_of((1.2, 1.15, -0.2)), gains=0.8 * best.gains)
    faster = replace(best, modes=1.05 * best.modes, gains=1.1 * best.gains)
    found = [drawn(LinearFeedback(guide), 8000, seed) for seed, guide in enumerate((best, weaker, faster))]
    for k in (1, 2):
        assert found[k][0] == pytest.approx(found[0][0], abs=3.0 * np.hypot(found[0][1], found[k][1]))
    assert max(error for _, error, _ in found) < 0.15
    assert found[0][2] > 5.0 * drawn(Tape(times(), best.tape), 8000, 3)[2]


@pytest.mark.parametrize("x", [(0.0, 0.0, 3.0), (1.5, 0.9, 0.5), (2.2, 0.2, -2.0)])
def test_homing_brings_a_rover_into_the_goal_from_anywhere(x):
    """Noise 0.1, q / lambda = 50: the disc around (2, 1) of radius 0.3 within 6 s, at no more than 1 m/s.

    If it lies behind, backwards all the way.
    """
    state, a, h = np.array(x, dtype=float), np.zeros(2), 0.01
    rover, ahead = Rover(b=0.1), np.array([np.cos(x[2]), np.sin(x[2])]) @ (np.array([2.0, 1.0]) - x[:2]) > 0.0
    for _ in range(600):
        towards_goal(state, np.zeros(0), rover.B_c(state), (2.0, 1.0), 0.3, 50.0, a)
        u = rover.input_of(state, a)
        assert -1e-12 <= (u[0] if ahead else -u[0]) <= 1.0 + 1e-12
        state = rover.step(state, u, np.zeros(2), h)
        if np.hypot(state[0] - 2.0, state[1] - 1.0) < 0.3:
            return
    pytest.fail(f"still at {state}")
