"""What stays as it is in a recording: scene, robot, tree, legend, settings; the eyes of its views, and its layout."""

import platform
from collections.abc import Callable, Mapping
from importlib.metadata import version
from math import dist, exp
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.geometry.scene import Scene
from pirrht.plotting.colors import blend
from pirrht.plotting.strokes import rings
from sim.drawing import strokes
from sim.drawing.colors import DRIVEN, MOVER, NAMED, labels
from sim.drawing.strokes import lift, placed
from sim.drawing.ways import label_places
from sim.recording import geoms
from sim.recording.subject import Subject

LEGEND = """\
**Thick lines**: the best path of each homology class, with its share of the weight.

**Thin lines**: sampled paths in the colour of their own class; the brighter, the heavier.
Grey ones hit an obstacle, left the workspace or ran out of time.

**White arrow**: the control. **White line**: the mean of the samples of the heaviest class; paler lines: other classes.

**Yellow line**: the path driven. Plans and samples are drawn {hz:g} times a second.

A class such as `0,-1` counts {turns} 1, 2, ... against the straight
line to the goal{positive}; with many obstacles `+5 -12` names those with a turn.
"""
IN_PLANE = {"turns": "whole turns around obstacles", "positive": ", counter-clockwise positive"}
IN_SPACE = {"turns": "how often a path links with loops of obstacles", "positive": ""}
OPTIMAL = """
**Green arrow**: the optimal control, solved for on a grid. **Floor**: the exact value, from pale at the goal to dark
where it is great, of a robot with a heading that of the best one. In the table *exact* is each class' share of psi.
"""
MOTIONS = """
**Pale outlines**: where the plan predicts moving obstacles in half a second, in one, and so on, the paler the later.

**Space-time**: the map as floor, time upward. The thin frame is now; the yellow thread shows when the robot was where.
Each **purple tube** is where an obstacle is at every time; grey walls are static, the green pillar is the goal. The
best paths of the classes are braids around the tubes. Thin: the heaviest samples.
"""
MAPPED = """
**Map**: what the lidar has shown. Black: rays ended there. Grey: no ray has passed. Red: the last scan, and the outline
where the robot believes to be. Plans know no more than that; low black boxes are their obstacles, with their numbers.
"""
FOLLOWING, ABOVE = "/world/eyes/following", "/world/eyes/above"
MOVERS, VALUE = "/world/scene/movers", "/world/scene/truth/value"
MARK, TIMES = "/world/robot/mark", "/spacetime"
SCENE = ["/world/scene/**", "- /world/scene/names"]
GROWING = [f"{TIMES}/{name}" for name in ("path", "walls", "goal", "axis")]
HEIGHT, MARGIN = 300.0, 1.06  # of the eye above, in sizes of the workspace; what it sees, over the workspace
DELAY = 0.35  # with which the other one follows the robot, whatever the noise does [s]
DEPTH = 1e-4  # of the frames that the viewer draws for cameras [m]
NARROW = 1.4  # width over height of the narrowest map that is not cut
TREE_EDGES = 8000
STATIC, MOVING = 0.6, 0.8  # opacity of static and moving obstacles: neither hides the robot
MARK_SIZE = 0.025  # radius of the disc that marks a small robot on the map, over the height of the map
LEVELS = (0.5, 1.0, 1.5)  # of H that are marked
SHARE = (-0.03, 1.08)  # of an axis for shares

FLOOR = (38, 42, 48)
GOAL = (44, 118, 66)
BORDER = (120, 128, 138)

CONTROL = (250, 246, 232)
OPTIMUM = (150, 235, 60)
BRANCH = blend((120, 170, 205), FLOOR, 0.35)

Log = Callable[..., None]  # of an entity path and archetypes


def properties(settings: Mapping[str, object]) -> dict[str, object]:
    """Settings and versions as numbers and texts."""
    plain = {n: v if isinstance(v, int | float | str) else str(v) for n, v in settings.items() if v is not None}
    packages = {name: version(name) for name in ("mujoco", "numpy", "rerun-sdk")}
    return {**plain, "python": platform.python_version(), **packages}


def entity(folder: str, name: str) -> str:
    """The entity of a moving obstacle in a folder."""
    return f"{folder}/{rr.escape_entity_path_part(name)}"


