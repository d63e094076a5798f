"""Laws as commands, and what a planner makes of maps, goals and scans."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from pirrht.errors import OptionError, PirrhtError
from pirrht.mapping.scan import Scan
from pirrht.systems.double_integrator import DoubleIntegrator
from pirrht.systems.rover import Rover
from pirrht.systems.second_order_car import SecondOrderCar
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from sim.ros import planning
from sim.ros.grids import Grid
from sim.ros.planning import PLANNING, SEARCHING, SOON, STARTING, Law, Pose, Task, Work
from sim.scenario.risk import RiskSearch

PLACE = np.array([1.0, 2.0, 0.6])
VELOCITY = np.array([0.5, 0.1, 0.3])


def commanded(dynamics, u, place=PLACE):
    scenario = SimpleNamespace(
        problem=SimpleNamespace(dynamics=dynamics), system=SimpleNamespace(states=dynamics.states)
    )
    plan = SimpleNamespace(at=lambda x, s: np.array(u))
    return Law(plan, scenario, 0.0, 0.0, 0.0).twist(Pose(place, VELOCITY, 0.0, 0.0), 0.1)


def test_speed_and_turn_rate_of_a_rover_or_a_unicycle_are_commanded_as_they_are():
    assert commanded(Rover(), (-0.4, 0.7)) == pytest.approx((-0.4, 0.0, 0.7), abs=1e-6)
    assert commanded(Unicycle(V=0.8, rho=0.5), (0.3,)) == pytest.approx((0.8, 0.0, 0.6), abs=1e-6)


def test_the_velocity_of_a_point_is_turned_into_the_frame_of_the_body():
    ahead, left, turn = commanded(SingleIntegrator(), (0.3, 0.4))
    assert (ahead * np.cos(0.6) - left * np.sin(0.6), ahead * np.sin(0.6) + left * np.cos(0.6)) == pytest.approx(
        (0.3, 0.4)
    )
    assert turn == 0.0


def test_accelerations_are_commanded_as_the_velocity_that_is_reached_soon():
    c, s = np.cos(0.6), np.sin(0.6)
    own = np.array([0.5 * c - 0.1 * s, 0.5 * s + 0.1 * c])
    ahead, left, _ = commanded(DoubleIntegrator(), (1.0, -2.0))
    world = np.array([c * ahead - s * left, s * ahead + c * left])
    np.testing.assert_allclose(world, own + SOON * np.array([1.0, -2.0]), atol=1e-9)

    car = SecondOrderCar()
    rates = car.rate(np.append(PLACE, 0.5), np.array([0.2, 0.6]), np.zeros(2), SOON)
    assert commanded(car, (0.2, 0.6)) == pytest.approx((0.5 + SOON * rates[1], 0.0, rates[0]), rel=1e-6)


def test_a_run_that_begins_anew_keeps_nothing_of_the_scene_before():
    work = Work({}, 0.25, None, print)
    before = []

    def prepare(task):
        before.append(work._built)
        work._built = task

    work._prepare = prepare
    work._planned = lambda began: SimpleNamespace(plan=None)
    work._risk = lambda plan: None
    work.poses.append(Pose(PLACE, VELOCITY, 0.0, 1.0))
    work.task = Task(np.array([4.0, 1.0, 0.25]), None)
    work.start()
    for runs in (1, 2):
        end = time.monotonic() + 5.0
        while len(before) < runs and time.monotonic() < end:
            time.sleep(0.01)
        work.begin_anew()
    work.end()
    assert before[:2] == [None, None]


def test_states_are_read_by_their_names_and_unknown_ones_are_refused():
    pose = Pose(PLACE, VELOCITY, 0.0, 0.0)
    assert pose.state(("x", "y", "heading", "speed")).tolist() == [1.0, 2.0, 0.6, 0.5]
    with pytest.raises(OptionError, match="odometry does not tell the states charge"):
        pose.state(("x", "charge"))


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"robot": "dffdrive"}, "did you mean diffdrive"),
        ({"robot": "rover", "footprint": "banana"}, "--footprint is 'banana'"),
        ({"robot": "puck", "risk": 0.1, "phi": -1.0}, "phi"),
        ({"robot": "diffdrive", "method": "passive"}, "--method passive knows no path"),
        ({"robot": "diffdrive", "sense": "lidar", "risk": 0.1}, "leave it out with --sense lidar"),
        ({"robot": "ball"}, "ball does not drive on the ground; choose --robot .*rover, .*or an MJCF file"),
    ],
)
def test_options_that_no_goal_can_be_reached_with_are_refused_before_there_is_one(given, why):
    with pytest.raises(PirrhtError, match=why):
        Work(given, 0.25, None, print).check()


def test_options_of_a_robot_are_checked_without_a_search_for_its_margin():
    Work({"robot": "diffdrive", "risk": 0.05, "footprint": "turtlebot4"}, 0.25, None, print).check()


def test_kernels_are_compiled_before_a_node_is_ready_and_goals_wait_meanwhile(monkeypatch):
    said = []
    seen = []
    work = Work({}, 0.25, None, said.append)
    monkeypatch.setattr(planning, "rehearse", lambda scenario, driving: seen.append((work.doing, [*said])))
    work._prepare = lambda task: seen.append((work.doing, [*said])) or setattr(work, "_ended", True)
    work.check()
    work.poses.append(Pose(PLACE, VELOCITY, 0.0, 1.0))
    work.task = Task(np.array([4.0, 1.0, 0.25]), None)
    work.start()
    work._thread.join(5.0)
    assert seen == [(STARTING, []), (PLANNING, ["ready"])]


def test_another_goal_ends_the_search_for_a_margin_before_the_next_candidate(monkeypatch):
    tried = []
    work = Work({"robot": "diffdrive", "risk": 0.05}, 0.25, None, print)

    def planned(search, margin):
        tried.append((work.doing, margin))
        work.task = None
        return search.at(margin)

    monkeypatch.setattr(RiskSearch, "_planned", planned)
    work.poses.append(Pose(PLACE, VELOCITY, 0.0, 1.0))
    work.task = Task(np.array([4.0, 1.0, 0.25]), None)
    work.start()
    end = time.monotonic() + 5.0
    while not tried and time.monotonic() < end:
        time.sleep(0.01)
    work.end()
    assert tried == [(SEARCHING, 0.0)]
    assert work.trouble == ""


def test_the_first_plan_of_a_goal_keeps_its_guides_for_the_next(monkeypatch):
    called = []
    driver = SimpleNamespace(
        begin=lambda x: called.append("begin"), plan=lambda x: called.append("plan"),
        observe=lambda x, duration: called.append(f"observe for {duration:g} s"),
    )  # fmt: skip
    settings = SimpleNamespace(method="mppi")
    scenario = SimpleNamespace(settings=settings, driver=lambda tree: driver)
    work = Work({}, 0.25, None, print)
    work._entered = lambda task, pose: scenario
    work._state = lambda pose: pose.place
    work.poses.append(Pose(PLACE, VELOCITY, 0.0, 1.0))
    work.trouble = "the goal before lies in a wall"
    work._prepare(Task(np.array([4.0, 1.0, 0.25]), None))
    assert called == ["begin", "plan", "observe for 0 s"]
    assert work.trouble == ""


def test_scans_are_on_the_clock_of_the_run_by_which_moving_obstacles_are_predicted(monkeypatch):
    seen = []
    begun = SimpleNamespace(
        begin=lambda x: None, see=lambda scan: seen.append(scan.time), observe=lambda states, duration: None,
        plan=lambda x, left: SimpleNamespace(),
    )  # fmt: skip
    monkeypatch.setattr(planning, "Mapped", SimpleNamespace)
    work = Work({"sense": "lidar"}, 0.25, None, print)
    work._driver = begun
    work._scenario = SimpleNamespace()
    work._state = lambda pose: pose.place
    work._begin(Pose(PLACE, VELOCITY, 70.0, 1000.0))
    work.scans.append(Scan(pose=PLACE, angles=np.zeros(1), ranges=np.ones(1), most=9.0, time=1000.5))
    work._planned(time.monotonic())
    assert seen == [0.5]


def test_a_robot_on_a_wall_of_the_map_is_to_be_driven_off():
    walls = np.zeros((40, 40), bool)
    walls[18:23, 18:23] = True
    task = Task(np.array([3.5, 3.5, 0.25]), Grid(walls=walls, lower=np.zeros(2), cell=0.1))
    at = Pose(np.array([2.05, 2.05, 0.0]), np.zeros(3), 0.0, 0.0)
    with pytest.raises(PirrhtError, match=r"touches .*; drive the robot off it"):
        Work({"robot": "diffdrive"}, 0.25, None, print)._entered(task, at)
