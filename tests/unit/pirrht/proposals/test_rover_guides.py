"""Guides of a rover: tried again at other paces, of the best speed all the way, and priced to the goal along a line."""

import copy
import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from corners import BOX, START, cheapest, controller

from pirrht import Controller, FreeSpace, Problem, Sampling, Scene, path_integral
from pirrht.geometry.disc import DISC
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import Course, DDPGuide, empty_course
from pirrht.rollouts.cpu import kind_of
from pirrht.systems.dynamics import Dynamics, no_drift

FAR_OFF = (-0.95, -1.95, -0.9, -1.9)  # a box that no path meets
BEHIND = (2.4, -1.0, 2.5, 0.5)
GOAL, RADIUS, DT = np.array([3.0, -0.35]), 0.3, 0.1


@cache
def made(*boxes: tuple[float, ...]) -> Controller:
    return controller(None, *boxes)


def asked(one: Controller) -> float:
    """|a| under which control costs what time does; along a path of free duration the Hamiltonian vanishes there."""
    return math.sqrt(2.0 * one.problem.least_rate / one.problem.temperature)


def course_of(guide: DDPGuide) -> Course:
    law = guide.gains, guide.share, guide.inverse, guide.volume
    return Course(guide.states, guide.modes, *law, guide.modes, guide.states[:, :2])


def test_a_course_at_its_own_pace_is_itself():
    one = made(BOX)
    guide = cheapest(one, START)
    course = course_of(guide)
    again, length = one.path_integral.guidance.starts.retimed(course, guide.length, guide.times, guide.times)
    assert length == guide.length
    for name in ("states", "control", "gains"):
        np.testing.assert_allclose(getattr(again, name), getattr(course, name), rtol=1e-12, atol=1e-12)


def test_a_straight_course_at_twice_the_pace_takes_half_the_steps():
    one = made(FAR_OFF)
    guide = cheapest(one, np.array([0.0, -0.35, 0.0]))
    guidance = one.path_integral.guidance
    fast, length = guidance.starts.retimed(course_of(guide), guide.length, guide.times, guide.times, pace=2.0)
    assert length == math.ceil(guide.length / 2)
    np.testing.assert_allclose(fast.states[: length + 1], guide.states[: 2 * length + 1 : 2], atol=1e-12)
    query = guidance.query(guide.states[0], guide.times, 0)
    arrived, *_ = guidance.optimise(query.setup, query.classes, guidance.tasks[1.0], query.clock, 0, 0, fast, length)
    assert abs(arrived - guide.length / 2) <= 1.0


def test_past_corners_a_guide_drives_at_the_best_speed():
    """Without other paces one of the two classes is up to 5 % slower."""
    one = made(BOX, BEHIND)
    cheapest(one, START)
    guides = [optima[0] for optima in one.run.starts.optima.values()]
    assert len(guides) == 2
    for guide in guides:
        np.testing.assert_allclose(np.hypot(*guide.modes[: guide.length].T) / asked(one), 1.0, atol=0.02)


@pytest.mark.parametrize("boxes", [(BOX,), (BOX, BEHIND), ((0.6, -1.5, 0.9, 0.0), (1.5, -0.2, 1.8, 1.5))])
def test_no_guide_costs_more_for_being_tried_at_other_paces(boxes):
    one = made(*boxes)
    assert one.tree is not None
    guidance, times = one.path_integral.guidance, 0.1 * np.arange(90)
    without = copy.copy(guidance)
    without.tuning = guidance.tuning._replace(paces=())
    gained = []
    for reference in one.tree.references(START):
        query = guidance.query(START, times, one.space.homology.key(reference.winding))
        before, after = (best.optima(query, reference.trajectory)[0] for best in (without, guidance))
        assert isinstance(guidance, DDPGuidance)
        assert before.valid
        assert after.valid
        assert after.penalised <= before.penalised
        gained.append(before.penalised - after.penalised)
        warm = guidance.optima(query, reference.trajectory, [before], paces=guidance.tuning.paces)[0]
        assert warm.penalised <= before.penalised
    assert max(gained) > one.problem.temperature or boxes == (BOX,)


def priced(x: np.ndarray, speed: float) -> tuple[int, float]:
    """Steps that end outside the goal, and cost to its rim, straight on at a share of the best speed."""
    one = made(BOX)
    integral, T = one.path_integral, 20
    course, tried = empty_course(T, 3, 2), empty_course(T, 3, 2)
    course.control[:, 0] = speed * asked(one)
    course.states[:] = tried.states[0] = x
    forward = forward_pass(kind_of(one.problem, DISC, integral.setup.world.moving.kernels)).forward
    steps, cost, _ = forward(
        integral.setup, integral.guidance.tasks[1.0], DT * np.arange(T + 1), course, T, 0.0, 4, tried
    )
    return steps, cost


def ahead_of_goal(distance: float, off: float, heading: float) -> np.ndarray:
    """A state so far before the rim along its heading, on a line that passes the goal's centre `off` to its side."""
    along, across = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    return np.array([*(GOAL + off * across - (distance + math.sqrt(RADIUS**2 - off**2)) * along), heading])


@pytest.mark.parametrize("off", [0.0, 0.1, -0.2, 0.28])
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_the_rest_to_the_goal_costs_as_much_as_the_way_there_along_the_line(off, heading):
    far = made(BOX).path_integral.guidance.tasks[1.0].far
    for distance in (0.03, 0.099, 0.55, 0.95):  # the first two are all rest
        steps, cost = priced(ahead_of_goal(distance, off, heading), 1.0)
        assert steps == int(distance / DT)
        assert cost == pytest.approx(far * distance, rel=1e-9)


@pytest.mark.parametrize("off", [0.0, 0.2, 0.28])
@pytest.mark.parametrize("speed", [0.8, 1.0, 1.2])
def test_the_cost_hardly_jumps_as_the_last_step_slides_over_the_rim(off, speed):
    """The jump is that of a step at another than the best speed: second order in the difference."""
    sides = [priced(ahead_of_goal(5 * DT * speed + shift, off, 0.0), speed) for shift in (-1e-7, 1e-7)]
    (few, below), (more, above) = sides
    assert (few, more) == (4, 5)
    assert above - below == pytest.approx((speed - 1.0) ** 2 * DT, abs=1e-6)


@dataclass(frozen=True, eq=False)
class Rail(Dynamics):
    """A point on an oblique rail that carries an arm: constant inputs, of which one moves the position."""

    n = 3
    m = 2
    states = ("x", "y", "arm")
    parameters = np.zeros(0)
    drift = staticmethod(no_drift)
    input_matrix = np.array([[1.0, 0.0], [0.5, 0.0], [0.0, 1.0]])
    input_noise = 0.1 * np.eye(2)


def test_the_rest_to_the_goal_leads_along_a_line_that_never_turns():
    scene = Scene.from_boxes([], lower=(0, 0), upper=(5, 4), start=(0.6, 0.8), goal=(3.6, 2.3, 0.3), robot_radius=0.2)
    problem = Problem(dynamics=Rail(), scene=scene, R=2.0 * np.eye(2))
    kind = kind_of(problem, DISC)
    assert kind.along_line
    assert kind.diffusion_block is None
    setup = path_integral(problem, FreeSpace.of(scene), Sampling(samples=10)).setup
    slope = np.zeros(3)
    forward_pass(kind).expand_end(setup, 2.0, np.array([3.0, 2.0, 0.0]), slope, np.zeros((3, 3)))
    np.testing.assert_allclose(slope, [-4.0 / np.sqrt(5.0), -2.0 / np.sqrt(5.0), 0.0], atol=1e-6)
