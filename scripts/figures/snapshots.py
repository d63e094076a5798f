"""Figs. 2 and 4: snapshots of drives with samples, references, how the heaviest class went on average, the robot."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from figures import ground, style
from pirrht.arrays import Array
from pirrht.estimation.sampler import PathIntegral
from pirrht.plotting.colors import ClassColors, Color
from pirrht.plotting.strokes import even
from pirrht.topology.signature import OTHER
from sim.drawing import strokes
from sim.drawing.colors import title
from sim.drive.metrics import Frame
from sim.scenario import Scenario

POINTS = 9000  # of samples in a panel
CURVE = 120  # points of a reference
MARGIN = 0.75  # around paths and obstacles [m]
MOST = 6  # classes in colour, the cheapest at the start; others are grey
DASHES = (0, (3, 1.5))
BAR = 0.045  # height of the bar of weights [in]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """A drive, and which of its control steps are shown."""

    scenario: Scenario
    path_integral: PathIntegral
    frames: Sequence[Frame]
    shown: Sequence[int]

    def driven(self, step: int) -> Array:
        """The path from the start to the beginning of a step, (k, 2)."""
        first = self.frames[0].plan.state[None, :2]
        return np.vstack([first, *(frame.advance.states[:, :2] for frame in self.frames[:step])])


def drive(scenario: Scenario, moments: Sequence[float]) -> Drive:
    """Drive once; `moments` are shares of the driven time, of which snapshots are taken."""
    driver = scenario.driver(scenario.grown_tree())
    frames = list(scenario.drive(scenario.plant(), driver))
    shown = [min(len(frames) - 1, round(moment * len(frames))) for moment in moments]
    return Drive(scenario=scenario, path_integral=driver.path_integral, frames=frames, shown=shown)


def draw(plt: Any, drives: Sequence[Drive], *, labels: Sequence[str], width: float, whole: bool) -> Any:
    """A row of panels per drive.

    Args:
        labels: what each drive's panels are called, beside their time.
        width: of the figure [in].
        whole: show the whole workspace, not only the part where something happens.
    """
    columns = len(drives[0].shown)
    low, high = _extent(drives, whole)
    height = width / columns * float((high - low)[1] / (high - low)[0])
    figure, panels = plt.subplots(
        len(drives), columns, figsize=(width, len(drives) * (height + 0.16) + 0.75), squeeze=False, layout="constrained"
    )
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.03, wspace=0.02, hspace=0.03)
    colors = ClassColors(name for one in drives for name in one.frames[0].plan.ids)
    for row, (one, label) in enumerate(zip(drives, labels, strict=True)):
        for column, step in enumerate(one.shown):
            axes, frame = panels[row][column], one.frames[step]
            panel(axes, one, step, colors)
            ground.frame(axes, low, high)
            style.panel(axes, row * columns + column, f"{label}$t$ = {frame.time:.1f} s")
            _ticks(axes, first_column=column == 0, last_row=row == len(drives) - 1)
            weights(axes, frame, colors, height)
    figure.legend(handles=_handles(colors), loc="outside lower center", ncols=5, columnspacing=1.4, handletextpad=0.5)
    return figure


def _extent(drives: Sequence[Drive], whole: bool) -> tuple[Array, Array]:
    scene = drives[0].scenario.loaded.scene
    if whole:
        return scene.lower, scene.upper
    lines = [one.driven(len(one.frames)) for one in drives]
    lines += [r.trajectory.points for one in drives for step in one.shown for r in one.frames[step].plan.references]
    return ground.around(lines, scene, MARGIN)


def panel(axes: Any, one: Drive, step: int, colors: ClassColors) -> None:
    """The plan at a step, and the path driven to it."""
    scene, frame = one.scenario.loaded.scene, one.frames[step]
    ground.draw(axes, scene, frame.plan.time, frame.plan.movers)
    _samples(axes, one, frame, colors)
    for reference, name in list(zip(frame.plan.references, frame.plan.ids, strict=True))[::-1]:
        line = even(reference.trajectory.points, CURVE)
        if name in list(colors)[:MOST]:
            ground.dots(axes, line, style.rgb(colors[name]), width=1.1)
        else:
            axes.plot(*line.T, color=style.LONGER, lw=0.7, zorder=4)
    if (estimate := frame.plan.estimate) is not None:
        for name, line in strokes.mean_paths(one.path_integral, estimate, frame.plan.classes).items():
            if name == frame.plan.favourite:
                axes.plot(*line.T, color=style.INK, lw=0.9, ls=DASHES, zorder=7)
    axes.plot(*one.driven(step).T, color=style.INK, lw=0.8, zorder=8)
    ground.robot(axes, scene, frame.plan.state)


def _samples(axes: Any, one: Drive, frame: Frame, colors: ClassColors) -> None:
    """Sampled paths: dead ones at the bottom, then by weight."""
    from matplotlib.collections import LineCollection

    if frame.plan.estimate is None:
        return
    found = strokes.fans(one.path_integral, frame.plan.estimate, frame.plan.classes, points=POINTS, everything=False)
    for name, fan in found.items():
        dead = name == strokes.DEAD
        shade = np.ones((len(fan.strips), 4))
        shade[:, :3] = style.rgb(style.DEAD if dead else _color(name, colors))
        shade[:, 3] = 0.45 if dead else 0.2 + 0.7 * fan.opacity
        axes.add_collection(LineCollection(list(fan.strips[..., :2]), colors=shade, lw=0.4, zorder=2 if dead else 3))


def _ticks(axes: Any, *, first_column: bool, last_row: bool) -> None:
    """Numbers at the figure's left and bottom only."""
    from matplotlib.ticker import MultipleLocator

    span = axes.get_xlim()[1] - axes.get_xlim()[0]
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(1.0 if span < 7 else 2.0))
    axes.tick_params(labelleft=first_column, labelbottom=last_row)
    axes.set(xlabel="$x$ [m]" if last_row else "", ylabel="$y$ [m]" if first_column else "")


