"""A car that turns and accelerates: a step of MuJoCo is the equation's, whose speed and heading live there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants import QUIET, STEP, driven, plants, scene_file

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.systems.second_order_car import SecondOrderCar, cruising
from sim.drive.executor import Executor
from sim.drive.plant import Analytic
from sim.mjcf import Loaded, load, models_folder
from sim.scenario import prepare

CAR = (models_folder() / "robots" / "car.xml").read_text()


def problem_of(loaded: Loaded, b: float) -> Problem:
    return Problem(dynamics=SecondOrderCar(b=b), scene=loaded.scene, R=np.eye(2), q=cruising, q_min=1.0)


def pair(folder: Path, b: float, *, steps: int = 10, option: str = "") -> tuple[Executor, Analytic]:
    return plants(scene_file(folder, option=option), "car", problem_of, b, steps)


def wander(x: Array, s: float) -> Array:
    """A control that depends on place, heading, speed and time."""
    return np.array([np.cos(3.0 * x[0]) - 0.4 * x[3] + s, np.sin(2.0 * x[1]) + x[2] - s])


@pytest.mark.parametrize("b", [QUIET, 0.3])
@pytest.mark.parametrize("timestep", [0.001, STEP, 0.01])
def test_a_step_of_mujoco_is_that_of_the_equation_along_the_heading_half_way(tmp_path, timestep, b):
    """The heading exactly; speed and place but for terms of dtheta^2 dv and dtheta^4, which shrink faster than dt."""
    option = f'<option timestep="{timestep}" integrator="implicitfast" density="1000" gravity="0 0 -9.81"/>'
    plant, _ = pair(tmp_path, b, option=option)
    start = np.array([1.0, -2.0, 0.7, 1.4])
    plant.reset(start)
    advances = driven(plant, wander, 7, 20)
    states = np.vstack([start, *(a.states for a in advances)])
    u, dw = (np.concatenate([getattr(a, name) for a in advances]) for name in ("controls", "noise"))
    before, after = states[:-1], states[1:]
    turn, gain = (u * timestep + b * dw).T
    np.testing.assert_allclose(after[:, 2], before[:, 2] + turn, rtol=0, atol=1e-9)
    most = np.abs(turn).max()
    np.testing.assert_allclose(
        after[:, 3], before[:, 3] + gain, rtol=0, atol=most**2 * np.abs(gain).max() + 3.0 * most**4 + 1e-9
    )
    half = before[:, 2] + 0.5 * turn
    way = (before[:, 3] + gain)[:, None] * np.column_stack([np.cos(half), np.sin(half)]) * timestep
    off = np.abs(after[:, :2] - before[:, :2] - way).max()
    assert off < timestep * (most**2 + most * np.abs(gain).max()) + 1e-9
    assert np.ptp(states[:, 2]) > 0.05


def test_drift_and_covariance_are_those_of_the_equation_up_to_the_step(tmp_path):
    """Heading, speed and both displacements after 0.2 s at 1 m/s, within 3 errors and the share of a step; seed 11.

    The mean speed tells a robot that white noise on its heading brakes: that would lose b^2 t / 2 = 0.009, 2.6 errors.
    """
    steps, count, b = 100, 1500, 0.3
    plant = pair(tmp_path, b, steps=steps)[0]
    rng, ends = np.random.default_rng(11), []
    for _ in range(count):
        plant.reset(np.array([0.0, 0.0, 0.0, 1.0]))
        ends.append(plant.advance(lambda x, s: np.zeros(2), rng).states[-1])
    t, moves = steps * STEP, np.array(ends)
    law = b * b * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
    for pair_of in ([1, 2], [0, 3]):  # sideways by the heading, ahead by the speed
        measured = np.cov(moves[:, pair_of].T)
        error = np.sqrt((np.outer(np.diag(law), np.diag(law)) + law**2) / count)
        assert np.all(np.abs(measured - law) < 3.0 * error + (2.0 / steps + b * b * t) * law)
    error = np.sqrt(b * b * t / count)
    assert abs(moves[:, 2].mean()) < 3.0 * error
    assert abs(moves[:, 3].mean() - 1.0) < 3.0 * error
    ahead = t - b * b * t**2 / 4.0  # the mean of v cos theta
    assert abs(moves[:, 0].mean() - ahead) < 3.0 * np.sqrt(law[0, 0] / count) + b * b * t * STEP


def test_neither_turns_nor_noise_on_the_heading_slow_it_down(tmp_path):
    """After 4 s of 3 rad/s and noise of 0.5: a share of 3e-4 at most, where projection alone would brake by 0.4."""
    loaded = load(scene_file(tmp_path), robot="car")
    plant = Executor(loaded, problem_of(loaded, QUIET), period=4.0)
    plant.reset(np.array([0.0, 0.0, 0.0, 1.0]))
    shaken = 0.5 * np.random.default_rng(3).standard_normal(2000) / np.sqrt(STEP)
    end = plant.advance(lambda x, s: np.array([3.0 + shaken[round(s / STEP)], 0.0]), np.random.default_rng(0)).states[
        -1
    ]
    assert end[3] == pytest.approx(1.0, abs=3e-4)
    assert end[2] == pytest.approx(12.0 + STEP * shaken.sum(), abs=1e-6)


def test_it_starts_at_rest_and_is_reset_with_heading_and_speed(tmp_path):
    for plant in pair(tmp_path, 0.2):
        np.testing.assert_array_equal(plant.state, np.zeros(4))
        runs = []
        for _ in range(2):
            plant.reset(np.array([1.0, 2.0, 9.5, -0.25]))
            np.testing.assert_allclose(plant.state, [1.0, 2.0, 9.5, -0.25], rtol=0, atol=1e-15)
            runs.append(driven(plant, wander, 1, 1)[0].states)
        np.testing.assert_array_equal(runs[0], runs[1])


def test_it_reverses(tmp_path):
    for plant in pair(tmp_path, QUIET, steps=500):
        plant.reset(np.array([0.0, 0.0, np.pi / 2.0, -1.0]))
        end = plant.advance(lambda x, s: np.zeros(2), np.random.default_rng(0)).states[-1]
        np.testing.assert_allclose(end, [0.0, -1.0, np.pi / 2.0, -1.0], atol=1e-6)


def test_contact_is_a_collision(tmp_path):
    wall = '<geom name="wall" type="box" size="0.05 3 0.3" pos="0.65 0 0.3"/>'  # face at 0.6, the bumper ends at 0.11
    loaded = load(scene_file(tmp_path, world=wall), robot="car")
    plant = Executor(loaded, problem_of(loaded, QUIET), period=1.3)
    plant.reset(np.array([0.0, 0.0, 0.0, 0.5]))
    end = plant.advance(lambda x, s: np.zeros(2), np.random.default_rng(0))
    assert end.outcome is Outcome.COLLISION
    assert end.states[-2, 0] + 0.11 < 0.6 + 1e-9  # an overlap of less is rounding
    assert end.states[-1, 0] + 0.11 >= 0.6 - 1e-9


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("0 0.5 0", "0 0 0", "instead of"),  # cornering costs speed
        ('mass="1"', 'mass="2"', "instead of"),
        ('<joint name="x" ', '<joint name="x" damping="1" ', "instead of"),
        ('<motor name="ahead" site="axis" gear="1', '<motor name="ahead" site="axis" gear="2', "instead of"),
    ],
    ids=["no cornering", "heavier", "damped", "geared"],
)
def test_a_robot_whose_speed_does_not_follow_is_refused_in_one_line(tmp_path, old, new, what):
    assert CAR.count(old) == 1
    path = tmp_path / "machine.xml"
    path.write_text(CAR.replace(old, new))
    with pytest.raises(OptionError) as caught:
        prepare("slit", robot=path)
    said = str(caught.value)
    assert "as" in said
    assert what in said
    assert "let half of the sideways acceleration keep its speed in turns" in said
    assert "\n" not in said


def test_speed_is_no_state_of_what_is_commanded_velocities():
    with pytest.raises(OptionError, match="no actuator is a motor, and the speed is a state of car"):
        prepare("slit", robot="unicycle", system="second_order_car")
    given = {"plant": "sde"}
    assert len(prepare("slit", robot="unicycle", system="second_order_car", given=given).plant().state) == 4


def test_scenes_for_other_robots_leave_a_car_its_noise_and_pace():
    for scene in ("slit", "clutter"):
        s = prepare(scene, robot="car").settings
        assert (s.noise, s.period, s.samples, s.vertices) == (0.1, 0.1, 300, 1000)
