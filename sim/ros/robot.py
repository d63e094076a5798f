"""The simulator as a robot of a ROS 2 graph: it tells where it is and what it senses, and others drive it.

The run goes by the wall clock. It waits for the first command that moves the robot, and takes new ones between two
physics steps. Odometry is the truth: the frames of map and odometry are one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from time import monotonic
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.errors import OptionError
from pirrht.estimation.assembly import path_integral
from pirrht.mapping.scan import Scan
from sim.drive.executor import Advance, Control, Executor
from sim.ros.frames import composed, inverse, quaternion_of
from sim.ros.graph import LATCHED, SENSOR, Graph, Quality
from sim.ros.grids import grid_of
from sim.ros.messages import (
    Clock,
    Header,
    LaserScan,
    OccupancyGrid,
    Odometry,
    Point,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Twist,
    TwistStamped,
    TwistWithCovariance,
    Vector3,
)
from sim.scenario import Scenario
from sim.sensing.lidar import Lidar, LidarSensor
from sim.sensing.senses import EARLY, Senses
from sim.states.plane import Plane

LASER = "laser"  # frame of the lidar
FASTEST = 100.0  # command that is taken [m/s, rad/s]
RESPONSE = 0.1  # time constant of the speed of a robot with inertia [s]
SECOND = 1.0  # between two messages of the goal, and looks for troubles [s]
LATEST = 0.1  # by which the simulation may be late; then its clock stands [s]
ROOMY = Quality(depth=100)  # /tf, as tf2 has it


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """How the robot takes part in a graph."""

    hz: float = 50.0  # of odometry, /tf and /clock
    stamped: bool = False  # whether commands are TwistStamped
    timeout: float = 0.5  # after which without a command the robot stops [s]
    wait: float = 60.0  # for the first command [s]
    map_frame: str = "map"
    odom_frame: str = "odom"
    base_frame: str = "base_link"
    cell: float | None = 0.05  # of the map [m]; None: it is not published


class Wire:
    """Publishes what a robot with a lidar knows, and has the command that it was last given.

    `say` takes a line about what is wrong.
    """

    def __init__(
        self, graph: Graph, scenario: Scenario, lidar: Lidar, wiring: Wiring, say: Callable[[str], object]
    ) -> None:
        self.graph, self.wiring, self.lidar, self._say = graph, wiring, lidar, say
        self._clock = graph.publisher("/clock", Clock, Quality())
        self._odom = graph.publisher("odom", Odometry)
        self._tf = graph.publisher("/tf", TFMessage, ROOMY)
        self._static = graph.publisher("/tf_static", TFMessage, LATCHED)
        self._scan = graph.publisher("scan", LaserScan, SENSOR)
        self._goal = graph.publisher("goal_pose", PoseStamped)
        kind: Any = TwistStamped if wiring.stamped else Twist
        self._commands = graph.subscription("cmd_vel", kind)

        self.begun = False  # whether a command has moved the robot
        self.taken = 0  # commands
        self._command, self._heard = np.zeros(3), -inf  # vx, vy [m/s] and turn rate [rad/s], and when it came [s]
        self._last = -inf, np.zeros(3)  # time [s] and pose of the last odometry
        self._due = self._check = 0.0
        self._refused = False

        scene = scenario.loaded.scene
        self._at = *scene.goal.center.tolist(), 0.0
        here = self._header(0.0, wiring.map_frame)
        mount = Vector3(lidar.x, lidar.y, scene.robot_height if lidar.z is None else lidar.z)
        self._static.publish(TFMessage([
            TransformStamped(here, wiring.odom_frame),
            TransformStamped(
                self._header(0.0, wiring.base_frame), LASER, Transform(mount, quaternion_of(lidar.yaw))
            ),
        ]))  # fmt: skip
        if wiring.cell is not None:
            graph.publisher("map", OccupancyGrid, LATCHED).publish(grid_of(scene, wiring.cell, here))
        graph.check()

    def _header(self, now: float, frame: str) -> Header:
        return Header(Time.of(now), frame)

    def take(self, now: float) -> None:
        """Take over commands that have come by a time [s] of /clock; one that cannot be driven stops the robot."""
        for message in self._commands.take():
            twist = getattr(message, "twist", message)
            command = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
            valid = bool((abs(command) <= FASTEST).all())
            if not valid and not self._refused:
                self._say(
                    f"{self._commands.name}: the command {command.tolist()} is refused, and the robot stops; it must "
                    f"be numbers of at most {FASTEST:g}"
                )
            self._refused |= not valid
            self._command = command if valid else np.zeros(3)
            self._heard = now
            self.taken += valid
            self.begun = self.begun or bool(self._command.any())

    def command(self, now: float) -> Array:
        """Return speeds ahead and to the left [m/s] and the turn rate [rad/s] at a time [s], (3,)."""
        return self._command if now <= self._heard + self.wiring.timeout + EARLY else np.zeros(3)

    def tell(self, pose: Array, now: float, *, last: bool = False) -> None:
        """Publish a pose (3,) at a time [s] if it is time for one, or the `last` one."""
        if now < self._due - EARLY and not last:
            return
        self._due = max(self._due + 1.0 / self.wiring.hz, now)
        before, known = self._last
        vx, vy, turning = composed(inverse(known), pose) / (now - before) if now > before else np.zeros(3)
        self._last = now, pose.copy()
        x, y, yaw = pose.tolist()
        header, base, rotation = self._header(now, self.wiring.odom_frame), self.wiring.base_frame, quaternion_of(yaw)
        self._clock.publish(Clock(header.stamp))
        transform = TransformStamped(header, base, Transform(Vector3(x, y), rotation))
        self._tf.publish(TFMessage([transform]))
        at = PoseWithCovariance(Pose(Point(x, y), rotation))
        moving = TwistWithCovariance(Twist(Vector3(float(vx), float(vy)), Vector3(z=float(turning))))
        self._odom.publish(Odometry(header, base, at, moving))
        if now >= self._check:
            self._check = now + SECOND
            for trouble in self.graph.troubles():
                self._say(trouble)
            if not self.begun:
                self._goal.publish(PoseStamped(self._header(now, self.wiring.map_frame), Pose(Point(*self._at))))

    def show(self, scan: Scan, now: float) -> None:
        """Publish a scan of a time [s]."""
        lidar = self.lidar
        first, last = float(scan.angles[0]), float(scan.angles[-1])
        self._scan.publish(LaserScan(
            self._header(now, LASER), first, last, (last - first) / max(1, lidar.rays - 1), 0.0, lidar.period,
            lidar.least, lidar.most, scan.ranges.tolist(),
        ))  # fmt: skip

    def silence(self) -> str:
        """Return why no run has begun."""
        name = self._commands.name
        known = "only commands to stand" if self.taken else "a publisher, and no command"
        known = known if self._commands.offered else "no publisher"
        kind = "TwistStamped" if self.wiring.stamped else "Twist"
        return (
            f"no command came within {self.wiring.wait:g} s: {name} has {known} of geometry_msgs/msg/{kind}; start a "
            "controller, or raise --wait"
        )


class RemotePlant(Executor):
    """The robot in MuJoCo, driven over the wire and paced by the wall clock; it stands until it is driven."""

    def __init__(self, scenario: Scenario, wire: Wire, rng: np.random.Generator) -> None:
        self.wire = wire
        self.late = list[float]()  # by which steps were, up to `LATEST` [s]
        self.lost = 0.0  # time by which the clock stood [s]
        self._standing = 0.0  # time until the first command [s]
        self._origin: float | None = None  # of the run on the wall clock [s]
        senses = Senses(LidarSensor(scenario.loaded, wire.lidar), 0.0, rng)
        super().__init__(scenario.loaded, scenario.problem, period=scenario.settings.period, senses=senses)

    @property
    def now(self) -> float:
        """Time of /clock [s]."""
        return self._standing + self.time

    def wanted(self, x: Array) -> Array:
        """Return the twist (k,) of the robot at x (n,) that follows the command."""
        assert isinstance(self._states, Plane)
        ahead, left, turning = self.wire.command(self.now)
        names = self._states.states
        if self._states.heading is None:
            speeds = np.array([ahead, left])
            return (speeds - x[2:]) / RESPONSE if self._states.rates else speeds
        if "speed" not in names:
            return np.array([ahead, turning])
        speed = x[names.index("speed")]
        return np.array([(ahead - speed) / RESPONSE, speed * turning, turning])

    def control(self, x: Array) -> Array:
        """Return the control (m,) of the equation that comes nearest to the command at x (n,)."""
        still = np.zeros(self._problem.dynamics.m)
        begin = super()._made(x, still, still)
        by = [super(RemotePlant, self)._made(x, one, still) - begin for one in np.eye(len(still))]
        return np.asarray(np.linalg.lstsq(np.transpose(by), self.wanted(x) - begin)[0], float)

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision, once there is a command; see `Plant.advance`."""
        if self._origin is None:
            self._origin = self._stand()
        return replace(super().advance(control_at, rng), off=())  # the equation may know no such twist

    def finish(self) -> None:
        """Publish where the robot is now."""
        self.wire.tell(self._states.poses(self._state), self.now, last=True)

    def _stand(self) -> float:
        """Publish until there is a command; return when that was on the wall clock [s]."""
        wire, pose, step = self.wire, self._states.poses(self._state), 0
        begin = monotonic()
        scanned = -inf
        while not wire.begun:
            if self._standing >= wire.wiring.wait:
                raise OptionError(wire.silence())
            wire.tell(pose, self._standing)
            assert self.senses is not None
            if self._standing >= scanned + wire.lidar.period - EARLY:
                self.senses.begin(self.data, pose, 0.0)
                scanned = self._standing
            self._show()
            step += 1
            self._wait(begin + step / wire.wiring.hz)
            self._standing = step / wire.wiring.hz
        return monotonic()

    def _wait(self, until: float) -> None:
        """Take commands until a time on the wall clock [s]."""
        while True:
            self.wire.take(self.now)
            left = until - monotonic()
            if left <= 0.0:
                return
            self.wire.graph.wait(left)

    def _show(self) -> None:
        assert self.senses is not None
        for scan in self.senses.take():
            self.wire.show(scan, self.now)

    def _made(self, x: Array, u: Array, dw: Array) -> Array:
        """Return the twist of the command with the noise that a control would have."""
        known = super()._made(x, u, dw) - super()._made(x, u, np.zeros_like(dw))
        return self.wanted(x) + known

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        """Make one step, and publish what is due once the wall clock is there."""
        x = super()._move(x, u, dw, step)
        if self._origin is not None:
            due = self._origin + self.time
            self._wait(due)
            late = monotonic() - due
            if late > LATEST:
                self._origin += late
                self.lost += late
            self.late.append(late)
            self.wire.tell(self._states.poses(x), self.now)
            self._show()
        return x


