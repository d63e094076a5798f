"""Decisions of a node, with topics in memory and a planner whose law is known."""

from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from pirrht.errors import OptionError
from pirrht.plotting.colors import ClassColors
from sim.ros import messages as ros
from sim.ros.drawn import classes_of, samples_of
from sim.ros.frames import quaternion_of
from sim.ros.graph import Graph, Quality, checked_name
from sim.ros.node import STILL, Node, NodeOptions
from sim.ros.planning import PLANNING, SEARCHING, STARTING
from sim.ros.planning import Law as PlannedLaw

AHEAD = (0.7, 0.0, 0.2)


class Topic:
    heard = offered = False

    def __init__(self, name):
        self.name = name
        self.queue = []
        self.sent = []

    def take(self):
        taken, self.queue = self.queue, []
        return taken

    def publish(self, message):
        self.sent.append(message)


class Wire:
    def __init__(self):
        self.topics = {}

    def publisher(self, name, kind, quality=None):
        return self.topics.setdefault(name.lstrip("/"), Topic(name))

    subscription = publisher

    def troubles(self):
        return []


class Law:
    blocked = doubtful = False
    drawn = True

    def __init__(self, made):
        self.made = made

    def twist(self, pose, now):
        return AHEAD

    def figures(self):
        return {"effective samples": "99"}


class Robot:
    """A node and all that it listens to; time goes by `tick`."""

    def __init__(self, sees=False, **options):
        self.wire = Wire()
        self.work = SimpleNamespace(
            sees=sees,
            radius=0.25,
            period=0.1,
            task=None,
            law=None,
            trouble="",
            doing=PLANNING,
            since=0.0,
            poses=deque(),
            scans=deque(),
            anew=0,
        )
        self.work.begin_anew = lambda: setattr(self.work, "anew", self.work.anew + 1)
        self.said = []
        self.node = Node(self.wire, self.work, NodeOptions(**options), self.said.append)
        self.now = 100.0
        self.stamp = 5.0

    def put(self, topic, message):
        self.wire.topics[topic].queue.append(message)

    def odometry(self, x=1.0, y=1.0, yaw=0.0, frame="map", stamp=None, speed=0.0):
        stamp = self.stamp if stamp is None else stamp
        message = ros.Odometry(ros.Header(ros.Time.of(stamp), frame), "base_link")
        message.pose.pose = ros.Pose(ros.Point(x, y, 0.0), quaternion_of(yaw))
        message.twist.twist.linear.x = speed
        self.put("odom", message)

    def goal(self, x=4.0, y=1.0, frame="map"):
        self.put("goal_pose", ros.PoseStamped(ros.Header(frame_id=frame), ros.Pose(ros.Point(x, y, 0.0))))

    def map(self, width=10, height=10, data=None):
        info = ros.MapMetaData(resolution=0.5, width=width, height=height)
        self.put("map", ros.OccupancyGrid(ros.Header(frame_id="map"), info, data or [0] * 100))

    def tick(self, seconds=0.02, planned=True):
        """Let time pass; the new commands (ahead, left, turn)."""
        self.now += seconds
        self.stamp += seconds
        if planned and self.work.task is not None:
            self.work.law = Law(self.now)
        before = len(self.wire.topics["cmd_vel"].sent)
        self.node.step(self.now)
        twists = [getattr(one, "twist", one) for one in self.wire.topics["cmd_vel"].sent[before:]]
        return [(one.linear.x, one.linear.y, one.angular.z) for one in twists]

    @property
    def status(self):
        return self.wire.topics["diagnostics"].sent[-1].status[0]


@pytest.fixture
def driving():
    robot = Robot()
    robot.map()
    robot.goal()
    robot.odometry()
    robot.tick()
    robot.odometry()
    assert robot.tick() == [AHEAD]
    return robot


def test_every_pose_is_answered_by_one_command_while_there_is_a_plan(driving):
    for _ in range(5):
        driving.odometry()
        assert driving.tick() == [AHEAD]
        assert driving.tick(0.001) == []
    assert driving.status.message == "driving"


