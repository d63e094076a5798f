"""Guides of any system: psi is the same whatever is followed, and far more samples count than open loop."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discs import disc, scene_of
from guides import assert_alike, psi_around, valid
from thoroughly import thorough
from wind import Balloon

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.steering.double_integrator import MassSteering
from pirrht.steering.motion import Trajectory, running_cost
from pirrht.steering.straight_line import StraightLine, Tracked
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.rover import Rover, towards_goal
from pirrht.systems.second_order_car import SecondOrderCar, cruising
from pirrht.systems.single_integrator import SingleIntegrator
from sim.mjcf import load

# -- a mass, and a car whose tree knows positions alone ----------------------------------------------------------


@cache
def in_slit(robot: str) -> tuple[FreeSpace, HomologyTree, PathIntegral]:
    """A tree in `slit`, and a sampler."""
    scene = load("slit", robot="puck").scene
    if robot == "mass":
        problem, vertices = Problem(dynamics=DoubleIntegrator(b=0.1), scene=scene, R=2 * np.eye(2)), 1000
    else:
        problem = Problem(dynamics=SecondOrderCar(b=0.1), scene=scene, R=np.eye(2), q=cruising, q_min=1.0)
        vertices = 300
    space, steering = FreeSpace.of(scene), (MassSteering if robot == "mass" else Tracked).of(problem)
    tree = HomologyTree(space, steering, limit=0.6, rng=np.random.default_rng(0))
    tree.grow(vertices)
    return space, tree, path_integral(problem, space, Sampling(dt=0.1, draws="independent", threads=1))


def times_of(integral: PathIntegral, x: Array, reference: Reference) -> Array:
    return integral.grid(running_cost(integral.problem, x, reference.trajectory))


@pytest.mark.parametrize(
    ("robot", "x"),
    [
        ("mass", (1.0, 2.5, 0.0, 0.0)), ("mass", (0.5, 0.5, 0.0, 0.0)), ("mass", (1.0, 3.5, 0.5, 0.8)),
        ("car", (1.0, 2.5, 0.0, 0.0)), thorough("car", (2.0, 4.0, -1.0, 1.0)),
    ],
)  # fmt: skip
def test_psi_does_not_depend_on_what_is_followed(robot, x):
    """Tape, guide, guide put aside with weaker gains, and tape and guide together; seeds 1, 2, ..."""
    (_, tree, integral), x, mass = in_slit(robot), np.array(x), robot == "mass"
    reference = tree.references(x)[0]
    times = times_of(integral, x, reference)
    guide = valid(integral, x, times, reference.winding, reference.trajectory)
    off, gains = ((0.02, -0.02, 0.0, 0.03), 0.7) if mass else ((0.02, -0.02, 0.05, 0.03), 0.8)
    aside = LinearFeedback(replace(guide, states=guide.states + np.array(off), gains=gains * guide.gains))
    tape, led = Tape(times, reference.trajectory.tape(times) if mass else guide.tape), LinearFeedback(guide)
    followed = [(tape,), (led,), (aside,), (tape, led)] if mass else [(led,), (aside,), (led, tape)]
    found = [
        psi_around(integral, x, times, leads, 20_000 if mass else 20_000 // len(leads), seed)
        for seed, leads in enumerate(followed, 1)
    ]
    assert_alike(found)
    assert all(error < (0.1 if mass else 0.15) for _, error, _ in found)
    assert not mass or found[1][1] < 0.01


def test_a_car_that_faces_away_is_turned_about():
    """At rest with its back to the slit: every class has a guide, none of which stays behind the start."""
    (_, tree, integral), x = in_slit("car"), np.array([1.0, 2.5, 3.0, 0.0])
    for reference in tree.references(x):
        guide = valid(integral, x, times_of(integral, x, reference), reference.winding, reference.trajectory)
        assert guide.states[guide.length, 0] > 4.5


def test_a_pace_that_the_cost_does_not_tell_must_be_declared():
    mass = in_slit("mass")[2].problem
    with pytest.raises(OptionError, match=r"cost of DoubleIntegrator does not tell how fast .* declare a pace"):
        Tracked.of(mass)
    assert Tracked.of(mass, 0.8).cost_per_meter == pytest.approx(1.0 / 0.8)  # a mass on its way needs no control
    with pytest.raises(OptionError, match="the pace of references is -1; it must be a positive number"):
        Tracked.of(mass, -1.0)


# -- a rover -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("x", [(0.0, 0.0, 3.0), (1.5, 0.9, 0.5), (2.2, 0.2, -2.0)])
def test_homing_brings_a_rover_into_the_goal_from_anywhere(x):
    """Noise 0.1, q / lambda = 50: the disc around (2, 1) of radius 0.3 within 6 s, at no more than 1 m/s.

    If it lies behind, backwards all the way.
    """
    state, a, h = np.array(x, dtype=float), np.zeros(2), 0.01
    rover, ahead = Rover(b=0.1), np.array([np.cos(x[2]), np.sin(x[2])]) @ (np.array([2.0, 1.0]) - x[:2]) > 0.0
    for _ in range(600):
        towards_goal(state, np.zeros(0), rover.B_c(state), (2.0, 1.0), 0.3, 50.0, a)
        u = rover.input_of(state, a)
        assert -1e-12 <= (u[0] if ahead else -u[0]) <= 1.0 + 1e-12
        state = rover.step(state, u, np.zeros(2), h)
        if np.hypot(state[0] - 2.0, state[1] - 1.0) < 0.3:
            return
    pytest.fail(f"still at {state}")


# -- a point in the wind -----------------------------------------------------------------------------------------

AT = np.array([0.5, 1.0])


def around_a_post(dynamics: Dynamics, **sampling: object) -> PathIntegral:
    """A sampler in a room of 3 x 2 m with a post below the way."""
    scene = scene_of([disc("post", 1.4, 0.7, 0.1)], start=AT, goal=(2.5, 1.0, 0.3), side=(3.0, 2.0))
    B = dynamics.B_c(AT)
    problem = Problem(dynamics=dynamics, scene=scene, R=0.02 * np.linalg.inv(B @ B.T))
    return path_integral(problem, FreeSpace.of(scene), Sampling(draws="independent", threads=1, **sampling))


def straight_guide(integral: PathIntegral, times: Array) -> tuple[Trajectory, DDPGuide]:
    """The reference over ground at 1 m/s to the rim of the goal, and its guide."""
    steering = StraightLine(pace=1.0, cost_rate=2.0)
    way = steering.trajectory(steering.connect(AT, np.array([2.2, 1.0])))
    way = replace(way, controls=way.controls - integral.problem.dynamics.f(AT))
    return way, valid(integral, AT, times, (0,), way)


@pytest.mark.thorough
def test_the_control_of_a_point_in_the_wind_is_the_slope_of_its_value():
    """u = -R^-1 dv/dx by differences of 0.02 m on one stream of noise, within 0.1 m/s; 20 000 samples, seed 4."""
    integral = around_a_post(Balloon(), first=0.01)
    times = integral.grid(4.0)
    lead = LinearFeedback(straight_guide(integral, times)[1])

    def at(x: Array) -> object:
        batch = Batch(state=x, times=times, proposals=(Proposal(lead=lead, count=20_000),))
        return integral.estimate(integral.rollout(batch, 4))

    slope = [(at(AT + h).value - at(AT - h).value) / 0.04 for h in 0.02 * np.eye(2)]
    middle = at(AT)
    assert np.all(middle.control_error < 0.05)
    np.testing.assert_allclose(middle.control, -np.linalg.solve(integral.problem.control_cost(AT), slope), atol=0.1)


def test_only_a_point_that_stands_still_and_is_shaken_alike_climbs():
    integral = around_a_post(SingleIntegrator(b=0.1))
    assert integral.proposals.climbs
    assert integral.guidance is None
