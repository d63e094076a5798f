"""Layout of a recording: the run, the argument behind it, and the tree."""

from __future__ import annotations

from math import hypot
from typing import Any

import rerun.blueprint as rrb

from pirrht.arrays import Array
from sim.recording import spacetime
from sim.recording.camera import ABOVE, COLUMNS, FOLLOWING
from sim.recording.static import MARK, MOVERS, label_path
from sim.recording.subject import Subject

BACKGROUND, GRID = [20, 22, 26], [70, 76, 84, 90]
SCENE = ["/world/scene/**", "- /world/scene/names"]
SHARE = (-0.03, 1.08)  # of an axis for shares


def layout(subject: Subject, *, live: bool) -> rrb.Blueprint:
    """Tabs Drive, Why, About, where obstacles move Space-time, and if a tree is lifted, Tree.

    Args:
        live: have the time cursor follow the data; else it waits at the first plan, which shows the choice.
    """
    scene = subject.space.scene
    tabs = [_drive(subject), _why(truth=subject.look.truth)]
    if subject.moves:
        high = hypot(*(scene.goal.center - scene.start[:2]))  # of the straight path at the best speed
        contents = [f"{spacetime.FOLDER}/**", *SCENE, f"- {MOVERS}/**"]
        name = "Time upward: classes around the paths of moving obstacles"
        growing = {path: _so_far() for path in spacetime.growing(scene)}
        view = _space(name, "/", contents, _eye(subject, high, 0.5, 0.85, 0.35 * high), growing)
        tabs.append(rrb.Horizontal(view, name="Space-time"))
    if subject.lifted:
        turn = subject.turn  # seen from the south, high enough to see what is below it
        eye = _eye(subject, 1.2 * turn, 0.45, 0.55, 0.75 * turn, 0.75 * turn)
        trees = [_space(title, "/", [f"{path}/**", *SCENE], eye, {}) for _, path, title in subject.lifted]
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
    moving = [label_path(mover.name) for mover in subject.space.scene.movers]  # on the map they are in /world/names
    views = [
        _space(name, "/world", ["$origin/**", *(f"- {path}" for path in without)],
               rrb.EyeControls3D(tracking_entity=eye), {"world/path": _so_far()})
        for name, eye, without in (
            ("With the robot", FOLLOWING, ["/world/scene/names", "/world/names", *moving, MARK, ABOVE]),
            ("From above", ABOVE, [FOLLOWING, *moving]),
        )
    ]  # fmt: skip
    key = rrb.TextDocumentView(origin="/key", name="Key")
    upper = rrb.Horizontal(*views, key, column_shares=list(COLUMNS))
    return rrb.Vertical(upper, rrb.Horizontal(*_words(), column_shares=[5, 3]), row_shares=[5, 3], name="Drive")


def _why(*, truth: bool) -> rrb.Container:
    """Plot values of the classes and the robot's control, with both in words; with a truth the errors."""
    classes = rrb.Vertical(
        _series("weight", "Class weights (shares of psi)", "RightTop", SHARE),
        _series("value", "Value: all paths with standard error, and by class [cost]"),
        _series("arriving", "Share of the samples that arrive", None, SHARE),
        _series("ess", "Effective sample size"),
        row_shares=[3, 2, 2, 2],
    )
    control = [_series("control", "Control", "LeftTop")]
    optimum = [
        _series("optimum/control", "Distance from the optimal control", "RightTop"),
        _series("optimum/value", "Value less the exact one [cost]", "RightBottom"),
    ]
    robot = rrb.Vertical(
        _series("clearance", "Clearance [m]"),
        *(optimum if truth else control),
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


def _space(name: str, origin: str, contents: list[str], eye: Any, overrides: dict[str, Any]) -> rrb.View:
    grid = rrb.LineGrid3D(visible=True, spacing=1.0, color=GRID)
    return rrb.Spatial3DView(
        origin=origin, contents=contents, name=name, background=BACKGROUND, line_grid=grid, eye_controls=eye,
        overrides=overrides,
    )  # fmt: skip


def _eye(subject: Subject, high: float, east: float, up: float, target: float, above: float = 0.0) -> Any:
    """An eye south of the scene and of something so high [m], which looks at a height [m] over its middle."""
    scene = subject.space.scene
    far = 1.25 * max(float((scene.upper - scene.lower).max()), high)
    middle: Array = 0.5 * (scene.lower + scene.upper)
    x, y = middle.tolist()
    return rrb.EyeControls3D(
        position=(x + east * far, y - far, above + up * far), look_target=(x, y, target), eye_up=(0.0, 0.0, 1.0)
    )


def _so_far() -> rrb.VisibleTimeRanges:
    """Everything from the start to the time shown."""
    begin, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative
    ends = {"sim_time": now(seconds=0.0), "step": now(seq=0)}
    return rrb.VisibleTimeRanges([rrb.VisibleTimeRange(line, start=begin, end=end) for line, end in ends.items()])
