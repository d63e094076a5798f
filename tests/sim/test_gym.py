"""Environments drive the same plant under the same noise as `pirrht run`, and score what drives them alike."""

from __future__ import annotations

import subprocess
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from thoroughly import first

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from pirrht.errors import OptionError  # noqa: E402
from pirrht.systems.unicycle import Unicycle  # noqa: E402
from pirrht.tree.homology_tree import HomologyTree  # noqa: E402
from sim import gym  # noqa: E402
from sim.cli import main  # noqa: E402
from sim.drive import episode  # noqa: E402
from sim.mjcf import scene_names  # noqa: E402
from sim.mjcf.robot import control_limits  # noqa: E402
from sim.scenario import Scenario  # noqa: E402
from sim.sweeps import columns, runs  # noqa: E402
from sim.sweeps.dataset import Dataset  # noqa: E402

INFO = {"outcome", "cost", "time", "min_clearance", "path_length"}


def ahead(x):
    """Through the slit at unit speed, with a pull to its middle."""
    return np.array([1.0, 4.0 * (2.5 - x[1])])


def driven(env, policy, seed=0):
    x, info = env.reset(seed=seed)
    states, rewards, over = [x], [], False
    while not over:
        x, reward, terminated, truncated, info = env.step(policy(x))
        states.append(x)
        rewards.append(reward)
        over = terminated or truncated
    return np.array(states), np.array(rewards), (terminated, truncated), info


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_name_is_enough_to_import_us():
    script = "import gymnasium; print(gymnasium.make('sim.gym:pirrht/Slit-v0').unwrapped.job.scene)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "slit"


# -- the same plant ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 5])
def test_a_seed_gives_the_noise_that_a_run_has(slit: Scenario, seed: int):
    env = gym.Drive("slit", max_time=0.1)
    env.reset(seed=seed)
    noise = []
    for _ in range(10):
        env.step(np.zeros(2))
        noise.append(env._frame.advance.noise)
    again = slit.with_settings(seed=seed).plant_rng()
    np.testing.assert_array_equal(np.vstack(noise), np.sqrt(0.002) * again.standard_normal((50, 2)))


@pytest.mark.slow
def test_our_controller_drives_as_it_does_in_a_run(slit: Scenario, slit_tree: HomologyTree):
    scenario = slit.with_settings(noise=0.3, seed=2, samples=60, threads=1)
    tally = episode.Tally(0.01)
    frames = []
    controller = scenario.controller(slit_tree)
    for frame in episode.run(scenario.plant(), controller, slit.start, scenario.plant_rng(), max_time=30.0):
        tally.add(frame)
        frames.append(frame)
    env = gym.Drive("slit", noise=0.3, period=0.002)
    policy = gym.Following(scenario.controller(slit_tree), period=0.01, step=0.002)
    states, rewards, ends, info = driven(env, policy, seed=2)
    np.testing.assert_array_equal(states[1:], np.vstack([frame.advance.states for frame in frames]))
    one, other = tally.result(), env.result()
    for name in ("time", "cost", "path_length"):
        assert other[name] == pytest.approx(one[name], rel=1e-9)
    for name in ("outcome", "executed_class"):
        assert other[name] == one[name]
    assert info["min_clearance"] == pytest.approx(one["min_clearance"], abs=1e-9)
    assert ends == (True, False)
    assert -rewards.sum() == pytest.approx(one["cost"] + (0.0 if one["outcome"] == "goal" else gym.PENALTY))


def test_a_control_that_is_held_costs_what_the_sde_plant_says():
    env = gym.Drive("slit", plant="sde", noise=1e-6)
    env.reset(seed=0)
    x, reward, terminated, truncated, info = env.step(np.array([1.0, -2.0]))
    assert reward == pytest.approx(-0.01 * (1.0 + 0.5 * 2.0 * 5.0))
    np.testing.assert_allclose(x, [1.01, 2.48], atol=1e-5)
    assert not terminated
    assert not truncated
    assert set(info) == INFO
    assert info["cost"] == pytest.approx(-reward)
    assert info["outcome"] is None


