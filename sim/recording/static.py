"""Log all that stays as it is: the scene, the robot, the tree, the legend, the settings."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pirrht.arrays import Array
from sim.drawing import strokes
from sim.drawing.colors import DRIVEN, MOVER, mix
from sim.drawing.sides import NAMED
from sim.drawing.strokes import lift, packed
from sim.recording import geoms
from sim.recording.camera import ABOVE, FOLLOWING, above, opening, pixels_per_metre
from sim.recording.geoms import ROOT
from sim.recording.subject import Subject
from sim.recording.truth_view import OPTIMUM, on_floor

OPTIMAL = """

**Green arrow**: the optimal control, solved for on a grid. **Floor**: the exact value, from pale at the goal to dark
where the way is dear, in bands of equal cost; **small arrows** on it: the optimal control there, of a robot with a
heading the best heading. In the table *exact* is each class' share of psi, by paths drawn under the optimal control."""


MOTIONS = """

**Pale outlines**: where the plan takes bodies that move to be in half a second, in one, and so on, the paler the later;
a plan that knows how they move is right about it, one that sees how fast they are takes them to go straight on.

**Space-time**: the same with time upward. The floor is the map, the thin frame above it is now, and the yellow thread
tells when the robot was where. Each **purple tube** is where a body is at every time; grey walls stand, and the goal is
the green pillar. The best paths of the classes are braids around the tubes: what passes a body before it runs on one
side of its tube, what passes behind it on the other. Thin: the heaviest samples. At the best speed a path rises as
steeply as it goes ahead; upright it waits."""
TREE_EDGES = 8000
BODY = "/world/robot/body"
MOVERS = "/world/scene/movers"
MARK = "/world/robot/mark"  # on the map only
SOLID, MOVING = 0.6, 0.8  # opacity of what stands and of what moves: neither hides the robot
RADIUS = 9.0  # of the disc that marks a small robot on the map [px]
TILES = 24  # along the longer side of the floor at most
LEVELS, DASHES = (0.5, 1.0, 1.5), 16  # of H that are marked; dashes over the obstacle that a tree is lifted by

FLOOR = (38, 42, 48)
TILE = (46, 50, 57)
GOAL = (44, 118, 66)
BORDER = (120, 128, 138)
CONTROL = (250, 246, 232)
BRANCH = (120, 170, 205)

Log = Callable[[str, rr.AsComponents | Sequence[rr.AsComponents]], None]


def legend(subject: Subject) -> str:
    """Explain in Markdown the colours and lines of the run, and list the settings."""
    optimum = OPTIMAL if subject.look.truth else ""
    moving = MOTIONS if subject.moves else ""
    rows = "\n".join(f"| {name} | {_text(value)} |" for name, value in properties(subject.settings).items())
    return f"""\
**Thick lines**: the best path of each homology class, with its share of the weight.

**Thin lines**: sampled paths in the colour of their own class; the brighter, the heavier.
Grey ones hit an obstacle, left the workspace or ran out of time.

**White arrow**: the control chosen now.{optimum}

**White line**: the way that the samples of the heaviest class went on average; paler lines: those of other classes.
In a fallback, what is followed instead.

Plans and samples are drawn {subject.look.hz:g} times a second; the panel *Why* says of which moment they are.

**Yellow line**: the path driven.{moving}

A class such as `0,-1` counts whole turns around obstacles 1, 2, ... against the straight
line to the goal, counter-clockwise positive; with many obstacles `+5 -12` names those with a turn.

| setting | value |
|---|---|
{rows}
"""


def key(subject: Subject) -> str:
    """Return what the numbers, letters and colours on the map mean, in Markdown."""
    rows = [f"**{sign}** {name}" for sign, name, _ in subject.marks if name != f"obstacle {sign}"]
    if len(rows) < len(subject.marks):
        rows.append("Other numbers: as in *obstacle 1*.")
    moving = " *Lilac*: moving obstacles." if subject.moves else ""
    signs = f"*Yellow*: the robot and its path. *White*: the path of most weight, and the control.{moving}"
    return "  \n".join([signs, *rows])


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