def name_tag(subject: Subject, name: str, place: tuple[float, ...]) -> rr.AsComponents:
    """The name of a moving obstacle at a place [m]; of many obstacles they are there when hovered."""
    few = len(subject.movers) <= NAMED
    return rr.Points3D([place], radii=0.0, labels=[name.replace("_", " ")], colors=[MOVER], show_labels=few)


def outer(scene: Scene) -> Array:
    """Return the border of the domain seen from above, (5, 2) [m]: its corners, the first one twice."""
    (x0, y0), (x1, y1) = scene.lower[:2], scene.upper[:2]
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])


def stage(subject: Subject, log: Log) -> None:
    """Log everything that stays as it is, each under its entity path."""
    loaded, scene = subject.loaded, subject.space.scene
    log("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    _texts(subject, log)
    _room(scene, log)
    robot, moving, obstacles = (getattr(loaded, f"{kind}_geoms") for kind in ("robot", "moving", "obstacle"))
    opacity = np.where(moving, MOVING, np.where(robot, 1.0, STATIC))
    model = geoms.see_through(loaded.model, opacity, moving, MOVER)
    shown = geoms.shown(model)
    drawn = [
        ("/world/scene/obstacles", obstacles & ~moving, None),
        ("/world/scene/others", shown & ~obstacles & ~robot & ~moving, None),
        ("/world/robot/body", shown & robot, geoms.ROOT),
    ]
    for mover in subject.movers:
        path = entity(MOVERS, mover.name)
        inside = model.body_rootid[model.geom_bodyid] == model.body(mover.name).id
        drawn.append((path, (shown | obstacles) & inside, mover.name))
        log(f"{path}/name", name_tag(subject, mover.name, (0.0, 0.0, 0.0)))
    for folder, mask, body in drawn:
        for name, solid in geoms.solids(model, mask, body=body).items():
            log(f"{folder}/{name}", solid)
    if subject.grid is not None and not subject.grid.moves and not subject.in_space:
        log(VALUE, geoms.on_floor(subject.grid, subject.space, 0.0))
    # The control; below it and thicker, so that neither hides the other, the optimal one.
    looks = [((0, 0, 0.12), CONTROL, 0.022), ((0, 0, 0.07), OPTIMUM, 0.034)]
    origins, colors, radii = zip(*looks[: 1 + subject.look.truth], strict=True)
    log("/world/robot", rr.Arrows3D.from_fields(origins=origins, colors=colors, radii=radii))
    if not scene.body.is_disc:
        outline = lift(rings(scene.body, np.zeros((1, 3))), 0.03)
        log("/world/robot/outline", rr.LineStrips3D(outline, radii=0.012, colors=[DRIVEN]))
    if not subject.in_space:
        _from_above(scene, log)
    log(FOLLOWING, rr.Pinhole(fov_y=0.9, aspect_ratio=1.5, image_plane_distance=DEPTH))
    named = placed(np.vstack([scene.goal.center, label_places(subject.space)]), 0.02)
    look = {"radii": 0.0, "colors": [CONTROL], "show_labels": True}
    log("/world/scene/names", rr.Points3D(named, labels=["goal", *labels(subject.names)], **look))
    log("/world/path", rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.011]))
    for obstacle, path, _ in subject.lifted:
        _tree(subject, obstacle, path, log)
    if subject.in_time:
        for mover in scene.movers:
            x, y, _ = mover.motion.pose_at(0.0)
            log(f"{entity(f'{TIMES}/bodies', mover.name)}/name", name_tag(subject, mover.name, (x, y, 0.05)))
        log(f"{TIMES}/path", rr.LineStrips3D.from_fields(colors=[DRIVEN], radii=[0.02]))
        border = lift(outer(scene), 0.0)
        log(f"{TIMES}/now", rr.LineStrips3D(border[None], radii=0.008, colors=[blend(CONTROL, FLOOR, 0.4)]))
        sheet = {"vertex_positions": border[:4], "triangle_indices": [(0, 1, 2), (0, 2, 3)]}
        log(f"{TIMES}/now/sheet", rr.Mesh3D(**sheet, albedo_factor=(*CONTROL, 4)))
        log(f"{TIMES}/now/robot", rr.Points3D([(0.0, 0.0, 0.0)], radii=rr.Radius.ui_points(9.0), colors=[DRIVEN]))


