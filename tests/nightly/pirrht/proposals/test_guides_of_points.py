"""Points that drift, or that noise shakes more one way, are led by guides, and none halts on the goal's rim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discs import disc
from guides import best
from wind import Balloon

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Scene
from pirrht.problem import Problem
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape
from pirrht.steering.motion import Trajectory
from pirrht.steering.straight_line import StraightLine
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.single_integrator import SingleIntegrator

START = np.array([0.5, 1.0])


def around_a_post(dynamics: Dynamics, **sampling: object) -> PathIntegral:
    """A sampler in a room of 3 x 2 m with a post below the way."""
    scene = Scene(
        name="post", lower=np.zeros(2), upper=np.array([3.0, 2.0]), obstacles=(disc("post", 1.4, 0.7, 0.1),),
        goal=Goal(center=np.array([2.5, 1.0]), radius=0.3), start=np.append(START, 0.0), robot_radius=0.1,
    )  # fmt: skip
    B = dynamics.B_c(START)
    problem = Problem(dynamics=dynamics, scene=scene, R=0.02 * np.linalg.inv(B @ B.T))
    return path_integral(problem, FreeSpace.of(scene), Sampling(draws="independent", threads=1, **sampling))


def straight(integral: PathIntegral) -> Trajectory:
    """Over ground at 1 m/s to the rim of the goal."""
    steering = StraightLine(pace=1.0, cost_rate=2.0)
    way = steering.trajectory(steering.connect(START, np.array([2.2, 1.0])))
    return replace(way, controls=way.controls - integral.problem.dynamics.f(START))


def said(
    integral: PathIntegral, lead: ProposalControl, times: Array, count: int, seed: int
) -> tuple[float, float, float]:
    """log psi, its standard error and the share of effective samples."""
    batch = Batch(state=START, times=times, proposals=(Proposal(lead=lead, count=count),))
    log_weight = integral.rollout(batch, seed).log_weight
    w = np.exp(log_weight - log_weight.max())
    error = float(w.std() / w.mean() / np.sqrt(count))
    return float(log_weight.max() + np.log(w.mean())), error, float(w.mean() ** 2 / (w**2).mean())


def guide_of(integral: PathIntegral, times: Array) -> LinearFeedback:
    assert isinstance(integral.guidance, DDPGuidance)
    found = best(integral.guidance, START, times, 0, straight(integral))
    assert found is not None
    assert found.valid
    return LinearFeedback(found)


@pytest.mark.thorough
def test_psi_of_a_point_in_the_wind_does_not_depend_on_its_guide_which_knows_the_wind():
    """A tape over ground, the guide, and the guide put aside; within 3 errors. 40 000 samples each, seeds 1 to 3."""
    integral = around_a_post(Balloon())
    assert not integral.proposals.climbs
    times = integral.grid(4.0)
    lead = guide_of(integral, times)
    aside = LinearFeedback(replace(lead.guide, states=lead.guide.states + 0.02, gains=0.7 * lead.guide.gains))
    tape = Tape(times, straight(integral).tape(times))
    found = [said(integral, one, times, 40_000, seed) for seed, one in enumerate((tape, lead, aside), start=1)]
    assert found[1][2] > 0.1
    assert found[1][2] > 3.0 * found[0][2]
    for i, (one, its, _) in enumerate(found):
        for other, error, _ in found[:i]:
            assert abs(one - other) < 3.0 * np.hypot(its, error)


@pytest.mark.thorough
def test_the_control_of_a_point_in_the_wind_is_the_slope_of_its_value():
    """u = -R^-1 dv/dx by differences of 0.02 m on one stream of noise, within 0.1 m/s; 20 000 samples, seed 4."""
    integral = around_a_post(Balloon(), first=0.01)
    times = integral.grid(4.0)
    lead = guide_of(integral, times)

    def at(x: Array) -> object:
        batch = Batch(state=x, times=times, proposals=(Proposal(lead=lead, count=20_000),))
        return integral.estimate(integral.rollout(batch, 4))

    slope = [(at(START + h).value - at(START - h).value) / 0.04 for h in 0.02 * np.eye(2)]
    u = -np.linalg.solve(integral.problem.control_cost(START), slope)
    middle = at(START)
    assert np.all(middle.control_error < 0.05)
    np.testing.assert_allclose(middle.control, u, atol=0.1)


def test_only_a_point_that_stands_still_and_is_shaken_alike_climbs():
    assert around_a_post(SingleIntegrator(b=0.1)).proposals.climbs
    assert around_a_post(SingleIntegrator(b=0.1)).guidance is None