def test_what_is_missing_is_named_and_nothing_is_commanded():
    robot = Robot()
    assert robot.tick() == []
    assert robot.status.message == "no message on odom: nobody publishes"
    robot.odometry()
    robot.tick()
    assert robot.status.message == "no message on map: nobody publishes"
    robot.map()
    robot.odometry()
    robot.tick()
    assert robot.status.message == "no goal"


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda r: r.odometry(x=np.nan), "the odometry is at nan"),
        (lambda r: r.odometry(speed=np.inf), "a velocity of the odometry"),
        (lambda r: r.odometry(frame="odom"), "no transforms join odom to map"),
        (lambda r: r.odometry(stamp=1.0), "time goes backwards, from 5.020 to 1.000 s"),
        (lambda r: (r.map(40_000, 25_000), r.odometry()), "40000 x 25000 cells"),
        (lambda r: (r.goal(x=np.nan), r.odometry()), "the goal is at nan"),
        (lambda r: (r.goal(frame="dock"), r.odometry()), "no transforms join dock to map"),
    ],
)
def test_bad_input_stops_the_robot_with_one_diagnostic_until_a_right_message_comes(driving, wrong, why):
    wrong(driving)
    assert driving.tick() == [(0.0, 0.0, 0.0)]
    assert why in driving.status.message
    assert driving.status.level == 2
    assert sum(why in line for line in driving.said) == 1
    driving.map()
    driving.goal()
    driving.stamp = 50.0
    driving.odometry()
    driving.tick()
    driving.odometry()
    assert driving.tick() == [AHEAD]


def test_time_that_goes_backwards_begins_the_run_anew(driving):
    driving.odometry(stamp=1.0)
    driving.tick()
    assert driving.work.anew == 1


def test_late_odometry_stops_the_robot_and_then_the_topic_is_left_to_others(driving):
    assert driving.tick(0.4) == []
    assert driving.tick(0.11) == [(0.0, 0.0, 0.0)]
    assert driving.status.message == "odometry is late"
    assert driving.tick(0.5 * STILL) == [(0.0, 0.0, 0.0)]
    assert driving.tick(STILL) == []


def test_a_plan_that_is_late_stops_the_robot(driving):
    for _ in range(4):
        driving.odometry()
        assert driving.tick(0.14, planned=False) == [AHEAD]
    driving.odometry()
    assert driving.tick(0.14, planned=False) == [(0.0, 0.0, 0.0)]
    assert driving.status.message.startswith("plans are late: they take longer than 0.6 s; raise --period")


def test_a_blocked_plan_stops_the_robot(driving):
    driving.work.law.blocked = True
    driving.odometry()
    assert driving.tick(planned=False) == [(0.0, 0.0, 0.0)]
    assert driving.status.message == "blocked: no way is free"


def test_a_goal_that_is_withdrawn_stops_the_robot(driving):
    driving.put("pirrht/cancel", ros.Empty())
    driving.odometry()
    assert driving.tick() == [(0.0, 0.0, 0.0)]
    assert driving.work.task is None
    assert driving.status.message == "no goal"


def test_trouble_of_the_planner_stops_the_robot_and_is_what_diagnostics_say(driving):
    driving.work.law = None
    driving.work.trouble = "the goal lies in a wall"
    driving.odometry()
    assert driving.tick(planned=False) == [(0.0, 0.0, 0.0)]
    assert driving.status.message == "the goal lies in a wall"


def test_in_the_goal_the_robot_stands_and_a_goal_that_is_said_again_changes_nothing(driving):
    driving.odometry(x=3.8)
    assert driving.tick() == [(0.0, 0.0, 0.0)]
    assert driving.node.arrived == 1
    driving.goal()
    driving.odometry(x=3.8)
    driving.tick()
    assert driving.node.arrived == 1
    driving.goal(x=2.0)
    driving.odometry(x=3.8)
    driving.tick()
    driving.odometry(x=3.8)
    assert driving.tick() == [AHEAD]


def test_a_robot_that_has_arrived_has_until_there_is_another_goal(driving):
    driving.odometry(x=3.8)
    driving.tick()
    driving.tick(1.0)
    assert driving.status.message == "arrived"
    driving.goal(x=2.0)
    driving.tick(1.0)
    assert driving.status.message == "odometry is late"


def test_diagnostics_warn_of_a_plan_that_rests_on_few_effective_samples(driving):
    driving.work.law.doubtful = True
    driving.work.law.made = driving.now + 1.0
    driving.odometry()
    assert driving.tick(1.1, planned=False) == [AHEAD]
    assert (driving.status.level, driving.status.message) == (1, "driving, few effective samples")


