"""The kernel that simulates points many abreast, against the one that simulates any dynamics path by path."""

from dataclasses import replace

import numpy as np
import pytest
from batches import batch_of
from thoroughly import first

from pirrht import HomologyTree, PathIntegral, path_integral
from pirrht.arrays import Array
from pirrht.estimation.estimate import Rollouts
from pirrht.problem import unit_rate
from pirrht.rollouts.cpu import Cpu, loops
from pirrht.rollouts.path import any_path
from pirrht.rollouts.step import KernelSpec
from pirrht.rollouts.tables import Paths
from sim.scenario import Scenario

TIMES = np.concatenate([np.arange(10) * 0.01, np.arange(1, 40) * 0.1])
RULES = [
    *({"guide": guide, "exit": exit} for guide in ("feedback", "open-loop") for exit in ("bridge", "endpoint")),
    {"guide": "feedback", "steps": "uniform"},
]


def drawn(source: PathIntegral, tree: HomologyTree, counts: list[int]) -> Rollouts:
    x = source.problem.scene.start[:2]
    trajectories = [r.trajectory for r in tree.references(x)]
    corners = [np.vstack([t.path.start[1:, :2], source.space.scene.goal.center]) for t in trajectories]
    tapes = np.array([t.tape(TIMES) for t in trajectories])
    return source.rollout(batch_of(source, x, TIMES, tapes, counts=counts, corners=corners), 1)


def both(scenario: Scenario, tree: HomologyTree, counts: list[int], phi: float, **rules: str) -> tuple[Paths, Paths]:
    problem = replace(scenario.problem, phi=phi)
    source = path_integral(problem, scenario.space, replace(scenario.sampling, **rules))
    block = drawn(source, tree, counts).paths
    path = any_path(KernelSpec(scenario.problem.dynamics.drift, None, None, unit_rate, 2, 2, False, True))
    source.backend = Cpu(loops(*path, 2), 1)
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
