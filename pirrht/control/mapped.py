"""Drive without a map: a policy among what a lidar has shown so far.

What nobody has seen counts as free. Moving obstacles are no part of the map: guides and samples pass them in time, as
tracks predict them. A new map changes the scene as `Controller.update` does: obstacles keep their numbers and classes
their names as far as they go on, and so does what the run knows of them.
"""

import math
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any, Protocol, cast

import numpy as np

from pirrht.arrays import Array, BoolArray
from pirrht.control.baselines import Mppi
from pirrht.control.blocked import Brake, blocked_plan
from pirrht.control.controller import Controller
from pirrht.control.map_update import Renewed
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.control.settings import TUNING, TimeBudget
from pirrht.errors import NoReference, SceneError
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import height_of_walls
from pirrht.geometry.solids import discs
from pirrht.mapping.believed import Believed
from pirrht.mapping.blind_side import BlindSide
from pirrht.mapping.occupancy import OccupancyMap
from pirrht.mapping.scan import Scan
from pirrht.mapping.tracker import Track, Tracker
from pirrht.planner.references import Reference


class Sensor(Protocol):
    """Senses of a robot."""

    @property
    def error(self) -> Array:
        """Return the error of the believed pose, x, y [m] and yaw [rad], (3,)."""

    def take(self) -> Iterable[Scan]:
        """Return the scans since it was last called."""


