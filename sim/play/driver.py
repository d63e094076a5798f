"""A policy whose world may change during a run: plans for a new one are made in the background, and take over."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.control.settings import TREELESS
from pirrht.errors import PirrhtError
from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from sim.play.world import World
from sim.scenario import Driver

FULLER = 2  # times as many vertices there is space for in a tree that grows on


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Built:
    """A world with its controller and tree."""

    world: World  # whose free space is that of its scene
    tree: HomologyTree | None
    driver: Driver


def build(world: World, before: HomologyTree | None) -> Built:
    """Grow a tree and make a controller; the tree of before is kept where only the noise has changed.

    Raises:
        SceneError, OptionError: nothing can be planned there.
    """
    scenario, tree = world.scenario, before
    if not world.grounded:
        scenario, tree = replace(scenario, space=FreeSpace.of(world.scene)), None
    if tree is None and scenario.settings.method not in TREELESS:
        tree = scenario.with_settings(tree=None).grown_tree()
        tree.reserve(FULLER * tree.size)
    return Built(world=replace(world, scenario=scenario, grounded=True), tree=tree, driver=scenario.driver(tree))


def _theirs(name: str) -> Any:
    """Return an attribute of the policy that decides now."""
    return property(lambda live: getattr(live.built.driver, name))


class Live(Policy):
    """The policy that decides now; the newest world that was requested is built, one at a time, and takes over.

    Args:
        tell: takes a line on what could not be planned.
        latency: simulated time after a request at which its world is waited for, so that it takes over at a time that
            does not depend on the machine [s]; None: it takes over when it is ready.
    """

    tree, run, path_integral, homology = map(_theirs, ("tree", "run", "path_integral", "homology"))

    def __init__(self, built: Built, tell: Callable[[str], object], latency: float | None) -> None:
        self.built, self._tell, self._latency = built, tell, latency
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="builder")
        self._requested: tuple[float, Future[Built]] | None = None  # at which time of the run [s]

    def request(self, world: World, at: float) -> None:
        """Request a world at a time of the run [s], in place of what was requested before."""
        if self._requested is not None:
            self._requested[1].cancel()
        tree = self.built.tree if world.grounded else None
        self._requested = at, self._pool.submit(build, world, tree)

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s]."""
        self.built.driver.begin(x, time)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,), in a new world if one is ready and has a path to the goal from there."""
        now = self.run.time
        try:
            ready = self._ready(now)
            if ready is not None:
                ready.driver.begin(x, now)
                plan = ready.driver.plan(x, left)
                self.built = ready
                return plan
        except PirrhtError as error:
            self._tell(f"{error}; the drive goes on as planned before")
        return self.built.driver.plan(x, left)

    def catch_up(self) -> None:
        """Wait for the requested world, and take it.

        Raises:
            SceneError, OptionError: nothing can be planned there.
        """
        self.built = self._ready(inf) or self.built

    def _ready(self, now: float) -> Built | None:
        """Return the requested world, once; None if there is nothing yet at this time [s], and at infinity wait."""
        if self._requested is None:
            return None
        at, future = self._requested
        due = inf if self._latency is None else at + self._latency - 1e-9
        if now < due and not (self._latency is None and future.done()):
            return None
        self._requested = None
        return future.result()

    def close(self) -> None:
        """Let what is under way end, and nothing more begin."""
        self._pool.shutdown(wait=True, cancel_futures=True)
