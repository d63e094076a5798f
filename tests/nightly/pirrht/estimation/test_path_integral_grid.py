"""The long tests of unit/pirrht/estimation/test_path_integral_grid.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from solved import Solved, around_corner, around_post, in_channel
from unit.pirrht.estimation.test_path_integral_grid import error_of, is_the_grids, shares

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampling import Sampling

SEEDS = 24


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


def test_the_control_of_samples_that_climb_is_that_of_the_grid():
    """Per component within three standard errors (below 0.01 of 1.2) and 2 % of its size."""
    for known in (around_corner(0.3), around_corner(0.5)):
        found = estimates(known, (1000,), 48, window=0.05)
        controls = np.array([e.control for e in found])
        exact = known.truth.control(known.x)
        error = controls.std(axis=0, ddof=1) / np.sqrt(len(controls))
        assert error.max() < 0.04
        assert np.all(np.abs(controls.mean(axis=0) - exact) < 3.0 * error + 0.02 * np.hypot(*exact))


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