class Mapped(Policy):
    """A `Controller` or `Mppi` whose scene is a map of what scans show.

    Args:
        controller: in a scene without obstacles, of a free space with a `grain`.
        cell: side of a cell of the map [m].
        sensor: has scans, by which plans begin, and the error of the believed pose; None: `see` is called.
        unknown: price of a metre of a reference that nobody has seen [cost/m].
        clock: tells the time by which the work on maps is measured [s].
        background: new maps are examined while the robot drives on by the last; False: before the next plan.
    """

    tree, run, path_integral, homology = (
        cast(Any, property(attrgetter(f"controller.{name}"))) for name in ("tree", "run", "path_integral", "homology")
    )

    def __init__(
        self, controller: Controller | Mppi, *, cell: float = 0.05, sensor: Sensor | None = None, unknown: float = 0.0,
        background: bool = False, clock: Callable[[], float] = time.perf_counter,
    ) -> None:  # fmt: skip
        self.controller = controller
        self.cell = cell
        self.sensor = sensor
        self.unknown = unknown
        self.clock = clock
        self.map = self._empty()
        self.tracks = Tracker()

        self._brake = Brake(problem=controller.problem)
        self._bare = replace(controller.problem.scene, obstacles=())
        self._vertices = 0 if controller.tree is None else controller.tree.size
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="mapper") if background else None
        self._pending: Future[Renewed | None] | None = None
        self._last: Scan | None = None
        self._version = 0  # of the map that was examined last
        self._covered = False  # whether no place of the goal is free in it
        self._avoided: list[Track] | None = None  # tracks as they are predicted; None: in the last map
        if isinstance(controller, Controller):
            controller.surcharge = self._surcharge if unknown > 0.0 else None

    def _empty(self) -> OccupancyMap:
        scene = self.space.scene
        return OccupancyMap(scene.lower, scene.upper, cell=self.cell)

    def _blind_side(self) -> BlindSide | None:
        """Return what tells where to look, of a robot with a heading that turns on the spot."""
        d = self.problem.dynamics
        start = d.state_of(self._bare.start)
        turns = len(d.reads(True)) == 3 and np.linalg.matrix_rank(d.G_c(start)[: len(d.position)]) < d.m
        return BlindSide(grid=self.map, footprint=self._bare.footprint) if turns else None

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far and its map; a new one starts at x (n,), at a time [s]."""
        self._pending = self._last = self.believed = None
        self.map = self._empty()
        self.controller.blind = self._blind_side()
        self.tracks = Tracker()
        self._version = 0
        self._avoid()
        self._covered = False
        self.controller.update(self._bare, self._vertices or None)
        self.controller.begin(x, time)

    def go_on(self, before: "Mapped") -> None:
        """Continue in the map of another policy, among the same obstacles; call it after `begin`."""
        self.map = before.map
        self.controller.blind = before.controller.blind
        self.tracks = before.tracks
        self._last = before._last

    def see(self, scan: Scan) -> None:
        """Add a scan to the map; the next plan counts with it."""
        passing = self.tracks.see(scan, self.map) if isinstance(self.controller, Controller) else None
        self.map.integrate(scan, free_around=self.space.scene.footprint.inscribed, passing=passing)
        self._last = scan
        if self.controller.blind is not None:
            self.controller.blind.scan = scan

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,) among what is known; see `Controller.plan`."""
        began = self.clock()
        error = np.zeros(len(x))
        pose = np.zeros(3)
        if self.sensor is not None:
            for scan in self.sensor.take():
                self.see(scan)
            reads = [*self.problem.dynamics.reads(True)]
            pose = self.sensor.error
            error[reads] = pose[: len(reads)]
        self._renew()
        self._avoid()
        last = self.believed
        if last is None or last.scan is not self._last:
            last = Believed.of(self.map, self._last, pose)
        self.believed = replace(last, seconds=self.clock() - began)
        if self._covered:
            plan = blocked_plan(self._brake, x + error, self.run, self.space, "no reference")
            return shifted(self.controller.governed(plan), error)
        if self._pool is not None:
            left = TimeBudget(left).less(TUNING.mapping) if left is not None else None
        return shifted(self._planned(x + error, left), error)

    def _planned(self, x: Array, left: Callable[[], float] | None) -> Plan:
        """Return the controller's plan at x (n,); a tree without a path gains vertices."""
        while True:
            try:
                plan = self.controller.plan(x, left)
            except NoReference:
                if not self._grow():
                    raise
            else:
                if plan.fallback == "no reference":
                    self._grow()
                return plan

    def _grow(self) -> bool:
        """Let the tree gain vertices, up to a number and unless another one is on the way; return whether it did."""
        tree = self.tree
        if tree is None or self._pending is not None or tree.size >= TUNING.unreached * self._vertices:
            return False
        before = tree.size
        tree.grow(before + math.ceil(TUNING.growth * self._vertices))
        return bool(tree.size > before)

    def _renew(self) -> None:
        """Continue in the newest map that is examined, and have the next one examined."""
        pool = self._pool if self.run.planned else None
        if self._pending is not None and (pool is None or self._pending.done()):
            self._adopt(self._pending)
        if self._pending is None and self.map.version != self._version:
            self._version = self.map.version
            work = partial(self._examined, self.map.occupied)
            if pool is None:
                self._adopt(immediately(work))
            else:
                self._pending = pool.submit(work)

    def _examined(self, occupied: BoolArray) -> Renewed | None:
        """Examine a map by its occupied cells (rows, columns)."""
        return self.controller.renewed(self.map.scene(self._bare, occupied), self._vertices or None)

    def _avoid(self) -> None:
        """Predict moving obstacles, which a scan or a map has changed; without a `Controller` they are walls."""
        moving = self.tracks.moving
        if isinstance(self.controller, Controller) and moving != self._avoided:
            self.controller.avoid([self._predicted(one) for one in moving])
            self._avoided = moving

    def _predicted(self, one: Track) -> Mover:
        """Return a track as a moving obstacle of constant velocity."""
        tuning = self.tracks.tuning
        solids = discs([[0.0, 0.0, one.radius + tuning.around]], height_of_walls(self._bare.robot_height))
        ends = np.vstack([one.at(0.0), one.at(tuning.horizon)])
        rows = np.column_stack([[0.0, tuning.horizon], ends, np.zeros(2)])
        return Mover(name=f"track {one.number}", solids=solids, motion=Motion(rows=rows, offset=-self.tracks.time))

    def _adopt(self, examined: "Future[Renewed | None]") -> None:
        """Continue in a map, or wait until another one if the goal is covered in it."""
        self._pending = None
        try:
            self.controller.adopt(examined.result())
            self._avoided = None
            self._covered = False
        except SceneError:
            self._covered = True

    def _surcharge(self, reference: Reference) -> float:
        """Price what nobody has seen of a reference [cost]."""
        return self.unknown * self.map.unseen_length(reference.trajectory.points)


def shifted(plan: Plan, error: Array) -> Plan:
    """Return a plan for states (n,) that the robot believes to be off by an error (n,)."""
    if not error.any():
        return plan
    law = plan.law
    moved = None if law is None else lambda x, s: law(x + error, s)
    return replace(plan, state=plan.state - error, law=moved)


def immediately(work: Callable[[], Any]) -> "Future[Any]":
    """Return the result of work, or its error, as a future does."""
    future: Future[Any] = Future()
    try:
        future.set_result(work())
    except Exception as error:
        future.set_exception(error)
    return future