@pytest.mark.parametrize("doing", [STARTING, SEARCHING])
def test_diagnostics_tell_for_how_long_a_robot_stands_for_compiling_or_a_search(doing):
    robot = Robot()
    robot.work.doing = doing
    robot.map()
    robot.goal()
    robot.odometry()
    robot.tick(planned=False)
    assert robot.status.message.startswith(f"{doing}, ")
    assert robot.status.level == 1
    assert doing in robot.said


def test_frames_without_a_name_are_refused():
    with pytest.raises(OptionError, match="the usual ones are map and base_link"):
        NodeOptions(map_frame="")


def test_a_map_that_is_late_stops_the_robot_if_that_is_asked_for():
    robot = Robot(map_late=0.3)
    robot.map()
    robot.goal()
    for _ in range(3):
        robot.odometry()
        robot.tick(0.1)
    assert robot.status.message == "driving"
    robot.odometry()
    robot.tick(0.15)
    assert robot.status.message == "the map is late"


def test_a_robot_with_a_lidar_needs_scans_and_sees_where_its_frame_is():
    robot = Robot(sees=True)
    turned = ros.Transform(ros.Vector3(0.3, 0.0, 0.0), quaternion_of(np.pi / 2))
    robot.put("tf_static", ros.TFMessage([ros.TransformStamped(ros.Header(frame_id="base_link"), "laser", turned)]))
    base = ros.Transform(ros.Vector3(1.0, 1.0, 0.0), quaternion_of(0.0))
    robot.put("tf", ros.TFMessage([ros.TransformStamped(ros.Header(frame_id="map"), "base_link", base)]))
    scan = ros.LaserScan(
        ros.Header(frame_id="laser"), angle_min=-1.0, angle_increment=0.5, range_min=0.1, range_max=5.0,
        ranges=[2.0, 6.0, float("nan"), 0.05, float("inf")],
    )  # fmt: skip
    robot.put("scan", scan)
    robot.goal()
    robot.odometry()
    robot.tick()
    (seen,) = robot.work.scans
    np.testing.assert_allclose(seen.pose, [1.3, 1.0, np.pi / 2], atol=1e-9)
    assert seen.ranges.tolist() == [2.0, np.inf, -np.inf, -np.inf, np.inf]
    assert seen.time == pytest.approx(robot.now)
    robot.odometry()
    assert robot.tick() == [AHEAD]
    robot.odometry()
    assert robot.tick(0.6) == [(0.0, 0.0, 0.0)]
    assert robot.status.message == "scans are late"


def test_a_ring_of_rays_that_begins_ahead_is_one_view_ahead():
    robot = Robot(sees=True)
    base = ros.Transform(ros.Vector3(1.0, 1.0, 0.0), quaternion_of(0.0))
    robot.put("tf", ros.TFMessage([ros.TransformStamped(ros.Header(frame_id="map"), "base_link", base)]))
    ranges = [1.0 + 0.001 * k for k in range(360)]
    one_degree = np.radians(1.0)
    ring = ros.LaserScan(
        ros.Header(frame_id="base_link"), angle_min=0.0, angle_increment=one_degree, range_max=5.0, ranges=ranges
    )
    robot.put("scan", ring)
    robot.goal()
    robot.odometry()
    robot.tick()
    (seen,) = robot.work.scans
    np.testing.assert_allclose(seen.angles, np.arange(-180, 180) * one_degree, atol=1e-9)
    np.testing.assert_allclose(seen.ranges, [*ranges[180:], *ranges[:180]])


def test_commands_are_slowed_down_along_the_same_arc():
    robot = Robot(max_speed=0.35, stamped=True)
    robot.map()
    robot.goal()
    robot.odometry()
    robot.tick()
    robot.odometry()
    ((ahead, _, turn),) = robot.tick()
    assert (ahead, turn) == pytest.approx((0.35, 0.1))


def test_the_pose_may_come_by_transforms_alone():
    robot = Robot(pose_from="tf")
    robot.map()
    robot.goal()
    for x in (1.0, 1.1):
        at = ros.Transform(ros.Vector3(x, 1.0, 0.0), quaternion_of(0.0))
        robot.put("tf", ros.TFMessage([ros.TransformStamped(ros.Header(frame_id="map"), "base_link", at)]))
        robot.tick(0.1)
    assert robot.work.poses[-1].velocity.tolist() == pytest.approx([1.0, 0.0, 0.0])
    assert robot.tick(0.6) == [(0.0, 0.0, 0.0)]