# -- ends --------------------------------------------------------------------------------------------------------


def test_every_episode_begins_with_the_bodies_where_they_set_out():
    env = gym.Drive("crossing", noise=1e-6)
    ends = [driven(env, lambda x: np.array([1.0, 0.0])) for _ in range(2)]
    assert [end[3]["outcome"] for end in ends] == ["collision", "collision"]
    assert ends[0][3]["time"] == ends[1][3]["time"]
    # at a speed of 1 the puck is 0.4 m from the disc's centre, at (3.25, 1.09 + 0.6 t), when t = 1.9...
    t = ends[0][3]["time"]
    assert np.hypot(3.25 - 1 - t, 1.09 + 0.6 * t - 2.5) == pytest.approx(0.4, abs=0.004)


def test_goal_collision_and_time_are_told_apart():
    goal = driven(gym.Drive("slit", noise=0.01), ahead)
    assert goal[2] == (True, False)
    assert goal[3]["outcome"] == "goal"
    assert -goal[1].sum() == pytest.approx(goal[3]["cost"])
    wall = driven(gym.Drive("slit", noise=0.01, penalty=7.0), lambda x: np.array([0.0, 3.0]))
    assert wall[2] == (True, False)
    assert wall[3]["outcome"] == "collision"
    assert -wall[1].sum() == pytest.approx(wall[3]["cost"] + 7.0)
    late = driven(gym.Drive("slit", noise=0.01, max_time=0.05), lambda x: np.zeros(2))
    assert late[2] == (False, True)
    assert late[3]["outcome"] == "timeout"
    assert late[3]["time"] == pytest.approx(0.05)


def test_a_finite_phi_is_the_penalty_of_a_collision():
    _, rewards, _, info = driven(gym.Drive("slit", noise=0.01, phi=31.0), lambda x: np.array([0.0, 3.0]))
    assert -rewards.sum() == pytest.approx(info["cost"] + 31.0)


def test_nothing_moves_before_the_beginning_and_after_the_end():
    env = gym.Drive("slit", max_time=0.01)
    with pytest.raises(OptionError, match="reset"):
        env.step(np.zeros(2))
    env.reset(seed=0)
    env.step(np.zeros(2))
    with pytest.raises(OptionError, match="reset"):
        env.step(np.zeros(2))
    x, info = env.reset(seed=0)
    np.testing.assert_array_equal(x, [1.0, 2.5])
    assert info["cost"] == 0.0


def test_actions_beyond_the_bound_are_clipped():
    free, bound = gym.Drive("slit"), gym.Drive("slit", bound=0.5)
    assert bound.action_space.contains(np.array([0.5, -0.5]))
    one = [driven_step(free, np.array([0.5, -0.5])), driven_step(bound, np.array([3.0, -9.0]))]
    np.testing.assert_array_equal(*one)


def driven_step(env, action):
    env.reset(seed=1)
    return env.step(action)[0]


def test_what_cannot_be_is_refused():
    for options in ({"bound": 0.0}, {"penalty": -1.0}, {"render_mode": "human"}, {"noise": -1.0}, {"plant": "gazebo"}):
        with pytest.raises(OptionError):
            gym.Drive("slit", **options)


# -- scores ------------------------------------------------------------------------------------------------------


def test_scores_are_records_of_a_sweep():
    records = gym.score(ahead, scene="slit", noise=0.02, seeds=range(3), method="steering wheel")
    task = tuple((name, None) for name in ("robot", "radius", "start", "goal", "preset"))
    given = (("plan_seed", 0), ("vertices", 60), ("samples", 10), ("max_time", 0.02))
    job = runs.Job(scene="slit", method="single", noise=0.02, seed=0, task=task, given=given)
    _, planned = runs.survey(runs.Survey(job=job))
    sweeps = runs.drive(job, planned)
    for seed, record in enumerate(records):
        assert record.keys() == sweeps.keys()
        assert {name: type(value) for name, value in record.items() if name in columns.KEY} == {
            name: type(sweeps[name]) if name != "scene_digest" else str for name in columns.KEY
        }
        assert (record["seed"], record["method"], record["outcome"]) == (seed, "steering wheel", "goal")
        assert record["executed_class"] == "0,0"
        assert columns.record_of(columns.row_of(record))["cost"] == record["cost"]
    assert record["scene_digest"] == runs.digest(job)


