"""What a recording shows from the start: the scene, the robot, the tree, the legend, the settings."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.tree.homology_tree import HomologyTree
from sim.drawing import strokes
from sim.drawing.colors import DRIVEN
from sim.drawing.strokes import lift, packed
from sim.mjcf import Loaded
from sim.recording import geoms
from sim.recording.look import Look

TREE_EDGES = 20000
TREES = 2  # lifted trees shown, one per obstacle

FLOOR = (38, 42, 48)
GOAL = (44, 118, 66)
BORDER = (120, 128, 138)
CONTROL = (250, 246, 232)
OPTIMUM = (150, 235, 60)

Log = Callable[[str, rr.AsComponents], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject:
    """What a recording is about; fixed before the drive."""

    loaded: Loaded
    tree: HomologyTree | None
    path_integral: PathIntegral
    look: Look
    settings: Mapping[str, object]

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
    def turn(self) -> float:
        """Height of one whole turn in the lifted tree [m]."""
        scene = self.space.scene
        return 0.45 * float((scene.upper - scene.lower).max())

    @property
    def lifted(self) -> list[tuple[int, str, str]]:
        """Obstacle, entity path and title of each lifted tree."""
        if self.tree is None:
            return []
        names = {k: self.space.obstacles[k].names[0] for k in self.lift}
        return [(k, f"/tree/{k + 1}", f"Height: H of obstacle {k + 1} ({name})") for k, name in names.items()]


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
        ("/world/robot/body", shown & robot),
    ):
        for name, solid in geoms.solids(model, mask).items():
            log(f"{folder}/{name}", solid)
    for mover in subject.loaded.scene.movers:
        mask = (shown | obstacles) & geoms.of_body(model, mover.name)
        for name, solid in geoms.solids(model, mask, body=mover.name).items():
            log(f"{mover_path(mover.name)}/{name}", solid)
    log("/world/robot", _arrows(truth=subject.look.truth))
    log("/world/tape", rr.LineStrips3D.from_fields(colors=[CONTROL], radii=[0.01]))
    log("/world/path", rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.011]))
    log(
        "/why/weight/switch",
        rr.SeriesPoints(names="class switch", colors=DRIVEN, markers="down", marker_sizes=7),
    )
    for obstacle, path, _ in subject.lifted:
        _tree(subject, obstacle, path, log)


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
    floor = {"half_sizes": [(*half, 0.01)], "centers": [(*center, -0.012)], "colors": [FLOOR]}
    log("/world/scene/floor", rr.Boxes3D(**floor, fill_mode="solid"))
    corners = center + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    log("/world/scene/border", rr.LineStrips3D(lift(corners, 0.0)[None], radii=0.01, colors=[BORDER]))
    disc = {"lengths": [0.004], "radii": [scene.goal.radius], "centers": [(*scene.goal.center, 0.002)]}
    log("/world/scene/goal", rr.Cylinders3D(**disc, colors=[GOAL], fill_mode="solid"))
    markers = subject.space.homology.markers
    names = [f"{k + 1}" for k in range(len(markers))]
    places = np.vstack([scene.goal.center, markers])
    labels = rr.Points3D(lift(places, 0.02), radii=0.001, labels=["goal", *names], colors=[CONTROL], show_labels=True)
    log("/world/scene/names", labels)


def _tree(subject: Subject, obstacle: int, path: str, log: Log) -> None:
    assert subject.tree is not None
    ends, middle = strokes.tree_edges(subject.tree, obstacle, TREE_EDGES)
    log(f"{path}/edges", branches(subject, ends, middle))
    scene = subject.space.scene
    x, y = np.column_stack([scene.lower, scene.upper])
    back = np.array([(x[0], y[1]), (x[0], y[0])])
    for level in (0.5, 1.0, 1.5):
        log(
            f"{path}/levels/{level:g}",
            rr.LineStrips3D(
                lift(back, level * subject.turn)[None],
                radii=0.008,
                colors=[BORDER],
                labels=[f"H = {level:g}"],
                show_labels=True,
            ),
        )


def branches(subject: Subject, ends: Array, middle: Array) -> rr.LineStrips3D:
    """Edges of a lifted tree: ends (k, 2, 3) [m, m, turns] and heights of their middles (k,) [turns]."""
    assert subject.tree is not None
    limit = subject.tree.limit
    colors = strokes.heights(middle, 1.0 - limit, 1.0 + limit)
    return rr.LineStrips3D(lift(ends, ends[..., 2] * subject.turn), radii=0.005, colors=packed(colors))


def telling(tree: HomologyTree, x: Array, most: int = TREES) -> tuple[int, ...]:
    """Obstacles, from 0, by which the shortest classes from x (n,) differ, before all others."""
    lengths = tree.lengths(x if len(x) >= tree.steering.n else np.append(x[:2], 0.0))
    windings = sorted(lengths, key=lambda winding: lengths[winding])
    standing = tree.space.homology.M
    apart = [k for w in windings[1:] for k in np.flatnonzero(np.not_equal(w, windings[0])).tolist() if k < standing]
    return tuple(dict.fromkeys([*apart, *range(standing)]))[:most]


def _legend(subject: Subject) -> str:
    """What the colours and lines of the drive mean, and the settings, in Markdown."""
    optimum = "\n\n**Green arrow**: the optimal control, solved for on a grid." if subject.look.truth else ""
    rows = "\n".join(f"| {name} | {_text(value)} |" for name, value in properties(subject.settings).items())
    return f"""\
**Thick lines**: the best path of each homology class, with its share of the weight.

**Thin lines**: sampled paths in the colour of their own class; the brighter, the heavier.
Grey ones hit an obstacle, left the workspace or ran out of time.

**White arrow and line**: the control chosen now, and where its tape alone would lead.{optimum}

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
