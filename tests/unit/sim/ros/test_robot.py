import os
from collections.abc import Callable, Iterator
from math import inf, nan
from pathlib import Path
from time import monotonic

import numpy as np
import pytest

from pirrht import OptionError
from pirrht.arrays import Array
from sim.cli import main
from sim.drive.metrics import Frame
from sim.ros.frames import Frames, planar
from sim.ros.graph import LATCHED, SENSOR, Graph, Quality, Subscription
from sim.ros.messages import (
    Clock,
    LaserScan,
    Message,
    OccupancyGrid,
    Odometry,
    PoseStamped,
    TFMessage,
    Twist,
    TwistStamped,
    Vector3,
)
from sim.ros.robot import Remote, Wiring
from sim.scenario import prepare
from sim.sensing.lidar import Lidar
from tests.helpers.plants import WALL, scene_file

pytestmark = pytest.mark.slow

DOMAIN = 100 + os.getpid() % 100
PERIOD = 0.1


class Link:
    """A robot in a small field with a wall to its right and ahead, and a controller in the same process."""

    def __init__(self, folder: Path, robot: str, **wiring: object) -> None:
        file = scene_file(folder, world=WALL, size=2.0, goal="-1.5 0 0")
        scenario = prepare(file, robot=robot, noise=1e-3, period=PERIOD, max_time=20.0)
        self.lines = list[str]()
        name = f"{robot}{id(self)}"
        self.graph, theirs = Graph(DOMAIN, namespace=name), Graph(DOMAIN, namespace=name)
        self.remote = Remote(
            scenario, theirs, lidar=Lidar.of("rays=19,fov=180,sigma=0"), wiring=Wiring(wait=5.0, **wiring),  # type: ignore[arg-type]
            say=self.lines.append,
        )  # fmt: skip
        stamped = self.remote.wire.wiring.stamped
        self.odom = self.graph.subscription("odom", Odometry)
        self._kind = TwistStamped if stamped else Twist
        self._commands = self.graph.publisher("cmd_vel", self._kind)
        until(lambda: self._commands.heard and self.odom.offered)
        self.frames: Iterator[Frame] = scenario.drive(self.remote.plant, self.remote)

    def drive(self, x: float, y: float, turn: float, periods: int = 1) -> Array:
        """Command speeds for some control periods; return the pose then."""
        for _ in range(periods):
            twist = Twist(Vector3(x, y), Vector3(z=turn))
            self._commands.publish(twist if self._kind is Twist else TwistStamped(twist=twist))
            frame = next(self.frames)
        return self.remote.plant._states.poses(frame.state)


def until(done: Callable[[], object], seconds: float = 5.0) -> None:
    end = monotonic() + seconds
    while not done():
        assert monotonic() < end


def last(subscription: Subscription[Message]) -> Message:
    found = list[Message]()
    until(lambda: found.extend(subscription.take()) or found)
    return found[-1]


def test_a_puck_goes_as_far_as_commands_say_then_stands(tmp_path: Path) -> None:
    link = Link(tmp_path, "puck", timeout=0.1)
    x, y, _ = link.drive(-0.5, 0.2, 0.0, periods=4)
    assert (x, y) == pytest.approx((-0.2, 0.08), abs=0.02)
    frames = [next(link.frames) for _ in range(6)]
    assert np.ptp([frame.state for frame in frames[2:]], axis=0) == pytest.approx([0.0, 0.0], abs=0.01)
    link.remote.plant.finish()
    odometry = last(link.odom)
    assert planar(odometry.pose.pose, "odom")[:2] == pytest.approx(frames[-1].state)
    assert odometry.header.stamp.seconds == pytest.approx(link.remote.plant.now)


@pytest.mark.parametrize(
    ("robot", "command"),
    [
        ("puck", (0.2, 0.3, 0.0)),
        ("diffdrive", (0.0, 0.0, 0.8)),
        pytest.param("hover", (0.2, 0.3, 0.0), marks=pytest.mark.slow),
        pytest.param("car", (0.3, 0.0, 0.5), marks=pytest.mark.slow),
        pytest.param("rover", (-0.3, 0.0, 0.5), marks=pytest.mark.slow),
    ],
)
def test_every_robot_on_the_ground_takes_speeds(tmp_path: Path, robot: str, command: tuple[float, ...]) -> None:
    link = Link(tmp_path, robot)
    link.drive(*command, periods=7)
    twist = last(link.odom).twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == pytest.approx(command, abs=0.08)


