"""The Jackal: wheels with inertia carry it as commanded, within its limits, and its box is what it plans as."""

import numpy as np
import pytest
from plants import QUIET, WALL, hold, problem_of, scene_file

from pirrht import Outcome, Rover
from sim.drive.executor import Executor
from sim.mjcf import load


def driven(folder, *command: float, time: float = 2.0, b: float = QUIET, world: str = ""):
    """Forward speed and turn rate (k, 2), and the whole period, from rest under one command."""
    loaded = load(scene_file(folder, world=world), robot="jackal")
    plant = Executor(loaded, problem_of(loaded, Rover(b=b), R=np.diag([2.0, 0.5])), period=time)
    advance = plant.advance(hold(*command), np.random.default_rng(0))
    states = np.vstack([np.zeros(3), advance.states])
    steps = np.diff(states, axis=0) / plant.physics_step
    ahead = steps[:, 0] * np.cos(states[:-1, 2]) + steps[:, 1] * np.sin(states[:-1, 2])
    return np.column_stack([ahead, steps[:, 2]]), advance


def test_it_plans_as_the_box_with_which_it_collides(tmp_path):
    loaded = load(scene_file(tmp_path), robot="jackal")
    model = loaded.model
    corners = np.abs(loaded.scene.footprint.hull)
    np.testing.assert_allclose(corners, np.tile([0.254, 0.216], (4, 1)))
    solid = np.flatnonzero(loaded.robot_geoms & ((model.geom_contype | model.geom_conaffinity) > 0))
    assert [model.geom(i).name for i in solid] == ["robot/bumper"]
    _, advance = driven(tmp_path, 1.0, 0.0, world=WALL)
    assert advance.outcome is Outcome.COLLISION
    assert advance.states[-1, 0] == pytest.approx(0.6 - 0.254, abs=0.005)


@pytest.mark.parametrize(
    ("asked", "made"),
    [((1.5, 0.0), (1.5, 0.0)), ((-3.0, 0.0), (-2.0, 0.0)), ((0.0, 9.0), (0.0, 4.0)), ((3.0, -9.0), (2.0, -4.0))],
)  # fmt: skip
def test_speed_turn_rate_and_acceleration_have_limits(tmp_path, asked, made):
    speeds, _ = driven(tmp_path, *asked)
    np.testing.assert_allclose(speeds[-100:].mean(axis=0), made, atol=0.02)
    gained = np.abs(speeds[50:] - speeds[:-50]) / 0.1  # in 0.1 s
    assert np.all(gained.max(axis=0) < [5.0, 32.0])
    assert gained[:, 0].max() > 4.5 * (made[0] != 0.0)


def test_it_follows_a_circle_and_lags_behind_the_equation(tmp_path):
    speeds, advance = driven(tmp_path, 1.2, 1.5, time=6.0)
    np.testing.assert_allclose(speeds[1000:].mean(axis=0), (1.2, 1.5), rtol=2e-3)
    x, y = advance.states[1000:, :2].T
    (a, b, c), *_ = np.linalg.lstsq(np.column_stack([x, y, np.ones_like(x)]), x**2 + y**2)
    assert np.sqrt(c + 0.25 * (a**2 + b**2)) == pytest.approx(1.2 / 1.5, abs=2e-3)
    assert 0.2 < -advance.off[0][2] < 0.5  # while both wheels give all they have to the speed, none is left to turn


def test_noise_of_every_physics_step_leaves_the_mean_speed_and_becomes_slow(tmp_path):
    speeds, advance = driven(tmp_path, 1.5, 0.0, time=4.0, b=0.05)
    due = 1.5 * 3.0 + 0.05 * advance.noise[500:, 0].sum()
    assert 0.002 * speeds[500:, 0].sum() == pytest.approx(due, abs=0.08)
    assert 0.03 < speeds[500:, 0].std() < 0.3  # that of the commands is 1.1 m/s
