"""A planner and a simulated robot, each a process of its own, over loopback; either may pause or die."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.slow
DOMAIN = 110 + os.getpid() % 100
ROBOT = ("--robot", "diffdrive", "--domain", str(DOMAIN))


@pytest.fixture
def started(tmp_path):
    """Start a command of pirrht; its output goes to a file."""
    running = []

    def start(*words):
        file = tmp_path / f"{words[0]}.txt"
        with file.open("w") as stream:
            process = subprocess.Popen([sys.executable, "-m", "sim.cli", *words], stdout=stream, stderr=stream)
        process.said = lambda: file.read_text()
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.wait()


def until(process, words, seconds=120.0):
    end = time.monotonic() + seconds
    while words not in process.said():
        assert process.poll() is None, process.said()
        assert time.monotonic() < end, process.said()
        time.sleep(0.05)


def test_a_planner_drives_a_robot_over_the_wire_to_its_goal(started, tmp_path):
    node = started("ros", *ROBOT, "--once")
    robot = started("run", "house", "--ros", *ROBOT, "--json", str(tmp_path / "run.json"))
    assert robot.wait(150) == 0, robot.said()
    assert node.wait(20) == 0, node.said()
    assert json.loads((tmp_path / "run.json").read_text())["outcome"] == "goal"
    assert "arrived" in node.said()


def test_after_a_pause_of_two_seconds_the_planner_drives_on(started):
    node = started("ros", *ROBOT, "--once")
    robot = started("run", "house", "--ros", *ROBOT)
    until(node, "driving")
    time.sleep(1.0)
    robot.send_signal(signal.SIGSTOP)
    time.sleep(2.0)
    assert "odometry is late" in node.said()
    robot.send_signal(signal.SIGCONT)
    assert robot.wait(150) == 0, robot.said()
    assert "the clock stood still for 0.00 s" not in robot.said()


def test_a_robot_whose_planner_is_killed_stands_still_and_the_next_planner_takes_it_to_the_goal(started):
    node = started("ros", *ROBOT)
    robot = started("run", "house", "--ros", *ROBOT, "--max-time", "90")
    until(node, "driving")
    time.sleep(1.0)
    node.kill()
    time.sleep(2.0)
    assert robot.poll() is None, robot.said()
    another = started("ros", *ROBOT, "--once")
    until(another, "no goal")
    goal = [sys.executable, "-c", GOAL.format(domain=DOMAIN)]
    assert subprocess.run(goal, timeout=60, check=False).returncode == 0
    assert robot.wait(150) == 0, robot.said() + another.said()


def test_a_planner_whose_robot_is_killed_says_that_odometry_is_late_and_ends_by_a_signal(started):
    node = started("ros", *ROBOT)
    robot = started("run", "house", "--ros", *ROBOT)
    until(node, "driving")
    robot.kill()
    until(node, "odometry is late", 5.0)
    node.send_signal(signal.SIGINT)
    assert node.wait(20) == 130
    assert "interrupted" in node.said()


GOAL = """
import time
from sim.ros.graph import Graph
from sim.ros.messages import Header, Point, Pose, PoseStamped
graph = Graph({domain})
goal = graph.publisher("goal_pose", PoseStamped)
while not goal.heard:
    time.sleep(0.05)
time.sleep(0.5)
goal.publish(PoseStamped(Header(frame_id="map"), Pose(Point(8.3, 3.85, 0.0))))
time.sleep(0.5)
"""
