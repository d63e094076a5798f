"""Space and time: the best path of every class as a braid around the tubes that moving bodies sweep, time upward."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from textwrap import fill
from typing import Any

import numpy as np
from numpy.typing import NDArray

from figures import style
from figures.effort import Effort, Tick
from pirrht.arrays import Array
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.plotting.colors import ClassColors
from pirrht.plotting.maps import MOVER
from pirrht.plotting.strokes import outline
from sim.drawing.colors import sides, worded
from sim.drawing.strokes import Tube, timed, tubes
from sim.scenario import Scenario

SCENES = ("crossing", "closing_door")
MOST = 4  # braids, the cheapest
HEIGHT = 5.2  # of the time shown, in meters of the floor
VIEW = {"elev": 26.0, "azim": -66.0}
PIECES = 160  # of a braid
LOOKS = 120  # places towards the eye that may hide one
WALL = "#b4bac1"  # on the floor
WIDE = 12  # letters of a line


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """A scene with moving bodies, and its classes."""

    scenario: Scenario
    tree: HomologyTree
    references: Sequence[Reference]

    @property
    def until(self) -> float:
        """The time up to which the panel goes [s]."""
        return float(ceil(max(float(timed(r, 0.0)[-1, 2]) for r in self.references)))


def work(effort: Effort, tick: Tick) -> list[Shown]:
    """Grow a tree in space and time for each scene and read off the references."""
    found = []
    for name in SCENES:
        scenario = effort.scenario(name)
        tree = scenario.grown_tree()
        start = np.array([*scenario.start[:2], 0.0])
        found.append(Shown(scenario=scenario, tree=tree, references=tree.references(start)[:MOST]))
        tick()
    return found


def draw(plt: Any, shown: Sequence[Shown]) -> Any:
    """One panel in three dimensions per scene, z being time."""
    figure = plt.figure(figsize=(style.PAGE, 3.7))
    for k, one in enumerate(shown):
        place = (-0.015 + k / len(shown), 0.1, 0.96 / len(shown), 0.88)
        axes = figure.add_axes(place, projection="3d", computed_zorder=False, proj_type="ortho")
        _panel(axes, one)
        text = f"({chr(ord('a') + k)}) {one.scenario.loaded.scene.name}"
        axes.text2D(0.5, 1.0, text, transform=axes.transAxes, ha="center", va="top")
    _legend(figure)
    return figure


def _panel(axes: Any, shown: Shown) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    scene, until = shown.scenario.loaded.scene, shown.until
    walls = [_prism(outline(solid), until) for solid in scene.obstacles]
    bodies = [tube for mover in scene.movers for tube in tubes(mover, 0.0, until)]
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    goal = scene.goal.center + scene.goal.radius * np.column_stack([np.cos(turn), np.sin(turn)])
    floor = [(outline(solid), WALL) for solid in scene.obstacles] + [(goal, style.GOAL_EDGE)]
    for ring, face in floor:
        axes.add_collection3d(Poly3DCollection([_at(ring, 0.0)], facecolors=face, edgecolors="none", zorder=1))
    for part, face, strength in (
        *((wall, style.WALL, 0.13) for wall in walls),
        *((body, MOVER, 0.3) for body in bodies),
        (_prism(goal, until), style.GOAL_EDGE, 0.09),
    ):
        _solid(axes, Poly3DCollection, part, face, strength, until)
    for body in bodies:  # rings each second, by which one sees it lean
        for second in np.arange(0.0, until + 0.5):
            if body.times[0] <= second <= body.times[-1]:
                ring = body.at(second)
                axes.plot(*_at(np.vstack([ring, ring[:1]]), second).T, color=MOVER, lw=0.6, alpha=0.8, zorder=4)
    for mover in scene.movers:
        x, y, _ = mover.motion.pose(until)
        axes.text(x, y, 1.04 * until, mover.name, fontsize=7, color=MOVER, ha="center", va="bottom", zorder=9)
    _braids(axes, shown, [*walls, *bodies])
    style.space(axes, scene.lower, scene.upper, (0.0, until), height=HEIGHT, **VIEW)
    axes.set_zlabel("$t$ [s]", labelpad=-8, rotation=90)
    axes.set_zticks(np.arange(0.0, until + 0.5))


def _braids(axes: Any, shown: Shown, solids: Sequence[Tube]) -> None:
    """What is behind a tube is drawn before it, so that it shows through."""
    colors, until = ClassColors(reference.id for reference in shown.references), shown.until
    words = _words(shown)
    for reference in reversed(shown.references):
        way = timed(reference, 0.0)
        at = np.linspace(0.0, way[-1, 2], PIECES + 1)
        line = np.column_stack([np.interp(at, way[:, 2], way[:, k]) for k in (0, 1)] + [at])
        covered = hidden(0.5 * (line[1:] + line[:-1]), solids, until)
        for begin, end in _runs(covered):
            piece, back = line[begin : end + 1], bool(covered[begin])
            axes.plot(*piece.T, color="white", lw=3.4, zorder=2.4 if back else 6, solid_capstyle="butt")
            axes.plot(*piece.T, color=style.rgb(colors[reference.id]), lw=2.0, zorder=2.5 if back else 7)
        tell = {"color": style.rgb(colors[reference.id]), "fontsize": 7, "zorder": 9, "ha": "left", "va": "center"}
        said = fill(f"{words[reference.id]} {reference.cost:.2f}", WIDE)
        axes.text(*(line[-1] + (0.25, 0.0, 0.0)), said, linespacing=1.0, **tell)


def _words(shown: Shown) -> dict[str, str]:
    """The classes as a person would name them."""
    homology, names = shown.tree.homology, shown.scenario.names
    passed = dict(zip((r.id for r in shown.references), sides(shown.references, homology), strict=True))
    straight = homology.static.base(shown.scenario.start)
    windings = {r.id: r.winding for r in shown.references}
    return worded(windings, straight, names, homology.names, None, passed)


def hidden(points: Array, solids: Sequence[Tube], until: float) -> NDArray[np.bool_]:
    """Whether each point (k, 3) [m, m, s] is seen through one of several tubes, (k,)."""
    eye = _towards_eye(until)
    far = np.linspace(0.0, 10.0, LOOKS)
    found = np.zeros(len(points), dtype=np.bool_)
    for k, point in enumerate(points):
        sight = point + far[:, None] * eye
        found[k] = any(_inside(tube, place) for tube in solids for place in sight if place[2] <= until)
    return found


def _towards_eye(until: float) -> Array:
    """Where the eye is, (3,) [m, m, s] per meter, on axes where HEIGHT meters are all the time shown [s]."""
    elevation, azimuth = np.deg2rad(VIEW["elev"]), np.deg2rad(VIEW["azim"])
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation) * until / HEIGHT])


def _inside(tube: Tube, place: Array) -> bool:
    """Whether a place (3,) [m, m, s] lies in a tube with convex outlines."""
    if not tube.times[0] <= place[2] <= tube.times[-1]:
        return False
    ring = tube.at(float(place[2]))
    side, off = np.roll(ring, -1, axis=0) - ring, place[:2] - ring
    return bool(np.all(side[:, 0] * off[:, 1] - side[:, 1] * off[:, 0] > 0.0))


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where runs of equal flags begin and end."""
    cuts = [0, *(np.flatnonzero(np.diff(flags)) + 1).tolist(), len(flags)]
    return list(zip(cuts[:-1], cuts[1:], strict=True))