def _room(scene: Scene, log: Log) -> None:
    """Log floor, border and goal: a disc, or in space a ball in a box."""
    low, high = (np.append(corner, 0.0)[:3] for corner in (scene.lower, scene.upper))
    half = 0.5 * (high - low)
    middle = 0.5 * (low + high)
    radius = scene.goal.radius
    bottom = low[2] - scene.robot_radius if half[2] else 0.0
    floor = {"centers": [(*middle[:2], bottom - 0.012)], "half_sizes": [(*half[:2], 0.01)]}
    log("/world/scene/floor", rr.Boxes3D(**floor, colors=[FLOOR], fill_mode="solid"))
    if half[2]:
        frame = {"centers": [middle], "half_sizes": [half]}
        log("/world/scene/border", rr.Boxes3D(**frame, radii=0.006, colors=[BORDER], fill_mode="majorwireframe"))
        ball = {"centers": [scene.goal.center], "half_sizes": [[radius] * 3]}
        log("/world/scene/goal", rr.Ellipsoids3D(**ball, colors=[(*GOAL, 150)], fill_mode="solid"))
    else:
        log("/world/scene/border", rr.LineStrips3D(lift(outer(scene), 0.0)[None], radii=0.01, colors=[BORDER]))
        disc = {"lengths": [0.004], "radii": [radius], "centers": [(*scene.goal.center, 0.002)]}
        log("/world/scene/goal", rr.Cylinders3D(**disc, colors=[GOAL], fill_mode="solid"))


def _from_above(scene: Scene, log: Log) -> None:
    """Log an eye over the middle, north being up, and a mark of a robot that would be small on the map."""
    wide, high = MARGIN * (scene.upper - scene.lower)  # Rerun fits the height of what it sees, whatever the width
    size = 100.0 * np.array([wide, max(high, wide / NARROW)])
    far = HEIGHT * float(size.max()) / 100.0
    lens = rr.Pinhole(focal_length=100.0 * far, width=size[0], height=size[1], image_plane_distance=DEPTH)
    middle = 0.5 * (scene.lower + scene.upper)
    log(ABOVE, rr.Transform3D(translation=(*middle, far), mat3x3=np.diag([1.0, -1.0, -1.0])), lens)
    if (radius := MARK_SIZE * size[1] / 100.0) > scene.robot_radius:
        disc = {"lengths": [0.01], "radii": [radius], "centers": [(0.0, 0.0, 1.0)]}  # above any robot
        log(MARK, rr.Cylinders3D(**disc, colors=[DRIVEN], fill_mode="solid"))


def _texts(subject: Subject, log: Log) -> None:
    """Log what lines and colours mean, the settings of the run, and what the numbers on the map stand for."""
    classes = IN_SPACE if subject.in_space else IN_PLANE
    about = LEGEND.format(hz=subject.look.hz, **classes) + OPTIMAL * subject.look.truth + MOTIONS * subject.moves
    about += MAPPED * subject.maps
    settings = properties(subject.settings).items()
    rows = [f"| {name} | {f'{value:g}' if isinstance(value, float) else value} |" for name, value in settings]
    moving = " *Lilac*: moving obstacles." * bool(subject.movers)
    mapped = " *Red*: the last scan. *Grey*: not seen. *Black*: obstacles of the map, in the true scene." * subject.maps
    signs = f"*Yellow*: the robot and its path. *White*: the path of most weight, and the control.{moving}{mapped}"
    key = [f"**{k}** {name}" for k, name in enumerate(subject.names, 1) if name != f"obstacle {k}"]
    for path, lines, end in (
        ("/about", [about, "| setting | value |", "|---|---|", *rows], "\n"),
        ("/key", [signs, *key], "  \n"),
    ):
        log(path, rr.TextDocument(end.join(lines), media_type=rr.MediaType.MARKDOWN))


