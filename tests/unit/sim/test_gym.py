"""Environments drive the same plant under the same noise as `pirrht run`."""

from types import SimpleNamespace

import numpy as np
import pytest
from plants import ahead

from pirrht import OptionError, Unicycle
from sim import barn, gym
from sim.mjcf.robot import control_limits
from sim.scenario import Scenario, prepare

FIGURES = ("time", "cost", "path_length", "noisy_path_length", "steps", "min_clearance")


def driven(env, policy, seed=0):
    x, info = env.reset(seed=seed)
    states, rewards, over = [x], [], False
    while not over:
        x, reward, terminated, truncated, info = env.step(policy(x))
        states.append(x)
        rewards.append(reward)
        over = terminated or truncated
    return np.array(states), np.array(rewards), (terminated, truncated), info


def test_our_controller_drives_as_it_does_in_a_run(slit: Scenario, slit_tree):
    scenario = slit.with_settings(noise=0.3, seed=2, samples=60, threads=1, period=0.002, max_time=0.2)
    frames = list(scenario.drive(scenario.plant(), scenario.controller(slit_tree)))
    env, controller = gym.Drive("slit", noise=0.3, period=0.002, max_time=0.2), scenario.controller(slit_tree)

    def following(x):
        if env.frame is None:
            controller.begin(x)
        else:
            controller.observe(env.frame.advance.states, env.frame.advance.time)
        return controller.plan(x).at(x, 0.0)

    states, rewards, ends, info = driven(env, following, seed=2)
    np.testing.assert_array_equal(states[1:], [frame.state for frame in frames])
    one, other = frames[-1].metrics.json(), env.result()
    assert [other[name] for name in FIGURES] == pytest.approx([one[name] for name in FIGURES], rel=1e-9)
    assert info["min_clearance"] == pytest.approx(other["min_clearance"], abs=1e-9)
    assert ends == (False, True)
    assert -rewards.sum() == pytest.approx(one["cost"])


def test_a_control_that_is_held_costs_what_the_sde_plant_says():
    env = gym.Drive("slit", plant="sde", noise=1e-6)
    env.reset(seed=0)
    x, reward, terminated, truncated, info = env.step(np.array([1.0, -2.0]))
    assert reward == pytest.approx(-0.01 * (1.0 + 0.5 * 2.0 * 5.0))
    np.testing.assert_allclose(x, [1.01, 2.48], atol=1e-5)
    assert (terminated, truncated, info.pop("outcome")) == (False, False, None)
    assert info.keys() == {"cost", "time", "min_clearance", "path_length"}
    assert info["cost"] == pytest.approx(-reward)


def test_every_episode_begins_with_the_obstacles_where_they_set_out():
    env = gym.Drive("crossing", noise=1e-6)
    one, other = (driven(env, lambda x: np.array([1.0, 0.0]))[3] for _ in range(2))
    assert one["outcome"] == other["outcome"] == "collision"
    assert one["time"] == other["time"]
    # at a speed of 1 the puck is 0.4 m from the disc's centre, at (3.25, 1.09 + 0.6 t), when t = 1.9...
    assert np.hypot(3.25 - 1 - one["time"], 1.09 + 0.6 * one["time"] - 2.5) == pytest.approx(0.4, abs=0.004)


@pytest.mark.parametrize(
    ("options", "policy", "ends", "outcome", "penalty"),
    [
        ({}, ahead, (True, False), "goal", 0.0),
        ({"penalty": 7.0}, lambda x: np.array([0.0, 3.0]), (True, False), "collision", 7.0),
        ({"phi": 31.0}, lambda x: np.array([0.0, 3.0]), (True, False), "collision", 31.0),
        ({"max_time": 0.05}, lambda x: np.zeros(2), (False, True), "timeout", 0.0),
    ],
)
def test_ends_differ_in_flags_and_reward_and_nothing_moves_after_them_until_a_reset(
    options, policy, ends, outcome, penalty
):
    env = gym.Drive("slit", noise=0.01, **options)
    for begin in (lambda: None, lambda: env.reset(seed=0)):
        with pytest.raises(OptionError, match="reset"):
            env.step(np.zeros(2))
        begin()
    _, rewards, ended, info = driven(env, policy)
    assert (ended, info["outcome"]) == (ends, outcome)
    assert -rewards.sum() == pytest.approx(info["cost"] + penalty)
    with pytest.raises(OptionError, match="reset"):
        env.step(np.zeros(2))
    x, info = env.reset(seed=0)
    np.testing.assert_array_equal(x, [1.0, 2.5])
    assert info["cost"] == 0.0


