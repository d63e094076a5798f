"""Layout of a recording: the run, the argument behind it, and the tree."""

from __future__ import annotations

from typing import Any

import rerun.blueprint as rrb

from pirrht.geometry.scene import Scene
from sim.drawing.labels import Eye
from sim.recording import camera, spacetime
from sim.recording.camera import ABOVE, COLUMNS, FOLLOWING
from sim.recording.static import MARK, MOVERS, label_path
from sim.recording.subject import Subject

BACKGROUND = (20, 22, 26)


def layout(subject: Subject, *, live: bool) -> rrb.Blueprint:
    """Tabs Drive, Why, About, where bodies move Space-time, and if a tree is lifted, Tree.

    Args:
        live: have the time cursor follow the data; else it waits at the first plan, which shows the choice.
    """
    scene = subject.space.scene
    tabs = [_drive(scene), _why(truth=subject.look.truth)]
    if subject.moves:
        tabs.append(_space_time(subject))
    if subject.lifted:
        eye = camera.on_tree(scene, subject.turn, len(subject.lifted))
        tabs.append(rrb.Horizontal(*(_tree(path, title, eye) for _, path, title in subject.lifted), name="Tree"))
    tabs.append(rrb.Horizontal(rrb.TextDocumentView(origin="/about", name="What you see"), name="About"))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following" if live else "paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _drive(scene: Scene) -> rrb.Container:
    """With the robot, from above with a key, and below them what the plan rests on and what happened."""
    moving = [label_path(mover.name) for mover in scene.movers]  # on the map they are among /world/names
    names = ["/world/scene/names", "/world/names", *moving, MARK]
    close = _space("With the robot", rrb.EyeControls3D(tracking_entity=FOLLOWING), [*names, ABOVE])
    chart = _space("From above", rrb.EyeControls3D(tracking_entity=ABOVE), [FOLLOWING, *moving])
    key = rrb.TextDocumentView(origin="/key", name="Key")
    upper = rrb.Horizontal(close, chart, key, column_shares=list(COLUMNS))
    words = rrb.Horizontal(_page(), _log(), column_shares=[5, 3])
    return rrb.Vertical(upper, words, row_shares=[5, 3], name="Drive")


def _space(name: str, eye: rrb.EyeControls3D, without: list[str]) -> rrb.View:
    return rrb.Spatial3DView(
        origin="/world",
        contents=["$origin/**", *(f"- {path}" for path in without)],
        name=name,
        background=list(BACKGROUND),
        line_grid=False,
        eye_controls=eye,
        overrides={"world/path": _so_far()},
    )


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
    if truth:
        deed = [
            _series("/why/optimum/control", "Distance from the optimal control", "RightTop"),
            _series("/why/optimum/value", "Value beside the exact one, which is 0 here [cost]", "RightBottom"),
        ]
    else:
        deed = [_series("/why/control", "Control", "LeftTop")]
    robot = rrb.Vertical(
        _series("/why/clearance", "Room around the robot [m]", None),
        *deed,
        _series("/why/cost", "Running cost [cost]", "RightBottom"),
    )
    words = rrb.Vertical(_page(), _log(), row_shares=[3, 2])
    return rrb.Horizontal(classes, robot, words, column_shares=[5, 3, 6], name="Why")


def _series(origin: str, name: str, corner: str | None, range: tuple[float, float] | None = None) -> rrb.View:
    """A plot; one without a corner for its legend has the colours of the plot above it."""
    axis = None if range is None else rrb.ScalarAxis(range=range)
    legend = rrb.PlotLegend(visible=False) if corner is None else rrb.PlotLegend(rrb.Corner2D[corner])
    return rrb.TimeSeriesView(origin=origin, name=name, axis_y=axis, plot_legend=legend)


def _tree(path: str, title: str, eye: Eye) -> rrb.View:
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"{path}/**", "/world/scene/**", "- /world/scene/names"],
        name=title,
        background=list(BACKGROUND),
        line_grid=False,
        eye_controls=_controls(eye),
        overrides={f"{path}/growth": _so_far()},
    )


def _space_time(subject: Subject) -> rrb.Container:
    """The map as floor, time upward."""
    scene = subject.space.scene
    view = rrb.Spatial3DView(
        origin="/",
        contents=[f"{spacetime.FOLDER}/**", "/world/scene/**", "- /world/scene/names", f"- {MOVERS}/**"],
        name="Time upward: classes around the paths of moving obstacles",
        background=list(BACKGROUND),
        line_grid=False,
        eye_controls=_controls(camera.in_time(scene)),
        overrides={path: _so_far() for path in spacetime.growing(scene)},
    )
    return rrb.Horizontal(view, name="Space-time")


def _so_far() -> rrb.VisibleTimeRanges:
    """Everything from the start to the time shown."""
    begin = rrb.TimeRangeBoundary.infinite()
    now: dict[str, dict[str, Any]] = {"sim_time": {"seconds": 0.0}, "step": {"seq": 0}}
    return rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(line, start=begin, end=rrb.TimeRangeBoundary.cursor_relative(**cursor))
            for line, cursor in now.items()
        ]
    )


def _controls(eye: Eye) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(position=eye.position, look_target=eye.target, eye_up=eye.up)
