"""Maps seen from above with matplotlib (extra `figures`), which is imported when one is drawn: scenes, trees, plans.

`HomologyTree.plot` and `Plan.plot` call `tree` and `plan`. Among moving obstacles a map shows where these and the
references are at equal moments.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import OptionError, printable
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Obstacle, Scene
from pirrht.outcome import Outcome
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from sim.drawing.colors import NAMED, ClassColors, Color, labels, passing, rgb, title
from sim.drawing.strokes import fading, outline, side_by_side, timed
from sim.extras import require
from sim.files import replaced

if TYPE_CHECKING:
    from sim.scenario import Scenario

FLOOR = "#f7f7f5"
BORDER = "#777777"
WALL = "#4d5866"
GOAL = "#8fd19e"
GOAL_EDGE = "#3c8f52"
INK = "#222222"

MOVER, TREE, SAMPLE = "#80609e", "#55aacc", "#70747a"
LEGEND = {"fontsize": 8, "title_fontsize": 8, "frameon": False, "loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}
LINE = 2.0  # width of the path of a class [points]
ARROW = 0.5  # time that the arrow of a control spans [s]
FAINT, STRONG = 0.08, 0.6  # opacity of samples, of the least and of the greatest weight
SPACING = 0.15  # of points on edges that turn [m]
WIDE, HIGH = 36, 30  # characters of a line of the legend, and lines of one of its columns
ENDINGS = (".png", ".pdf", ".svg")
MOST, SHOWN = 8, 16  # moments on a map, and classes in a figure of lengths
APART = 0.022  # from each other that numbers are at least, over the width of the map


def pyplot(what: str) -> Any:
    """Return matplotlib.pyplot; OptionError, which says what needs it, if matplotlib is not installed."""
    require(what, "figures")
    from matplotlib import pyplot as plt

    return plt


def literal(text: str) -> str:
    """Return text that matplotlib shows in one line as it is: no formula, and no label that legends leave out."""
    return printable(f" {text}" if text.startswith("_") else text).replace("$", r"\$")


def tree(drawn: HomologyTree, x: Array | None, axes: Any) -> Any:
    """Draw the best edge of every vertex, and the references from a state; return the axes."""
    references = [] if x is None else drawn.references(np.asarray(x, dtype=float))
    axes = axes or pyplot("tree.plot").subplots(figsize=(7.0, 5.0), layout="constrained")[1]
    scene = drawn.space.scene
    draw(axes, scene)
    edges(axes, drawn, TREE, width=0.4, opacity=0.6, zorder=2)
    numbers(axes, drawn.space, 0.0)
    labels = [f"{formatting.turns(one.id)}: {one.cost:.3g}" for one in references]
    colors = ClassColors(one.id for one in references)
    lines = [one.trajectory.points for one in references]
    classes(axes, lines, labels, [colors[one.id] for one in references], title="class: cost")
    axes.set_title(f"{literal(scene.name)}: {drawn.size} vertices", fontsize=10)
    return axes


def plan(drawn: Plan, samples: int, axes: Any) -> Any:
    """Draw the state, references, samples and control of a plan on a map of its scene; return the axes."""
    if drawn.space is None:
        raise OptionError("this plan does not know its scene; plot one that Controller, Mppi or Optimal made")
    axes = axes or pyplot("plan.plot").subplots(figsize=(7.0, 5.0), layout="constrained")[1]
    draw(axes, drawn.space.scene, drawn.time)
    numbers(axes, drawn.space, drawn.time)
    predicted(axes, drawn.movers, drawn.time)
    _samples(drawn, axes, samples)
    by = drawn.weights()
    labels = [f"{formatting.turns(id)}: {formatting.share(by[id]) if id in by else '-'}" for id in drawn.ids]
    lines = [one.trajectory.points for one in drawn.references]
    colors = ClassColors(drawn.ids)
    hues = [colors[id] for id in drawn.ids]
    classes(axes, lines[: len(labels)], labels[: len(lines)], hues[: len(lines)], title="class: weight")
    axes.plot(*drawn.state[:2], "o", ms=5, color=INK, zorder=6)
    if len(drawn.control) == 2:
        look = {"arrowprops": {"arrowstyle": "-|>", "lw": 1.4, "color": INK}, "zorder": 6}
        axes.annotate("", tuple(drawn.state[:2] + ARROW * drawn.control), tuple(drawn.state[:2]), **look)
    axes.set_title(f"{literal(drawn.space.scene.name)} at {drawn.time:.2f} s", fontsize=10)
    return axes


def edges(axes: Any, tree: HomologyTree, color: str, *, width: float, opacity: float, zorder: float) -> None:
    """Draw the edge that each vertex' cheapest node takes."""
    graph, size = tree.graph, tree.size
    tails = np.flatnonzero(graph.nodes[:size] > 0)
    costs = np.where(np.arange(graph.cost.shape[1]) < graph.nodes[tails, None], graph.cost[tails], np.inf)
    taken = graph.parent[tails, np.argmin(costs, axis=1)]
    tails = tails[taken >= 0]
    heads = graph.head[taken[taken >= 0]]

    if len(tails):
        paths = tree.steering.connect(tree.states[tails], tree.states[heads])
        _lines(axes, paths.points(SPACING), color, width=width, opacity=opacity, zorder=zorder)