def test_actions_beyond_the_bound_are_clipped():
    free, bound = gym.Drive("slit"), gym.Drive("slit", bound=0.5)
    assert bound.action_space.contains(np.array([0.5, -0.5]))
    for env in (free, bound):
        env.reset(seed=1)
    np.testing.assert_array_equal(free.step(np.array([0.5, -0.5]))[0], bound.step(np.array([3.0, -9.0]))[0])


def test_an_environment_has_the_margin_that_keeps_its_risk():
    margin = gym.Drive("slit", noise=0.2, risk=0.01).scenario.margin
    assert margin == prepare("slit", noise=0.2, risk=0.01).margin > 0.005


def test_options_of_a_run_are_taken_and_reach_controllers_made_of_the_scenario():
    env = gym.Drive("slit", limit=0.8, vertices=50, samples=20, preset="fast", max_time=0.05)
    s = env.scenario.settings
    assert (s.limit, s.vertices, s.samples, s.classes) == (0.8, 50, 20, 6)
    made = []

    def controller(seed):
        own = env.scenario.with_settings(seed=seed)
        made.append((seed, own.controller(own.grown_tree())))
        return lambda x: made[-1][1].step(x, s.period)

    rows = gym.score(controller, environment=env, seeds=[3, 4], method="ours", anew=True)
    assert [(seed, one.path_integral.sampling.samples) for seed, one in made] == [(3, 20), (4, 20)]
    assert [row["outcome"] for row in rows] == ["timeout"] * 2
    with pytest.raises(OptionError, match=r"method: no argument of an environment; those .* but method, plan_seed"):
        gym.Drive("slit", method="single")


def test_what_cannot_be_is_refused():
    for options in ({"bound": 0.0}, {"penalty": -1.0}, {"render_mode": "human"}, {"noise": -1.0}, {"plant": "gazebo"}):
        with pytest.raises(OptionError):
            gym.Drive("slit", **options)
    with pytest.raises(OptionError, match=r"niose: no argument of an environment; those are bound, .*noise"):
        gym.score(ahead, seeds=[0], method="m", niose=0.1)
    with pytest.raises(OptionError, match="noise: no argument next to an environment"):
        gym.score(ahead, seeds=[0], method="m", environment=gym.Drive("slit"), noise=0.3)
    for seeds in ([], (), range(0), 5, None):
        with pytest.raises(OptionError, match=r"^seeds is .*; give at least one whole number, as in range\(10\)$"):
            gym.score(ahead, scene="slit", seeds=seeds, method="m")
    for seed in (-1, 0.5):
        with pytest.raises(OptionError, match=f"seed is {seed}"):
            gym.score(ahead, scene="slit", seeds=[seed], method="m")


@pytest.mark.parametrize("action", [np.zeros(3), 1.0, "left", np.array([1.0, np.nan])])
def test_what_is_no_control_is_named_and_moves_nothing(action):
    with pytest.raises(OptionError, match=r"^seed 4, step 0: the policy returned .*; a control is finite .* \(2,\)$"):
        gym.score(lambda x: action, scene="slit", seeds=[4], method="m")
    env = gym.Drive("slit")
    env.reset()
    with pytest.raises(OptionError, match="a control is finite"):
        env.step(action)
    env.step(np.zeros(2))
    assert env.result()["steps"] == 1


def test_the_ranges_of_the_actuators_bound_the_actions():
    """Speed and turn rate of wheels h apart share a range; the sde plant has no actuators."""
    car = gym.Drive("slit", robot="unicycle")
    np.testing.assert_allclose([car.action_space.low, car.action_space.high], [[-500.0], [500.0]])
    assert gym.Drive("slit", robot="unicycle", bound=2.0).action_space.high == 2.0
    assert gym.Drive("slit", robot="unicycle", plant="sde").action_space.high == np.inf
    wheels = np.array([[10.0, -1.5], [10.0, 1.5]])
    limited = SimpleNamespace(
        actuator_ctrllimited=np.ones(2, bool), actuator_ctrlrange=np.array([[-20.0, 16.0]] * 2),
        actuator_actlimited=np.zeros(2, bool), actuator_actrange=np.zeros((2, 2)), actuator_dyntype=np.zeros(2),
    )  # fmt: skip
    low, high = control_limits(limited, wheels, Unicycle(V=1.0, rho=0.5))
    np.testing.assert_allclose([low, high], [[-2.0], [2.0]])
    for u in (low, high):
        assert (wheels @ Unicycle(V=1.0, rho=0.5).twist(np.zeros(3), u / 0.5)).max() == pytest.approx(16.0)