def test_wrapped_environments_and_policies_made_for_each_seed_are_scored_alike():
    wrapped = gymnasium.wrappers.RescaleAction(gym.Drive("slit", noise=0.1, bound=2.0), -1.0, 1.0)
    seen = []

    def anew(seed):
        seen.append(seed)
        return lambda x: 0.5 * ahead(x)

    one = gym.score(anew, environment=wrapped, seeds=[4, 7], method="m", anew=True)
    other = gym.score(lambda x: np.clip(ahead(x), -2, 2), scene="slit", noise=0.1, seeds=[4, 7], method="m")
    assert seen == [4, 7]
    for a, b in zip(one, other, strict=True):
        assert a["outcome"] == b["outcome"]
        assert a["cost"] == pytest.approx(b["cost"])


# -- scores in a sweep's folder ----------------------------------------------------------------------------------

FAST = {"scene": "slit", "noise": 0.02, "max_time": 0.05}
SWEEP = "sweep slit --noise 0.02 --seeds 0:3 --methods passive --vertices 60 --samples 10 --max-time 0.05 --jobs 1"


@pytest.fixture
def swept(tmp_path):
    assert main([*SWEEP.split(), "-o", str(tmp_path / "sweep")]) == 0
    return tmp_path / "sweep"


@pytest.mark.slow
def test_a_report_shows_the_users_method_beside_ours(swept, capsys):
    before = Dataset(swept).records()
    scored = gym.score(ahead, seeds=range(3), method="mine", into=swept, **FAST)
    assert Dataset(swept).records()[:3] == before
    assert [r["cost"] for r in Dataset(swept).records()[3:]] == [r["cost"] for r in scored]
    assert [r["noisy_path_length"] for r in Dataset(swept).records()[3:]] == [r["noisy_path_length"] for r in scored]
    assert main(["report", str(swept)]) == 0
    told = capsys.readouterr().out
    assert "6 of 6 runs asked for are there" in told
    assert "mine" in told
    assert main([*SWEEP.split(), "-o", str(swept)]) == 0  # it goes on as before


@pytest.mark.slow
def test_a_score_makes_a_folder_that_a_sweep_goes_on_with(tmp_path, capsys):
    gym.score(ahead, seeds=[4, 7], method="mine", into=tmp_path / "new", scene="slit", noise=0.02)
    assert main(["report", str(tmp_path / "new")]) == 0
    assert "2 of 2 runs asked for are there" in capsys.readouterr().out
    Dataset(tmp_path / "new").check({"plan_seed": 0}, {})


@pytest.mark.slow
def test_runs_that_are_there_are_refused_and_replaced_only_on_demand(swept):
    gym.score(ahead, seeds=range(2), method="mine", into=swept, **FAST)
    driven = []

    def other(x):
        driven.append(x)
        return np.array([-0.5, 0.0])

    with pytest.raises(OptionError, match=r"holds 1 of these runs already \(method 'mine', seed 1\).* again=True"):
        gym.score(other, seeds=[1, 2], method="mine", into=swept, **FAST)
    assert not driven  # refused before anything is driven
    scored = gym.score(other, seeds=[1, 2], method="mine", into=swept, again=True, **FAST)
    found = {r["seed"]: r["cost"] for r in Dataset(swept).records() if r["method"] == "mine"}
    assert found[1] == scored[0]["cost"]
    assert found[2] == scored[1]["cost"]
    assert sorted(found) == [0, 1, 2]


