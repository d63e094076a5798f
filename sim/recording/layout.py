"""How a recording is laid out: the drive, the argument behind it, and the tree."""

from __future__ import annotations

from typing import Any

import rerun.blueprint as rrb

from pirrht.geometry.scene import Scene
from sim.recording.static import Subject

BACKGROUND = (20, 22, 26)


def layout(subject: Subject, *, live: bool) -> rrb.Blueprint:
    """Three tabs: Drive, Why and, if there is a tree, Tree; `live` has the time cursor follow the data."""
    scene = subject.space.scene
    tabs = [_drive(scene), _why(truth=subject.look.truth)]
    if subject.lifted:
        views = [_tree(scene, path, title, subject.turn) for _, path, title in subject.lifted]
        tabs.append(rrb.Horizontal(*views, name="Tree"))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following" if live else "playing"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _drive(scene: Scene) -> rrb.Container:
    view = rrb.Spatial3DView(
        origin="/world",
        name="From above",
        background=list(BACKGROUND),
        line_grid=False,
        eye_controls=_eye(scene, tilt=0.02, height=0.0),
        overrides={"world/path": _so_far()},
    )
    side = rrb.Vertical(
        rrb.TextDocumentView(origin="/about", name="What you see"),
        _weights(legend=False),
        row_shares=[3, 2],
    )
    return rrb.Horizontal(view, side, column_shares=[3, 1], name="Drive")


def _why(*, truth: bool) -> rrb.Container:
    plots = rrb.Vertical(
        _weights(legend=True),
        _series(
            "/why/value",
            "Value -lambda log psi of all paths, with its standard error, and class by class [cost]",
            "RightTop",
        ),
        _series("/why/ess", "Effective sample size", "LeftTop"),
        row_shares=[3, 2, 2],
    )
    columns = rrb.TextLogColumns(text_log_columns=["body"])
    log = rrb.TextLogView(origin="/log", name="What happened", columns=columns)
    if not truth:
        return rrb.Horizontal(plots, log, column_shares=[3, 1], name="Why")
    beside = rrb.Vertical(
        _series("/why/optimum/control", "Distance from the optimal control", "RightTop"),
        _series("/why/optimum/value", "Value beside the exact one, which is 0 here [cost]", "RightBottom"),
        log,
        row_shares=[3, 3, 1],
    )
    return rrb.Horizontal(plots, beside, column_shares=[3, 2], name="Why")


def _weights(*, legend: bool) -> rrb.View:
    return rrb.TimeSeriesView(
        origin="/why/weight",
        name="Class weights (shares of psi, stacked)",
        axis_y=rrb.ScalarAxis(range=(-0.03, 1.1)),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightBottom, visible=legend),
    )


def _series(origin: str, name: str, corner: str) -> rrb.View:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.PlotLegend(rrb.Corner2D[corner]))


def _tree(scene: Scene, path: str, title: str, turn: float) -> rrb.View:
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"{path}/**", "/world/scene/**"],
        name=title,
        background=list(BACKGROUND),
        line_grid=False,
        eye_controls=_eye(scene, tilt=1.1, height=turn),
        overrides={f"{path}/growth": _so_far()},
    )


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


def _eye(scene: Scene, *, tilt: float, height: float) -> rrb.EyeControls3D:
    """An eye that looks down on the workspace, moved south by `tilt` times its distance."""
    center, extent = 0.5 * (scene.lower + scene.upper), scene.upper - scene.lower
    distance = 1.1 * max(float(extent[1]), float(extent[0]) / 1.2) + 0.4 * height
    x, y, z = float(center[0]), float(center[1]), 0.6 * height
    return rrb.EyeControls3D(
        position=(x, y - distance * tilt, z + distance),
        look_target=(x, y, z),
        eye_up=(0.0, 1.0, 0.0) if tilt < 0.5 else (0.0, 0.0, 1.0),
    )
