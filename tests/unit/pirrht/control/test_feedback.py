"""Feedback between plans: the control follows the state, class by class, in time and next to moving walls."""

from types import SimpleNamespace

import numpy as np
import pytest
from discs import block
from moving import closing_door, hall, moved

from pirrht import FreeSpace, Problem, SingleIntegrator
from pirrht.control.plan import ClassLaw, ClassMixture, pooled
from pirrht.proposals.proposal import Tape
from pirrht.proposals.tuning import TUNING as PROPOSALS
from pirrht.proposals.wall_drift import WallDrift, linear_law_weight, window
from sim.mjcf import load

START = np.array([1.0, 2.5])  # both detours are worth the same there


class Steep(Tape):
    """A guide whose law is linear and changes fast."""

    def __call__(self, x, s):
        return np.array([[-50.0, 3.0], [2.0, -80.0]]) @ x


def nothing(x, s):
    return np.zeros(2)


def estimate(x, *, law_weight=1.0, **classes):
    """What the samples of one plan say: log psi and control of each class."""
    logs = {name: log for name, (log, _) in classes.items()}
    total = np.logaddexp.reduce(list(logs.values()))
    origin, tables = SimpleNamespace(x=np.array(x, dtype=float)), SimpleNamespace(law_weight=law_weight)
    return SimpleNamespace(
        rollouts=SimpleNamespace(origin=origin, tables=tables),
        log_psi=float(total),
        class_weights={name: float(np.exp(log - total)) for name, log in logs.items()},
        class_controls={name: np.array(u) for name, (_, u) in classes.items()},
    )


@pytest.fixture
def problem():
    return Problem(dynamics=SingleIntegrator(b=0.5), scene=load("slit").scene, R=2.0 * np.eye(2))


def test_at_the_state_of_a_first_plan_the_law_is_the_estimate(slit, slit_tree):
    plan = slit.with_settings(noise=0.3, samples=10000, plan_seed=0).controller(slit_tree).plan(START)
    np.testing.assert_allclose(plan.law(START, 0.0), plan.estimate.control, rtol=1e-9)
    for name, weight in plan.law.law.weights(START, 0.0).items():
        assert weight == pytest.approx(plan.estimate.class_weights[name], abs=1e-9)


def test_a_law_of_two_classes_is_the_slope_of_the_sum_of_two_exponentials(problem):
    """In free space psi = e^(k a.x) + e^(k b.x) solves the linear equation; u* is lambda R^-1 times its log slope."""
    stiff = 2.0 / problem.temperature
    a, b = np.array([0.6, 0.8]), np.array([1.0, 0.0])
    law = pooled(problem, None, estimate([0, 0], one=(0.0, a), other=(-0.3, b)), {}, nothing, 0.0)
    for x in ([0.1, 0.0], [-0.05, 0.2], [0.3, -0.2]):
        psi = np.exp([stiff * a @ x, stiff * b @ x - 0.3])
        np.testing.assert_allclose(law(np.array(x), 0.0), psi @ np.array([a, b]) / psi.sum(), rtol=1e-9)


def test_plans_at_one_place_are_averaged(problem):
    """Five plans a hundredth of a second apart; the spread of 400 laws (seed 4) is that of 3.6 plans, within 15 %."""
    rng, laws = np.random.default_rng(4), []
    for _ in range(400):
        law = None
        for _ in range(5):
            law = pooled(problem, law, estimate([0, 0], one=(0.0, rng.normal(size=2))), {}, nothing, 0.01)
        laws.append(law(np.zeros(2), 0.0))
    weights = np.exp(-np.arange(5) / 3.0)
    assert np.std(laws) == pytest.approx(np.sqrt(np.sum(weights**2)) / np.sum(weights), rel=0.15)


