"""A planner as a node of a ROS 2 graph: map or scans, odometry and a goal come in, velocities go out.

The node answers every pose with a command at once, by the law of the last plan; plans are made on a thread of their
own (`sim.ros.planning`). Whatever is missing, late or wrong stops the robot, and one diagnostic says what it is.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot, inf, pi, remainder, tau
from typing import Any

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import OptionError, PirrhtError
from pirrht.mapping.scan import Scan
from pirrht.plotting.colors import ClassColors
from sim.drive.episode import undisturbed
from sim.ros import messages as ros
from sim.ros.drawn import classes_of, path_of, samples_of
from sim.ros.frames import Frames, composed, planar
from sim.ros.graph import LATCHED, RELIABLE, SENSOR, Graph, Quality, Subscription
from sim.ros.grids import Grid
from sim.ros.planning import PLANNING, STARTING, Law, Pose, Task, Work

TICK = 0.02  # between two looks at what is late [s]
STILL = 1.0  # for which a robot that shall stand is commanded to [s]
SHOWN = 0.2  # between two drawings of a plan [s]
SAID = 1.0  # between two diagnostics without news [s]
FRAMES = Quality(depth=100)
OK, WARNING, ERROR = 0, 1, 2
FINE = ("driving", "no goal", "arrived", PLANNING)


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeOptions:
    """What a node listens to, and when it stops the robot."""

    map_frame: str = "map"
    base_frame: str = "base_link"
    pose_from: str = "odom"  # odom: odometry and the frame it is in; tf: the base frame alone
    stamped: bool = False  # whether commands are TwistStamped
    late: float = 0.5  # age of odometry, scans and plans from which on the robot stops [s]
    map_late: float = 0.0  # age of the map; 0: a map is for ever [s]
    max_speed: float = inf  # [m/s]
    max_turn: float = inf  # [rad/s]
    samples_drawn: int = 30  # paths of each kind

    def __post_init__(self) -> None:
        if not (self.map_frame and self.base_frame):
            raise OptionError("--map-frame or --base-frame has no name; the usual ones are map and base_link")


class Node:
    """Drives a robot to goals that others name.

    Args:
        graph: where its topics are.
        work: makes plans; started and ended by this node.
        options: frames, limits and times.
        say: takes a line for a person whenever something changes.
    """

    def __init__(self, graph: Graph, work: Work, options: NodeOptions, say: Callable[[str], object]) -> None:
        self.graph = graph
        self.work = work
        self.options = options
        self.say = say
        self.latencies = list[float]()  # from a pose to its command [s]
        self.arrived = 0  # goals

        self._frames = Frames()
        self._pose: Pose | None = None
        self._goal: Array | None = None
        self._grid: Grid | None = None
        self._map_came = -inf
        self._scan_came = -inf
        self._ahead: float | None = None  # this machine's clock of that of scans [s]
        self._wrong = dict[str, str]()  # what is wrong, by the topic it came with
        self._status = ""
        self._moving = False
        self._stopped = -inf  # when the robot was first commanded to stand [s]
        self._colors = ClassColors()
        self._drawn = -inf
        self._reported = -inf
        self._arrived_at: Array | None = None

        senses = work.sees
        self._map = None if senses else graph.subscription("map", ros.OccupancyGrid, LATCHED)
        self._scans = graph.subscription("scan", ros.LaserScan, SENSOR) if senses else None
        self._odometry = graph.subscription("odom", ros.Odometry, SENSOR)
        self._goals = graph.subscription("goal_pose", ros.PoseStamped, RELIABLE)
        self._cancels = graph.subscription("pirrht/cancel", ros.Empty, RELIABLE)
        self._tf = graph.subscription("/tf", ros.TFMessage, FRAMES)
        self._tf_static = graph.subscription("/tf_static", ros.TFMessage, replace(FRAMES, latched=True))
        self._commands = graph.publisher("cmd_vel", ros.Twist) if not options.stamped else None
        self._stamped = graph.publisher("cmd_vel", ros.TwistStamped) if options.stamped else None
        self._plans = graph.publisher("plan", ros.Path)
        self._classes = graph.publisher("pirrht/classes", ros.MarkerArray)
        self._samples = graph.publisher("pirrht/samples", ros.MarkerArray)
        self._diagnostics = graph.publisher("/diagnostics", ros.DiagnosticArray)

    def run(self, ends: Callable[[], bool]) -> None:
        """Listen and drive until somebody `ends` it, or an exception does; the robot stands then."""
        with undisturbed():
            self.work.start()
            try:
                while not ends():
                    self.graph.wait(TICK)
                    self.step(time.monotonic())
            finally:
                self.work.end()
                self._command(0.0, 0.0, 0.0)
                self._clear()

    def step(self, now: float) -> None:
        """Take what has come until a time [s], and answer it."""
        new = self._listen(now)
        if self._pose is not None and self._goal is not None:
            away = hypot(*(self._pose.place[:2] - self._goal[:2]))
            if away <= self._goal[2] and not self._wrong:
                self._arrive()
        self._order()

        why = self._standing(now)
        law = self.work.law
        if why is None and law is not None and self._pose is not None:
            if new:
                self._command(*self._limited(*law.twist(self._pose, now)))
                self.latencies.append(time.monotonic() - self._pose.came)
            self._moving = True
        elif self._moving or now - self._stopped < STILL:
            if self._moving:
                self._moving = False
                self._stopped = now
            self._command(0.0, 0.0, 0.0)
        self._report(now, why)

    def _listen(self, now: float) -> bool:
        """Take new messages; return whether there is another pose."""
        o = self.options
        for static, source in ((True, self._tf_static), (False, self._tf)):
            for transforms in source.take():
                self._try(source.name, self._frames.hear, transforms, inf if static else now)
        if self._map is not None:
            for grid in self._map.take()[-1:]:
                self._map_came = now
                self._try(self._map.name, self._take_map, grid)
        for scan in [] if self._scans is None else self._scans.take():
            self._scan_came = now
            self._try("scan", self._take_scan, scan, now)
        for goal in self._goals.take()[-1:]:
            self._try(self._goals.name, self._take_goal, goal)
        if self._cancels.take():
            self._goal = None
            self._wrong.pop(self._goals.name, None)
            self.say("the goal is withdrawn")

        before = self._pose
        for odometry in self._odometry.take()[-1:]:
            if o.pose_from == "odom":
                self._try(self._odometry.name, self._take_odometry, odometry, now)
        if o.pose_from == "tf":
            self._try("/tf", self._take_base, now)
        return self._pose is not before

    def _try(self, topic: str, take: Callable[..., object], *what: Any) -> None:
        """Take a message, and remember what is wrong with it until a right one comes."""
        try:
            take(*what)
            self._wrong.pop(topic, None)
        except PirrhtError as error:
            self._wrong[topic] = f"{topic}: {error}"

    def _in_map(self, header: ros.Header, nameless: str = "") -> Array:
        """Return the pose (3,) of a header's frame in that of the map; one without a name is `nameless` or the map."""
        return self._frames.pose(self.options.map_frame, header.frame_id or nameless or self.options.map_frame)[0]

    def _take_map(self, message: ros.OccupancyGrid) -> None:
        self._grid = None
        grid = Grid.of(message)
        at = self._in_map(message.header)
        self._grid = grid.moved(at)

    def _take_goal(self, message: ros.PoseStamped) -> None:
        at = self._in_map(message.header)
        place = composed(at, planar(message.pose, "the goal"))
        goal = np.append(place[:2], self.work.radius)
        if self._arrived_at is not None and np.array_equal(goal, self._arrived_at):
            return  # it is said again
        if self._goal is None or not np.array_equal(goal, self._goal):
            self._goal = goal
            self._arrived_at = None
            self.say(f"goal {formatting.vector(place[:2])}")

    def _take_odometry(self, message: ros.Odometry, now: float) -> None:
        pose = planar(message.pose.pose, "the odometry")
        twist = message.twist.twist
        velocity = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        if not np.isfinite(velocity).all():
            raise OptionError(f"a velocity of the odometry is {velocity.tolist()}; it must be finite numbers")
        at = self._in_map(message.header)
        self._move(composed(at, pose), velocity, message.header.stamp.seconds, now)

    def _take_base(self, now: float) -> None:
        place, came = self._frames.pose(self.options.map_frame, self.options.base_frame)
        last = self._pose
        if last is not None and came <= last.came:
            return
        velocity = np.zeros(3)
        if last is not None:
            moved = composed(np.array([0.0, 0.0, -last.place[2]]), np.append(place[:2] - last.place[:2], 0.0))
            turned = remainder(place[2] - last.place[2], tau)
            velocity = np.append(moved[:2], turned) / (came - last.came)
        self._move(place, velocity, came, came if np.isfinite(came) else now)

    def _move(self, place: Array, velocity: Array, stamp: float, came: float) -> None:
        """Be at a place; time that goes backwards makes the run begin anew."""
        last = self._pose
        if last is not None:
            place = place.copy()
            place[2] = last.place[2] + remainder(place[2] - last.place[2], tau)
        pose = Pose(place, velocity, stamp, came)
        self._pose = pose
        if last is not None and stamp < last.stamp:
            self.work.begin_anew()
            self._ahead = None
            self._frames.forget()
            raise OptionError(f"time goes backwards, from {last.stamp:.3f} to {stamp:.3f} s; the run begins anew")
        self.work.poses.append(pose)

    def _take_scan(self, message: ros.LaserScan, now: float) -> None:
        at = self._in_map(message.header, self.options.base_frame)
        ranges = np.array(message.ranges)
        angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
        if not (len(ranges) and np.isfinite(angles).all() and 0.0 < message.range_max < inf):
            raise OptionError("a scan needs ranges, finite angles and a positive range_max")
        if len(ranges) * abs(message.angle_increment) > tau - 1e-3:
            angles = np.mod(angles + pi, tau) - pi  # a ring is cut behind the sensor, not ahead of it
        ranges[np.isnan(ranges) | (ranges < message.range_min)] = -inf
        ranges[ranges > message.range_max] = inf
        stamp = message.header.stamp.seconds
        self._ahead = now - stamp if self._ahead is None else self._ahead
        scan = Scan(pose=at, angles=angles, ranges=ranges, most=message.range_max, time=stamp + self._ahead)
        self.work.scans.append(scan)

    def _arrive(self) -> None:
        self._arrived_at = self._goal
        self._goal = None
        self.arrived += 1

    def _order(self) -> None:
        """Have plans made, if there is all that they need."""
        ready = self._goal is not None and self._pose is not None and (self.work.sees or self._grid is not None)
        task = self.work.task
        if not ready:
            self.work.task = None
        elif task is None or task.goal is not self._goal or task.grid is not self._grid:
            assert self._goal is not None
            self.work.task = Task(self._goal, self._grid)

    def _standing(self, now: float) -> str | None:
        """Return why the robot stands; None: it drives."""
        law = self.work.law
        late = self.options.late + self.work.period
        if self._goal is None and self._arrived_at is not None and not self._wrong:
            return "arrived"
        if lacking := self._lacking(now):
            return lacking
        if self._goal is None and self.work.doing != STARTING:
            return "no goal"
        if self.work.trouble:
            return self.work.trouble
        if law is None:
            return self.work.doing
        if now - law.made > late:
            return f"plans are late: they take longer than {late:g} s; raise --period or --dt"
        return "blocked: no way is free" if law.blocked else None

    def _lacking(self, now: float) -> str:
        """Return what is wrong, missing or late of what comes in; empty if nothing is."""
        o = self.options
        if self._wrong:
            return "; ".join(self._wrong.values())
        if self._pose is None:
            return self._missing(self._odometry) if o.pose_from == "odom" else "no transforms on /tf"
        if now - self._pose.came > o.late:
            return "odometry is late"
        if self._map is not None and self._grid is None:
            return self._missing(self._map)
        if self._map is not None and o.map_late and now - self._map_came > o.map_late:
            return "the map is late"
        if self._scans is not None and now - self._scan_came > o.late:
            return "scans are late" if self._scan_came > -inf else self._missing(self._scans)
        return ""

    def _missing(self, source: Subscription[ros.Message]) -> str:
        heard = "somebody publishes, and nothing has come yet" if source.offered else "nobody publishes"
        return f"no message on {source.name}: {heard}"

    def _limited(self, ahead: float, left: float, turn: float) -> tuple[float, float, float]:
        """Slow a command down to the limits, along the same arc."""
        o = self.options
        share = max(1.0, hypot(ahead, left) / o.max_speed, abs(turn) / o.max_turn)
        return ahead / share, left / share, turn / share

    def _command(self, ahead: float, left: float, turn: float) -> None:
        twist = ros.Twist(ros.Vector3(ahead, left, 0.0), ros.Vector3(0.0, 0.0, turn))
        if self._commands is not None:
            self._commands.publish(twist)
        if self._stamped is not None:
            self._stamped.publish(ros.TwistStamped(self._header(self.options.base_frame), twist))

    def _header(self, frame: str) -> ros.Header:
        return ros.Header(ros.Time.of(0.0 if self._pose is None else self._pose.stamp), frame)

    def _report(self, now: float, why: str | None) -> None:
        """Publish the plan and how things are, at news and now and then."""
        law = self.work.law
        status = why or "driving"
        news = status != self._status
        if news:
            self._status = status
            self.say(status)
        if news or now - self._reported > SAID:
            self._reported = now
            self._diagnose(status, law)
        if law is not None and not law.drawn and now - self._drawn >= SHOWN:
            law.drawn = True
            self._drawn = now
            self._draw(law)
        elif law is None and self._drawn > -inf:
            self._drawn = -inf
            self._clear()

    def _diagnose(self, status: str, law: Law | None) -> None:
        for trouble in self.graph.troubles():
            self.say(trouble)
        level = OK if status in FINE else ERROR if self._wrong or self.work.trouble else WARNING
        if status == self.work.doing:
            status += f", {time.monotonic() - self.work.since:.0f} s so far"
        elif status == "driving" and law is not None and law.doubtful:
            level = WARNING
            status = f"driving, {ros.DOUBTFUL}"
        values = [ros.KeyValue(key, value) for key, value in ({} if law is None else law.figures()).items()]
        found = ros.DiagnosticStatus(level, "pirrht: planner", status, "", values)
        self._diagnostics.publish(ros.DiagnosticArray(self._header(""), [found]))

    def _draw(self, law: Law) -> None:
        """Publish the favourite's path, and what somebody looks at."""
        header = self._header(self.options.map_frame)
        plan = law.plan
        if plan.favourite in plan.ids:
            points = plan.references[plan.ids.index(plan.favourite)].trajectory.points
            self._plans.publish(path_of(points[:, :2], header))
        if self._classes.heard:
            self._classes.publish(classes_of(plan, self._colors, header))
        if self._samples.heard:
            self._samples.publish(samples_of(plan, self.options.samples_drawn, header))

    def _clear(self) -> None:
        """Take back what was drawn of a plan that is none any more."""
        header = self._header(self.options.map_frame)
        self._plans.publish(ros.Path(header))
        for drawn in (self._classes, self._samples):
            drawn.publish(ros.MarkerArray([ros.Marker(header, action=ros.DELETE_ALL)]))
