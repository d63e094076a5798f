"""What the clearance along a step costs: its derivatives, and that backward passes know what small steps gain."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from discs import disc
from guides import best

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.problem import Problem
from pirrht.proposals.backward_pass import backward_pass
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide, empty_course
from pirrht.proposals.walls import clearance_costs
from pirrht.rollouts.cpu import kind_of
from pirrht.steering.motion import Trajectory
from pirrht.systems.double_integrator import DoubleIntegrator

STEP = 0.1


@cache
def beside_a_pillar() -> tuple[PathIntegral, DDPGuidance]:
    """A mass before a pillar of radius 0.3 that stands in its way to the goal."""
    scene = Scene(
        name="pillar", lower=np.zeros(2), upper=np.array([5.0, 4.0]), start=np.array([0.5, 2.0, 0.0]),
        obstacles=(disc("pillar", 2.0, 1.9, 0.3),), robot_radius=0.1,
        goal=Goal(center=np.array([4.0, 2.0]), radius=0.3),
    )  # fmt: skip
    problem = Problem(dynamics=DoubleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
    integral = path_integral(problem, FreeSpace.of(scene), Sampling(dt=STEP, threads=1))
    assert isinstance(integral.guidance, DDPGuidance)
    return integral, integral.guidance


@cache
def above_the_pillar() -> tuple[Array, DDPGuide]:
    """The guide around it, on the side of its greater distance from the straight way."""
    integral, guidance = beside_a_pillar()
    up = np.array([[1.0, 0.5]] * 10 + [[0.6, -0.55]] * 22)
    push = Trajectory(controls=up, durations=np.full(32, STEP), path=None, cost=3.2, length=3.6)
    times = STEP * np.arange(90)
    key = integral.space.homology.key((0,))
    guide = best(guidance, np.array([0.5, 2.0, 0.0, 0.0]), times, key, push)
    assert guide is not None
    assert guide.valid
    return times, guide


def test_the_derivatives_of_a_steps_price_are_those_of_differences():
    """In both positions and the velocity lost, at 40 places by the pillar, seed 1; Hessians are never indefinite."""
    integral, guidance = beside_a_pillar()
    task, rng, (scratch, cost, expand) = guidance.tasks[100.0], np.random.default_rng(1), clearance_costs(None)
    walls = scratch(integral.setup)
    g, H, near = np.zeros(6), np.zeros((6, 6)), 0

    def price(z):
        (x, y), (nx, ny), (bx, by) = z.reshape(3, 2)
        return cost(integral.setup, task, (x, y, nx - x, ny - y, bx, by, 0.0, STEP), 3, walls)

    for _ in range(40):
        angle, gap = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.02, 0.1)
        tail = np.array([2.0, 1.9]) + (0.4 + gap) * np.array([np.cos(angle), np.sin(angle)])
        z = np.concatenate([tail, tail + rng.normal(scale=0.02, size=2), rng.normal(scale=0.5, size=2)])
        x, y, nx, ny, bx, by = z
        if not expand(integral.setup, task, (x, y, nx - x, ny - y, bx, by, 0.0, STEP), 3, walls, g, H):
            continue
        h = 1e-7
        slope = np.array([(price(z + h * e) - price(z - h * e)) / (2.0 * h) for e in np.eye(6)])
        np.testing.assert_allclose(g, slope, atol=2e-3 * np.abs(slope).max())
        np.testing.assert_allclose(H, H.T, atol=1e-12)
        assert np.linalg.eigvalsh(H).min() > -1e-9 * np.abs(H).max()
        near += 1
    assert near > 30


def test_a_backward_pass_knows_what_a_small_step_gains():
    """Put aside by 1 cm, a guide whose ways bow beside the pillar gains 2 e times what is expected, to 5 %."""
    integral, guidance = beside_a_pillar()
    times, guide = above_the_pillar()
    course = empty_course(len(times) - 1, 4, guidance.width)
    push = np.zeros_like(guide.modes)
    push[3, 1], push[9, 1] = 1.0, -1.0
    course.states[0], course.control[:] = guide.states[0], guide.modes + push
    trial = empty_course(len(times) - 1, 4, guidance.width)
    trial.states[0] = guide.states[0]
    task = guidance.tasks[10.0]
    kind = kind_of(integral.problem)
    forward, backward = forward_pass(kind).forward, backward_pass(kind)
    steps, _, before = forward(integral.setup, task, times, course, guide.length, 0.0, 4, trial)
    course.states[:], course.control[:] = trial.states, trial.control
    expected = backward(integral.setup, task, times, course, steps, 4, 0.0)
    share = 1e-3
    _, _, after = forward(integral.setup, task, times, course, steps, share, 4, trial)
    assert expected > 1e-3
    assert before - after == pytest.approx(2.0 * share * expected, rel=0.05)
