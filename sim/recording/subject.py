"""Subject of a recording, and names for what is in it."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from string import ascii_lowercase
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.sampler import PathIntegral
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from sim.mjcf import Loaded
from sim.recording import geoms
from sim.recording.geoms import Bodies
from sim.recording.options import Look
from sim.recording.reasons import Bystanders

SERIES = 6  # solids whose names differ by a number only, and that keep them
TREES = 2  # lifted trees shown, one per obstacle
FEW = 8  # obstacles that bear their names on the map, not only their numbers
MEMBERS = 3  # solids of one obstacle that are named
SPARE = "a wall"  # name of a solid of the border that has none of its own


class Mark(NamedTuple):
    """A number or letter on the map."""

    sign: str
    name: str  # of the solids that it stands for
    place: Array  # (2,) that it belongs to [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject:
    """Subject of a recording; fixed before the run."""

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
    def moves(self) -> bool:
        """Return whether obstacles move in the scene."""
        return bool(self.space.scene.movers)

    @cached_property
    def rise(self) -> float:
        """Height of a second in space and time [m]: at the best speed a way goes up as steeply as ahead."""
        return float(self.path_integral.homology.speed)

    @cached_property
    def lift(self) -> tuple[int, ...]:
        """Obstacles, from 0, whose H lifts a tree."""
        if self.look.lift is not None:
            return tuple(dict.fromkeys(k - 1 for k in self.look.lift))
        problem = self.path_integral.problem
        if self.moves:  # a tree of many times, seen from above all of them at once, tells nothing
            return ()
        return () if self.tree is None else telling(self.tree, problem.dynamics.state_of(problem.scene.start))

    @property
    def name(self) -> str:
        """Scene, method and seed."""
        parts = (self.space.scene.name, self.settings.get("method"), self.settings.get("seed"))
        return " ".join(str(part) for part in parts if part is not None)

    @property
    def application(self) -> str:
        """Application id, equal for recordings that are laid out alike."""
        truth = ("truth",) if self.look.truth else ()
        parts = ("pirrht", self.space.scene.name, *truth, *(k + 1 for k in self.lift))
        return " ".join(str(part) for part in parts)

    @property
    def id(self) -> str:
        """Recording id, equal for equal scene and settings, seed included."""
        text = json.dumps(dict(self.settings), sort_keys=True, default=str)
        return f"{self.space.scene.name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"

    @property
    def bodies(self) -> Bodies:
        """Those of the robot, where they are at the start."""
        return Bodies(self.loaded)

    @cached_property
    def bystanders(self) -> Bystanders | None:
        """The bodies that move, if there are any."""
        return Bystanders(self.space.scene.movers, self.space.scene.footprint) if self.moves else None

    @cached_property
    def solids(self) -> tuple[str, ...]:
        """Name of each static solid, in the order of the scene."""
        loaded = self.loaded
        given = geoms.names(loaded.model, loaded.obstacle_geoms & ~loaded.moving_geoms)
        obstacles = enumerate(self.space.obstacles, 1)
        number = {i: k for k, component in obstacles for i in component.members}
        return tuple(called(given, number))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each topological obstacle: that of the solid that its marker lies in."""
        places = [obstacle.position[:2] for obstacle in self.space.scene.obstacles]
        found = []
        for component, marker in zip(self.space.obstacles, self.space.homology.markers, strict=True):
            off = [float(np.linalg.norm(places[i] - marker)) for i in component.members]
            found.append(self.solids[component.members[int(np.argmin(off))]])
        return tuple(found)

    @cached_property
    def marks(self) -> tuple[Mark, ...]:
        """Return a number for each obstacle that classes count turns around, a letter for named border solids."""
        solids, places = self.solids, [solid.position[:2] for solid in self.space.scene.obstacles]
        found, inner = [], set()
        for k, (part, marker) in enumerate(zip(self.space.obstacles, self.space.homology.markers, strict=True), 1):
            inner |= set(part.members)
            names = list(dict.fromkeys(solids[i] for i in part.members))
            more = f" and {len(names) - MEMBERS} more" if len(names) > MEMBERS else ""
            found.append(Mark(str(k), ", ".join(names[:MEMBERS]) + more, marker))
        outer = [i for i, name in enumerate(solids) if i not in inner and name != SPARE]
        found += [Mark(letter, solids[i], places[i]) for letter, i in zip(ascii_lowercase, outer, strict=False)]
        return tuple(found)

    @property
    def labels(self) -> list[str]:
        """Return what marks are called on the map: where there are few also by name."""
        few = len(self.marks) <= FEW
        return [f"{sign} {name}" if few and not name.endswith(f" {sign}") else sign for sign, name, _ in self.marks]

    @property
    def turn(self) -> float:
        """Height of one whole turn in the lifted tree [m]."""
        scene = self.space.scene
        return 0.45 * float((scene.upper - scene.lower).max())

    @property
    def lifted(self) -> list[tuple[int, str, str]]:
        """Obstacle, entity path and title of each lifted tree."""
        if self.tree is None:
            return []
        names = {k: self.names[k] for k in self.lift}
        also = {k: "" if name == f"obstacle {k + 1}" else f" ({name})" for k, name in names.items()}
        return [(k, f"/tree/{k + 1}", f"Height: H of obstacle {k + 1}{name}") for k, name in also.items()]


def called(given: Sequence[str], number: Mapping[int, int]) -> list[str]:
    """Names for solids: those given, unless they are missing, used twice, or one of a long series.

    Args:
        given: in the file, empty where there is none.
        number: of the obstacle that a solid belongs to, as on the map, by place in `given`.
    """
    stems = Counter(_stem(name) for name in given)
    found = []
    for i, name in enumerate(given):
        plain = name and given.count(name) == 1 and stems[_stem(name)] <= SERIES
        spare = f"obstacle {number[i]}" if i in number else SPARE
        found.append(name.replace("_", " ") if plain else spare)
    return found


def _stem(name: str) -> str:
    return name.rstrip("0123456789 _-")


def telling(tree: HomologyTree, x: Array, most: int = TREES) -> tuple[int, ...]:
    """Obstacles, from 0, by which the shortest classes from x (n,) differ, before all others."""
    lengths = tree.lengths(tree.at(x, 0.0))
    windings = sorted(lengths, key=lambda winding: lengths[winding])
    standing = len(tree.space.homology.markers)
    apart = [k for w in windings[1:] for k in np.flatnonzero(np.not_equal(w, windings[0])).tolist() if k < standing]
    return tuple(dict.fromkeys([*apart, *range(standing)]))[:most]
