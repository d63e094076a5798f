"""Draw maps of scenes with matplotlib: solids, moving obstacles, lines of classes, and names on them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, printable
from pirrht.freespace import FreeSpace
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Obstacle, Scene
from pirrht.plotting.colors import Color, rgb
from pirrht.plotting.strokes import fading, outline, rings, side_by_side
from pirrht.plotting.tuning import TUNING

FLOOR = "#f7f7f5"
BORDER = "#777777"
WALL = "#4d5866"
GOAL = "#8fd19e"
GOAL_EDGE = "#3c8f52"
INK = "#222222"

View = tuple[Any, tuple[int, int]]  # matplotlib's axes, and which two of x, y and z they show

MOVER, TREE, SAMPLE = "#80609e", "#55aacc", "#70747a"
LEGEND = {"fontsize": 8, "title_fontsize": 8, "frameon": False, "loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}


def pyplot(what: str) -> Any:
    """Return matplotlib.pyplot; OptionError, which says what needs it, if matplotlib is not installed."""
    try:
        from matplotlib import pyplot as plt
    except ModuleNotFoundError as error:
        install = "install with: pip install 'pirrht[figures]', or 'pirrht[all]' for every command"
        raise OptionError(f"{what} needs {error.name}; {install}") from None
    return plt


def literal(text: str) -> str:
    """Return text that matplotlib shows in one line as it is: no formula, and no label that legends leave out."""
    return printable(f" {text}" if text.startswith("_") else text).replace("$", r"\$")


def of(space: FreeSpace, time: float, axes: Any, what: str) -> list[View]:
    """Draw an examined scene at a time [s] and number its obstacles, on new axes if none are given; return the views.

    New axes of a scene in space are two, the first seen from above.
    """
    if axes is None and space.scene.dimension == 3:
        found = views(pyplot(what).figure(figsize=(7.0, 7.0), layout="constrained"), space.scene)
    else:
        found = [(axes or pyplot(what).subplots(figsize=(7.0, 5.0), layout="constrained")[1], (0, 1))]
    for one, seen in found:
        draw(one, space.scene, time, seen)
        numbers(one, space, time, seen)
    return found


def views(figure: Any, scene: Scene) -> list[View]:
    """Add axes to a figure that show a scene in space from above and from the south, to one scale."""
    _, deep, high = scene.upper - scene.lower
    both = figure.subplots(2, 1, sharex=True, height_ratios=[deep, high])
    return list(zip(both, ((0, 1), (0, 2)), strict=True))


def draw(axes: Any, scene: Scene, time: float = 0.0, seen: tuple[int, int] = (0, 1)) -> None:
    """Draw a scene to scale, with moving obstacles at a time [s]; one in space as two of its axes show it."""
    from matplotlib.patches import Circle, Polygon, Rectangle

    pick = list(seen)
    lower = scene.lower[pick]
    upper = scene.upper[pick]
    solid = scene.dimension == 2  # else what is behind an obstacle shows through it
    axes.add_patch(Rectangle(tuple(lower), *(upper - lower), fc=FLOOR, ec=BORDER, lw=1, zorder=0))
    for obstacle in scene.obstacles:
        axes.add_patch(
            Polygon(outline(obstacle, seen), closed=True, fc=WALL, ec="none", alpha=None if solid else 0.55, zorder=3)
        )
    bodies(axes, scene.movers, time, seen=seen)
    axes.add_patch(Circle(tuple(scene.goal.center[pick]), scene.goal.radius, fc=GOAL, ec=GOAL_EDGE, lw=1, zorder=1))
    style = {"fc": "none", "ec": INK, "lw": 1.2, "zorder": 5}
    if scene.footprint.is_disc:
        axes.add_patch(Circle(tuple(scene.start[pick]), scene.robot_radius, **style))
    else:
        axes.add_patch(Polygon(scene.body.at(scene.start), closed=True, **style))
    margin = 0.02 * float((scene.upper - scene.lower).max()) + (0.0 if solid else scene.robot_radius)
    x, y = ("xyz"[axis] for axis in seen)
    (left, low), (right, high) = lower - margin, upper + margin
    axes.set(aspect="equal", xlim=(left, right), ylim=(low, high), xlabel=f"{x} [m]", ylabel=f"{y} [m]")


def lines(axes: Any, drawn: Sequence[Array], color: Any, *, width: float, opacity: Any, zorder: float) -> None:
    """Draw polylines (k, 2) [m]; opacities are common or one each."""
    from matplotlib.collections import LineCollection

    if len(drawn):
        axes.add_collection(LineCollection(list(drawn), colors=color, lw=width, alpha=opacity, zorder=zorder))


def classes(
    axes: Any, body: Footprint, paths: Sequence[Any], labels: Sequence[str], colors: Sequence[Color],
    seen: tuple[int, int] = (0, 1), **legend: Any,
) -> None:  # fmt: skip
    """Draw one `Trajectory` per class, side by side where they coincide, and a robot with corners along them.

    The legend is on the view from above.
    """
    per_point = float(np.ptp(axes.get_xlim())) / (72.0 * axes.get_window_extent().width / axes.figure.dpi)
    for place, (line, label, color) in enumerate(
        zip(
            side_by_side([path.points[:, list(seen)] for path in paths], TUNING.line * per_point),
            labels,
            colors,
            strict=True,
        )
    ):
        axes.plot(line[:, 0], line[:, 1], label=label, color=rgb(color), lw=TUNING.line, zorder=4.0 - 1e-3 * place)
    for path, color in zip(paths, colors, strict=True):
        robots(axes, body, path.poses(TUNING.outlines + 1)[1:], rgb(color))
    if labels and seen == (0, 1):
        axes.legend(**LEGEND, **legend)


def numbers(axes: Any, space: FreeSpace, time: float, seen: tuple[int, int] = (0, 1)) -> None:
    """Write the numbers by which classes name obstacles, moving ones where they are at a time [s]."""
    pick = list(seen)
    places = [*space.homology.markers[:, pick]]
    if len(space.scene.movers) == space.homology.J:  # else one has parts with a number each
        places += [mover.motion.pose(time)[pick] for mover in space.scene.movers]
    tags(axes, places, [str(number) for number in range(1, len(places) + 1)])


def tags(axes: Any, places: Iterable[Array], texts: Sequence[str]) -> None:
    """Write a text at each of several places (2,) [m], to be read on obstacles as on the floor."""
    from matplotlib.patheffects import withStroke

    style = {"color": "white", "fontsize": 8, "ha": "center", "va": "center", "zorder": 5}
    for (x, y, *_), text in zip(places, texts, strict=True):
        axes.text(x, y, literal(text), path_effects=[withStroke(linewidth=1.8, foreground=WALL)], **style)


def solids(axes: Any, drawn: Sequence[Obstacle], seen: tuple[int, int] = (0, 1), **style: Any) -> None:
    """Draw solids seen from above, or as two axes show them, with the style of a patch."""
    from matplotlib.patches import Polygon

    for solid in drawn:
        axes.add_patch(Polygon(outline(solid, seen), closed=True, **style))


def bodies(
    axes: Any, movers: Sequence[Mover], time: float, *, zorder: float = 3.0, seen: tuple[int, int] = (0, 1)
) -> None:  # fmt: skip
    """Draw moving obstacles at a time [s]."""
    for mover in movers:
        solids(axes, mover.at(time), seen, fc=MOVER, ec="none", alpha=0.7, zorder=zorder)


def predicted(
    axes: Any, movers: Sequence[Mover], time: float, *, zorder: float = 2.9, seen: tuple[int, int] = (0, 1)
) -> None:  # fmt: skip
    """Outline moving obstacles soon after a time [s], the paler the later."""
    for mover in movers:
        outlined(
            axes, mover, [(time + after, strength) for after, strength in fading(mover, time)], zorder=zorder, seen=seen
        )


def outlined(
    axes: Any, mover: Mover, moments: Sequence[tuple[float, float]], *, zorder: float, seen: tuple[int, int] = (0, 1)
) -> None:  # fmt: skip
    """Outline a moving obstacle at times [s], each with its opacity."""
    for time, alpha in moments:
        solids(axes, mover.at(time), seen, fill=False, ec=MOVER, lw=0.9, alpha=alpha, zorder=zorder)


def position(axes: Any, place: Array, moved: Array) -> None:
    """Mark a place (2,) [m], with an arrow to where it is moved (2,) [m]."""
    axes.plot(*place, "o", ms=5, color=INK, zorder=6)
    style = {"arrowprops": {"arrowstyle": "-|>", "lw": 1.4, "color": INK}, "zorder": 6}
    axes.annotate("", tuple(moved), tuple(place), **style)


def robots(axes: Any, footprint: Footprint, poses: Array, color: Any) -> None:
    """Outline a footprint with corners at poses (k, 3); discs are left out."""
    if not footprint.is_disc:
        lines(axes, [*rings(footprint, poses)], color, width=0.8, opacity=1.0, zorder=5)
