"""The long tests of unit/sim/test_gym.py."""

from __future__ import annotations

import subprocess
import sys
import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from unit.sim.test_gym import driven

from sim import gym
from sim.mjcf import scene_names
from sim.mjcf.robot import control_limits

gymnasium = pytest.importorskip("gymnasium")


@pytest.mark.parametrize("scene", scene_names())
def test_every_scene_is_registered_and_passes_gymnasiums_own_checks(scene: str):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # unbounded spaces are meant
        env = gymnasium.make(gym.name_of(scene)).unwrapped
        check_env(env)
        check_env(gymnasium.make("pirrht/Scene-v0", scene=scene, bound=2.0).unwrapped)


def test_a_hover_is_observed_with_its_velocity_and_pushed_by_forces():
    env = gym.Drive("slit", robot="hover", noise=1e-6, max_time=0.5)
    assert (env.observation_space.shape, env.action_space.shape) == ((4,), (2,))
    states, *_ = driven(env, lambda x: np.array([2.0, 0.0]))
    np.testing.assert_allclose(states[-1], [1.0 + 0.25, 2.5, 1.0, 0.0], atol=2e-3)
    bounded = control_limits(env.scenario.loaded.model, env.scenario.loaded.command, env.scenario.problem.dynamics)
    assert np.all(np.isinf(bounded))


def test_a_name_is_enough_to_import_us():
    script = "import gymnasium; print(gymnasium.make('sim.gym:pirrht/Slit-v0').unwrapped.job.scene)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "slit"
