"""Maps and lengths of a plan that the command line writes, with matplotlib (extra `figures`).

Among moving obstacles a map shows where these and the references are at equal moments.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.scene import Scene
from pirrht.mapping.believed import Believed
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.plotting import maps
from pirrht.plotting.colors import ClassColors, rgb
from pirrht.plotting.tuning import TUNING as PLOTTING
from sim.drawing.colors import NAMED, labels, passing, title
from sim.drawing.known import SCAN, shades
from sim.drawing.strokes import timed
from sim.drawing.ways import label_places, ways_in
from sim.files import replaced

if TYPE_CHECKING:
    from sim.scenario import Scenario


WIDE, HIGH = 36, 30  # characters of a line of the legend, and lines of one of its columns
ENDINGS = (".png", ".pdf", ".svg")
MOST, SHOWN = 8, 16  # moments on a map, and classes in a figure of lengths
APART = 0.022  # from each other that numbers are at least, over the width of the map


def draw_plan(
    path: Path, scenario: "Scenario", tree: HomologyTree, references: Sequence[Reference], known: Believed | None = None
) -> None:
    """Write a map with obstacles, tree and the reference of every class; in space as two views.

    If just a map is `known`, obstacles as they are are outlines.
    """
    scene = scenario.loaded.scene
    if scene.dimension == 3:
        return draw_views(path, scenario, tree, references)
    wide, high = scene.upper - scene.lower
    axes = maps.pyplot("--png").Figure(figsize=(8.0, 6.2 * high / wide + 0.8)).subplots()
    draw_scene(axes, scenario, known)
    maps.tags(axes, scenario.space.homology.markers, labels(scenario.names))  # moving ones bear their names
    maps.lines(axes, tree.best_edges(PLOTTING.spacing), "#9aa3ab", width=0.35, opacity=0.5, zorder=1)
    colors = ClassColors(reference.id for reference in references)
    sides = [wrap(maps.literal(", ".join(words)), WIDE) for words in passing(references, tree.homology, scenario.names)]
    costs = [f"{title(reference.id)}: {reference.cost:.2f}" for reference in references]
    rows = ["\n  ".join([cost, *words]) for cost, words in zip(costs, sides, strict=True)]
    step = draw_moments(axes, scenario, references, colors) if scene.movers and known is None else 0.0
    paths = [r.trajectory for r in references]
    hues = [colors[r.id] for r in references]
    maps.classes(
        axes, scene.body, paths, rows, hues, title="class: cost", ncols=1 + "\n".join(rows).count("\n") // HIGH
    )
    when = f"; obstacles at 0 s, dots and outlines every {step:g} s" if step else ""
    if known is not None:
        when += "\ngrey: unseen, red: the scan, black: obstacles of the map, outlines: what there is"
    counts = f"{tree.size} vertices, {len(references)} classes, cheapest first{when}"
    axes.set_title(f"{maps.literal(scene.name)}: {counts}", fontsize=10)
    _save(axes, path, "--png")


def draw_views(path: Path, scenario: "Scenario", tree: HomologyTree, references: Sequence[Reference]) -> None:
    """Write two views of a plan in space, from above and from the south: obstacles, tree, references by class.

    The legend names the cheapest classes, as many as there is room for.
    """
    scene, names = scenario.loaded.scene, scenario.names
    wide, deep, high = scene.upper - scene.lower
    tall = max(5.5, 5.4 * (deep + high) / wide + 1.2)
    figure = maps.pyplot("--png").Figure(figsize=(8.0, tall), layout="constrained")
    views = maps.views(figure, scene)
    colors = ClassColors(reference.id for reference in references)
    ways = ways_in(scenario.space, references, names)
    rows = [
        wrap(maps.literal(f"{title(r.id)}: {r.cost:.2f}, {way}"), WIDE) for r, way in zip(references, ways, strict=True)
    ]
    named = int(np.sum(np.cumsum([len(row) for row in rows]) <= HIGH))
    edges = tree.best_edges(PLOTTING.spacing)
    for (axes, seen), look in zip(views, ("from above", "from the south"), strict=True):
        pick = list(seen)
        maps.draw(axes, scene, seen=seen)
        maps.tags(axes, label_places(scenario.space)[:, pick], labels(names))
        maps.lines(axes, [line[:, pick] for line in edges], "#9aa3ab", width=0.35, opacity=0.5, zorder=1)
        for k, (reference, row) in enumerate(zip(references, rows, strict=True)):
            line = reference.trajectory.points[:, pick]
            label = "\n  ".join(row) if k < named else None
            axes.plot(*line.T, color=rgb(colors[reference.id]), lw=PLOTTING.line, zorder=4, label=label)
        _name_movers(axes, scene, seen)
        step = draw_moments(axes, scenario, references, colors, seen) if scene.movers else 0.0
        axes.set_title(look, fontsize=9)
    _legend(axes, len(rows) - named)
    when = f"; obstacles at 0 s, dots and outlines every {step:g} s" if step else ""
    counts = f"{tree.size} vertices, {len(references)} classes{when}"
    views[0][0].set_title(f"{maps.literal(scene.name)}: {counts}\nfrom above", fontsize=9)
    _save(views[0][0], path, "--png")


def _legend(axes: Any, more: int) -> None:
    """Add the legend of the lines on axes to their figure, with a line that counts those that it leaves out."""
    if more:
        axes.plot([], [], " ", label=f"and {more} more")
    handles, names = axes.get_legend_handles_labels()
    if handles:
        style = maps.LEGEND | {"loc": "outside right upper", "bbox_to_anchor": None}
        axes.figure.legend(handles, names, **style, title="class: cost, way")


def draw_convergence(path: Path, scene: str, convergence: Mapping[str, Any], references: Sequence[Reference]) -> None:
    """Write the lengths of the best path per class (`sim.result.convergence_json`) against the iteration (Fig. 3a)."""
    axes = maps.pyplot("--convergence").Figure(figsize=(8.0, 4.8), layout="constrained").subplots()
    colors = ClassColors(reference.id for reference in references)
    final = {reference.id: reference.length for reference in references}
    iterations = convergence["iterations"]
    end = convergence["iterations"][-1]
    shown = [name for name in final if name in convergence["lengths"]][:SHOWN]
    for name in shown:
        lengths = np.array(convergence["lengths"][name])
        look = {"color": rgb(colors[name]), "lw": 1.6}
        label = f"{title(name)}: {lengths[-1]:.2f} m, shortened {final[name]:.2f}"
        lengths = np.where(np.isfinite(lengths), lengths, np.nan)
        axes.step(iterations, lengths, where="post", label=label, **look)
        axes.plot([0.97 * end, 1.03 * end], [final[name]] * 2, ls=":", **look)
    if shown:  # first paths may be several times as long as the last ones: those are what one looks at
        axes.set_ylim(0.97 * min(final.values()), 1.5 * max(final[name] for name in shown))
    axes.set(xlabel="iteration (random states drawn)", ylabel="length of the tree's best path per class [m]")
    axes.set_title(
        f"{maps.literal(scene)}: {convergence['vertices'][-1]} vertices; dotted: shortened within the class",
        fontsize=10,
    )
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(title="class", **maps.LEGEND)
    _save(axes, path, "--convergence")


def draw_scene(axes: Any, scenario: "Scenario", known: Believed | None = None) -> None:
    """Workspace, obstacles seen from above, start and heading, goal, and moving obstacles at 0 s, few by name.

    If just a map is `known`, that and the last scan are drawn, and obstacles are outlines.
    """
    scene = scenario.loaded.scene
    if known is None:
        maps.draw(axes, scene)
    else:
        maps.draw(axes, replace(scene, obstacles=(), movers=()))
        (left, right), (low, high) = np.column_stack([known.lower, known.upper])
        axes.imshow(shades(known), extent=(left, right, low, high), zorder=0.5, interpolation="nearest")
        solids = [*scene.obstacles, *(solid for mover in scene.movers for solid in mover.at(0.0))]
        maps.solids(axes, solids, fill=False, ec=maps.WALL, lw=0.6, zorder=3)
        axes.plot(*known.scan.points.T if known.scan else ((), ()), ".", ms=1.5, color=rgb(SCAN), zorder=3.5)
    _name_movers(axes, scene, (0, 1))
    states = scenario.system.adapter
    if (ahead := states.direction(scene.start)) is not None:
        start = states.above(scene.start)
        tip = start + scene.robot_radius * 1.6 * ahead
        axes.annotate("", tip, start, arrowprops={"arrowstyle": "->", "lw": 1.2})


def _name_movers(axes: Any, scene: Scene, seen: tuple[int, int]) -> None:
    from matplotlib.patheffects import withStroke

    look = {"fontsize": 7, "ha": "center", "va": "center", "color": maps.INK, "zorder": 9}
    for mover in scene.movers if len(scene.movers) <= NAMED else ():
        x, y = mover.motion.pose(0.0)[list(seen)]
        axes.text(x, y, maps.literal(mover.name), path_effects=[withStroke(linewidth=1.8, foreground="white")], **look)


def draw_moments(
    axes: Any, scenario: "Scenario", references: Sequence[Reference], colors: ClassColors,
    seen: tuple[int, int] = (0, 1),
) -> float:  # fmt: skip
    """Outline moving obstacles, the paler the later, and put a dot on every reference, at equal moments.

    Return the time between moments [s]; 0 where no reference moves.
    """
    from matplotlib.ticker import MaxNLocator

    paths = [timed(reference, 0.0) for reference in references]
    last = max((float(path[-1, -1]) for path in paths), default=0.0)
    if last <= 0.0:
        return 0.0
    moments = MaxNLocator(MOST, steps=[1, 2, 5, 10]).tick_values(0.0, last)[1:]
    numbers: list[tuple[float, Array, dict[str, Any]]] = []
    for mover in scenario.loaded.scene.movers:
        until = moments[: 1 + int(np.searchsorted(moments, mover.motion.last))]
        maps.outlined(axes, mover, [(time, 0.9 - 0.7 * time / moments[-1]) for time in until], zorder=2.9, seen=seen)
        look = {"xytext": (0, 0), "ha": "center", "va": "center", "color": maps.MOVER, "zorder": 2.9}
        numbers += [(time, mover.motion.pose(time)[list(seen)], look) for time in until]
    for reference, path in zip(references, paths, strict=True):
        for time in moments[moments <= path[-1, -1]]:
            place = np.array([np.interp(time, path[:, -1], path[:, k]) for k in seen])
            axes.plot(*place, "o", ms=4.0, mfc="white", mec=rgb(colors[reference.id]), mew=1.2, zorder=7)
            numbers.append((time, place, {"xytext": (3, 4), "color": maps.INK, "zorder": 8}))
    marked: list[Array] = []  # places of numbers
    for time, place, look in numbers:
        if all(np.hypot(*(place - other)) >= APART * np.ptp(axes.get_xlim()) for other in marked):  # it can be read
            marked.append(place)
            axes.annotate(f"{time:g}", place, textcoords="offset points", fontsize=6.5, **look)
    return float(moments[0])


def check(path: Path, option: str) -> None:
    """Refuse a figure before any work, by OptionError: matplotlib is missing, or it knows no such ending."""
    maps.pyplot(option)
    if path.suffix.lower() not in ENDINGS:
        raise OptionError(f"{option} {path}: no figure has this ending; give a file that ends in {', '.join(ENDINGS)}")


def _save(axes: Any, path: Path, option: str) -> None:
    """Write a figure whole or not at all, in the format of the file's ending."""
    with replaced(path, option) as stream:
        axes.figure.savefig(stream, format=path.suffix[1:].lower(), dpi=150, bbox_inches="tight")