def classes(
    axes: Any, lines: Sequence[Array], labels: Sequence[str], colors: Sequence[Color], **legend: Any
) -> None:  # fmt: skip
    """Draw one polyline (k, 2) [m] per class, side by side where they coincide, with colours and labels."""
    per_point = float(np.ptp(axes.get_xlim())) / (72.0 * axes.get_window_extent().width / axes.figure.dpi)
    shown = side_by_side(lines, LINE * per_point)
    for place, (line, label, color) in enumerate(zip(shown, labels, colors, strict=True)):
        axes.plot(line[:, 0], line[:, 1], label=label, color=rgb(color), lw=LINE, zorder=4.0 - 1e-3 * place)
    if labels:
        axes.legend(**LEGEND, **legend)


def numbers(axes: Any, space: FreeSpace, time: float) -> None:
    """Write the numbers by which classes name obstacles, moving ones where they are at a time [s]."""
    places = [*space.homology.markers]
    if len(space.scene.movers) == space.homology.J:  # else one has parts with a number each
        places += [mover.motion.pose(time)[:2] for mover in space.scene.movers]
    tags(axes, places, [str(number) for number in range(1, len(places) + 1)])


def tags(axes: Any, places: Iterable[Array], texts: Sequence[str]) -> None:
    """Write a text at each of several places (2,) [m], to be read on obstacles as on the floor."""
    from matplotlib.patheffects import withStroke

    look = {"color": "white", "fontsize": 8, "ha": "center", "va": "center", "zorder": 5}
    for (x, y), text in zip(places, texts, strict=True):
        axes.text(x, y, literal(text), path_effects=[withStroke(linewidth=1.8, foreground=WALL)], **look)


