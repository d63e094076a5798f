"""Log all that stays as it is: the scene, the robot, the tree, the legend, the settings."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from sim.drawing import strokes
from sim.drawing.colors import DRIVEN, MOVER, mix
from sim.drawing.sides import NAMED
from sim.drawing.strokes import lift, packed
from sim.recording import geoms
from sim.recording.camera import ABOVE, FOLLOWING, above, opening, pixels_per_metre
from sim.recording.subject import Subject
from sim.recording.truth_view import OPTIMUM, on_floor

LEGEND = """\
**Thick lines**: the best path of each homology class, with its share of the weight.

**Thin lines**: sampled paths in the colour of their own class; the brighter, the heavier.
Grey ones hit an obstacle, left the workspace or ran out of time.

**White arrow**: the control. **White line**: the mean of the samples of the heaviest class; paler lines: other classes.

**Yellow line**: the path driven. Plans and samples are drawn {hz:g} times a second.

A class such as `0,-1` counts whole turns around obstacles 1, 2, ... against the straight
line to the goal, counter-clockwise positive; with many obstacles `+5 -12` names those with a turn.
"""
OPTIMAL = """
**Green arrow**: the optimal control, solved for on a grid. **Floor**: the exact value, from pale at the goal to dark
where it is great, in bands of equal cost; **small arrows**: the optimal control there, of a robot with a
heading the best heading. In the table *exact* is each class' share of psi, by paths drawn under the optimal control.
"""
MOTIONS = """
**Pale outlines**: where the plan predicts moving obstacles in half a second, in one, and so on, the paler the later.

**Space-time**: the map as floor, time upward. The thin frame is now; the yellow thread shows when the robot was where.
Each **purple tube** is where an obstacle is at every time; grey walls are static, the green pillar is the goal. The
best paths of the classes are braids around the tubes: what passes an obstacle before it runs on one side of its tube,
what passes behind it on the other. Thin: the heaviest samples. At the best speed a path rises as steeply as it goes on.
"""
TREE_EDGES = 8000
BODY = "/world/robot/body"
MOVERS = "/world/scene/movers"
MARK = "/world/robot/mark"  # on the map only
STATIC, MOVING = 0.6, 0.8  # opacity of static and moving obstacles: neither hides the robot
RADIUS = 9.0  # of the disc that marks a small robot on the map [px]
TILES = 24  # along the longer side of the floor at most
LEVELS = (0.5, 1.0, 1.5)  # of H that are marked

FLOOR = (38, 42, 48)
TILE = (46, 50, 57)
GOAL = (44, 118, 66)
BORDER = (120, 128, 138)
CONTROL = (250, 246, 232)
BRANCH = mix((120, 170, 205), FLOOR, 0.35)

Log = Callable[[str, rr.AsComponents | Sequence[rr.AsComponents]], None]


def legend(subject: Subject) -> str:
    """Explain in Markdown the colours and lines of the run, and list the settings."""
    parts = [LEGEND.format(hz=subject.look.hz), OPTIMAL * subject.look.truth, MOTIONS * subject.moves]
    settings = properties(subject.settings).items()
    rows = [f"| {name} | {f'{value:g}' if isinstance(value, float) else value} |" for name, value in settings]
    return "\n".join(["".join(parts), "| setting | value |", "|---|---|", *rows])


def key(subject: Subject) -> str:
    """Return what the numbers and colours on the map mean, in Markdown."""
    named = [(f"obstacle {k}", f"**{k}** {name}") for k, name in enumerate(subject.names, 1)]
    rows = [row for spare, row in named if not row.endswith(f" {spare}")]
    if len(rows) < len(named):
        rows.append("Other numbers: as in *obstacle 1*.")
    moving = " *Lilac*: moving obstacles." if subject.moves else ""
    signs = f"*Yellow*: the robot and its path. *White*: the path of most weight, and the control.{moving}"
    return "  \n".join([signs, *rows])


def properties(settings: Mapping[str, object]) -> dict[str, object]:
    """Settings and versions as numbers and texts."""
    plain = {n: v if isinstance(v, int | float | str) else str(v) for n, v in settings.items() if v is not None}
    packages = {name: version(name) for name in ("mujoco", "numpy", "rerun-sdk")}
    return {**plain, "python": platform.python_version(), **packages}


def stage(subject: Subject, log: Log) -> None:
    """Log everything that stays as it is, each under its entity path."""
    markdown = {"media_type": rr.MediaType.MARKDOWN}
    log("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log("/about", rr.TextDocument(legend(subject), **markdown))
    log("/key", rr.TextDocument(key(subject), **markdown))
    _ground(subject, log)
    loaded, scene = subject.loaded, subject.space.scene
    robot, moving, obstacles = (getattr(loaded, f"{kind}_geoms") for kind in ("robot", "moving", "obstacle"))
    opacity = np.where(moving, MOVING, np.where(robot, 1.0, STATIC))
    model = geoms.see_through(loaded.model, opacity, moving, MOVER)
    shown = geoms.shown(model)
    for folder, mask in (
        ("/world/scene/obstacles", obstacles & ~moving),
        ("/world/scene/others", shown & ~obstacles & ~robot & ~moving),
    ):
        for name, solid in geoms.solids(model, mask).items():
            log(f"{folder}/{name}", solid)
    for mover in scene.movers:
        mask = (shown | obstacles) & geoms.of_body(model, mover.name)
        for name, solid in geoms.solids(model, mask, body=mover.name).items():
            log(f"{mover_path(mover.name)}/{name}", solid)
        label = {"labels": [mover.name.replace("_", " ")], "colors": [MOVER], "show_labels": all_named(subject)}
        log(label_path(mover.name), rr.Points3D([(0, 0, 0)], radii=0.0, **label))
    if subject.grid is not None and not subject.grid.moves:
        for path, picture in on_floor(subject.grid, subject.space, 0.0):
            log(path, picture)
    log("/world/robot", _arrows(truth=subject.look.truth))
    for kind, solid in geoms.solids(model, shown & robot, body=geoms.ROOT).items():
        log(f"{BODY}/{kind}", solid)
    radius, top = RADIUS / pixels_per_metre(scene), geoms.top(model)
    if radius > scene.robot_radius:
        rim = {"radii": [1.15 * radius, radius], "centers": [(0.0, 0.0, top + 0.1), (0.0, 0.0, top + 0.2)]}
        log(MARK, rr.Cylinders3D(lengths=[0.01] * 2, **rim, colors=[FLOOR, DRIVEN], fill_mode="solid"))
    log(ABOVE, above(scene))
    log(FOLLOWING, [opening()])
    named = lift(np.vstack([scene.goal.center, subject.space.homology.markers.reshape(-1, 2)]), 0.02)
    look = {"radii": 0.0, "colors": [CONTROL], "show_labels": True}
    log("/world/scene/names", rr.Points3D(named, labels=["goal", *subject.labels], **look))
    log("/world/path", rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.011]))
    log("/why/weight/switch", rr.SeriesPoints(names="class switch", colors=DRIVEN, markers="down", marker_sizes=7))
    for obstacle, path, _ in subject.lifted:
        _tree(subject, obstacle, path, log)


def mover_path(name: str) -> str:
    """The entity of a moving obstacle: its pose on the timeline, with its geoms below it."""
    return f"{MOVERS}/{rr.escape_entity_path_part(name)}"


def all_named(subject: Subject) -> bool:
    """Return whether so few obstacles move that all bear their names; others bear theirs when hovered."""
    return len(subject.space.scene.movers) <= NAMED


def label_path(name: str) -> str:
    """The entity of a moving obstacle's name, which moves along."""
    return f"{mover_path(name)}/name"


