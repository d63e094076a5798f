"""Maps seen from above with matplotlib, which is imported when one is drawn, and trees and plans on them.

`HomologyTree.plot` and `Plan.plot` call `tree` and `plan`.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import OptionError
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Kind, Obstacle, Scene
from pirrht.outcome import Outcome
from pirrht.planner.tree import HomologyTree

FLOOR, BORDER, WALL, GOAL, GOAL_EDGE, INK = "#f7f7f5", "#777777", "#4d5866", "#8fd19e", "#3c8f52", "#222222"
MOVER, TREE, SAMPLE = "#80609e", "#55aacc", "#70747a"
# Cyan, magenta, teal, orange, blue, red: they stay apart for colour-blind eyes and read on dark as on white ground.
PALETTE = ("#33bbee", "#ee3377", "#009988", "#ee7733", "#0077bb", "#cc3311")
LEGEND = {"fontsize": 8, "title_fontsize": 8, "frameon": False, "loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}
ROUND = 64  # corners of what is round
MOMENTS = (0.5, 1.0, 1.5, 2.0, 2.5)  # after which predicted moving obstacles are outlined [s]
ARROW = 0.5  # time that the arrow of a control spans [s]
FAINT, STRONG = 0.08, 0.6  # opacity of samples, of the least and of the greatest weight
SPACING = 0.15  # of points on edges that turn [m]


def pyplot(what: str) -> Any:
    """matplotlib.pyplot; OptionError, which says what needs it, if matplotlib is not installed."""
    try:
        from matplotlib import pyplot as plt
    except ImportError:
        raise OptionError(f"{what} needs matplotlib; install it with: pip install 'pirrht[figures]'") from None
    return plt


def tree(drawn: HomologyTree, x: Array | None, axes: Any) -> Any:
    """Draw the best edge of every vertex, and the references from a state; return the axes."""
    references = [] if x is None else drawn.references(np.asarray(x, dtype=float))
    axes = axes or _axes("tree.plot")
    scene = drawn.space.scene
    draw(axes, scene)
    edges(axes, drawn, TREE, width=0.4, opacity=0.6, zorder=2)
    labels = [f"{formatting.turns(one.id)}: {one.cost:.3g}" for one in references]
    classes(axes, [one.trajectory.points for one in references], labels, title="class: cost")
    axes.set_title(f"{scene.name}: {drawn.size} vertices", fontsize=10)
    return axes


def plan(drawn: Plan, samples: int, axes: Any) -> Any:
    """Draw the state, references, samples and control of a plan on a map of its scene; return the axes."""
    if drawn.space is None:
        raise OptionError("this plan does not know its scene; plot one that Controller, Mppi or Optimal made")
    axes = axes or _axes("plan.plot")
    draw(axes, drawn.space.scene, drawn.time)
    predicted(axes, drawn.movers, drawn.time)
    _samples(drawn, axes, samples)
    by = drawn.weights()
    labels = [f"{formatting.turns(id)}: {formatting.share(by[id]) if id in by else '-'}" for id in drawn.ids]
    lines = [one.trajectory.points for one in drawn.references]
    classes(axes, lines[: len(labels)], labels[: len(lines)], title="class: weight")
    axes.plot(*drawn.state[:2], "o", ms=5, color=INK, zorder=6)
    if len(drawn.control) == 2:
        look = {"arrowprops": {"arrowstyle": "-|>", "lw": 1.4, "color": INK}, "zorder": 6}
        axes.annotate("", tuple(drawn.state[:2] + ARROW * drawn.control), tuple(drawn.state[:2]), **look)
    axes.set_title(f"{drawn.space.scene.name} at {drawn.time:.2f} s", fontsize=10)
    return axes


def edges(axes: Any, tree: HomologyTree, color: str, *, width: float, opacity: float, zorder: float) -> None:
    """Draw the edge that each vertex' cheapest node takes."""
    graph, size = tree.graph, tree.size
    tails = np.flatnonzero(graph.nodes[:size] > 0)
    costs = np.where(np.arange(graph.cost.shape[1]) < graph.nodes[tails, None], graph.cost[tails], np.inf)
    taken = graph.parent[tails, np.argmin(costs, axis=1)]
    tails, heads = tails[taken >= 0], graph.head[taken[taken >= 0]]
    if len(tails):
        paths = tree.steering.connect(tree.states[tails], tree.states[heads])
        _lines(axes, paths.points(SPACING), color, width=width, opacity=opacity, zorder=zorder)


def classes(
    axes: Any, lines: Sequence[Array], labels: Sequence[str], colors: Sequence[Any] = PALETTE, **legend: Any
) -> None:  # fmt: skip
    """Draw one polyline (k, 2) [m] per class with a label each in a legend, the first on top."""
    for place, (line, label) in reversed(list(enumerate(zip(lines, labels, strict=True)))):
        axes.plot(line[:, 0], line[:, 1], color=colors[place % len(colors)], lw=2.2, label=label, zorder=4)
    handles, texts = axes.get_legend_handles_labels()
    if handles:
        axes.legend(handles[::-1], texts[::-1], **LEGEND, **legend)


def _axes(method: str) -> Any:
    return pyplot(method).subplots(figsize=(7.0, 5.0), layout="constrained")[1]


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
    (left, low), (right, high) = scene.lower - margin, scene.upper + margin
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


def fading(mover: Mover, time: float) -> list[tuple[float, float]]:
    """Return times after a time [s] at which to outline a moving obstacle, and opacities; none after it stops."""
    last = [after for after in MOMENTS if time + after - MOMENTS[0] < mover.motion.last]
    return [(after, 1.0 - 0.8 * after / (MOMENTS[-1] + MOMENTS[0])) for after in last]


def outline(obstacle: Obstacle) -> Array:
    """Return the corners (k, 2) of an obstacle's convex outline seen from above, counterclockwise [m]."""
    body = surface(obstacle.kind, obstacle.size) if obstacle.vertices is None else obstacle.vertices
    points = (body @ obstacle.rotation.T + obstacle.position)[:, :2]
    return np.asarray(points[ConvexHull(points).vertices])


def surface(kind: Kind, size: Array) -> Array:
    """Return points (k, 3) [m] whose convex hull is a primitive in its own frame, or close to a round one."""
    angle, latitude = (
        np.linspace(0, 2 * np.pi, ROUND, endpoint=False),
        np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2 + 1),
    )
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(ROUND)])
    ball = np.vstack([np.cos(a) * ring + [0.0, 0.0, np.sin(a)] for a in latitude])
    up = np.array([0.0, 0.0, size[1]])
    points = {
        Kind.BOX: np.array(list(product((-1, 1), repeat=3))) * size,
        Kind.CYLINDER: np.vstack([size[0] * ring - up, size[0] * ring + up]),
        Kind.CAPSULE: np.vstack([size[0] * ball - up, size[0] * ball + up]),
        Kind.ELLIPSOID: ball * size,
        Kind.SPHERE: ball * size[0],
    }
    return np.asarray(points[kind])