def weights(axes: Any, frame: Frame, colors: ClassColors, height: float) -> None:
    """A bar at the bottom of a panel of that height [in]: the share of psi that each class has."""
    from matplotlib.patches import Rectangle

    known = frame.plan.estimate.class_weights if frame.plan.estimate else {}
    left = 0.0
    for name in [*frame.plan.ids, OTHER]:
        place, share = (left, 0.0), known.get(name, 0.0)
        color = style.rgb(_color(name, colors))
        axes.add_patch(Rectangle(place, share, BAR / height, transform=axes.transAxes, fc=color, ec="none", zorder=12))
        left += share


def _color(name: str, colors: ClassColors) -> Color:
    return colors[name if name in list(colors)[:MOST] else OTHER]


def _handles(colors: ClassColors) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    ink, many = style.INK, len(colors) > MOST
    return [
        *(
            Line2D(
                [], [], color=style.rgb(colors[n]), lw=1.1, marker="o", ms=2.5, mfc="white", label=f"class {title(n)}"
            )
            for n in list(colors)[:MOST]
        ),
        *([Line2D([], [], color=style.LONGER, lw=0.7, label="longer classes")] if many else []),
        Line2D([], [], color=style.rgb(style.DEAD), lw=0.5, label="samples that died"),
        Line2D([], [], color=ink, lw=0.8, label="driven"),
        Line2D([], [], color=ink, lw=0.9, ls=DASHES, label="heaviest class, on average"),
        Line2D([], [], color=ink, marker="o", ms=5, mfc=style.ROBOT, mew=0.6, ls="none", label="robot"),
        Patch(fc=style.GOAL, ec=style.GOAL_EDGE, lw=0.6, label="goal"),
        Patch(fc=style.WALL, label="obstacle"),
        Patch(fc=style.rgb(next(iter(colors.values()))), label="bar: class weights"),
    ]
