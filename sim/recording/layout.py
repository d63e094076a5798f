"""Layout of a recording: the run, the argument behind it, and the tree."""

from __future__ import annotations

from math import hypot
from typing import Any

import rerun.blueprint as rrb

from sim.recording import spacetime
from sim.recording.camera import ABOVE, COLUMNS, FOLLOWING
from sim.recording.static import MARK, MOVERS, label_path
from sim.recording.subject import Subject

BACKGROUND = [20, 22, 26]


def layout(subject: Subject, *, live: bool) -> rrb.Blueprint:
    """Tabs Drive, Why, About, where obstacles move Space-time, and if a tree is lifted, Tree.

    Args:
        live: have the time cursor follow the data; else it waits at the first plan, which shows the choice.
    """
    tabs = [_drive(subject), _why(truth=subject.look.truth)]
    if subject.moves:
        tabs.append(_space_time(subject))
    if subject.lifted:
        tabs.append(rrb.Horizontal(*(_tree(subject, path, title) for _, path, title in subject.lifted), name="Tree"))
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
    names = ["/world/scene/names", "/world/names", *moving, MARK]
    path = {"world/path": _so_far()}
    close, chart = (
        _space(name, "/world", ["$origin/**", *(f"- {each}" for each in without)],
               rrb.EyeControls3D(tracking_entity=eye), path)
        for name, eye, without in (
            ("With the robot", FOLLOWING, [*names, ABOVE]), ("From above", ABOVE, [FOLLOWING, *moving])
        )
    )  # fmt: skip
    key = rrb.TextDocumentView(origin="/key", name="Key")
    upper = rrb.Horizontal(close, chart, key, column_shares=list(COLUMNS))
    words = rrb.Horizontal(_page(), _log(), column_shares=[5, 3])
    return rrb.Vertical(upper, words, row_shares=[5, 3], name="Drive")


def _space(name: str, origin: str, contents: list[str], eye: Any, overrides: dict[str, Any]) -> rrb.View:
    return rrb.Spatial3DView(
        origin=origin, contents=contents, name=name, background=BACKGROUND, line_grid=False, eye_controls=eye,
        overrides=overrides,
    )  # fmt: skip


def _page() -> rrb.View:
    return rrb.TextDocumentView(origin="/why/page", name="Why")


def _log() -> rrb.View:
    columns = rrb.TextLogColumns(text_log_columns=["body"])
    return rrb.TextLogView(origin="/log", name="What happened", columns=columns)


def _why(*, truth: bool) -> rrb.Container:
    """Plot values of the classes and the robot's control, with both in words; with a truth the errors."""
    classes = rrb.Vertical(
        _series("/why/weight", "Class weights (shares of psi)", "RightTop", range=(-0.03, 1.08)),
        _series("/why/value", "Value: all paths with standard error, and by class [cost]", None),
        _series("/why/arriving", "Share of the samples that arrive", None, range=(-0.03, 1.08)),
        _series("/why/ess", "Effective sample size", None),
        row_shares=[3, 2, 2, 2],
    )
    control = [_series("/why/control", "Control", "LeftTop")]
    optimum = [
        _series("/why/optimum/control", "Distance from the optimal control", "RightTop"),
        _series("/why/optimum/value", "Value less the exact one [cost]", "RightBottom"),
    ]
    robot = rrb.Vertical(
        _series("/why/clearance", "Clearance [m]", None),
        *(optimum if truth else control),
        _series("/why/cost", "Running cost [cost]", "RightBottom"),
    )
    words = rrb.Vertical(_page(), _log(), row_shares=[3, 2])
    return rrb.Horizontal(classes, robot, words, column_shares=[5, 3, 6], name="Why")


def _series(origin: str, name: str, corner: str | None, range: tuple[float, float] | None = None) -> rrb.View:
    """A plot; one without a corner for its legend has the colours of the plot above it."""
    axis = None if range is None else rrb.ScalarAxis(range=range)
    legend = rrb.PlotLegend(visible=False) if corner is None else rrb.PlotLegend(rrb.Corner2D[corner])
    return rrb.TimeSeriesView(origin=origin, name=name, axis_y=axis, plot_legend=legend)


def _tree(subject: Subject, path: str, title: str) -> rrb.View:
    """A lifted tree from the south, high enough to see what is below it."""
    scene, turn = subject.space.scene, subject.turn
    far = 1.25 * max(float((scene.upper - scene.lower).max()), 1.2 * turn)
    (x, y), z = 0.5 * (scene.lower + scene.upper), 0.75 * turn
    eye = _eye((x + 0.45 * far, y - far, z + 0.55 * far), (x, y, z))
    contents = [f"{path}/**", "/world/scene/**", "- /world/scene/names"]
    return _space(title, "/", contents, eye, {})


def _space_time(subject: Subject) -> rrb.Container:
    """The map as floor, time upward."""
    scene = subject.space.scene
    high = hypot(*(scene.goal.center - scene.start[:2]))  # of the straight path at the best speed
    far = 1.25 * max(float((scene.upper - scene.lower).max()), high)
    x, y = 0.5 * (scene.lower + scene.upper)
    eye = _eye((x + 0.5 * far, y - far, 0.85 * far), (x, y, 0.35 * high))
    contents = [f"{spacetime.FOLDER}/**", "/world/scene/**", "- /world/scene/names", f"- {MOVERS}/**"]
    title = "Time upward: classes around the paths of moving obstacles"
    return rrb.Horizontal(
        _space(title, "/", contents, eye, {path: _so_far() for path in spacetime.growing(scene)}), name="Space-time"
    )


def _eye(position: tuple[float, ...], target: tuple[float, ...]) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(position=position, look_target=target, eye_up=(0.0, 0.0, 1.0))


def _so_far() -> rrb.VisibleTimeRanges:
    """Everything from the start to the time shown."""
    now: dict[str, dict[str, Any]] = {"sim_time": {"seconds": 0.0}, "step": {"seq": 0}}
    begin, until = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative
    return rrb.VisibleTimeRanges(
        [rrb.VisibleTimeRange(line, start=begin, end=until(**cursor)) for line, cursor in now.items()]
    )
