"""A rover on two driven wheels: a step of MuJoCo is the Euler-Maruyama step of its equation, and what follows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants import QUIET, STEP, driven, plants, scene_file

from pirrht.arrays import Array
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.systems.rover import Rover
from sim.drive.executor import Executor
from sim.drive.metrics import Length, spread
from sim.drive.plant import Analytic
from sim.mjcf import Loaded, load
from sim.mjcf.robot import control_limits
from sim.scenario import prepare

WALL = '<geom name="wall" type="box" size="0.05 3 0.3" pos="0.65 0 0.3"/>'  # face at 0.6
R = np.diag([2.0, 0.5])


def problem_of(loaded: Loaded, b: float) -> Problem:
    return Problem(dynamics=Rover(b=b), scene=loaded.scene, R=R)


def pair(folder: Path, b: float, *, steps: int = 10, option: str = "") -> tuple[Executor, Analytic]:
    return plants(scene_file(folder, option=option), "rover", problem_of, b, steps)


def wander(x: Array, s: float) -> Array:
    """A control that depends on place, heading and time."""
    return np.array([1.0 + np.cos(3.0 * x[0]) + s, 2.0 * np.sin(2.0 * x[1] + x[2])])


@pytest.mark.parametrize("b", [QUIET, 0.3])
@pytest.mark.parametrize("timestep", [0.001, STEP, 0.01])
def test_a_step_of_mujoco_is_the_euler_maruyama_step_of_the_equation(tmp_path, timestep, b):
    option = f'<option timestep="{timestep}" integrator="implicitfast" density="1000" gravity="0 0 -9.81"/>'
    plant, _ = pair(tmp_path, b, option=option)
    start = np.array([1.0, -2.0, 0.7])
    plant.reset(start)
    advances = driven(plant, wander, 7, 20)
    states = np.vstack([start, *(a.states for a in advances)])
    u, dw = (np.concatenate([getattr(a, name) for a in advances]) for name in ("controls", "noise"))
    way, turn = (u * timestep + dw * (b, 2.0 * b)).T
    heading = states[:-1, 2]
    moved = np.column_stack([way * np.cos(heading), way * np.sin(heading), turn])
    np.testing.assert_allclose(np.diff(states, axis=0), moved, rtol=0, atol=1e-8)
    assert np.ptp(states[:, 2]) > 0.05


def test_mujoco_and_the_equation_stay_together_under_the_same_noise(tmp_path):
    """A step goes along its start's heading in MuJoCo and along its middle's in the equation; over 2 s it is 1 cm."""
    ends = []
    for plant in pair(tmp_path, 0.1):
        plant.reset(np.array([0.0, 0.0, 0.4]))
        ends.append(np.concatenate([a.states for a in driven(plant, lambda x, s: np.array([1.0, 0.5]), 3, 100)]))
    mujoco, sde = ends
    np.testing.assert_allclose(mujoco[:, 2], sde[:, 2], rtol=0, atol=1e-8)
    assert np.hypot(*(mujoco - sde)[:, :2].T).max() < 0.01
    assert np.hypot(*sde[-1, :2]) > 1.0


@pytest.mark.parametrize("which", [0, 1], ids=["mujoco", "sde"])
def test_one_step_drifts_and_spreads_as_the_equation_says(tmp_path, which):
    """Mean G u h and covariance G s s' G' h of 3000 steps from one state, within 3.5 standard errors."""
    plant, x, u, b, count = (
        pair(tmp_path, 0.1, steps=1)[which],
        np.array([1.0, 2.0, 0.6]),
        np.array([0.8, -0.5]),
        0.1,
        3000,
    )
    rng, moves = np.random.default_rng(5), []
    for _ in range(count):
        plant.reset(x)
        moves.append(plant.advance(lambda x, s: u, rng).states[0] - x)
    G = np.array([[np.cos(0.6), 0.0], [np.sin(0.6), 0.0], [0.0, 1.0]])
    law = G @ np.diag([b**2, 4.0 * b**2]) @ G.T * STEP
    error = np.sqrt(np.diag(law) / count)
    assert np.all(np.abs(np.mean(moves, axis=0) - G @ u * STEP) < 3.5 * error)
    measured = np.cov(np.array(moves).T)
    off = np.sqrt((np.outer(np.diag(law), np.diag(law)) + law**2) / count)
    assert np.all(np.abs(measured - law) < 3.5 * off)


@pytest.mark.parametrize("speed", [0.5, 2.0, 90.0])
def test_contact_is_a_collision_even_where_noise_would_leap_over_the_wall(tmp_path, speed):
    loaded = load(scene_file(tmp_path, world=WALL), robot="rover")
    plant = Executor(loaded, problem_of(loaded, QUIET), period=1.3)
    end = plant.advance(lambda x, s: np.array([speed, 0.0]), np.random.default_rng(0))
    assert end.outcome is Outcome.COLLISION
    before = end.states[-2, 0] if len(end.states) > 1 else 0.0
    assert before <= 0.51 + 1e-9 < end.states[-1, 0] + 2e-9  # its bumper ends 9 cm ahead


def test_it_waits_where_it_is_told_to(tmp_path):
    for plant in pair(tmp_path, QUIET):
        plant.reset(np.array([3.0, 4.0, 1.0]))
        np.testing.assert_allclose(driven(plant, lambda x, s: np.zeros(2), 0, 50)[-1].states[-1], [3, 4, 1], atol=1e-9)


def test_the_wheels_bound_what_may_be_commanded_where_they_are_bounded():
    loaded = load("slit", robot="rover")
    assert np.all(np.isinf(control_limits(loaded.model, loaded.command, Rover())))


def test_scenes_for_others_leave_a_rover_its_pace_and_tell_it_their_noise():
    for scene, b in (("slit", 0.1), ("clutter", 0.03)):
        scenario = prepare(scene, robot="rover")
        s = scenario.settings
        assert (s.noise, s.period, s.samples, s.vertices) == (b, 0.05, 300, 2000)
        np.testing.assert_allclose(scenario.problem.dynamics.input_noise, np.diag([b, 2.0 * b]))
        assert scenario.problem.temperature == pytest.approx(2.0 * b**2)


def test_its_path_is_as_long_as_its_way_whatever_the_noise_along_it(tmp_path):
    loaded = load(scene_file(tmp_path), robot="rover")
    rng, totals, rough = np.random.default_rng(1), [], []
    problem = problem_of(loaded, 0.1)
    assert spread(problem, np.zeros(3)) == pytest.approx(0.0, abs=1e-18)
    for _ in range(40):
        x = np.zeros((3001, 3))
        x[1:, 0] = np.cumsum(STEP + 0.1 * np.sqrt(STEP) * rng.standard_normal(3000))
        length = Length(problem, x[0])
        length.add(x[1:], STEP, float(np.abs(np.diff(x[:, 0])).sum()))
        totals.append(length.total / x[-1, 0])
        rough.append(length.noisy / x[-1, 0])
    assert np.mean(totals) == pytest.approx(1.0, rel=0.01)
    assert np.mean(rough) > 1.5