def _lines(axes: Any, lines: Sequence[Array], color: str, *, width: float, opacity: Any, zorder: float) -> None:
    """Draw polylines (k, 2) [m]; opacities are common or one each."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(lines), colors=color, lw=width, alpha=opacity, zorder=zorder))


def _samples(drawn: Plan, axes: Any, count: int) -> None:
    """Draw the heaviest samples, stronger the more they weigh, then as many of those that died."""
    if drawn.estimate is None or drawn.replay is None or count < 1:
        return
    rollouts, weight = drawn.estimate.rollouts, drawn.estimate.weight
    arrived = np.flatnonzero(rollouts.paths.outcome == Outcome.GOAL)
    died = np.flatnonzero(rollouts.paths.outcome == Outcome.COLLISION)[:count]
    best = arrived[np.argsort(-weight[arrived], kind="stable")[:count]]
    share = weight[best] / max(float(weight[best].max(initial=0.0)), 1e-300)
    for chosen, opacity in ((died, FAINT), (best, FAINT + (STRONG - FAINT) * share)):
        if len(chosen):
            states, steps = drawn.replay.trace(rollouts, chosen)
            paths = [path[: int(count) + 1, :2] for path, count in zip(states, steps, strict=True)]
            _lines(axes, paths, SAMPLE, width=0.7, opacity=opacity, zorder=2)


def draw(axes: Any, scene: Scene, time: float = 0.0) -> None:
    """Draw a scene to scale, with moving obstacles at a time [s]."""
    from matplotlib.patches import Circle, Rectangle

    axes.add_patch(Rectangle(tuple(scene.lower), *(scene.upper - scene.lower), fc=FLOOR, ec=BORDER, lw=1, zorder=0))
    solids(axes, scene.obstacles, fc=WALL, ec="none", zorder=3)
    bodies(axes, scene.movers, time)
    axes.add_patch(Circle(tuple(scene.goal.center), scene.goal.radius, fc=GOAL, ec=GOAL_EDGE, lw=1, zorder=1))
    axes.add_patch(Circle(tuple(scene.start[:2]), scene.robot_radius, fc="none", ec=INK, lw=1.2, zorder=5))
    margin = 0.02 * float((scene.upper - scene.lower).max())
    left, low = scene.lower - margin
    right, high = scene.upper + margin
    axes.set(aspect="equal", xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]")


def solids(axes: Any, shown: Sequence[Obstacle], **look: Any) -> None:
    """Draw solids seen from above, with the look of a patch."""
    from matplotlib.patches import Polygon

    for solid in shown:
        axes.add_patch(Polygon(outline(solid), closed=True, **look))


def bodies(axes: Any, movers: Sequence[Mover], time: float, *, zorder: float = 3.0) -> None:
    """Draw moving obstacles at a time [s]."""
    for mover in movers:
        solids(axes, mover.at(time), fc=MOVER, ec="none", alpha=0.7, zorder=zorder)


def predicted(axes: Any, movers: Sequence[Mover], time: float, *, zorder: float = 2.9) -> None:
    """Outline moving obstacles soon after a time [s], the paler the later."""
    for mover in movers:
        outlined(axes, mover, [(time + after, strength) for after, strength in fading(mover, time)], zorder=zorder)


def outlined(axes: Any, mover: Mover, moments: Sequence[tuple[float, float]], *, zorder: float) -> None:
    """Outline a moving obstacle at times [s], each with its opacity."""
    for time, alpha in moments:
        solids(axes, mover.at(time), fill=False, ec=MOVER, lw=0.9, alpha=alpha, zorder=zorder)


def draw_plan(path: Path, scenario: "Scenario", tree: HomologyTree, references: Sequence[Reference]) -> None:
    """Write a map with obstacles, tree and the reference of every class."""
    scene = scenario.loaded.scene
    wide, high = scene.upper - scene.lower
    axes = pyplot("--png").Figure(figsize=(8.0, 6.2 * high / wide + 0.8)).subplots()
    draw_scene(axes, scenario)
    tags(axes, scenario.space.homology.markers, labels(scenario.names))  # moving ones bear their names
    edges(axes, tree, "#9aa3ab", width=0.35, opacity=0.5, zorder=1)
    colors = ClassColors(reference.id for reference in references)
    sides = [wrap(literal(", ".join(words)), WIDE) for words in passing(references, tree.homology, scenario.names)]
    costs = [f"{title(reference.id)}: {reference.cost:.2f}" for reference in references]
    rows = ["\n  ".join([cost, *words]) for cost, words in zip(costs, sides, strict=True)]
    step = draw_moments(axes, scenario, references, colors) if scene.movers else 0.0
    lines = [r.trajectory.points for r in references]
    hues = [colors[r.id] for r in references]
    classes(axes, lines, rows, hues, title="class: cost", ncols=1 + "\n".join(rows).count("\n") // HIGH)
    when = f"; obstacles at 0 s, dots and outlines every {step:g} s" if step else ""
    counts = f"{tree.size} vertices, {len(references)} classes, cheapest first{when}"
    axes.set_title(f"{literal(scene.name)}: {counts}", fontsize=10)
    _save(axes, path, "--png")


def draw_convergence(path: Path, scene: str, convergence: Mapping[str, Any], references: Sequence[Reference]) -> None:
    """Write the lengths of the best path per class (`sim.result.convergence_json`) against the iteration (Fig. 3a)."""
    axes = pyplot("--convergence").Figure(figsize=(8.0, 4.8), layout="constrained").subplots()
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
        f"{literal(scene)}: {convergence['vertices'][-1]} vertices; dotted: shortened within the class", fontsize=10
    )
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(title="class", **LEGEND)
    _save(axes, path, "--convergence")


def draw_scene(axes: Any, scenario: "Scenario") -> None:
    """Workspace, obstacles seen from above, start and heading, goal, and moving obstacles at 0 s, few by name."""
    from matplotlib.patheffects import withStroke

    scene = scenario.loaded.scene
    draw(axes, scene)
    look = {"fontsize": 7, "ha": "center", "va": "center", "color": INK, "zorder": 9}
    for mover in scene.movers if len(scene.movers) <= NAMED else ():
        x, y = mover.motion.pose(0.0)[:2]
        axes.text(x, y, literal(mover.name), path_effects=[withStroke(linewidth=1.8, foreground="white")], **look)
    if scenario.problem.dynamics.angles:
        heading = scene.robot_radius * 1.6 * np.array([np.cos(scene.start[2]), np.sin(scene.start[2])])
        axes.annotate("", scene.start[:2] + heading, scene.start[:2], arrowprops={"arrowstyle": "->", "lw": 1.2})


def draw_moments(axes: Any, scenario: "Scenario", references: Sequence[Reference], colors: ClassColors) -> float:
    """Outline moving obstacles, the paler the later, and put a dot on every reference, at equal moments.

    Return the time between moments [s]; 0 where no reference moves.
    """
    from matplotlib.ticker import MaxNLocator

    paths = [timed(reference, 0.0) for reference in references]
    last = max((float(path[-1, 2]) for path in paths), default=0.0)
    if last <= 0.0:
        return 0.0
    moments = MaxNLocator(MOST, steps=[1, 2, 5, 10]).tick_values(0.0, last)[1:]
    numbers: list[tuple[float, Array, dict[str, Any]]] = []
    for mover in scenario.loaded.scene.movers:
        until = moments[: 1 + int(np.searchsorted(moments, mover.motion.last))]
        outlined(axes, mover, [(time, 0.9 - 0.7 * time / moments[-1]) for time in until], zorder=2.9)
        look = {"xytext": (0, 0), "ha": "center", "va": "center", "color": MOVER, "zorder": 2.9}
        numbers += [(time, mover.motion.pose(time)[:2], look) for time in until]
    for reference, path in zip(references, paths, strict=True):
        for time in moments[moments <= path[-1, 2]]:
            place = np.array([np.interp(time, path[:, 2], path[:, k]) for k in (0, 1)])
            axes.plot(*place, "o", ms=4.0, mfc="white", mec=rgb(colors[reference.id]), mew=1.2, zorder=7)
            numbers.append((time, place, {"xytext": (3, 4), "color": INK, "zorder": 8}))
    marked: list[Array] = []  # places of numbers
    for time, place, look in numbers:
        if all(np.hypot(*(place - other)) >= APART * np.ptp(axes.get_xlim()) for other in marked):  # it can be read
            marked.append(place)
            axes.annotate(f"{time:g}", place, textcoords="offset points", fontsize=6.5, **look)
    return float(moments[0])


def check(path: Path, option: str) -> None:
    """Refuse a figure before any work, by OptionError: matplotlib is missing, or it knows no such ending."""
    pyplot(option)
    if path.suffix.lower() not in ENDINGS:
        raise OptionError(f"{option} {path}: no figure has this ending; give a file that ends in {', '.join(ENDINGS)}")


def _save(axes: Any, path: Path, option: str) -> None:
    """Write a figure whole or not at all, in the format of the file's ending."""
    with replaced(path, option) as stream:
        axes.figure.savefig(stream, format=path.suffix[1:].lower(), dpi=150, bbox_inches="tight")
