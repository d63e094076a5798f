"""Samples among bodies that move against closed forms, the grid, standing worlds, and against each other."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from batches import led
from discs import block, disc
from moving import SCENES, hall, moved, walled
from thoroughly import thorough
from trees import point

from pirrht import (
    Desirability,
    FreeSpace,
    Outcome,
    PathIntegral,
    Problem,
    Sampling,
    Scene,
    SingleIntegrator,
    path_integral,
)
from pirrht.proposals.proposal import Batch, Proposal, Tape


def sampler(
    scene: Scene, b: float = 0.3, phi: float = np.inf, grain: float | None = None, **settings: object
) -> PathIntegral:
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2), phi=phi)
    return path_integral(problem, FreeSpace.of(scene, grain), Sampling(threads=1, **settings))


def held(integral: PathIntegral, x: np.ndarray, control: np.ndarray, count: int, time: float = 0.0, T: int = 60):
    """Samples around one control that is held."""
    times = integral.steps(T * integral.sampling.dt)
    return led(integral, x, times, Tape(times, np.tile(control, (len(times) - 1, 1))), count=count, seed=3, time=time)


@pytest.mark.parametrize("speed", [0.4, -0.4, 1.0])
@pytest.mark.parametrize("control", [(0.0, 0.0), (-0.4, 0.1)])
def test_before_a_wall_at_constant_speed_samples_pay_what_girsanov_says(speed, control):
    scene, rate_of = walled(speed)
    integral = sampler(scene, phi=0.0)
    rate = rate_of(0.3, integral.temperature)
    for z in (0.05, 0.15, 0.3):
        found = integral.estimate(held(integral, np.array([2.8 + z, 1.5]), np.array(control), 8000, time=0.4, T=15))
        assert abs(-found.log_psi - rate * z) < 3.0 * found.value_error / integral.temperature + 0.005


@pytest.mark.parametrize("phi", [np.inf, 0.7])
def test_a_mover_that_stands_still_is_an_obstacle(phi):
    solid = disc("disc", 2.2, 1.7, 0.3)
    still = moved("disc", [(0.0, 2.2, 1.7, 0.4), (0.5, 2.2, 1.7, 0.4)], disc("disc", 0.0, 0.0, 0.3))
    x, values = np.array([1.6, 1.5]), []
    for scene in (hall("moves", [still], goal=(2.8, 1.5)), hall("stands", [], [solid], goal=(2.8, 1.5))):
        integral = sampler(scene, 0.3, phi)
        found = integral.estimate(held(integral, x, np.array([0.6, -0.1]), 30_000))
        values.append((found.log_psi, found.value_error / integral.temperature))
    (a, da), (b, db) = values
    assert abs(a - b) < 3.5 * math.hypot(da, db)
    assert math.hypot(da, db) < 0.2


def test_the_key_of_a_sampled_path_is_that_of_its_winding():
    integral, seen = sampler(SCENES["oblique"](), 0.3), set()
    for x, control in (((1.0, 2.5), (0.9, 0.0)), ((1.5, 1.2), (0.8, 0.4)), ((2.9, 4.2), (0.3, -0.6))):
        rollouts = held(integral, np.array(x), np.array(control), 300, time=0.2)
        arrived = np.flatnonzero(rollouts.paths.outcome != Outcome.COLLISION)
        states, steps = integral.replay.trace(rollouts, arrived)
        for k, s in enumerate(arrived):
            path = np.column_stack([states[k, : steps[k] + 1], 0.2 + rollouts.tables.times[: steps[k] + 1]])
            winding = integral.homology.winding(path)
            assert integral.homology.key(winding) == rollouts.paths.key[s]
            seen.add(winding)
    assert len(seen) > 4


@pytest.mark.parametrize(("moving", "grain", "few"), [(True, None, 44), (False, 0.1, 44), (False, None, 440)])
def test_in_a_world_that_changes_a_plan_without_time_draws_a_tenth_of_its_samples(moving, grain, few):
    scene = SCENES["crossing"]()
    integral = sampler(scene if moving else replace(scene, movers=()), grain=grain)
    times = integral.steps(3.0)
    tapes = [Tape(times, np.tile(u, (len(times) - 1, 1))) for u in ([1.0, 0.2], [1.0, -0.2])]
    proposals = tuple(Proposal(lead=tape, count=count) for tape, count in zip(tapes, (400, 40), strict=True))
    batch = Batch(state=np.array([5.0, 2.5]), times=times, proposals=proposals)
    assert [part.size for part in integral.sample(batch, 0, left=lambda: 0.0).parts] == [few]
    assert [part.size for part in integral.sample(batch, 0).parts] == [440]
    assert (
        sum(part.size for part in integral.sample(batch, 0, left=iter(np.linspace(9.0, 0.0, 9)).__next__).parts) > 440
    )


def test_once_bodies_rest_samples_weigh_as_in_the_same_world_where_nothing_moves():
    """Around two corners, b = 0.3, 1000 samples, 5 states, seed 8: 4 standard errors and 0.3 %, half as many effective.

    What goes around corners follows the way that climbs what stands, with all of its bends.
    """
    scene = SCENES["closing_door"]()
    shut = replace(scene, movers=(), obstacles=(*scene.obstacles, block("door", 3.1, 2.5, (0.08, 0.4))))
    plans = []
    for one in (scene, shut):
        plans.append((point(one, 0.3, 400, seed=1, rng=2, samples=1000, threads=1), bool(one.movers)))
    for x in np.random.default_rng(8).uniform([0.3, 0.3], [2.6, 3.0], (5, 2)):
        found = []
        for controller, moving in plans:
            controller.begin(x, 2.0 if moving else 0.0)
            found.append([controller.plan(x) for _ in range(2)][1].estimate)
        among, alone = found
        error = math.hypot(among.value_error, alone.value_error)
        assert abs(among.value - alone.value) < 4.0 * error + 3e-3 * alone.value, x
        assert among.ess > 0.5 * alone.ess, x


@cache
def known(name: str, b: float) -> Desirability:
    scene = SCENES[name]()
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2))
    return Desirability.of(problem, FreeSpace.of(scene))


JUDGED = [(name, b) if (name, b) == ("crossing", 0.2) else thorough(name, b) for name in SCENES for b in (0.2, 0.3)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "b"), JUDGED)
def test_plans_value_is_that_of_the_grid_at_random_states_and_times(name, b):
    """2000 samples per class at 8 states, seed 5: 4 standard errors and 0.3 %, all within 1 %; one may lack a class.

    A tree of 800 vertices that is aimed at a state does not find every dash through a gap that is about to close.
    """
    truth, rng, off = known(name, b), np.random.default_rng(5), []
    one = point(SCENES[name](), b, 400, seed=1, rng=2, samples=2000, threads=1)
    while len(off) < 8:
        x, t = rng.uniform([0.3, 0.3], [4.5, 4.7]), float(rng.uniform(0.0, 2.0))
        if not truth.value(x, t) < 14.0 or np.hypot(*(x - truth.problem.scene.goal.center)) < 0.5:
            continue
        one.begin(x, t)
        found, value = [one.plan(x) for _ in range(2)][1].estimate, truth.value(x, t)
        error = abs(found.value - value)
        off.append(0.0 if error < 4.0 * found.value_error + 3e-3 * value and error < 0.01 * value else error / value)
    assert np.count_nonzero(off) <= 1, off


@pytest.mark.slow
def test_close_to_the_goal_the_control_is_that_of_the_grid():
    """Where paths arrive, and walls are near, before a guide's law or a mean over 0.4 s has told the control: it was
    off by 0.8 % along the rim, or 0.8 % too weak towards it. Mean over 6 states and both directions, seed 7.
    """
    truth, off = known("closing_door", 0.3), []
    one = point(SCENES["closing_door"](), 0.3, 100, seed=1, rng=7, samples=20_000, threads=1, first=0.01)
    for angle, beyond in ((1.4, 0.28), (1.0, 0.36), (0.8, 0.33), (-1.4, 0.28), (-1.0, 0.36), (-0.8, 0.33)):
        outward = np.array([np.cos(angle), np.sin(angle)])
        x = truth.problem.scene.goal.center + (truth.problem.scene.goal.radius + beyond) * outward
        one.begin(x, 2.1)
        found = one.plan(x).estimate
        around = np.array([-outward[1], outward[0]]) * np.sign(angle)
        error = found.control - truth.control(x, 2.1)
        off.append([(error @ side, math.hypot(*(side * found.control_error))) for side in (outward, around)])
    means, errors = np.array(off).mean(axis=0)[:, 0], np.sqrt(np.sum(np.array(off)[:, :, 1] ** 2, axis=0)) / len(off)
    assert np.all(np.abs(means) < 3.0 * errors), (means, errors)
    assert np.all(errors < 0.003)