@pytest.mark.slow
def test_a_policy_that_fails_loses_no_finished_drive(swept):
    def some(seed):
        return (lambda x: np.full(2, np.nan)) if seed == 2 else ahead

    with pytest.raises(OptionError, match="seed 2"):
        gym.score(some, seeds=range(5), method="mine", anew=True, into=swept, **FAST)
    assert [r["seed"] for r in Dataset(swept).records() if r["method"] == "mine"] == [0, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "what"),
    first(
        [
            ({"max_time": 0.1}, "--max-time 0.05 and these drives are with 0.1"),
            ({"plant": "sde"}, "--plant mujoco and these drives are with sde"),
            ({"phi": 5.0}, "--phi inf and these drives are with 5.0"),
            ({"start": (1.0, 2.0)}, "--start 1.0 2.5 and these drives are with 1.0 2.0"),
            ({"goal": (5.0, 2.5, 0.2)}, "--goal"),
            ({"radius": 0.07}, "--radius"),
            ({"robot": "unicycle"}, "--phi inf and"),
        ]
    ),
)
def test_drives_of_another_task_are_not_mixed_in(swept, changes, what):
    with pytest.raises(OptionError, match="choose another folder") as caught:
        gym.score(ahead, seeds=[0], method="mine", into=swept, **{**FAST, **changes})
    assert what in str(caught.value)


@pytest.mark.parametrize(
    ("action", "what"),
    [
        (np.zeros(3), r"seed 4, step 0: the policy returned the shape \(3,\); expected .* shape \(2,\)"),
        (1.0, r"the policy returned the shape \(\); expected .* shape \(2,\)"),
        ("left", r"the policy returned 'left'; expected"),
        (np.array([1.0, np.nan]), r"seed 4, step 0: the policy returned \[1.0, nan\]; a control must be finite"),
    ],
)
def test_a_policy_that_returns_no_control_is_named_with_seed_and_step(action, what: str):
    with pytest.raises(OptionError, match=what):
        gym.score(lambda x: action, scene="slit", seeds=[4], method="m")


@pytest.mark.parametrize("action", [[np.nan, 0.0], [1.0], 1.0])
def test_an_action_that_is_no_control_is_refused_and_moves_nothing(action):
    env = gym.Drive(**FAST)
    before, _ = env.reset()
    with pytest.raises(OptionError, match="must be 2 finite numbers"):
        env.step(np.array(action))
    np.testing.assert_array_equal(env.step(np.zeros(2))[0].shape, before.shape)
    assert env.result()["steps"] == 1


@pytest.mark.parametrize("seed", [-1, 0.5])
def test_seeds_are_whole_numbers_from_zero_on(seed):
    with pytest.raises(OptionError, match=f"seed is {seed}"):
        gym.score(ahead, scene="slit", seeds=[seed], method="m")


def test_the_ranges_of_the_actuators_bound_the_actions():
    """Speed and turn rate of wheels h apart share a range; the sde plant has no actuators."""
    car = gym.Drive("slit", robot="unicycle")
    np.testing.assert_allclose([car.action_space.low, car.action_space.high], [[-500.0], [500.0]])
    assert gym.Drive("slit", robot="unicycle", bound=2.0).action_space.high == 2.0
    assert gym.Drive("slit", robot="unicycle", plant="sde").action_space.high == np.inf
    wheels = np.array([[10.0, -1.5], [10.0, 1.5]])
    limited = SimpleNamespace(actuator_ctrllimited=np.ones(2), actuator_ctrlrange=np.array([[-20.0, 16.0]] * 2))
    low, high = control_limits(limited, wheels, Unicycle(V=1.0, rho=0.5))
    np.testing.assert_allclose([low, high], [[-2.0], [2.0]])
    for u in (low, high):
        ctrl = wheels @ Unicycle(V=1.0, rho=0.5).twist(np.zeros(3), u / 0.5)
        assert ctrl.max() == pytest.approx(16.0)