class Remote(Policy):
    """A policy whose control is the command that came over the wire.

    Args:
        scenario: known, on the ground.
        graph: of ROS 2 that the robot takes part in.
        lidar: of the robot.
        say: takes a line about what is wrong.

    Raises:
        OptionError: no velocity commands drive this robot.
    """

    def __init__(
        self, scenario: Scenario, graph: Graph, *, lidar: Lidar | None = None, wiring: Wiring | None = None,
        say: Callable[[str], object] = print,
    ) -> None:  # fmt: skip
        states = scenario.system.adapter.states
        drivable = (Plane.pose[:2], Plane.pose, (*Plane.pose[:2], *Plane.velocities), (*Plane.pose, *Plane.speeds))
        if states not in drivable:
            raise OptionError(
                f"{scenario.loaded.robot} takes no commands of ROS 2, which are velocities on the ground; choose "
                "another robot, such as diffdrive, or leave out --ros"
            )
        s = scenario.settings
        self.path_integral = path_integral(
            scenario.problem, scenario.space, scenario.sampling, homology=scenario.homology
        )
        self.homology = self.path_integral.homology
        self.wire = Wire(graph, scenario, lidar or Lidar(), wiring or Wiring(), say)
        self.plant = RemotePlant(scenario, self.wire, np.random.default_rng(s.seed))
        self._held = s.period
        self._say = say
        self.begin(scenario.start)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Return the law that follows the commands, at state x (n,)."""
        return Plan(
            state=x, times=np.array([0.0, self._held]), references=(), ids=(), estimate=None, fallback=None,
            instead=self.plant.control(x)[None, :], law=lambda state, _: self.plant.control(state),
            time=self.run.clock.time, space=self.space, dynamics=self.problem.dynamics, movers=self.run.route.movers,
        )  # fmt: skip

    def end(self) -> None:
        """Publish where the robot is, and say how the run went over the wire."""
        self.plant.finish()
        late = 1e3 * np.percentile(self.plant.late or [0.0], [50, 99, 100])
        self._say(
            f"ROS 2: {self.wire.taken} commands; physics steps late by {late[0]:.2g} ms, p99 {late[1]:.2g}, max "
            f"{late[2]:.2g}; the clock stood still for {self.plant.lost:.2f} s"
        )
