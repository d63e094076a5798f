"""Log all that stays as it is: the scene, the robot, the tree, the legend, the settings."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.geometry.scene import Scene
from sim.drawing import strokes
from sim.drawing.colors import DRIVEN, MOVER, mix
from sim.drawing.sides import NAMED
from sim.drawing.strokes import lift
from sim.recording import geoms
from sim.recording.camera import ABOVE, FOLLOWING, WIDE, above, pixels_per_metre
from sim.recording.subject import Subject
from sim.recording.truth_view import OPTIMUM, VALUE, on_floor

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
where it is great, in bands of equal cost, of a robot with a heading that of the best one. In the table *exact* is each
class' share of psi, by paths drawn under the optimal control.
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
LEVELS = (0.5, 1.0, 1.5)  # of H that are marked

FLOOR = (38, 42, 48)
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
    rows = [f"**{k}** {name}" for k, name in enumerate(subject.names, 1) if name != f"obstacle {k}"]
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
    loaded, scene = subject.loaded, subject.space.scene
    (x0, y0), (x1, y1) = scene.lower, scene.upper
    floor = {
        "centers": [(0.5 * (x0 + x1), 0.5 * (y0 + y1), -0.012)],
        "half_sizes": [(*0.5 * (scene.upper - scene.lower), 0.01)],
    }
    log("/world/scene/floor", rr.Boxes3D(**floor, colors=[FLOOR], fill_mode="solid"))
    log("/world/scene/border", rr.LineStrips3D(lift(outer(scene), 0.0)[None], radii=0.01, colors=[BORDER]))
    disc = {"lengths": [0.004], "radii": [scene.goal.radius], "centers": [(*scene.goal.center, 0.002)]}
    log("/world/scene/goal", rr.Cylinders3D(**disc, colors=[GOAL], fill_mode="solid"))
    robot, moving, obstacles = (getattr(loaded, f"{kind}_geoms") for kind in ("robot", "moving", "obstacle"))
    opacity = np.where(moving, MOVING, np.where(robot, 1.0, STATIC))
    model = geoms.see_through(loaded.model, opacity, moving, MOVER)
    shown = geoms.shown(model)
    drawn = [
        ("/world/scene/obstacles", obstacles & ~moving, None),
        ("/world/scene/others", shown & ~obstacles & ~robot & ~moving, None),
        (BODY, shown & robot, geoms.ROOT),
    ]
    for mover in scene.movers:
        drawn.append((mover_path(mover.name), (shown | obstacles) & geoms.of_body(model, mover.name), mover.name))
        label = {"labels": [mover.name.replace("_", " ")], "colors": [MOVER], "show_labels": all_named(subject)}
        log(label_path(mover.name), rr.Points3D([(0, 0, 0)], radii=0.0, **label))
    for folder, mask, body in drawn:
        for name, solid in geoms.solids(model, mask, body=body).items():
            log(f"{folder}/{name}", solid)
    if subject.grid is not None and not subject.grid.moves:
        log(VALUE, on_floor(subject.grid, subject.space, 0.0))
    # The control; below it and thicker, so that neither hides the other, the optimal one.
    looks = [((0, 0, 0.12), CONTROL, 0.022), ((0, 0, 0.07), OPTIMUM, 0.034)]
    origins, colors, radii = zip(*looks[: 1 + subject.look.truth], strict=True)
    log("/world/robot", rr.Arrows3D.from_fields(origins=origins, colors=colors, radii=radii))
    radius, high = RADIUS / pixels_per_metre(scene), geoms.top(model)
    if radius > scene.robot_radius:
        rim = {"radii": [1.15 * radius, radius], "centers": [(0.0, 0.0, high + 0.1), (0.0, 0.0, high + 0.2)]}
        log(MARK, rr.Cylinders3D(lengths=[0.01] * 2, **rim, colors=[FLOOR, DRIVEN], fill_mode="solid"))
    log(ABOVE, above(scene))
    log(FOLLOWING, WIDE)
    named = lift(np.vstack([scene.goal.center, subject.space.homology.markers.reshape(-1, 2)]), 0.02)
    look = {"radii": 0.0, "colors": [CONTROL], "show_labels": True}
    log("/world/scene/names", rr.Points3D(named, labels=["goal", *subject.labels], **look))
    log("/world/path", rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.011]))
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


def outer(scene: Scene) -> Array:
    """Return the border of the domain, (5, 2) [m]: its corners, the first one twice."""
    (x0, y0), (x1, y1) = scene.lower, scene.upper
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])


def _tree(subject: Subject, obstacle: int, path: str, log: Log) -> None:
    """A lifted tree, levels of H along the far sides, and a line over the obstacle that is counted."""
    assert subject.tree is not None
    ends = strokes.tree_edges(subject.tree, obstacle, TREE_EDGES)
    log(f"{path}/edges", rr.LineStrips3D(lift(ends, ends[..., 2] * subject.turn), radii=0.004, colors=[BRANCH]))
    far = outer(subject.space.scene)[[0, 3, 2]]
    levels = np.stack([lift(far, level * subject.turn) for level in LEVELS])
    log(f"{path}/levels", rr.LineStrips3D(levels, radii=0.004, colors=[mix(BORDER, FLOOR, 0.6)]))
    texts = [f"H = {level:g}" for level in LEVELS]
    log(f"{path}/axis", rr.Points3D(levels[:, 2], radii=0.03, labels=texts, colors=[BORDER], show_labels=True))
    marker = subject.space.homology.markers[obstacle]
    line = lift(np.array([marker, marker]), np.array([0.0, LEVELS[-1] * subject.turn]))
    log(f"{path}/marker", rr.LineStrips3D(line[None], radii=0.01, colors=[CONTROL]))