def _tree(subject: Subject, obstacle: int, path: str, log: Log) -> None:
    """Log a lifted tree, levels of H along the far sides, and a line over the obstacle that is counted."""
    assert subject.tree is not None
    ends = strokes.tree_edges(subject.tree, obstacle, TREE_EDGES)
    log(f"{path}/edges", rr.LineStrips3D(lift(ends, ends[..., 2] * subject.turn), radii=0.004, colors=[BRANCH]))
    far = outer(subject.space.scene)[[0, 3, 2]]
    levels = np.stack([lift(far, level * subject.turn) for level in LEVELS])
    log(f"{path}/levels", rr.LineStrips3D(levels, radii=0.004, colors=[blend(BORDER, FLOOR, 0.6)]))
    texts = [f"H = {level:g}" for level in LEVELS]
    log(f"{path}/axis", rr.Points3D(levels[:, 2], radii=0.03, labels=texts, colors=[BORDER], show_labels=True))
    marker = subject.space.homology.markers[obstacle]
    line = lift(np.array([marker, marker]), np.array([0.0, LEVELS[-1] * subject.turn]))
    log(f"{path}/marker", rr.LineStrips3D(line[None], radii=0.01, colors=[CONTROL]))


class Following:
    """An eye above the robot, which pulls it behind itself on a level rope, so that it turns slowly."""

    def __init__(self, scene: Scene, start: Array) -> None:
        extent = float((scene.upper - scene.lower).max())
        self._back = min(max(0.3 * extent, 6.0 * scene.robot_radius), 12.0 * scene.robot_radius)
        self._place = np.array(start, dtype=float)
        towards = scene.goal.center[:2] - self._place[:2]
        self._eye = self._place[:2] - self._back * towards / max(float(np.hypot.reduce(towards)), 1e-9)

    def poses(self, points: Array, durations: Array) -> Array:
        """Places [m] and quaternions, w last, (k, 7), as the robot is at points (k, 3) [m] for durations [s]."""
        eyes = np.empty((len(points), 3))
        ahead = np.empty((len(points), 2))

        for k, (point, dt) in enumerate(zip(points, durations, strict=True)):
            self._place = self._place + (1.0 - exp(-float(dt) / DELAY)) * (point - self._place)
            rope = self._place[:2] - self._eye
            self._eye = self._eye + max(0.0, 1.0 - self._back / max(float(np.hypot.reduce(rope)), 1e-9)) * rope
            eyes[k, :2], eyes[k, 2] = self._eye, self._place[2] + 0.9 * self._back
            ahead[k] = self._place[:2] - self._eye
        # A camera's axes are x right, y down, z ahead: turned to its course, then down to the robot.
        course = np.arctan2(ahead[:, 1], ahead[:, 0])
        down = np.arctan(0.9) - 0.1
        angles = np.column_stack([course - np.pi / 2, np.full(len(points), -np.pi / 2 - down)])
        turns = Rotation.from_euler("ZX", angles).as_quat()
        return np.column_stack([eyes, turns])


def layout(subject: Subject, *, live: bool) -> rrb.Blueprint:
    """Tabs Drive, Why, About, where obstacles move Space-time, and if a tree is lifted, Tree.

    If live, the time cursor follows the data; else it waits at the first plan, which shows the choice.
    """
    scene = subject.space.scene
    tabs = [_drive(subject), _why(subject)]
    if subject.in_time:
        high = dist(
            scene.goal.center, scene.start[subject.loaded.adapter.position]
        )  # of the straight path at the best speed
        growing = [*GROWING, *(entity(f"{TIMES}/bodies", mover.name) for mover in scene.movers)]
        name = "Time upward: classes around the paths of moving obstacles"
        eye = _eye(subject, high, (0.5, 0.85), 0.35 * high)
        tabs.append(rrb.Horizontal(_space(name, [f"{TIMES}/**", *SCENE, f"- {MOVERS}/**"], eye, growing, "/"),
                                   name="Space-time"))  # fmt: skip
    if subject.lifted:  # seen from the south, high enough to see what is below it
        eye = _eye(subject, 1.2 * subject.turn, (0.45, 0.55), 0.75 * subject.turn, 0.75 * subject.turn)
        trees = [_space(title, [f"{path}/**", *SCENE], eye, [], "/") for _, path, title in subject.lifted]
        tabs.append(rrb.Horizontal(*trees, name="Tree"))
    tabs.append(rrb.Horizontal(rrb.TextDocumentView(origin="/about", name="What you see"), name="About"))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following" if live else "paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _drive(subject: Subject) -> rrb.Container:
    """With the robot, from above with a key, and below them the reasons of the plan and what happened."""
    tags = [f"{entity(MOVERS, mover.name)}/name" for mover in subject.movers]
    eye, target = subject.loaded.overview
    orbit = rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0))
    whole = ("Overview: drag to turn it", orbit) if subject.in_space else ("From above", _tracking(ABOVE))
    views: list[Any] = [
        _space(name, ["$origin/**", *(f"- {path}" for path in without)], eye, ["/world/path"])
        for name, eye, without in (
            ("With the robot", _tracking(FOLLOWING), ["/world/scene/names", "/world/names", *tags, MARK, ABOVE]),
            (*whole, [FOLLOWING]),
        )
    ]
    if subject.maps:
        known = rrb.Spatial2DView(origin="/map", name="What the robot knows", background=[20, 22, 26])
        views = [rrb.Vertical(views[0], known), *views[1:]]
    upper = rrb.Horizontal(*views, rrb.TextDocumentView(origin="/key", name="Key"), column_shares=[4, 6, 2])
    return rrb.Vertical(upper, rrb.Horizontal(*_words(), column_shares=[5, 3]), row_shares=[5, 3], name="Drive")


