"""What a recording shows from the start: the scene, the robot, the tree, the legend, the settings."""

from __future__ import annotations

import hashlib
import json
import platform
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.estimation.sampler import PathIntegral
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.tree.homology_tree import HomologyTree
from sim.drawing import strokes
from sim.drawing.colors import DRIVEN, mix
from sim.drawing.strokes import lift, packed
from sim.mjcf import Loaded
from sim.recording import geoms
from sim.recording.bodies import ROOT, Bodies
from sim.recording.camera import ABOVE, FOLLOWING, above, opening
from sim.recording.look import Look
from sim.recording.truth_view import OPTIMUM, on_floor

TREE_EDGES = 8000
SERIES = 3  # solids whose names differ by a number only, and that keep them
BODY = "/world/robot/body"
TILES = 24  # along the longer side of the floor at most
FEW = 8  # obstacles that bear their names on the map, not only their numbers
LEVELS, DASHES = (0.5, 1.0, 1.5), 16  # of H that are marked; dashes over the obstacle that a tree is lifted by
TREES = 2  # lifted trees shown, one per obstacle

FLOOR = (38, 42, 48)
TILE = (46, 50, 57)
GOAL = (44, 118, 66)
BORDER = (120, 128, 138)
CONTROL = (250, 246, 232)
BRANCH = (120, 170, 205)