def test_commands_that_are_no_numbers_stop_the_robot_and_are_reported_once(tmp_path: Path) -> None:
    link = Link(tmp_path, "puck", stamped=True)
    link.drive(-0.5, 0.0, 0.0, periods=2)
    link.drive(nan, 0.0, 0.0)
    before = link.drive(inf, 0.0, 0.0)
    assert link.drive(0.0, 1e9, 0.0, periods=2) == pytest.approx(before, abs=0.01)
    (line,) = link.lines
    assert "nan" in line
    assert "the robot stops" in line


def test_map_scan_goal_clock_and_frames_are_those_of_the_scene(tmp_path: Path) -> None:
    link = Link(tmp_path, "diffdrive", cell=0.1)
    clock, scan = link.graph.subscription("/clock", Clock), link.graph.subscription("scan", LaserScan, SENSOR)
    tf = link.graph.subscription("/tf", TFMessage, Quality(depth=100))
    static = link.graph.subscription("/tf_static", TFMessage, LATCHED)
    known = link.graph.subscription("map", OccupancyGrid, LATCHED)
    goal = link.graph.subscription("goal_pose", PoseStamped)
    until(lambda: all(one.offered for one in (clock, scan, tf, static, goal, known)))
    x, y, yaw = link.drive(0.2, 0.0, 0.0, periods=3)

    grid = last(known)
    rows = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    middles = -2.0 + 0.1 * (np.arange(40) + 0.5)
    walls = np.flatnonzero(rows.all(axis=0))
    assert np.all((middles[walls] > 0.5) & (middles[walls] < 0.8))
    assert 1 <= len(walls) <= 3
    assert not np.delete(rows, walls, axis=1).any()

    seen = last(scan)
    assert seen.ranges[9] == pytest.approx(0.6 - x, abs=0.05)
    assert seen.ranges[0] == inf
    assert np.linspace(seen.angle_min, seen.angle_max, 19)[1] == pytest.approx(seen.angle_min + seen.angle_increment)

    frames = Frames()
    frames.hear(last(static), inf)
    frames.hear(last(tf), 0.0)
    place, _ = frames.pose("map", "laser")
    assert place == pytest.approx([x, y, yaw], abs=0.02)
    assert last(goal).pose.position.x == -1.5
    assert last(clock).clock.seconds == pytest.approx(link.remote.plant.now, abs=0.03)


def test_a_run_that_nobody_drives_ends(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "slit", "--ros", "--wait", "0.1", "--domain", str(DOMAIN), "--namespace", "alone"]) == 2
    error = capsys.readouterr().err
    assert "/alone/cmd_vel has no publisher" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(("words", "part"), [
    (("slit", "--samples", "50"), "--samples has no effect"), (("slit", "--truth"), "--truth has no effect"),
    (("slit", "--remap", "scan"), "has no :="), (("slit", "--qos", "scan=best"), "has no 'best'"),
    pytest.param(("gate",), "takes no commands", marks=pytest.mark.slow),
])  # fmt: skip
def test_options_that_others_drive_without_are_refused(
    words: tuple[str, ...], part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", *words, "--ros", "--domain", str(DOMAIN)]) == 2
    assert part in capsys.readouterr().err


def test_topics_have_other_names_and_qualities() -> None:
    graph = Graph.of(
        domain=DOMAIN, namespace="one", remap=["scan:=front/scan", "/tf:=tf"], qos=["scan=reliable,7", "/map=volatile"]
    )
    assert [graph.full(name) for name in ("scan", "/tf", "odom")] == ["/one/front/scan", "/one/tf", "/one/odom"]
    assert graph._qualities == {"/one/front/scan": Quality(depth=7), "/map": Quality()}
    with pytest.raises(OptionError, match="must be words"):
        Graph.of(domain=DOMAIN, remap=["scan:=front scan"])
