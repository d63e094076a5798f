"""References without controls: the tree knows positions alone, guides make them feasible, and psi does not mind."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from guides import best
from scooter import Scooter
from thoroughly import first, thorough

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.steering.motion import running_cost
from pirrht.steering.straight_line import Tracked
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.second_order_car import SecondOrderCar, cruising
from sim.mjcf import load


def scene() -> Scene:
    return load("slit", robot="puck").scene


def car(b: float = 0.1) -> Problem:
    return Problem(dynamics=SecondOrderCar(b=b), scene=scene(), R=np.eye(2), q=cruising, q_min=1.0)


def scooter() -> Problem:
    return Problem(dynamics=Scooter(), scene=scene(), R=np.diag([2.0, 0.5]))


@cache
def grown() -> tuple[Problem, FreeSpace, HomologyTree, PathIntegral]:
    """A problem in `slit`, its tree of positions and a sampler."""
    problem = car()
    space = FreeSpace.of(problem.scene)
    tree = HomologyTree(space, Tracked.of(problem), limit=0.6, rng=np.random.default_rng(0))
    tree.grow(300)
    return problem, space, tree, path_integral(problem, space, Sampling(dt=0.1, draws="independent", threads=1))


def guided(x: Array, reference: Reference) -> tuple[Array, DDPGuide | None]:
    """The grid of the rollouts from x (n,), and a guide."""
    problem, space, _, integral = grown()
    times = integral.grid(running_cost(problem, x, reference.trajectory))
    assert isinstance(integral.guidance, DDPGuidance)
    return times, best(integral.guidance, x, times, space.homology.key(reference.winding), reference.trajectory)


def mean_and_error(log_weight: Array) -> tuple[float, float, float]:
    """log psi, its standard error and the share of effective samples."""
    top = log_weight.max()
    w = np.exp(log_weight - top)
    spread = float(w.std() / w.mean() / np.sqrt(len(w)))
    return float(top + np.log(w.mean())), spread, float(w.mean() ** 2 / (w**2).mean())


def sampled(x: Array, times: Array, leads: tuple[ProposalControl, ...], seed: int) -> tuple[float, float, float]:
    proposals = tuple(Proposal(lead=lead, count=20_000 // len(leads)) for lead in leads)
    return mean_and_error(grown()[3].rollout(Batch(state=x, times=times, proposals=proposals), seed).log_weight)


def test_a_pace_that_the_cost_does_not_tell_must_be_declared():
    mass = Problem(dynamics=DoubleIntegrator(), scene=scene(), R=2 * np.eye(2))
    with pytest.raises(OptionError, match=r"cost of DoubleIntegrator does not tell how fast .* declare a pace"):
        Tracked.of(mass)
    assert Tracked.of(mass, 0.8).pace == 0.8
    assert Tracked.of(mass, 0.8).cost_per_meter == pytest.approx(1.0 / 0.8)  # a mass on its way needs no control
    with pytest.raises(OptionError, match="the pace of references is -1; it must be a positive number"):
        Tracked.of(mass, -1.0)


@pytest.mark.parametrize("seed", first(range(4)))
def test_guides_of_a_car_are_of_their_references_class_and_dearer_than_the_taut_way_at_the_best_pace(seed):
    """From random states at any heading: q + u'Ru/2 is at least 1 + v^2, and that at least 2 |v|."""
    _, space, tree, _ = grown()
    rng = np.random.default_rng(seed)
    valid = total = 0
    while total < 8:
        x = np.array(
            [*rng.uniform(space.scene.lower, space.scene.upper), rng.uniform(-3.0, 3.0), rng.uniform(-0.3, 1.0)]
        )
        if space.clearance(x) < 0.05 or space.scene.goal.contains(x[:2]):
            continue
        for reference in tree.references(x):
            _, guide = guided(x, reference)
            total += 1
            if guide is None or not guide.valid:
                continue
            valid += 1
            assert guide.cost > 2.0 * reference.length - 0.15  # taut but for what the field's certificate costs
            assert np.all([space.clearance(state) > 0.0 for state in guide.states[: guide.length + 1]])
            travelled = np.diff(guide.states[: guide.length + 1, :2], axis=0)
            assert np.hypot(*travelled.T).sum() > reference.length - 0.1 - 0.2
    assert valid >= total - 1


@pytest.mark.parametrize(
    "x",
    [np.array([1.0, 2.5, 0.0, 0.0]), thorough(np.array([2.0, 4.0, -1.0, 1.0]))],
    ids=["car at rest", "car under way"],
)
def test_psi_does_not_depend_on_what_was_tracked(x):
    """Guide, guide put aside with weaker gains, and it with the guide's tape: within 3 errors. Seeds 1 to 3."""
    _, _, tree, _ = grown()
    times, guide = guided(x, tree.references(x)[0])
    assert guide is not None
    assert guide.valid
    off = np.array([0.02, -0.02, 0.05, 0.03])[: len(x)]
    aside = replace(guide, states=guide.states + off, gains=0.8 * guide.gains)
    both = (LinearFeedback(guide), Tape(times, guide.tape))
    found = [
        sampled(x, times, leads, k)
        for k, leads in enumerate([(LinearFeedback(guide),), (LinearFeedback(aside),), both], 1)
    ]
    for i, (one, its, _) in enumerate(found):
        assert its < 0.15
        for other, error, _ in found[:i]:
            assert abs(one - other) < 3.0 * np.hypot(its, error)


def test_a_car_that_faces_away_is_turned_about():
    """At rest with its back to the slit: every class has a guide, none of which stays behind the start."""
    x = np.array([1.0, 2.5, 3.0, 0.0])
    for reference in grown()[2].references(x):
        _, guide = guided(x, reference)
        assert guide is not None
        assert guide.valid
        assert guide.states[guide.length, 0] > 4.5
