"""Guides of any system: their gains are Riccati's where all is linear, derivatives are exact, and weights are honest.

A mass (`DoubleIntegrator`) is the linear case, a car that accelerates the other one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from guides import best

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.rollouts.cpu import kind_of
from pirrht.steering.double_integrator import MassSteering
from pirrht.steering.motion import Trajectory, running_cost
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.second_order_car import SecondOrderCar
from sim.mjcf import load

STEP = 0.1
START, BELOW, ABOVE = (np.array(x) for x in ((1.0, 2.5, 0.0, 0.0), (0.5, 0.5, 0.0, 0.0), (1.0, 3.5, 0.5, 0.8)))


def in_the_open(dynamics: Dynamics) -> PathIntegral:
    """A sampler in a wide empty room."""
    scene = Scene(
        name="open", lower=np.array([-20.0, -20.0]), upper=np.array([20.0, 20.0]), obstacles=(),
        goal=Goal(center=np.array([3.0, 1.0]), radius=0.4), start=np.zeros(3), robot_radius=0.15,
    )  # fmt: skip
    R = 0.02 * np.linalg.inv(dynamics.B_c(np.zeros(4)) @ dynamics.B_c(np.zeros(4)).T)
    return path_integral(Problem(dynamics=dynamics, scene=scene, R=R), FreeSpace.of(scene), Sampling(dt=STEP))


@cache
def slit() -> tuple[Problem, FreeSpace, HomologyTree]:
    """A mass in `slit`."""
    problem = Problem(dynamics=DoubleIntegrator(b=0.1), scene=load("slit", robot="puck").scene, R=2 * np.eye(2))
    space = FreeSpace.of(problem.scene)
    tree = HomologyTree(space, MassSteering.of(problem), limit=0.6, rng=np.random.default_rng(0))
    tree.grow(1000)
    return problem, space, tree


def guidance_of(integral: PathIntegral) -> DDPGuidance:
    assert isinstance(integral.guidance, DDPGuidance)
    return integral.guidance


def around(x: Array) -> tuple[PathIntegral, Array, Reference, DDPGuide]:
    """A sampler in `slit`, its grid, the cheapest reference from x (4,) and its guide."""
    problem, space, tree = slit()
    reference = tree.references(x)[0]
    integral = path_integral(problem, space, Sampling(dt=STEP, draws="independent", threads=1))
    times = integral.grid(running_cost(problem, x, reference.trajectory))
    key = space.homology.key(reference.winding)
    guide = best(guidance_of(integral), x, times, key, reference.trajectory)
    assert guide is not None
    assert guide.valid
    return integral, times, reference, guide


def drawn(
    integral: PathIntegral, x: Array, times: Array, leads: tuple[ProposalControl, ...], count: int, seed: int
) -> Array:
    """Log weights of samples around leads, `count` each."""
    proposals = tuple(Proposal(lead=lead, count=count) for lead in leads)
    return integral.rollout(Batch(state=x, times=times, proposals=proposals), seed).log_weight


def mean_and_error(log_weight: Array) -> tuple[float, float, float]:
    """log psi, its standard error and the share of effective samples."""
    top = log_weight.max()
    w = np.exp(log_weight - top)
    return (
        float(top + np.log(w.mean())),
        float(w.std() / w.mean() / np.sqrt(len(w))),
        float(w.mean() ** 2 / (w**2).mean()),
    )


def test_in_the_open_a_masss_gains_are_those_of_riccatis_recursion():
    """From the Hessian of the time to the goal's rim back, under the exact step of a mass that sways."""
    integral = in_the_open(DoubleIntegrator(b=0.1))
    lam, b, T = integral.problem.temperature, 0.1, 40
    times = STEP * np.arange(T + 1)
    u = np.tile([1.0, 0.3], (20, 1))
    push = Trajectory(controls=u, durations=np.full(20, STEP), path=None, cost=2.0, length=3.0)
    guide = best(guidance_of(integral), np.zeros(4), times, 0, push)
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
    J, S = np.zeros((5, 8)), np.zeros((8, 8))
    forward_pass(kind_of(integral.problem)).expand(
        integral.setup, (z[:4], z[4:], STEP, costate), guidance_of(integral).tasks[1.0].active, True, J, S
    )
    np.testing.assert_allclose(J[:4], jacobian(z), atol=1e-7)
    np.testing.assert_allclose(J[4], 0.0, atol=1e-9)
    exact = np.array([costate @ (jacobian(z + 1e-5 * e) - jacobian(z - 1e-5 * e)) / 2e-5 for e in np.eye(8)])
    np.testing.assert_allclose(S, exact, atol=1e-4)
    assert guidance_of(integral).tasks[1.0].active == 0b1100
    assert guidance_of(integral).tasks[1.0].curved


@pytest.mark.parametrize("x", [START, BELOW, ABOVE], ids=["start", "below", "above"])
def test_psi_of_a_mass_does_not_depend_on_the_guide(x):
    """Tape, guide, guide put aside with weaker gains, first and second together; within 3 errors. Seeds 1 to 4."""
    integral, times, reference, guide = around(x)
    aside = replace(guide, states=guide.states + np.array([0.02, -0.02, 0.0, 0.03]), gains=0.7 * guide.gains)
    tape = Tape(times, reference.trajectory.tape(times))
    found = []
    for seed, leads in enumerate(
        [(tape,), (LinearFeedback(guide),), (LinearFeedback(aside),), (tape, LinearFeedback(guide))], start=1
    ):
        found.append(mean_and_error(drawn(integral, x, times, leads, 20_000, seed)))
    assert all(error < 0.1 for _, error, _ in found)
    assert found[1][1] < 0.01
    for i, (one, its, _) in enumerate(found):
        for other, error, _ in found[:i]:
            assert abs(one - other) < 3.0 * np.hypot(its, error)


def test_a_last_guide_is_where_the_next_one_starts():
    integral, times, reference, guide = around(START)
    elapsed = 0.25
    x = np.array([np.interp(elapsed, times, column) for column in guide.states.T])
    key = integral.space.homology.key(reference.winding)
    later = best(guidance_of(integral), x, times, key, reference.trajectory, guide, elapsed)
    assert later is not None
    assert later.valid
    assert later.cost == pytest.approx(
        guide.cost - elapsed * (1.0 + (guide.tape[:2] ** 2).sum(axis=1).mean()), abs=0.01
    )
    np.testing.assert_allclose(later.tape[:20], guide.tape[2:22], atol=0.1)
    rest = guide.rest(elapsed, integral.space.scene.goal.center)
    assert rest is not None
    np.testing.assert_allclose(rest.points[-1], integral.space.scene.goal.center)
    np.testing.assert_allclose(rest.tape(times)[:20], guide.tape[2:22])