Log = Callable[[str, rr.AsComponents | Sequence[rr.AsComponents]], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject:
    """What a recording is about; fixed before the drive."""

    loaded: Loaded
    tree: HomologyTree | None
    path_integral: PathIntegral
    look: Look
    settings: Mapping[str, object]
    grid: Desirability | None = None  # the exact solution, where it is to be shown

    @property
    def space(self) -> FreeSpace:
        """Where the drive takes place."""
        return self.path_integral.space

    @cached_property
    def lift(self) -> tuple[int, ...]:
        """Obstacles, from 0, whose H lifts a tree."""
        if self.look.lift is not None:
            return tuple(dict.fromkeys(k - 1 for k in self.look.lift))
        problem = self.path_integral.problem
        return () if self.tree is None else telling(self.tree, problem.dynamics.state_of(problem.scene.start))

    @property
    def name(self) -> str:
        """Scene, method and seed."""
        parts = (self.space.scene.name, self.settings.get("method"), self.settings.get("seed"))
        return " ".join(str(part) for part in parts if part is not None)

    @property
    def application(self) -> str:
        """The same for recordings that are laid out alike."""
        truth = ("truth",) if self.look.truth else ()
        parts = ("pirrht", self.space.scene.name, *truth, *(k + 1 for k in self.lift))
        return " ".join(str(part) for part in parts)

    @property
    def id(self) -> str:
        """The same for the same scene and settings, seed included."""
        text = json.dumps(dict(self.settings), sort_keys=True, default=str)
        return f"{self.space.scene.name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"

    @property
    def bodies(self) -> Bodies:
        """Those of the robot, where they are at the start."""
        return Bodies(self.loaded)

    @cached_property
    def solids(self) -> tuple[str, ...]:
        """What to call each solid that stands, in the order of the scene."""
        loaded = self.loaded
        given = geoms.names(loaded.model, loaded.obstacle_geoms & ~loaded.moving_geoms)
        obstacles = enumerate(self.space.obstacles, 1)
        number = {i: k for k, component in obstacles for i in component.members}
        return tuple(called(given, number))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What to call each topological obstacle: as the one of its solids that its marker lies in."""
        places = [obstacle.position[:2] for obstacle in self.space.scene.obstacles]
        found = []
        for component, marker in zip(self.space.obstacles, self.space.homology.markers, strict=True):
            off = [float(np.linalg.norm(places[i] - marker)) for i in component.members]
            found.append(self.solids[component.members[int(np.argmin(off))]])
        return tuple(found)

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
        spare = f"obstacle {number[i]}" if i in number else "a wall"
        found.append(name.replace("_", " ") if plain else spare)
    return found


def _stem(name: str) -> str:
    return name.rstrip("0123456789 _-")


def stage(subject: Subject, log: Log) -> None:
    """Log everything that stays as it is, each under its entity path."""
    log("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log("/about", rr.TextDocument(_legend(subject), media_type=rr.MediaType.MARKDOWN))
    _ground(subject, log)
    model, obstacles = subject.loaded.model, subject.loaded.obstacle_geoms
    shown, robot, moving = geoms.shown(model), subject.loaded.robot_geoms, subject.loaded.moving_geoms
    for folder, mask in (
        ("/world/scene/obstacles", obstacles & ~moving),
        ("/world/scene/others", shown & ~obstacles & ~robot & ~moving),
    ):
        for name, solid in geoms.solids(model, mask).items():
            log(f"{folder}/{name}", solid)
    for mover in subject.loaded.scene.movers:
        mask = (shown | obstacles) & geoms.of_body(model, mover.name)
        for name, solid in geoms.solids(model, mask, body=mover.name).items():
            log(f"{mover_path(mover.name)}/{name}", solid)
    if subject.grid is not None and not subject.grid.moves:
        for path, picture in on_floor(subject.grid, subject.space, 0.0):
            log(path, picture)
    _robot(subject, shown & robot, log)
    log(ABOVE, above(subject.space.scene))
    log(FOLLOWING, [opening()])
    log("/world/path", rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.011]))
    log(
        "/why/weight/switch",
        rr.SeriesPoints(names="class switch", colors=DRIVEN, markers="down", marker_sizes=7),
    )
    for obstacle, path, _ in subject.lifted:
        _tree(subject, obstacle, path, log)


def _robot(subject: Subject, drawn: NDArray[np.bool_], log: Log) -> None:
    """The geoms of each of the robot's bodies in its own frame; of what is fixed to the root also where."""
    model = subject.loaded.model
    log("/world/robot", _arrows(truth=subject.look.truth))
    bodies = subject.bodies
    for name, path in ((ROOT, BODY), *((part.name, part_path(part.name)) for part in bodies.parts)):
        own = drawn & (model.geom_bodyid == model.body(name).id)
        for kind, solid in geoms.solids(model, own, body=name).items():
            log(f"{path}/{kind}", solid)
    for part in bodies.parts:
        if part not in bodies.wheels:
            pose = rr.Transform3D(translation=part.place, quaternion=np.roll(part.turn, -1))
            log(part_path(part.name), pose)


def part_path(name: str) -> str:
    """The entity of a body of the robot other than its root."""
    return f"/world/robot/parts/{rr.escape_entity_path_part(name.removeprefix('robot/'))}"


def mover_path(name: str) -> str:
    """The entity of a body that moves: its pose on the timeline, with its geoms below it."""
    return f"/world/scene/movers/{rr.escape_entity_path_part(name)}"


def _arrows(*, truth: bool) -> rr.Arrows3D:
    """The control chosen; below it and thicker, so that neither hides the other, the optimal one."""
    looks = [((0, 0, 0.12), CONTROL, 0.022), ((0, 0, 0.07), OPTIMUM, 0.034)]
    origins, colors, radii = (list(part) for part in zip(*looks[: 1 + truth], strict=True))
    return rr.Arrows3D.from_fields(origins=origins, colors=colors, radii=radii)


def _ground(subject: Subject, log: Log) -> None:
    """Floor, border of the domain, goal, and the numbers of the obstacles that classes count turns around."""
    scene = subject.space.scene
    center, half = 0.5 * (scene.lower + scene.upper), 0.5 * (scene.upper - scene.lower)
    log("/world/scene/floor", _tiles(scene.lower, scene.upper))
    corners = center + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    log("/world/scene/border", rr.LineStrips3D(lift(corners, 0.0)[None], radii=0.01, colors=[BORDER]))
    disc = {"lengths": [0.004], "radii": [scene.goal.radius], "centers": [(*scene.goal.center, 0.002)]}
    log("/world/scene/goal", rr.Cylinders3D(**disc, colors=[GOAL], fill_mode="solid"))
    markers = subject.space.homology.markers
    few = len(markers) <= FEW
    names = [f"{k} {name}" if few and not name.endswith(f" {k}") else f"{k}" for k, name in enumerate(subject.names, 1)]
    places = np.vstack([scene.goal.center, markers])
    labels = rr.Points3D(lift(places, 0.02), radii=0.001, labels=["goal", *names], colors=[CONTROL], show_labels=True)
    log("/world/scene/names", labels)


def _tiles(lower: Array, upper: Array) -> rr.Boxes3D:
    """A floor of square tiles in two shades, by which one sees how far it is: a metre wide, in a large hall more."""
    side = max(1.0, float(np.ceil((upper - lower).max() / TILES)))
    edges = [np.append(np.arange(a, b - 1e-6, side), b) for a, b in zip(lower, upper, strict=True)]
    middles = np.stack(np.meshgrid(*(0.5 * (e[1:] + e[:-1]) for e in edges), indexing="ij"), axis=-1)
    halves = np.stack(np.meshgrid(*(0.5 * np.diff(e) for e in edges), indexing="ij"), axis=-1)
    even = (np.indices(middles.shape[:2]).sum(axis=0) % 2).ravel()
    sizes, centers = (
        np.column_stack([part.reshape(-1, 2), np.full(len(even), z)]) for part, z in ((halves, 0.01), (middles, -0.012))
    )
    return rr.Boxes3D(
        half_sizes=sizes, centers=centers, colors=packed(np.array([FLOOR, TILE])[even]), fill_mode="solid"
    )


def _tree(subject: Subject, obstacle: int, path: str, log: Log) -> None:
    assert subject.tree is not None
    ends, _ = strokes.tree_edges(subject.tree, obstacle, TREE_EDGES)
    log(f"{path}/edges", branches(subject, ends))
    _axes(subject, obstacle, path, log)


def _axes(subject: Subject, obstacle: int, path: str, log: Log) -> None:
    """Levels of H along the far sides, its axis with numbers, and a dashed line over the obstacle that is counted."""
    scene, turn = subject.space.scene, subject.turn
    (x0, y0), (x1, y1) = scene.lower, scene.upper
    far = np.array([(x0, y0), (x0, y1), (x1, y1)])
    levels = np.stack([lift(far, level * turn) for level in LEVELS])
    log(f"{path}/levels", rr.LineStrips3D(levels, radii=0.004, colors=[mix(BORDER, FLOOR, 0.6)]))
    axis = np.stack([lift(far[2], level * turn) for level in LEVELS])
    log(f"{path}/axis", rr.LineStrips3D(axis[None], radii=0.008, colors=[BORDER]))
    told = [f"H = {level:g}" for level in LEVELS]
    log(f"{path}/axis/names", rr.Points3D(axis, radii=0.03, labels=told, colors=[BORDER], show_labels=True))
    marker = subject.space.homology.markers[obstacle]
    heights = np.linspace(0.0, LEVELS[-1] * turn, 2 * DASHES)
    dashes = np.stack([lift(np.array([marker, marker]), pair) for pair in heights.reshape(-1, 2)])
    log(f"{path}/marker", rr.LineStrips3D(dashes, radii=0.01, colors=[CONTROL]))


def branches(subject: Subject, ends: Array) -> rr.LineStrips3D:
    """Edges of a lifted tree, of ends (k, 2, 3) [m, m, turns]."""
    colors = mix(BRANCH, FLOOR, 0.35)
    return rr.LineStrips3D(lift(ends, ends[..., 2] * subject.turn), radii=0.004, colors=[colors])


def telling(tree: HomologyTree, x: Array, most: int = TREES) -> tuple[int, ...]:
    """Obstacles, from 0, by which the shortest classes from x (n,) differ, before all others."""
    lengths = tree.lengths(x)
    windings = sorted(lengths, key=lambda winding: lengths[winding])
    apart = [k for w in windings[1:] for k in np.flatnonzero(np.not_equal(w, windings[0])).tolist()]
    return tuple(dict.fromkeys([*apart, *range(tree.space.homology.M)]))[:most]


OPTIMAL = """

**Green arrow**: the optimal control, solved for on a grid. **Floor**: the exact value, from pale at the goal to dark
where the way is dear, in bands of equal cost; **small arrows** on it: the optimal control there, of a robot with a
heading the best heading. In the table *exact* is each class' share of psi, by paths drawn under the optimal control."""


def _legend(subject: Subject) -> str:
    """What the colours and lines of the drive mean, and the settings, in Markdown."""
    optimum = OPTIMAL if subject.look.truth else ""
    rows = "\n".join(f"| {name} | {_text(value)} |" for name, value in properties(subject.settings).items())
    return f"""\
**Thick lines**: the best path of each homology class, with its share of the weight.

**Thin lines**: sampled paths in the colour of their own class; the brighter, the heavier.
Grey ones hit an obstacle, left the workspace or ran out of time.

**White arrow**: the control chosen now.{optimum}

**White line**: the way that the samples of the heaviest class went on average; paler lines: those of other classes.
In a fallback, what is followed instead.

Plans and samples are drawn {subject.look.hz:g} times a second; the panel *Why* says of which moment they are.

**Yellow line**: the path driven.

A class such as `0,-1` counts whole turns around obstacles 1, 2, ... against the straight
line to the goal, counter-clockwise positive; with many obstacles `+5 -12` names those with a turn.

| setting | value |
|---|---|
{rows}
"""


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def properties(settings: Mapping[str, object]) -> dict[str, object]:
    """Settings and versions as numbers and texts."""
    plain = {
        name: value if isinstance(value, int | float | str) else str(value)
        for name, value in settings.items()
        if value is not None
    }
    packages = {name: version(name) for name in ("mujoco", "numpy", "rerun-sdk")}
    return {**plain, "python": platform.python_version(), **packages}