@pytest.mark.parametrize("law_weight", [0.0, 0.3, 1.0])
def test_between_plans_a_guide_is_followed_as_far_as_it_is_trusted(problem, law_weight):
    """At the plan's state the control is what samples said; beside it that and a share of how the guide changes."""
    guide = Steep(np.array([0.0, 1.0]), np.zeros((1, 2)))
    x, beside = np.array([0.2, 0.1]), np.array([0.21, 0.1])
    law = pooled(problem, None, estimate(x, law_weight=law_weight, one=(0.0, [1.0, 0.5])), {"one": guide}, nothing, 0.0)
    np.testing.assert_allclose(law(x, 0.0), [1.0, 0.5], rtol=1e-12)
    np.testing.assert_allclose(
        law(beside, 0.0) - law(x, 0.0), law_weight * (guide(beside, 0.0) - guide(x, 0.0)), atol=1e-12
    )


def test_a_linear_law_is_trusted_beyond_what_noise_carries_to_walls_and_the_less_the_nearer_they_are():
    shares = [linear_law_weight(0.04, near) for near in (0.0, 0.01, 0.03, 0.2, np.inf)]
    assert shares[0] == 0.0
    assert shares[-2:] == [1.0, 1.0]
    assert shares == sorted(shares)
    times = np.arange(100) * 0.01
    shortest = window(0.04, 0.0, times, 0.4, PROPOSALS.averaged_moving)
    assert shortest < window(0.04, 0.0, times, 0.4)
    for near in np.linspace(0.01, 0.2, 30):  # what is trusted in part is averaged over the shortest time only
        trusted = linear_law_weight(0.04, near) >= 1.0
        assert trusted or window(0.04, near, times, 0.4, PROPOSALS.averaged_moving) == shortest


B = 0.2


def among_movers() -> Problem:
    """q = 1, R = 2, lambda = 0.08, in a world with a door."""
    return Problem(dynamics=SingleIntegrator(b=B), scene=closing_door(), R=2.0 * np.eye(2))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_classes_that_hurry_and_others_weigh_what_the_equation_in_time_says(share):
    """psi = e^(k.x + w t) solves d psi / dt = (q / lambda) psi - b^2 laplace psi / 2 for w = q / lambda - |b k|^2 / 2.

    Its control is b^2 k, however long k is: of the sum of two, the carried law is the exact one at any place and time.
    """
    problem, fast, slow = among_movers(), np.array([1.7, 0.3]), np.array([0.2, -0.9])
    classes = {
        name: ClassLaw(log_psi=float(np.log(part)), rest=u, lead=None)
        for name, u, part in (("fast", fast, share), ("slow", slow, 1.0 - share))
    }
    mixture = ClassMixture(problem=problem, state=START, classes=classes, push=nothing)
    k = np.array([fast, slow]) / B**2
    rate = 1.0 / problem.temperature - 0.5 * B**2 * np.sum(k**2, axis=1)
    for dx, s in (([0.0, 0.0], 0.1), ([0.05, -0.02], 0.1), ([-0.03, 0.04], 0.02)):
        psi = np.array([share, 1.0 - share]) * np.exp(k @ dx + rate * s)
        np.testing.assert_allclose(list(mixture.weights(START + dx, s).values()), psi / psi.sum(), rtol=1e-9)


@pytest.mark.parametrize("gap", [0.003, 0.01, 0.03])
def test_a_wall_that_comes_pushes_as_psi_vanishes_there(gap):
    """Towards a flat wall psi ~ c / (c + reach); down to 3 mm, as near as the wall is by then. It rises by 0.5 m/s."""
    wall = moved("wall", [(0.0, 3.0, 1.0, 0.0), (2.0, 3.0, 2.0, 0.0)], block("wall", 0.0, 0.0, (2.0, 0.2)))
    space = FreeSpace.of(hall("lift", [wall]))
    push = WallDrift(problem=among_movers(), static=space.static, offset=0.08, step=0.05, moving=space.moving, time=0.3)
    drift = push(np.array([3.0, 1.0 + 0.5 * 0.7 + 0.2 + 0.1 + gap]), 0.4)
    assert drift[1] == pytest.approx(B**2 * 0.08 / (gap * (gap + 0.08)), rel=0.01)
    assert abs(drift[0]) < 0.01 * drift[1]
