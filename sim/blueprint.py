"""How a recording is laid out: the drive, the argument behind it, and the tree."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from pirrht.scene import Scene

BACKGROUND = (20, 22, 26)


def blueprint(scene: Scene, trees: Sequence[tuple[str, str]], *, turn: float, live: bool) -> rrb.Blueprint:
    """Three tabs: Drive, Why and, if there are any, Tree.

    Args:
        trees: entity path and title of each lifted tree.
        turn: height of one whole turn in the lifted trees [m].
        live: whether the time cursor follows the data as they come in.
    """
    tabs = [_drive(scene), _why()]
    if trees:
        views = [_tree(scene, path, title, turn) for path, title in trees]
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
        overrides={"world/path": rrb.VisibleTimeRanges(timeline="sim_time", start=_first(), end=_cursor())},
    )
    side = rrb.Vertical(
        rrb.TextDocumentView(origin="/about", name="What you see"),
        _weights(legend=True),
        row_shares=[3, 2],
    )
    return rrb.Horizontal(view, side, column_shares=[3, 1], name="Drive")


def _why() -> rrb.Container:
    plots = rrb.Vertical(
        _weights(legend=True),
        _series("/why/value", "Value v = -lambda log psi [cost]"),
        _series("/why/ess", "Effective sample size"),
        row_shares=[3, 2, 2],
    )
    log = rrb.TextLogView(origin="/log", name="What happened")
    return rrb.Horizontal(plots, log, column_shares=[3, 1], name="Why")


def _weights(*, legend: bool) -> rrb.View:
    return rrb.TimeSeriesView(
        origin="/why/weight",
        name="Class weights (share of psi)",
        axis_y=rrb.ScalarAxis(range=(-0.03, 1.1)),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
    )


def _series(origin: str, name: str) -> rrb.View:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop))


def _tree(scene: Scene, path: str, title: str, turn: float) -> rrb.View:
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"{path}/**", "/world/scene/**"],
        name=title,
        background=list(BACKGROUND),
        line_grid=False,
        eye_controls=_eye(scene, tilt=1.1, height=turn),
    )


def _eye(scene: Scene, *, tilt: float, height: float) -> rrb.EyeControls3D:
    """An eye that looks down on the workspace, moved south by `tilt` times its distance."""
    center, extent = 0.5 * (scene.lower + scene.upper), scene.upper - scene.lower
    distance = 1.1 * max(float(extent[1]), float(extent[0]) / 1.2) + 0.8 * height
    x, y, z = float(center[0]), float(center[1]), 0.7 * height
    return rrb.EyeControls3D(
        position=(x, y - distance * tilt, z + distance),
        look_target=(x, y, z),
        eye_up=(0.0, 1.0, 0.0) if tilt < 0.5 else (0.0, 0.0, 1.0),
    )


def _first() -> rrb.TimeRangeBoundary:
    return rrb.TimeRangeBoundary.infinite()


def _cursor() -> rrb.TimeRangeBoundary:
    return rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
