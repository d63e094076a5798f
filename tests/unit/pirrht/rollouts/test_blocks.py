"""Sampled paths: points many abreast are those of any dynamics one by one, and a car sways within fitted steps.

A path of the plain chain is steered by one number per step. What it cannot do makes the best path dearer by about the
integral of (du/dt dt)^2 / 24, several lambda at steps of 0.1 s.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from batches import batch_of, led, still
from discs import disc, scene_of
from thoroughly import first
from trees import grown

from pirrht import Dubins, FreeSpace, HomologyTree, PathIntegral, Problem, Sampling, Unicycle, path_integral
from pirrht.arrays import Array
from pirrht.geometry.disc import DISC
from pirrht.problem import unit_rate
from pirrht.rollouts.cpu import Cpu, loops
from pirrht.rollouts.path import any_path
from pirrht.rollouts.step import KernelSpec
from pirrht.rollouts.tables import Paths
from pirrht.traits import Traits

TIMES = np.concatenate([np.arange(10) * 0.01, np.arange(1, 40) * 0.1])
RULES = [
    *({"guide": guide, "exit": exit} for guide in ("feedback", "open-loop") for exit in ("bridge", "endpoint")),
    {"guide": "feedback", "steps": "uniform"},
]


def drawn(source: PathIntegral, tree: HomologyTree, counts: list[int]):
    x = source.problem.scene.start[:2]
    trajectories = [r.trajectory for r in tree.references(x)]
    corners = [np.vstack([t.path.start[1:, :2], source.space.scene.goal.center]) for t in trajectories]
    return source.rollout(
        batch_of(source, x, TIMES, np.array([t.tape(TIMES) for t in trajectories]), counts=counts, corners=corners), 1
    )


def both(scenario, tree: HomologyTree, counts: list[int], phi: float, **rules: str) -> tuple[Paths, Paths]:
    problem = replace(scenario.problem, phi=phi)
    source = path_integral(problem, scenario.space, replace(scenario.sampling, **rules))
    block = drawn(source, tree, counts).paths
    kernels = source.homology.table.kernels
    kind = KernelSpec(
        problem.dynamics.drift, None, None, unit_rate, 2, 2, Traits.of(problem), DISC, (0, 1), classes=kernels
    )
    source.backend = Cpu(loops(*any_path(kind), 2), 1)
    return block, drawn(source, tree, counts).paths


@pytest.mark.parametrize("noise", first([0.3, 0.1]))
@pytest.mark.parametrize("phi", [np.inf, 1.0], ids=["weighed", "killed"])
@pytest.mark.parametrize("rules", RULES, ids=lambda rules: " ".join(rules.values()))
def test_blocks_hold_the_paths_that_one_by_one_come_out(slit, slit_tree, rules, noise, phi):
    block, single = both(slit.with_settings(noise=noise), slit_tree, [301, 128, 1], phi, **rules)
    different: Array = block.steps != single.steps  # rounding may flip an exit, in one of many thousand steps
    assert different.mean() < 5e-3
    assert len(np.unique(block.outcome)) > 1
    for name in Paths._fields:
        one, other = getattr(block, name)[~different], getattr(single, name)[~different]
        if name == "log_survival":
            one, other = np.exp(one), np.exp(other)
        if name == "log_ratio":  # blocks hold what has fallen far below the rest (`RolloutTuning.negligible`)
            one, other = (np.maximum(x, x.max(axis=1, keepdims=True) - 10.0) for x in (one, other))
        # Blocks are in single precision; log dQ/dP is a sum of some hundred terms of up to ten, and survival hangs on
        # distances of millimeters. Steps that fit a place depend on it, so that a few paths, close to walls for long,
        # come apart by more than a rounding error.
        big = name in ("log_ratio", "log_survival", "exposure")
        rough = 1e-3 if name == "exposure" else 1e-4  # it grows as 1 / distance
        for share, rtol, atol in ((0.06, rough, 2e-3 if big else 1e-5), (0.01, 0.01, 0.1 if big else 0.01)):
            apart = ~np.isclose(one, other, rtol=rtol, atol=atol)
            assert apart.reshape(len(one), -1).any(axis=1).mean() < share, name


def test_a_sample_does_not_depend_on_how_many_others_there_are(slit, slit_tree):
    source = path_integral(slit.problem, slit.space, replace(slit.sampling, threads=1))
    few, many = drawn(source, slit_tree, [5, 1, 1]).paths, drawn(source, slit_tree, [300, 1, 1]).paths
    for name in Paths._fields:
        np.testing.assert_array_equal(getattr(few, name)[:5], getattr(many, name)[:5], err_msg=name)


STEP = 0.1


@cache
def case(b: float) -> tuple[Problem, FreeSpace, HomologyTree]:
    """A car in front of a post, and the goal behind it."""
    ends = {"start": (0.0, 0.0), "goal": (4.0, -0.6, 0.3), "lower": (-1.0, -3.0), "side": (6.0, 3.0)}
    scene = scene_of([disc("post", 2.2, -0.2, 0.4)], **ends, radius=0.15)
    problem, space = Problem(dynamics=Unicycle(b=b), scene=scene, R=np.eye(1), phi=1000.0), FreeSpace.of(scene)
    return problem, space, grown(space, Dubins.of(problem), 300)


def test_within_fitted_steps_a_car_sways_as_the_integral_of_its_heading_does():
    """Heading and offset after one and two steps: moments of (w, integral of w); 40 000 paths, seed 1, 4 deviations."""
    b, count = 0.3, 40_000
    problem, space, _ = case(b)
    integral, times = path_integral(problem, space, Sampling(dt=STEP, draws="independent")), STEP * np.arange(3)
    rollouts = led(integral, np.zeros(3), times, still(times, 1), count=count, seed=1)
    states = integral.replay.trace(rollouts, np.arange(count))[0]
    for k in (1, 2):
        t = k * STEP
        x, y, heading = states[:, k].T
        ahead = 2.0 / b**2 * (1.0 - np.exp(-0.5 * b**2 * t))  # E of the integral of cos
        assert abs(x.mean() - ahead) < 4.0 * x.std() / np.sqrt(count) + 1e-6
        products = heading * heading, heading * y, y * y
        for product, exact in zip(products, b**2 * np.array([t, t**2 / 2.0, t**3 / 3.0]), strict=True):
            assert product.mean() == pytest.approx(exact, abs=4.0 * product.std() / np.sqrt(count) + 0.003 * exact)
