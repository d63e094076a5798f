"""A policy whose world may change under way: plans for a new one are made in the background, and take over."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy, RunState
from pirrht.control.settings import TREELESS
from pirrht.errors import NoReference, PirrhtError
from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.topology.homology import Homology
from sim.play.world import World
from sim.scenario import Driver

FULLER = 2  # times as many vertices there is room for in a tree that grows on


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Built:
    """A world with its controller and tree."""

    world: World  # whose free space is that of its scene
    tree: HomologyTree | None
    driver: Driver


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Wanted:
    at: float  # time of the drive at which it was asked for [s]
    future: Future[Built]


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


class Builder:
    """Builds the newest world that was asked for, one at a time.

    Args:
        latency: simulated time after which what was asked for is waited for, so that it takes over at a time that does
            not depend on the machine [s]; None: it takes over when it is ready.
    """

    def __init__(self, latency: float | None = None) -> None:
        self._latency, self._wanted = latency, None  # type: float | None, _Wanted | None
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="builder")

    def want(self, world: World, before: HomologyTree | None, at: float) -> None:
        """Ask for a world at a time of the drive [s]; what was asked for before is no longer wanted."""
        if self._wanted is not None:
            self._wanted.future.cancel()
        self._wanted = _Wanted(at=at, future=self._pool.submit(build, world, before))

    @property
    def busy(self) -> bool:
        """Return whether something that was asked for has not been taken."""
        return self._wanted is not None

    def ready(self, now: float) -> Built | PirrhtError | None:
        """Return what was asked for, once, or why it cannot be had; None if there is nothing yet at this time [s].

        At infinity it is waited for.
        """
        wanted = self._wanted
        if wanted is None:
            return None
        late = now >= (inf if self._latency is None else wanted.at + self._latency - 1e-9)
        if not late and not (self._latency is None and wanted.future.done()):
            return None
        self._wanted = None
        try:
            return wanted.future.result()
        except PirrhtError as error:
            return error

    def close(self) -> None:
        """Let what is under way end, and nothing more begin."""
        self._pool.shutdown(wait=True, cancel_futures=True)


class Live(Policy):
    """Whoever decides now; everything but `plan` is theirs.

    Args:
        built: who decides at first.
        builder: of those that come later.
        tell: takes a line on what could not be planned.
    """

    def __init__(self, built: Built, builder: Builder, tell: Callable[[str], object]) -> None:
        self.built, self.builder, self._tell = built, builder, tell

    @property
    def tree(self) -> HomologyTree | None:  # type: ignore[override]
        """Theirs."""
        return self.built.tree

    @property
    def run(self) -> RunState:  # type: ignore[override]
        """Memory of whoever decides."""
        return self.built.driver.run

    @property
    def path_integral(self) -> Any:  # type: ignore[override]
        """Theirs."""
        return self.built.driver.path_integral

    @property
    def homology(self) -> Homology:  # type: ignore[override]
        """Theirs."""
        return self.built.driver.homology

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s]."""
        self.built.driver.begin(x, time)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,), in a new world if one is ready."""
        ready = self.builder.ready(self.run.time)
        if isinstance(ready, PirrhtError):
            self._tell(f"{ready}; the drive goes on as planned before")
        elif ready is not None and (plan := self._first(ready, x, left)) is not None:
            self.built = ready
            return plan
        return self.built.driver.plan(x, left)

    def catch_up(self) -> None:
        """Wait for what is being built, and take it.

        Raises:
            SceneError, OptionError: nothing can be planned there.
        """
        ready = self.builder.ready(inf)
        if isinstance(ready, PirrhtError):
            raise ready
        self.built = ready or self.built

    def _first(self, ready: Built, x: Array, left: Callable[[], float] | None) -> Plan | None:
        """The first plan in a new world; None if it has no way to the goal from here."""
        now = self.run.time
        ready.driver.begin(x, now)
        try:
            return ready.driver.plan(x, left)
        except NoReference as error:
            self._tell(f"{error}; the drive goes on as planned before")
            return None
