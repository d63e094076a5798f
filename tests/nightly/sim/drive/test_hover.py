"""A mass pushed by forces: a step of MuJoCo is the semi-implicit Euler step of its equation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants import QUIET, STEP, driven, plants, scene_file

from pirrht.arrays import Array
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.systems.double_integrator import DoubleIntegrator
from sim.drive.executor import Executor
from sim.drive.plant import Analytic
from sim.mjcf import Loaded, load


def problem_of(loaded: Loaded, b: float) -> Problem:
    return Problem(dynamics=DoubleIntegrator(b=b), scene=loaded.scene, R=2.0 * np.eye(2), q=1.0)


def pair(folder: Path, b: float, *, steps: int = 10, option: str = "", **scene) -> tuple[Executor, Analytic]:
    return plants(scene_file(folder, option=option, **scene), "hover", problem_of, b, steps)


def wander(x: Array, s: float) -> Array:
    """A control that depends on place, velocity and time."""
    return np.array([np.cos(3.0 * x[0]) - 0.4 * x[2] + s, np.sin(2.0 * x[1]) + x[3] - s])


@pytest.mark.parametrize("b", [QUIET, 0.3])
@pytest.mark.parametrize("timestep", [0.001, STEP, 0.01])
def test_a_step_of_mujoco_is_the_semi_implicit_euler_step_of_the_equation(tmp_path, timestep, b):
    option = f'<option timestep="{timestep}" integrator="implicitfast" density="1000" gravity="0 0 -9.81"/>'
    plant, _ = pair(tmp_path, b, option=option)
    start = np.array([1.0, -2.0, 0.7, -0.4])
    plant.reset(start)
    advances = driven(plant, wander, 7, 20)
    states = np.vstack([start, *(a.states for a in advances)])
    u, dw = (np.concatenate([getattr(a, name) for a in advances]) for name in ("controls", "noise"))
    before, after = states[:-1], states[1:]
    np.testing.assert_allclose(after[:, 2:], before[:, 2:] + (u + b * dw / timestep) * timestep, rtol=0, atol=1e-9)
    np.testing.assert_allclose(after[:, :2], before[:, :2] + after[:, 2:] * timestep, rtol=0, atol=1e-9)
    assert np.ptp(states[:, 2]) > 0.05


def test_mujoco_and_the_equation_differ_by_a_step_of_the_velocity_gained(tmp_path):
    """Same noise, same forces: equal velocities; where the equation takes v of a step's start, MuJoCo has its end's."""
    ends, start = [], np.array([0.0, 0.0, 1.0, -0.5])
    for plant in pair(tmp_path, 0.3):
        plant.reset(start)
        ends.append(np.concatenate([a.states for a in driven(plant, lambda x, s: np.array([np.cos(s), 2.0]), 3, 30)]))
    mujoco, sde = ends
    np.testing.assert_allclose(mujoco[:, 2:], sde[:, 2:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(mujoco[:, :2] - sde[:, :2], STEP * (sde[:, 2:] - start[2:]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("which", [0, 1], ids=["mujoco", "sde"])
def test_velocity_and_place_spread_as_integrated_white_noise_does(tmp_path, which):
    """Within 3 standard errors of a Gaussian sample covariance, plus the 2 / steps that discrete time costs."""
    steps, count, b = 100, 800, 0.3
    plant = pair(tmp_path, b, steps=steps)[which]
    states = np.vstack([plant.state, *(a.states[-1] for a in driven(plant, lambda x, s: np.zeros(2), 11, count))])
    t = steps * STEP
    p = np.diff(states[:, :2], axis=0) - states[:-1, 2:] * t  # what the velocity of the start does not explain
    moves = np.hstack([p, np.diff(states[:, 2:], axis=0)])
    law = b * b * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
    expected = np.kron(law, np.eye(2))  # x, y, vx, vy
    measured = moves.T @ moves / count
    error = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / count)
    assert np.all(np.abs(measured - expected) < 3.0 * error + 2.0 / steps * expected)
    mean_error = np.sqrt(np.diag(expected) / count)
    assert np.all(np.abs(moves.mean(axis=0)) < 3.0 * mean_error)


def test_without_force_it_glides_on(tmp_path):
    for plant in pair(tmp_path, QUIET):
        plant.reset(np.array([3.0, 4.0, -1.0, 2.0]))
        end = driven(plant, lambda x, s: np.zeros(2), 0, 50)[-1].states[-1]
        np.testing.assert_allclose(end, [2.0, 6.0, -1.0, 2.0], atol=1e-6)


def test_it_starts_at_rest_and_is_reset_with_its_velocity(tmp_path):
    for plant in pair(tmp_path, 0.2):
        np.testing.assert_array_equal(plant.state, np.zeros(4))
        runs = []
        for _ in range(2):
            plant.reset(np.array([1.0, 2.0, 0.5, -0.25]))
            np.testing.assert_array_equal(plant.state, [1.0, 2.0, 0.5, -0.25])
            runs.append(driven(plant, wander, 1, 1)[0].states)
        np.testing.assert_array_equal(runs[0], runs[1])


WALL = '<geom name="wall" type="box" size="0.05 3 0.3" pos="0.65 0 0.3"/>'  # face at 0.6


@pytest.mark.parametrize("speed", [0.5, 2.0, 90.0])
def test_contact_is_a_collision(tmp_path, speed):
    loaded = load(scene_file(tmp_path, world=WALL), robot="hover")
    plant = Executor(loaded, problem_of(loaded, QUIET), period=1.3)
    plant.reset(np.array([0.0, 0.0, speed, 0.0]))
    end = plant.advance(lambda x, s: np.zeros(2), np.random.default_rng(0))
    assert end.outcome is Outcome.COLLISION
    before = end.states[-2, 0] if len(end.states) > 1 else 0.0
    assert before <= 0.51 + 1e-9 < end.states[-1, 0] + 2e-9  # its bumper ends 9 cm ahead


def test_a_brake_in_time_is_none(tmp_path):
    loaded = load(scene_file(tmp_path, world=WALL), robot="hover")
    plant = Executor(loaded, problem_of(loaded, QUIET), period=2.0)
    plant.reset(np.array([0.0, 0.0, 0.9, 0.0]))
    end = plant.advance(lambda x, s: np.array([-0.9, 0.0]), np.random.default_rng(0))  # 0.45 m to a stop
    assert end.outcome is None
    assert end.states[:, 0].max() == pytest.approx(0.45, abs=2e-3)


def test_the_goal_is_entered_at_any_velocity(tmp_path):
    loaded = load(scene_file(tmp_path, goal="1 0 0"), robot="hover")
    plant = Executor(loaded, problem_of(loaded, QUIET), period=1.0)
    plant.reset(np.array([0.0, 0.0, 2.0, 0.0]))
    end = plant.advance(lambda x, s: np.array([1.0, 0.0]), np.random.default_rng(0))
    assert end.outcome is Outcome.GOAL
    assert 2.0 * end.time + 0.5 * end.time**2 == pytest.approx(0.9, abs=3.0 * STEP)