def _solid(axes: Any, polygons: Any, part: Tube, face: str, strength: float, until: float) -> None:
    """A tube one sees through: what faces away from the eye behind everything, the rest in front.

    Between two rows either is one sheet: seams of many would show.
    """
    eye = _towards_eye(until)
    for i in range(len(part.times) - 1):
        low, high = _at(part.rings[i], part.times[i]), _at(part.rings[i + 1], part.times[i + 1])
        along, up = np.roll(low, -1, axis=0) - low, high - low
        scale = np.array([1.0, 1.0, HEIGHT / until])
        front = np.cross(along * scale, up * scale) @ (eye * scale) > 0.0
        for side, zorder in ((~front, 2.0), (front, 5.0)):
            if side.any():
                around = _around(side)
                sheet = [np.vstack([low[around], high[around[::-1]]])]
                look = {"facecolors": face, "lw": 0.0, "alpha": strength, "zorder": zorder}
                axes.add_collection3d(polygons(sheet, **look))


def _around(side: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Corners of a convex outline, in order, between which its sides are marked (c,)."""
    begins = np.flatnonzero(side & ~np.roll(side, 1))
    begin = int(begins[0]) if len(begins) else 0
    return (begin + np.arange(int(side.sum()) + 1)) % len(side)


def _prism(ring: Array, until: float) -> Tube:
    return Tube(times=np.array([0.0, until]), rings=np.stack([ring, ring]))


def _at(points: Array, time: float) -> Array:
    return np.column_stack([points, np.full(len(points), time)])


def _legend(figure: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=style.INK, lw=2.0, label="best path of a class, and its cost"),
        Patch(fc=MOVER, alpha=0.5, label="where a body is, a ring each second"),
        Patch(fc=style.WALL, alpha=0.3, label="a wall that stands"),
        Patch(fc=style.GOAL_EDGE, alpha=0.4, label="goal"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), columnspacing=1.2, handletextpad=0.5)
