"""Guides of any system: their gains are Riccati's where all is linear, derivatives are exact, steps gain as expected.

A mass (`DoubleIntegrator`) is the linear case, a car that accelerates the other one.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from discs import disc, scene_of
from guides import best, valid

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.proposals.backward_pass import backward_pass
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.guide import DDPGuide, empty_course
from pirrht.rollouts.cpu import kind_of
from pirrht.steering.motion import Trajectory, running_cost
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.second_order_car import SecondOrderCar
from sim.scenario import prepare

STEP = 0.1


def in_the_open(dynamics: Dynamics) -> PathIntegral:
    """A sampler in a wide empty room."""
    scene = scene_of(start=(0.0, 0.0), goal=(3.0, 1.0, 0.4), lower=(-20.0, -20.0), side=20.0, radius=0.15)
    R = 0.02 * np.linalg.inv(dynamics.B_c(np.zeros(4)) @ dynamics.B_c(np.zeros(4)).T)
    return path_integral(Problem(dynamics=dynamics, scene=scene, R=R), FreeSpace.of(scene), Sampling(dt=STEP))


def test_in_the_open_a_masss_gains_are_those_of_riccatis_recursion():
    """From the Hessian of the time to the goal's rim back, under the exact step of a mass that sways."""
    integral = in_the_open(DoubleIntegrator(b=0.1))
    lam, b, T = integral.problem.temperature, 0.1, 40
    times = STEP * np.arange(T + 1)
    u = np.tile([1.0, 0.3], (20, 1))
    push = Trajectory(controls=u, durations=np.full(20, STEP), path=None, cost=2.0, length=3.0)
    guide = best(integral.guidance, np.zeros(4), times, 0, push)
    assert guide is not None

    def rim(x: Array) -> float:
        gap, v = np.array([3.0, 1.0]) - x[:2], x[2:]
        along = gap @ v / np.sqrt(v @ v)
        return float((along - np.sqrt(0.16 - gap @ gap + along**2)) / np.sqrt(v @ v))

    h, unit, end = 2e-4, np.eye(4), guide.states[guide.length]
    corners = ((1, 1), (-1, -1), (1, -1), (-1, 1))
    P = np.array([
        [sum(s * t * rim(end + h * (s * unit[i] + t * unit[j])) for s, t in corners) / (4 * h * h) for j in range(4)]
        for i in range(4)
    ])  # fmt: skip
    A = np.eye(4) + STEP * np.eye(4, k=2)
    C = b * STEP * np.block([
        [0.5 * STEP * np.eye(2), -STEP / np.sqrt(12.0) * np.eye(2)], [np.eye(2), np.zeros((2, 2))]
    ])  # fmt: skip
    for i in range(guide.length - 1, -1, -1):
        stiff = lam * STEP * np.eye(4) + C.T @ P @ C
        K = -np.linalg.solve(stiff, C.T @ P @ A)
        np.testing.assert_allclose(guide.gains[i], K, atol=2e-4 * np.abs(K).max())
        left = lam * STEP * np.linalg.inv(stiff)
        if np.linalg.eigvalsh(left).max() <= 1.0:
            np.testing.assert_allclose(guide.share[i] @ guide.share[i], left, atol=1e-4)
        np.testing.assert_allclose(guide.share[i] @ guide.inverse[i], np.eye(4), atol=1e-12)
        assert guide.volume[i] == pytest.approx(np.linalg.slogdet(guide.share[i])[1], abs=1e-10)
        assert np.linalg.eigvalsh(guide.share[i]).max() <= 1.0 + 1e-12
        P = A.T @ P @ A + A.T @ P @ C @ K
        P = 0.5 * (P + P.T)