def _arrows(*, truth: bool) -> rr.Arrows3D:
    """The control; below it and thicker, so that neither hides the other, the optimal one."""
    looks = [((0, 0, 0.12), CONTROL, 0.022), ((0, 0, 0.07), OPTIMUM, 0.034)]
    origins, colors, radii = (list(part) for part in zip(*looks[: 1 + truth], strict=True))
    return rr.Arrows3D.from_fields(origins=origins, colors=colors, radii=radii)


def _ground(subject: Subject, log: Log) -> None:
    """Floor, border of the domain, and goal."""
    scene = subject.space.scene
    log("/world/scene/floor", _tiles(scene.lower, scene.upper))
    (x0, y0), (x1, y1) = scene.lower, scene.upper
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
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
    shades = packed(np.array([FLOOR, TILE])[even])
    return rr.Boxes3D(half_sizes=sizes, centers=centers, colors=shades, fill_mode="solid")


def _tree(subject: Subject, obstacle: int, path: str, log: Log) -> None:
    """A lifted tree, levels of H along the far sides, and a line over the obstacle that is counted."""
    assert subject.tree is not None
    ends = strokes.tree_edges(subject.tree, obstacle, TREE_EDGES)
    raised = lift(ends, ends[..., 2] * subject.turn)
    log(f"{path}/edges", rr.LineStrips3D(raised, radii=0.004, colors=[BRANCH]))
    (x0, y0), (x1, y1) = subject.space.scene.lower, subject.space.scene.upper
    far = np.array([(x0, y0), (x0, y1), (x1, y1)])
    levels = np.stack([lift(far, level * subject.turn) for level in LEVELS])
    log(f"{path}/levels", rr.LineStrips3D(levels, radii=0.004, colors=[mix(BORDER, FLOOR, 0.6)]))
    axis = levels[:, 2]
    log(f"{path}/axis", rr.LineStrips3D(axis[None], radii=0.008, colors=[BORDER]))
    told = [f"H = {level:g}" for level in LEVELS]
    log(f"{path}/axis/names", rr.Points3D(axis, radii=0.03, labels=told, colors=[BORDER], show_labels=True))
    marker = subject.space.homology.markers[obstacle]
    line = lift(np.array([marker, marker]), np.array([0.0, LEVELS[-1] * subject.turn]))
    log(f"{path}/marker", rr.LineStrips3D(line[None], radii=0.01, colors=[CONTROL]))