@pytest.mark.parametrize("text", ["reliable,0", "sometimes", ""])
def test_a_quality_that_is_none_is_refused(text):
    with pytest.raises(OptionError, match="a quality of service has no"):
        Quality.of(text)


def test_the_text_of_a_quality_says_what_differs():
    assert Quality.of("best-effort,latched,5") == Quality(reliable=False, latched=True, depth=5)


@pytest.mark.parametrize("name", ["a b", "1a", "a//b", "a/", "", "ä"])
def test_a_name_that_ros_does_not_allow_is_refused(name):
    with pytest.raises(OptionError, match="letters, digits and _"):
        checked_name(name, "the topic")


def test_names_without_a_slash_in_front_are_in_the_namespace_and_no_interface_is_no_graph():
    graph = Graph(101, namespace="robot1")
    assert graph.full("cmd_vel") == "/robot1/cmd_vel"
    assert graph.full("/tf") == "/tf"
    with pytest.raises(OptionError, match="no DDS on the interface nowhere0"):
        Graph(102, interface="nowhere0")


def test_an_interface_that_is_none_is_answered_by_those_that_there_are():
    with pytest.raises(OptionError, match=r"name one of .*\blo\b"):
        Graph(103, interface="nowhere0")


@pytest.mark.parametrize("known", [{"remap": {"scn": "front"}}, {"qualities": {"scn": Quality()}}])
def test_another_name_or_quality_of_a_topic_that_is_none_is_refused_with_those_that_are(known):
    graph = Graph(101, **known)
    graph.subscription("scan", ros.LaserScan)
    with pytest.raises(OptionError, match="there is no topic /scn; topics are /scan"):
        graph.check()


def test_topics_with_another_name_and_quality_pass():
    graph = Graph(101, remap={"scan": "front/scan"}, qualities={"scan": Quality()})
    graph.subscription("scan", ros.LaserScan)
    graph.check()


def test_a_peer_that_is_no_address_is_refused():
    with pytest.raises(OptionError, match="--peer 'not an address' is no address"):
        Graph(104, peers=["not an address"])


def test_what_is_drawn_of_a_plan_is_taken_back_when_there_is_none(driving):
    driving.work.law.drawn = False
    driving.work.law.plan = SimpleNamespace(favourite=None, ids=())
    driving.odometry()
    driving.tick(planned=False)
    driving.work.law = None
    driving.odometry()
    driving.tick(planned=False)
    assert [path.poses for path in driving.wire.topics["plan"].sent] == [[]]
    for topic in ("pirrht/classes", "pirrht/samples"):
        assert [[one.action for one in array.markers] for array in driving.wire.topics[topic].sent] == [
            [ros.DELETE_ALL]
        ]


def test_the_heaviest_samples_are_drawn_as_such_where_none_has_died():
    paths = [np.zeros((3, 2))]
    both = SimpleNamespace(heaviest=lambda count: iter([(paths, np.zeros(1)), (paths, np.ones(1))]))
    alone = SimpleNamespace(heaviest=lambda count: iter([(paths, np.ones(1))]))
    *_, heaviest = samples_of(both, 5, ros.Header()).markers
    assert samples_of(alone, 5, ros.Header()).markers[1:] == [heaviest]


def test_names_of_classes_without_weight_are_readable_and_lines_lie_above_the_map():
    path = SimpleNamespace(trajectory=SimpleNamespace(points=np.arange(40.0).reshape(20, 2)))
    plan = SimpleNamespace(ids=("0,1", "1,0"), references=(path, path), weights=lambda: {"0,1": 1.0})
    _, *markers = classes_of(plan, ClassColors(), ros.Header()).markers
    lines = [one for one in markers if one.ns == "classes"]
    names = [one for one in markers if one.ns == "names"]
    assert [one.color.a for one in names] == [1.0, 1.0]
    assert names[0].pose.position != names[1].pose.position
    assert lines[1].color.a < lines[0].color.a == 1.0
    assert all(point.z > 0.0 for line in lines for point in line.points)


@pytest.mark.parametrize(("name", "shown"), [("0,0,0,0,1", "+5"), (None, "-")])
def test_diagnostics_name_a_class_as_the_markers_do(name, shown):
    plan = SimpleNamespace(favourite=name, fallback=None, estimate=None)
    assert PlannedLaw(plan, None, 0.0, 0.0, 0.0).figures()["class"] == shown