def test_derivatives_of_a_step_are_those_of_complex_steps():
    """First ones to 1e-7; second ones to 1e-4, against central differences of complex steps. A car that accelerates."""
    integral = in_the_open(SecondOrderCar(b=0.1))
    B, costate = integral.problem.dynamics.B_c(np.zeros(4)), np.array([0.7, -1.2, 0.4, 2.0])

    def step(z: Array) -> Array:
        x, a, mean, f = z[:4], B @ z[4:6], z[:4].copy(), np.zeros(4, complex)
        mean[2:] += STEP * (0.5 * a - B @ z[6:] / np.sqrt(12.0))
        f[:2] = mean[3] * np.cos(mean[2]), mean[3] * np.sin(mean[2])
        moved = x + STEP * f
        moved[2:] += STEP * a
        return moved

    def jacobian(z: Array) -> Array:
        return np.array([step(z + 1e-30j * e).imag / 1e-30 for e in np.eye(8)]).T

    z = np.array([0.3, -0.4, 0.8, 1.1, 2.0, -3.0, 1.0, 0.5])
    J, S, task = np.zeros((5, 8)), np.zeros((8, 8)), integral.guidance.tasks[1.0]
    assert (task.active, task.curved) == (0b1100, True)
    given = (z[:4], z[4:], STEP, costate)
    forward_pass(kind_of(integral.problem)).expand(integral.setup, given, task.active, True, J, S)
    np.testing.assert_allclose(J[:4], jacobian(z), atol=1e-7)
    np.testing.assert_allclose(J[4], 0.0, atol=1e-9)
    exact = np.array([costate @ (jacobian(z + 1e-5 * e) - jacobian(z - 1e-5 * e)) / 2e-5 for e in np.eye(8)])
    np.testing.assert_allclose(S, exact, atol=1e-4)


# -- next to a wall -----------------------------------------------------------------------------------------------


@cache
def beside_a_pillar() -> PathIntegral:
    """A mass before a pillar of radius 0.3 that stands in its way to the goal."""
    pillar = disc("pillar", 2.0, 1.9, 0.3)
    scene = scene_of([pillar], start=(0.5, 2.0), goal=(4.0, 2.0, 0.3), side=(5.0, 4.0))
    problem = Problem(dynamics=DoubleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
    return path_integral(problem, FreeSpace.of(scene), Sampling(dt=STEP, threads=1))


def test_a_backward_pass_knows_what_a_small_step_gains():
    """Put aside by 1 cm, a guide whose paths bow next to the pillar gains 2 e times what is expected, to 5 %."""
    integral, times = beside_a_pillar(), STEP * np.arange(90)
    up = np.array([[1.0, 0.5]] * 10 + [[0.6, -0.55]] * 22)  # past it on the farther side
    push = Trajectory(controls=up, durations=np.full(32, STEP), path=None, cost=3.2, length=3.6)
    guide = valid(integral, np.array([0.5, 2.0, 0.0, 0.0]), times, (0,), push)
    course, trial = (empty_course(len(times) - 1, 4, integral.guidance.width) for _ in range(2))
    off = np.zeros_like(guide.modes)
    off[3, 1], off[9, 1] = 1.0, -1.0
    course.states[0], course.control[:] = guide.states[0], guide.modes + off
    trial.states[0] = guide.states[0]
    task, kind = integral.guidance.tasks[10.0], kind_of(integral.problem)
    forward, backward = forward_pass(kind).forward, backward_pass(kind)
    steps, _, before = forward(integral.setup, task, times, course, guide.length, 0.0, 4, trial)
    course.states[:], course.control[:] = trial.states, trial.control
    expected = backward(integral.setup, task, times, course, steps, 4, 0.0)
    share = 1e-3
    _, _, after = forward(integral.setup, task, times, course, steps, share, 4, trial)
    assert expected > 1e-3
    assert before - after == pytest.approx(2.0 * share * expected, rel=0.05)


# -- a car between obstacles -------------------------------------------------------------------------------------


# Where, from these curves, descent at the actual noise level creeps along walls for hundreds of rounds.
@pytest.mark.parametrize("state", [(3.678, 1.202, 3.111), (9.944, -1.841, -1.994), (4.758, -4.111, 3.028)])
def test_a_cold_guide_and_one_continued_from_it_at_the_same_state_agree_in_cost(state):
    """Five continuations gain less than three lambda in all, and none of them leaves its class or touches anything."""
    scenario = prepare("clutter", robot="unicycle", given={"seed": 8, "vertices": 400})
    x, integral = np.array(state), path_integral(scenario.problem, scenario.space, scenario.sampling)
    references = scenario.grown_tree().references(x)
    times = integral.grid(min(running_cost(scenario.problem, x, r.trajectory) for r in references))
    made = 0
    for reference in references:
        key = scenario.space.homology.key(reference.winding)
        cold = best(integral.guidance, x, times, key, reference.trajectory)
        if cold is None:  # a curve that takes longer than any path that weighs anything
            continue
        assert cold.valid
        made += 1
        last: DDPGuide | None = cold
        for _ in range(5):
            last = best(integral.guidance, x, times, key, reference.trajectory, last, 0.0)
            assert last is not None
            assert last.valid
        assert abs(last.penalised - cold.penalised) < 3.0 * scenario.problem.temperature
    assert made > 0