def _tracking(path: str) -> Any:
    return rrb.EyeControls3D(tracking_entity=path)


def _why(subject: Subject) -> rrb.Container:
    """Plot values of the classes and the robot's control, with both in words; with a truth the errors."""
    classes = rrb.Vertical(
        _series("weight", "Class weights (shares of psi)", "RightTop", SHARE),
        _series("value", "Value: all paths with standard error, and by class [cost]"),
        _series("arriving", "Share of the samples that arrive", None, SHARE),
        _series("ess", "Effective sample size"),
        row_shares=[3, 2, 2, 2],
    )
    control = [_series("control", "Control", "LeftTop")]
    if subject.look.truth:
        control = [_series("optimum/control", "Distance from the optimal control", "RightTop"),
                   _series("optimum/value", "Value less the exact one [cost]", "RightBottom")]  # fmt: skip
    noisy = subject.path_integral.proposals.traits.noisy_position
    risk = [_series("risk", "Collision probability")] if noisy else []
    robot = rrb.Vertical(
        _series("clearance", "Clearance [m]"),
        *risk,
        *control,
        _series("cost", "Running cost [cost]", "RightBottom"),
    )
    words = rrb.Vertical(*_words(), row_shares=[3, 2])
    return rrb.Horizontal(classes, robot, words, column_shares=[5, 3, 6], name="Why")


def _words() -> list[rrb.View]:
    columns = rrb.TextLogColumns(text_log_columns=["body"])
    page = rrb.TextDocumentView(origin="/why/page", name="Why")
    return [page, rrb.TextLogView(origin="/log", name="What happened", columns=columns)]


def _series(path: str, name: str, corner: str | None = None, range: tuple[float, float] | None = None) -> rrb.View:
    """A plot; one without a corner for its legend has the colours of the plot above it."""
    axis = None if range is None else rrb.ScalarAxis(range=range)
    legend = rrb.PlotLegend(visible=False) if corner is None else rrb.PlotLegend(rrb.Corner2D[corner])
    return rrb.TimeSeriesView(origin=f"/why/{path}", name=name, axis_y=axis, plot_legend=legend)


def _space(name: str, contents: list[str], eye: Any, growing: list[str], origin: str = "/world") -> rrb.View:
    """A view in space, where of some entities all is shown from the start to the time shown."""
    begin, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative
    ends = {"sim_time": now(seconds=0.0), "step": now(seq=0)}
    ranges = [rrb.VisibleTimeRange(line, start=begin, end=end) for line, end in ends.items()]
    grid = rrb.LineGrid3D(visible=True, spacing=1.0, color=[70, 76, 84, 90])
    return rrb.Spatial3DView(
        origin=origin, contents=contents, name=name, background=[20, 22, 26], line_grid=grid, eye_controls=eye,
        overrides={path: rrb.VisibleTimeRanges(ranges) for path in growing},
    )  # fmt: skip


def _eye(subject: Subject, high: float, place: tuple[float, float], target: float, above: float = 0.0) -> Any:
    """An eye south of the scene and of something so high [m], so far east and up; it looks at a height [m]."""
    scene, (east, up) = subject.space.scene, place
    far = 1.25 * max(float((scene.upper - scene.lower).max()), high)
    x, y = (0.5 * (scene.lower + scene.upper)).tolist()
    position = (x + east * far, y - far, above + up * far)
    target_place = (x, y, target)

    return rrb.EyeControls3D(position=position, look_target=target_place, eye_up=(0.0, 0.0, 1.0))
