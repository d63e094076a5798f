"""Context of a recording, fixed before the run, names for what is in it, and the stream that it is written to."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import rerun as rr

from pirrht.arrays import Array
from pirrht.estimation.sampler import PathIntegral
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.planner.tree import HomologyTree
from sim.drive.episode import IDLE, LONGEST_WAIT
from sim.mjcf import Loaded
from sim.mjcf.names import names_of, names_of_solids
from sim.recording.viewer import Look

TREES = 2  # lifted trees shown, one per obstacle

Moment = tuple[int, float]  # a step and simulated time [s]
Moments = Sequence[Moment]


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject:
    """Context of a recording."""

    loaded: Loaded
    tree: HomologyTree | None
    path_integral: PathIntegral
    look: Look
    settings: Mapping[str, object]
    grid: Desirability | None = None  # the exact solution, where it is to be shown

    @property
    def space(self) -> FreeSpace:
        """Free space of the run."""
        return self.path_integral.space

    @property
    def in_space(self) -> bool:
        """Return whether the robot moves in space."""
        return self.space.scene.dimension == 3

    @property
    def maps(self) -> bool:
        """Return whether the robot makes a map of what it sees, and knows no more."""
        return self.space.grain is not None

    @property
    def movers(self) -> tuple[Mover, ...]:
        """Obstacles that move, whether plans know of them or not."""
        return self.loaded.scene.movers

    def among(self, path_integral: PathIntegral) -> Subject:
        """Return the context of a plan whose sampler may be another one, among other obstacles; no tree is lifted."""
        return self if path_integral is self.path_integral else replace(self, path_integral=path_integral, tree=None)

    @property
    def moves(self) -> bool:
        """Return whether obstacles move in the scene."""
        return bool(self.space.scene.movers)

    @property
    def in_time(self) -> bool:
        """Return whether there is a view with time upward: of moving obstacles in the plane."""
        return self.moves and not self.in_space

    @cached_property
    def rise(self) -> float:
        """Height of a second in space and time [m]: at the best speed a path rises as steeply as it goes ahead."""
        return float(self.path_integral.homology.speed)

    @cached_property
    def lift(self) -> tuple[int, ...]:
        """Obstacles, from 0, whose H lifts a tree."""
        if self.look.lift is not None:
            return tuple(dict.fromkeys(k - 1 for k in self.look.lift))
        if self.moves or self.in_space or self.tree is None:  # of many times, or in space: all at once shows nothing
            return ()
        return telling(self.tree, self.path_integral.problem.dynamics.state_of(self.space.scene.start))

    def stream(self) -> Stream:
        """Begin a stream; equal are application ids of equal layouts, and recording ids of equal settings and seed."""
        scene, truth = self.space.scene.name, ("truth",) if self.look.truth else ()
        known = ("lidar",) if self.maps else ()
        application = " ".join(map(str, ("pirrht", scene, *truth, *known, *(k + 1 for k in self.lift))))
        text = json.dumps(dict(self.settings), sort_keys=True, default=str)
        return Stream(application, f"{scene}-{hashlib.sha256(text.encode()).hexdigest()[:12]}")

    @cached_property
    def solids(self) -> tuple[str, ...]:
        """Name of each static solid, in the order of the scene."""
        return names_of_solids(self.loaded, self.space)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each static topological obstacle."""
        return names_of(self.loaded, self.space)

    @property
    def turn(self) -> float:
        """Height of one whole turn in the lifted tree [m]."""
        return 0.45 * float((self.space.scene.upper - self.space.scene.lower).max())

    @property
    def lifted(self) -> list[tuple[int, str, str]]:
        """Obstacle, entity path and title of each lifted tree."""
        lift = () if self.tree is None else self.lift
        return [(k, f"/tree/{k + 1}", f"Height: H of obstacle {k + 1} ({self.names[k]})") for k in lift]


def telling(tree: HomologyTree, x: Array, most: int = TREES) -> tuple[int, ...]:
    """Obstacles, from 0, by which the shortest classes from x (n,) differ, before all others."""
    lengths = tree.lengths(tree.at(x, 0.0))
    first, *others = sorted(lengths, key=lambda winding: lengths[winding]) or [()]
    static = range(len(tree.space.homology.markers))
    apart = [k for winding in others for k in static if winding[k] != first[k]]
    return tuple(dict.fromkeys([*apart, *static]))[:most]


class Stream:
    """One recording with the timelines `step` and `sim_time`: equal data makes equal chunks in the same order."""

    def __init__(self, application: str, recording_id: str) -> None:
        never = rr.ChunkBatcherConfig.NEVER()  # chunks end where we say, not where a clock does
        options = {"send_properties": False, "batcher_config": never}  # properties would hold the wall time
        self.native = rr.RecordingStream(application, recording_id=recording_id, **options)
        self.native.set_log_time_enabled(False)

    def static(self, path: str, *together: rr.AsComponents) -> None:
        """Log something, or several things together, that hold at all times."""
        self.native.log(path, *together, static=True)
        self.cut()

    def log(self, path: str, step: int, time: float, archetype: rr.AsComponents) -> None:
        """Log something at a step and simulated time [s]."""
        IDLE.wait(LONGEST_WAIT)
        self.native.set_time("step", sequence=step)
        self.native.set_time("sim_time", duration=time)
        self.native.log(path, archetype)
        self.cut()

    def columns(self, path: str, moments: Moments, columns: Iterable[Any]) -> None:
        """Log a row for each of many steps and simulated times [s]."""
        IDLE.wait(LONGEST_WAIT)
        steps, times = zip(*moments, strict=True)
        index = [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("sim_time", duration=times)]
        self.native.send_columns(path, indexes=index, columns=columns)

    def flush(self, timeout: float) -> bool:
        """Hand on everything logged so far; whether that worked within the time [s]."""
        with suppress(RuntimeError, ValueError):
            self.native.flush(timeout_sec=timeout)
            return True
        return False

    def cut(self) -> None:
        """Keep chunks in order: those that wait together leave in any; a flush in between is not waited for."""
        self.native.flush(timeout_sec=0)
