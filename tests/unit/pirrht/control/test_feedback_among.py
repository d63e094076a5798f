"""Feedback between plans where bodies move: who has to hurry loses by waiting, and walls that come push."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from discs import block
from moving import closing_door, hall, moved

from pirrht.arrays import Array
from pirrht.control.plan import ClassLaw, ClassMixture
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.proposals.wall_drift import WallDrift
from pirrht.systems.single_integrator import SingleIntegrator

B = 0.2
FAST, SLOW = np.array([1.7, 0.3]), np.array([0.2, -0.9])  # controls of two classes [m/s]


@cache
def problem() -> Problem:
    """q = 1, R = 2, lambda = 0.08, in a world with a door."""
    return Problem(dynamics=SingleIntegrator(b=B), scene=closing_door(), R=2.0 * np.eye(2))


def nothing(x: Array, s: float) -> Array:
    return np.zeros(2)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_classes_that_hurry_and_others_weigh_what_the_equation_in_time_says(share):
    """psi = e^(k.x + w t) solves d psi / dt = (q / lambda) psi - b^2 laplace psi / 2 for w = q / lambda - |b k|^2 / 2.

    Its control is b^2 k, however long k is: of the sum of two, the carried law is the exact one at any place and time.
    """
    classes = {
        name: ClassLaw(log_psi=float(np.log(part)), rest=u, lead=None)
        for name, u, part in (("fast", FAST, share), ("slow", SLOW, 1.0 - share))
    }
    mixture = ClassMixture(problem=problem(), state=np.array([1.0, 2.5]), classes=classes, push=nothing)
    k = np.array([FAST, SLOW]) / B**2
    rate = 1.0 / problem().temperature - 0.5 * B**2 * np.sum(k**2, axis=1)
    for dx, s in (([0.0, 0.0], 0.1), ([0.05, -0.02], 0.1), ([-0.03, 0.04], 0.02)):
        psi = np.array([share, 1.0 - share]) * np.exp(k @ dx + rate * s)
        told = mixture.weights(np.array([1.0, 2.5]) + dx, s)
        np.testing.assert_allclose(list(told.values()), psi / psi.sum(), rtol=1e-9)


@pytest.mark.parametrize("gap", [0.003, 0.01, 0.03])
def test_a_wall_that_comes_pushes_as_psi_vanishes_there(gap):
    """Towards a flat wall psi ~ c / (c + reach); down to 3 mm, as near as the wall is by then. It rises by 0.5 m/s."""
    wall = moved("wall", [(0.0, 3.0, 1.0, 0.0), (2.0, 3.0, 2.0, 0.0)], block("wall", 0.0, 0.0, (2.0, 0.2)))
    space = FreeSpace.of(hall("lift", [wall]))
    push = WallDrift(problem=problem(), field=space.field, offset=0.08, step=0.05, moving=space.moving, time=0.3)
    told = push(np.array([3.0, 1.0 + 0.5 * 0.7 + 0.2 + 0.1 + gap]), 0.4)
    assert told[1] == pytest.approx(B**2 * 0.08 / (gap * (gap + 0.08)), rel=0.01)
    assert abs(told[0]) < 0.01 * told[1]
