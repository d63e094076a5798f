"""The long tests of unit/pirrht/estimation/test_path_integral_grid.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rooms import DOORWAY, box
from solved import Solved, around_corner, around_post, in_channel, problem_in
from thoroughly import thorough
from unit.pirrht.estimation.test_path_integral_grid import FINE, error_of, is_the_grids, near_goal, shares

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.problem import unit_rate
from pirrht.rollouts.cpu import Cpu, loops
from pirrht.rollouts.path import any_path
from pirrht.rollouts.step import KernelSpec

SEEDS = 24


def one_by_one(integral: PathIntegral) -> PathIntegral:
    """The same, but simulated path by path."""
    path = any_path(KernelSpec(integral.problem.dynamics.drift, None, None, unit_rate, 2, 2, False, True))
    integral.backend = Cpu(loops(*path, 2), 1)
    return integral


def estimates(known: Solved, counts: tuple[int, ...], seeds: int = SEEDS, **settings: object) -> list[Estimate]:
    integral = path_integral(known.problem, known.space, Sampling(**settings))
    batch = known.batch(integral, *counts)
    return [integral.estimate(integral.rollout(batch, seed)) for seed in range(seeds)]


def agree(one: Array, other: Array) -> bool:
    """Whether means of independent values are the same up to three standard errors."""
    return bool(abs(one.mean() - other.mean()) < 3.0 * np.hypot(error_of(one), error_of(other)))


# -- any guide ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [{}, {"draws": "independent"}, {"guide": "open-loop"}, {"dt": 0.3}])
@pytest.mark.parametrize("counts", [(1000, 1000), (1600, 400)])
def test_psi_around_a_post_is_that_of_the_grid(settings, counts):
    known = around_post(0.5)
    if settings.get("guide") == "open-loop":
        counts = tuple(8 * n for n in counts)
    values = shares(known, estimates(known, counts, **settings))
    assert error_of(values) < 0.04
    assert is_the_grids(values)


@pytest.mark.parametrize("make", [around_post, around_corner])
def test_a_guide_that_knows_nothing_of_the_walls_leaves_psi_where_it_is(make: Callable[..., Solved]):
    """Its way leads over the wrong corners, and back; a third of the samples do well, to bound the variance."""
    known = make(0.5)
    integral = path_integral(known.problem, known.space, Sampling())
    goal = known.space.scene.goal.center
    wrong = [np.array([[0.7, 2.4], [0.4, 1.0], goal]), np.array([[1.2, 1.0], [0.8, 2.0], goal])]
    batch = replace(known, lines=(*known.lines, *wrong)).batch(integral, *(700,) * (len(known.lines) + 2))
    values = shares(known, [integral.estimate(integral.rollout(batch, seed)) for seed in range(SEEDS)])
    assert error_of(values) < 0.02
    assert is_the_grids(values)


def test_the_control_of_samples_that_climb_is_that_of_the_grid():
    """Per component within three standard errors (below 0.01 of 1.2) and 2 % of its size."""
    for known in (around_corner(0.3), around_corner(0.5)):
        found = estimates(known, (1000,), 48, window=0.05)
        controls = np.array([e.control for e in found])
        exact = known.truth.control(known.x)
        error = controls.std(axis=0, ddof=1) / np.sqrt(len(controls))
        assert error.max() < 0.04
        assert np.all(np.abs(controls.mean(axis=0) - exact) < 3.0 * error + 0.02 * np.hypot(*exact))


PLACES = {
    "channel": lambda: in_channel(0.5, 0.5, length=2.0, ahead=1.0),
    "goal": lambda: near_goal(0.5),
    "corner": lambda: around_corner(0.5),
}


@pytest.mark.parametrize("kernels", ["blocks", thorough("one by one")])
@pytest.mark.parametrize("place", list(PLACES))
def test_split_steps_are_equal_in_law_to_small_ones(place, kernels):
    """dt = 0.1 split, against 0.1 / 64 throughout; 24 seeds each."""
    known = PLACES[place]()
    values = {}
    for name, settings in (("split", {}), ("small", FINE)):
        integral = path_integral(known.problem, known.space, Sampling(threads=1, **settings))
        integral = one_by_one(integral) if kernels == "one by one" else integral
        batch = known.batch(integral, 600)
        found = [integral.estimate(integral.rollout(batch, seed + 100 * (name == "small"))) for seed in range(SEEDS)]
        values[name] = shares(known, found)
        assert is_the_grids(values[name])
    assert agree(values["split"], values["small"])


# -- weighed survival --------------------------------------------------------------------------------------------


def test_weighing_survival_has_the_mean_of_killing_and_scatters_less():
    """phi just below and above what makes a collision weigh nothing; 96 seeds each, of 400 samples.

    The ratio of two deviations, 0.75, has a standard error of 0.08.
    """
    values, weighed = {}, []
    for phi in (0.999, 1.001):
        known = in_channel(0.5, 0.3, length=2.0, ahead=1.0)
        integral = path_integral(known.problem, known.space, Sampling())
        batch = known.batch(integral, 400)
        end = known.problem.least_rate * float(batch.times[-1])
        integral = path_integral(replace(known.problem, phi=phi * end), known.space, Sampling())
        rollouts = [integral.rollout(batch, seed) for seed in range(96)]
        weighed.append(rollouts[0].tables.weighed)
        values[phi] = shares(known, [integral.estimate(one) for one in rollouts])
    killing, weighing = values.values()
    assert weighed == [False, True]
    assert agree(killing, weighing)
    assert is_the_grids(killing)
    assert is_the_grids(weighing)
    assert weighing.std() < 0.95 * killing.std()


# -- a doorway ---------------------------------------------------------------------------------------------------


def test_in_a_doorway_whose_jambs_join_elsewhere_the_control_is_symmetric():
    """Before a door on the middle of the room behind it; within three of the standard errors that it reports."""
    scene = Scene(
        name="room", lower=np.zeros(2), upper=np.array([6.0, 5.0]), robot_radius=0.1,
        obstacles=tuple(box(f"box{i}", extent) for i, extent in enumerate(DOORWAY)),
        start=np.array([2.8, 2.5, 0.0]), goal=Goal(center=np.array([4.5, 2.5]), radius=0.1),
    )  # fmt: skip
    problem, space = problem_in(scene, 0.3), FreeSpace.of(scene)
    for x in (2.8, 3.2, 3.5):
        known = Solved(problem, space, np.array([x, 2.5]), (scene.goal.center[None],))
        found = estimates(known, (2000,), 12)
        across, error = np.array([[e.control[1], e.control_error[1]] for e in found]).T
        assert abs(across.mean()) < 3.0 * np.sqrt(np.mean(error**2) / len(found))
        assert is_the_grids(shares(known, found))