def test_a_jackal_in_barn_sees_ranges_its_goal_and_its_speed_and_its_actions_are_bounded():
    env = gym.Barn()
    np.testing.assert_allclose(env.action_space.high, [2.0, 4.0], rtol=1e-3)
    np.testing.assert_allclose(env.action_space.low, [-2.0, -4.0], rtol=1e-3)
    seen, info = env.reset(seed=1, options={"world": 3})
    assert env.observation_space.contains(seen)
    np.testing.assert_allclose(seen["goal"], [10.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(seen["pose"], barn.START)
    assert seen["ranges"][[120, 599]] == pytest.approx([2.14, 2.14], abs=0.05)  # walls to the right and to the left
    assert (info["world"], info["score"]) == ("3", 0.0)
    for _ in range(5):
        seen, reward, *ends, info = env.step(np.array([1.0, 0.0]))
    assert 0.7 < seen["speed"][0] < 1.3
    assert seen["goal"][0] == pytest.approx(10.0 - 0.4, abs=0.1)
    assert (reward, ends, info["score"]) == (0.0, [False, False], 0.0)
    again = gym.Barn({"some": barn.grown(3)})
    np.testing.assert_array_equal(
        again.reset(seed=1)[0]["ranges"], env.reset(seed=1, options={"world": "3"})[0]["ranges"]
    )


@pytest.mark.slow
@pytest.mark.parametrize(("turns", "outcome", "points"), [(0.0, "goal", 0.5), (1.0, "collision", 0.0)])
def test_the_rewards_of_barn_add_up_to_its_score(turns: float, outcome: str, points: float):
    env = gym.Barn([[]] if turns == 0.0 else [[[-2.25, 3.8]]], lengths={"0": 11.0})
    _, rewards, _, info = driven(env, lambda x: np.array([1.5, 2.0 * x["goal"][1] * (1.0 - turns)]))
    assert (info["outcome"], info["score"], sum(rewards)) == (outcome, points, points)
    assert env.result()["score"] == points
    assert env.best == pytest.approx(5.5)


def test_worlds_of_barn_that_cannot_be_are_refused():
    for options, words in (
        ({"robot": "puck"}, "robot: no argument of an environment whose worlds have their own"),
        ({"worlds": []}, "there is no world"), ({"worlds": [[1.0, 2.0, 3.0]]}, r"world '0': .*centres are"),
    ):  # fmt: skip
        with pytest.raises(OptionError, match=words):
            gym.Barn(**options)
    with pytest.raises(OptionError, match="grown worlds have numbers"):
        gym.Barn().reset(options={"world": "first"})
    with pytest.raises(OptionError, match=r"there is no world 'b'; those are .*a"):
        gym.Barn({"a": []}).reset(options={"world": "b"})


@pytest.mark.parametrize("method", ["pi-rrht", "pursuit", "mppi"])
def test_our_methods_are_policies_of_environments(method: str):
    env = gym.Drive("slit", noise=0.1, vertices=50, samples=20, max_time=0.05)
    (row,) = gym.score(gym.method_of(env, method=method), environment=env, seeds=[3], method=method)
    assert row["outcome"] == "timeout"
    assert row["path_length"] > 0.02
    assert row["fallbacks"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("method", ["pi-rrht", "pursuit", "mppi"])
def test_our_methods_cross_a_world_of_barn_without_a_map(method: str):
    env = gym.Barn()
    act = gym.method_of(env, method=method)
    seen, _ = env.reset(seed=0, options={"world": 1})
    over = False
    while not over:
        seen, reward, *ends, info = env.step(act(seen))
        over = any(ends)
    assert info["outcome"] == "goal"
    assert reward > 0.4