def stage(subject: Subject, log: Log) -> None:
    """Log everything that stays as it is, each under its entity path."""
    log("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log("/about", rr.TextDocument(legend(subject), media_type=rr.MediaType.MARKDOWN))
    _ground(subject, log)
    log("/key", rr.TextDocument(key(subject), media_type=rr.MediaType.MARKDOWN))
    robot, moving, obstacles = (getattr(subject.loaded, f"{kind}_geoms") for kind in ("robot", "moving", "obstacle"))
    model = geoms.see_through(
        subject.loaded.model, np.where(moving, MOVING, np.where(robot, 1.0, SOLID)), moving, MOVER
    )
    shown = geoms.shown(model)
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
        label = {"labels": [mover.name.replace("_", " ")], "colors": [MOVER], "show_labels": all_named(subject)}
        log(label_path(mover.name), rr.Points3D([(0, 0, 0)], radii=0.0, **label))
    if subject.grid is not None and not subject.grid.moves:
        for path, picture in on_floor(subject.grid, subject.space, 0.0):
            log(path, picture)
    _robot(subject, shown & robot, log)
    log(ABOVE, above(subject.space.scene))
    log(FOLLOWING, [opening()])
    log("/world/path", rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.011]))
    log("/why/weight/switch", rr.SeriesPoints(names="class switch", colors=DRIVEN, markers="down", marker_sizes=7))
    for obstacle, path, _ in subject.lifted:
        _tree(subject, obstacle, path, log)


def _robot(subject: Subject, drawn: NDArray[np.bool_], log: Log) -> None:
    """The geoms of each of the robot's bodies in its own frame; of what is fixed to the root also where."""
    model = subject.loaded.model
    log("/world/robot", _arrows(truth=subject.look.truth))
    top = geoms.top(model)
    radius = RADIUS / pixels_per_metre(subject.space.scene)
    if radius > subject.space.scene.robot_radius:
        rim = {"radii": [1.15 * radius, radius], "centers": [(0.0, 0.0, top + 0.1), (0.0, 0.0, top + 0.2)]}
        log(MARK, rr.Cylinders3D(lengths=[0.01] * 2, **rim, colors=[FLOOR, DRIVEN], fill_mode="solid"))
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
    return f"{MOVERS}/{rr.escape_entity_path_part(name)}"


def all_named(subject: Subject) -> bool:
    """Return whether so few obstacles move that all bear their names; others bear theirs when hovered."""
    return len(subject.space.scene.movers) <= NAMED


def label_path(name: str) -> str:
    """The entity of a moving body's name, which moves along."""
    return f"{mover_path(name)}/name"


def _arrows(*, truth: bool) -> rr.Arrows3D:
    """The control chosen; below it and thicker, so that neither hides the other, the optimal one."""
    looks = [((0, 0, 0.12), CONTROL, 0.022), ((0, 0, 0.07), OPTIMUM, 0.034)]
    origins, colors, radii = (list(part) for part in zip(*looks[: 1 + truth], strict=True))
    return rr.Arrows3D.from_fields(origins=origins, colors=colors, radii=radii)


def _ground(subject: Subject, log: Log) -> None:
    """Floor, border of the domain, and goal."""
    scene = subject.space.scene
    center, half = 0.5 * (scene.lower + scene.upper), 0.5 * (scene.upper - scene.lower)
    log("/world/scene/floor", _tiles(scene.lower, scene.upper))
    corners = center + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    log("/world/scene/border", rr.LineStrips3D(lift(corners, 0.0)[None], radii=0.01, colors=[BORDER]))
    disc = {"lengths": [0.004], "radii": [scene.goal.radius], "centers": [(*scene.goal.center, 0.002)]}
    log("/world/scene/goal", rr.Cylinders3D(**disc, colors=[GOAL], fill_mode="solid"))


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
    levels = levels_of(subject)
    log(f"{path}/levels", rr.LineStrips3D(levels, radii=0.004, colors=[mix(BORDER, FLOOR, 0.6)]))
    axis = levels[:, 2]
    log(f"{path}/axis", rr.LineStrips3D(axis[None], radii=0.008, colors=[BORDER]))
    told = [f"H = {level:g}" for level in LEVELS]
    log(f"{path}/axis/names", rr.Points3D(axis, radii=0.03, labels=told, colors=[BORDER], show_labels=True))
    marker = subject.space.homology.markers[obstacle]
    heights = np.linspace(0.0, LEVELS[-1] * subject.turn, 2 * DASHES)
    dashes = np.stack([lift(np.array([marker, marker]), pair) for pair in heights.reshape(-1, 2)])
    log(f"{path}/marker", rr.LineStrips3D(dashes, radii=0.01, colors=[CONTROL]))


def levels_of(subject: Subject) -> strokes.Floats:
    """Return the levels of H along the far sides, (levels, 3, 3) [m]; their last points bear their names."""
    (x0, y0), (x1, y1) = subject.space.scene.lower, subject.space.scene.upper
    far = np.array([(x0, y0), (x0, y1), (x1, y1)])
    return np.stack([lift(far, level * subject.turn) for level in LEVELS])


def branches(subject: Subject, ends: Array) -> rr.LineStrips3D:
    """Edges of a lifted tree, of ends (k, 2, 3) [m, m, turns]."""
    colors = mix(BRANCH, FLOOR, 0.35)
    return rr.LineStrips3D(lift(ends, ends[..., 2] * subject.turn), radii=0.004, colors=[colors])
