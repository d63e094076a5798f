"""Plans of a node, made on a thread of their own: a scene of a map, a tree, and a plan every period."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.mapped import Mapped
from pirrht.control.plan import Plan
from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError, PirrhtError, SceneError
from pirrht.geometry.rectangles import cover
from pirrht.geometry.scene import height_of_walls
from pirrht.geometry.solids import cells
from pirrht.mapping.scan import Scan
from sim.rehearsal import rehearse
from sim.ros.grids import Grid
from sim.scenario import Scenario, prepare
from sim.systems import named, names

SHARE = 0.7  # of a period, in which samples are drawn
SOON = 0.1  # time after which a robot with inertia has the commanded velocity [s]
INSTANT = 1e-3  # as long for one without [s]
IDLE = 0.01  # between two looks for work [s]
PATIENCE = 2.0  # with what is under way at the end [s]
AROUND = 5.0  # of start and goal that a workspace holds, if none is given [m]
SOMEWHERE = np.array([3.0, 0.0, 1.0])  # x, y and radius of a goal, of a robot that starts at 0, 0 [m]
WALL = 0.5  # height of walls [m]
MOST_POSES = 1000  # between two plans
STARTING = "starting: kernels are compiled or loaded"
SEARCHING = "searching the margin for --risk"
PLANNING = "planning"
STATES = {"x", "y", "heading", "vx", "vy", "speed", "turn"}  # that odometry tells


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where the robot is and how it moves."""

    place: Array  # x, y [m] and yaw, which is not wrapped [rad], (3,), in the frame of the map
    velocity: Array  # ahead, to the left [m/s] and turn rate [rad/s], (3,)
    stamp: float  # time of the message [s]
    came: float  # on this machine's clock [s]

    def state(self, names: tuple[str, ...]) -> Array:
        """Return the components of a state by their names; OptionError: one is not known."""
        x, y, yaw = self.place
        ahead, left, turn = self.velocity
        c = np.cos(yaw)
        s = np.sin(yaw)
        known = {
            "x": x, "y": y, "heading": yaw, "vx": c * ahead - s * left, "vy": s * ahead + c * left, "speed": ahead,
            "turn": turn,
        }  # fmt: skip
        if strange := [name for name in names if name not in known]:
            raise OptionError(f"odometry does not tell the states {', '.join(strange)}; choose another robot")
        return np.array([known[name] for name in names])


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Where the robot shall go, and among what."""

    goal: Array  # x, y, radius [m]
    grid: Grid | None  # None: it has to see it


@dataclass(slots=True, eq=False)
class Law:
    """A plan, and when it was made."""

    plan: Plan
    scenario: Scenario
    at: float  # time of the pose that it is for, on this machine's clock [s]
    made: float  # [s]
    seconds: float  # that it took
    risk: float | None = None  # predicted probability of a collision
    drawn: bool = False

    @property
    def doubtful(self) -> bool:
        """Whether it rests on few effective samples."""
        return self.plan.estimate is not None and self.plan.estimate.doubtful

    @property
    def blocked(self) -> bool:
        """Whether the robot must brake."""
        return self.plan.fallback is not None

    def twist(self, pose: Pose, now: float) -> tuple[float, float, float]:
        """Return the velocity ahead, to the left [m/s] and the turn rate [rad/s] at a pose and a time [s]."""
        d = self.scenario.problem.dynamics
        names = self.scenario.system.states
        x = pose.state(names)
        u = self.plan.at(x, max(0.0, now - self.at))
        inert = "vx" in names or "speed" in names
        step = SOON if inert else INSTANT
        after = d.step(x, u, np.zeros(d.m), step)
        moved = dict(zip(names, (after - x) / step, strict=True))
        then = dict(zip(names, after, strict=True))
        turn = moved.get("heading", 0.0)
        if "speed" in then:
            return float(then["speed"]), 0.0, float(turn)
        vx, vy = (then["vx"], then["vy"]) if inert else (moved["x"], moved["y"])
        yaw = pose.place[2] + 0.5 * step * turn
        ahead = np.cos(yaw) * vx + np.sin(yaw) * vy
        left = np.cos(yaw) * vy - np.sin(yaw) * vx
        return float(ahead), 0.0 if "heading" in names else float(left), float(turn)

    def figures(self) -> dict[str, str]:
        """Return what diagnostics tell of it."""
        e = self.plan.estimate
        found = {"class": formatting.turns(self.plan.favourite or "-"), "blocked": self.plan.fallback or "no"}
        found["plan [ms]"] = f"{1e3 * self.seconds:.1f}"
        if e is not None:
            found |= {"effective samples": f"{e.ess:.0f}", "value": f"{e.value:.4g}", "samples": str(len(e.weight))}
        if self.risk is not None:
            found["risk"] = f"{self.risk:.3g}"
        return found


class Work:
    """Makes plans for the task, as long as there is one.

    Other threads set `task`, append `poses` and `scans`, and read `law`, `trouble`, `doing` and `since`.

    Args:
        given: options of the robot, the problem and the planner, as `prepare` takes them.
        radius: of goals [m].
        workspace: x0, x1, y0, y1 [m] of a robot that has to see its scene; None: around start and goal.
        say: takes a line for a person.
    """

    def __init__(
        self, given: Mapping[str, Any], radius: float, workspace: Array | None, say: Callable[[str], object]
    ) -> None:  # fmt: skip
        self.given = dict(given)
        self.radius = radius
        self.workspace = workspace
        self.say = say
        self.sees = given.get("sense") == "lidar"
        self.period = float(given.get("period") or 0.1)

        self.task: Task | None = None
        self.law: Law | None = None
        self.trouble = ""
        self.doing = STARTING  # while there is no law
        self.since = time.monotonic()  # [s]
        self.poses: deque[Pose] = deque(maxlen=MOST_POSES)
        self.scans: deque[Scan] = deque(maxlen=MOST_POSES)
        self._ended = False
        self._anew = False
        self._built: Task | None = None
        self._driver: Any = None
        self._scenario: Scenario | None = None
        self._checked: Scenario | None = None
        self._last = 0.0  # time of the pose of the last plan [s]
        self._began = 0.0  # that of the first [s]
        self._thread = Thread(target=self._run, name="planner", daemon=True)

    def check(self) -> None:
        """Refuse options that no goal can be reached with, before there is one; OptionError or SceneError says why."""
        robots = {robot: one.adapter.states for one in map(named, names()) for robot in one.robots}
        fit = [robot for robot, states in robots.items() if STATES.issuperset(states)]
        robot = self.given.get("robot") or fit[0]
        if robot in robots and robot not in fit:
            raise OptionError(f"{robot} does not drive on the ground; choose --robot {', '.join(fit)} or an MJCF file")
        if self.given.get("method") == "passive":
            raise OptionError("--method passive knows no path and hits walls; choose another to drive a robot")
        still = Pose(np.zeros(3), np.zeros(3), 0.0, 0.0)
        task = Task(SOMEWHERE, None)
        given = self.given if self.sees else {**self.given, "risk": None}  # which would be a search
        self._checked = Work(given, 1.0, None, self.say)._entered(task, still)
        still.state(self._checked.system.states)

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    def end(self) -> None:
        """Stop working; nobody waits for a compiler."""
        self._ended = True
        self._thread.join(PATIENCE)

    def begin_anew(self) -> None:
        """Forget the run so far."""
        self.law = None
        self._anew = True

    def _run(self) -> None:
        if self._checked is not None:
            rehearse(self._checked, driving=True)
            self.say("ready")
        self._begin_doing(PLANNING)
        failed: Task | None = None
        while not self._ended:
            task = self.task
            if task is None or task is failed or not self.poses:
                if task is None:
                    self.law = None
                    self.trouble = ""
                    self._built = failed = None
                time.sleep(IDLE)
                continue
            began = time.monotonic()
            try:
                if self._anew:
                    self._anew = False
                    self._built = None  # else the run would go on in a scene that is known
                if task is not self._built:
                    self._prepare(task)
                    began = time.monotonic()
                law = self.law = self._planned(began)
                self.trouble = ""
                law.risk = self._risk(law.plan)
            except PirrhtError as error:
                self.law = None
                self.trouble = str(error) if self.task is task else ""
                failed = task if self._built is not task else None
            except Exception as error:  # whatever it is, the robot stops
                self.law = None
                self.trouble = f"no plan: {error!r}"
                failed = task
            while not self._ended and (time.monotonic() < began + self.period or self._waits()):
                time.sleep(min(IDLE, 0.1 * self.period))

    def _waits(self) -> bool:
        """Whether the last plan is for the newest pose."""
        return self.task is self._built and bool(self.poses) and self.poses[-1].came <= self._last

    def _prepare(self, task: Task) -> None:
        """Be in the scene of a task; what changes in a map alone changes the scene alone."""
        before = self._built
        x = self.poses[-1]
        if (
            before is not None and before.goal is task.goal and before.grid is not None and task.grid is not None
            and before.grid.same_cells(task.grid)
        ):  # fmt: skip
            walls = cells(task.grid.walls, task.grid.cell, task.grid.lower, height_of_walls(self._scene.robot_height))
            self._driver.update(replace(self._scene, obstacles=walls))
            self._built = task
            return
        self.law = None
        self.trouble = ""
        self._built = None
        self._begin_doing(PLANNING if self.given.get("risk") is None else SEARCHING)
        scenario = self._entered(task, x)
        self._begin_doing(PLANNING)
        tree = None if scenario.settings.method in TREELESS else scenario.grown_tree()
        if tree is not None and not self.sees:
            scenario.references(tree)  # NoReference says why there is none
        self._driver = scenario.driver(tree)
        self._scenario = scenario
        self._begin(self.poses[-1])
        if not self.sees:
            self._driver.plan(self._state(self.poses[-1]))  # the first one takes long, and its guides serve the next
            pose = self.poses[-1]
            self._driver.observe(self._state(pose), 0.0)
            self._last = pose.came
        self._built = task

    def _begin_doing(self, what: str) -> None:
        self.doing = what
        self.since = time.monotonic()

    @property
    def _scene(self) -> Any:
        return self._driver.space.scene

    def _state(self, pose: Pose) -> Array:
        assert self._scenario is not None
        return pose.state(self._scenario.system.states)

    def _begin(self, pose: Pose) -> None:
        self.poses.clear()
        self.poses.append(pose)
        self._driver.begin(self._state(pose))
        self._last = self._began = pose.came

    def _planned(self, began: float) -> Law:
        """Plan at the newest pose."""
        assert self._scenario is not None
        driven = [self.poses.popleft() for _ in range(len(self.poses) - 1)] + [self.poses[-1]]
        pose = driven[-1]
        states = np.array([self._state(one) for one in driven if one.came > self._last])
        if len(states):
            self._driver.observe(states, pose.came - self._last)
        self._last = pose.came
        if isinstance(self._driver, Mapped):
            with suppress(IndexError):
                while True:
                    scan = self.scans.popleft()
                    self._driver.see(replace(scan, time=scan.time - self._began))  # on the clock of the run
        until = began + SHARE * self.period
        plan = self._driver.plan(self._state(pose), lambda: until - time.monotonic())
        made = time.monotonic()
        return Law(plan, self._scenario, pose.came, made, made - began)

    def _risk(self, plan: Plan) -> float | None:
        """Predict the probability of a collision; None: nothing is predicted."""
        assert self._scenario is not None
        collision = self._scenario.collisions(plan)
        return None if collision is None else collision.probability

    def _entered(self, task: Task, pose: Pose) -> Scenario:
        """Return the scenario of a task; SceneError or OptionError: there can be none, or another goal is set."""

        def pause() -> None:
            asked = self.task
            if self._thread.is_alive() and (self._ended or asked is None or asked.goal is not task.goal):
                raise OptionError("the goal is withdrawn, or another")

        with TemporaryDirectory(prefix="pirrht-") as folder:
            file = Path(folder) / "map.xml"
            file.write_text(self._text(task, pose.place), encoding="utf-8")
            try:
                scenario = prepare(file, given={**self.given, "period": self.period, "real_time": True}, pause=pause)
            except (SceneError, OptionError) as error:
                why = str(error).replace(f"{file}: ", "").replace("--goal", "/goal_pose")
                raise type(error)(why.replace('move site "start"', "drive the robot off it")) from None
        if scenario.risk_note:
            self.say(scenario.risk_note)
        return scenario

    def _text(self, task: Task, place: Array) -> str:
        """Write a task as MJCF."""
        x, y, yaw = place
        ends = np.array([place[:2], task.goal[:2]])
        lower = ends.min(axis=0) - AROUND
        upper = ends.max(axis=0) + AROUND
        boxes = ""
        if task.grid is not None:
            grid = task.grid
            lower = grid.lower
            upper = grid.upper
            rows = grid.cell * cover(grid.walls).reshape(-1, 4) if grid.walls.any() else np.empty((0, 4))
            corners = rows[:, [2, 0, 3, 1]] + np.tile(lower, 2)
            boxes = "\n".join(
                f'<geom name="wall {i}" type="box" pos="{0.5 * (x0 + x1):.6f} {0.5 * (y0 + y1):.6f} {0.5 * WALL}" '
                f'size="{0.5 * (x1 - x0):.6f} {0.5 * (y1 - y0):.6f} {0.5 * WALL}"/>'
                for i, (x0, y0, x1, y1) in enumerate(corners.tolist())
            )
        elif self.workspace is not None:
            lower = self.workspace[::2]
            upper = self.workspace[1::2]
        middle = " ".join(f"{v:.6f}" for v in 0.5 * (lower + upper))
        half = " ".join(f"{v:.6f}" for v in 0.5 * (upper - lower))
        return f"""<mujoco model="map">
  <option timestep="0.002"/>
  <custom><text name="pirrht_robot" data="rover"/></custom>
  <worldbody>
    {boxes}
    <site name="workspace" type="box" pos="{middle} 0.5" size="{half} 0.5"/>
    <site name="start" pos="{x:.6f} {y:.6f} 0" euler="0 0 {np.degrees(yaw):.4f}"/>
    <site name="goal" type="cylinder" pos="{task.goal[0]:.6f} {task.goal[1]:.6f} 0" size="{task.goal[2]:.6f} 0.01"/>
  </worldbody>
</mujoco>
"""
