"""When what: on a map of a plan among bodies that move, where these and the references are at equal moments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.motion import Mover
from pirrht.plotting.ground import MOVER
from pirrht.tree.reference import Reference
from sim.drawing.colors import ClassColors
from sim.drawing.strokes import timed
from sim.drawing.tubes import outlines
from sim.figures import style
from sim.scenario import Scenario

STEPS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)  # between moments [s]
MOST = 8  # moments, where steps allow
APART = 0.022  # from each other that numbers are at least, over the width of the map


def draw(axes: Any, scenario: Scenario, references: Sequence[Reference], colors: ClassColors) -> float:
    """Outline bodies where they will be, and put a dot on every reference, at equal moments.

    Returns:
        the time between moments [s]; 0 where no reference moves.
    """
    ways = [timed(reference, 0.0) for reference in references]
    last = max((float(way[-1, 2]) for way in ways), default=0.0)
    if last <= 0.0:
        return 0.0
    step = next((step for step in STEPS if last / step <= MOST), STEPS[-1])
    moments = np.arange(step, last + 0.5 * step, step)
    told: list[Array] = []
    apart = APART * float(np.ptp(axes.get_xlim()))
    for mover in scenario.loaded.scene.movers:
        _outline(axes, mover, moments, told, apart)
    for reference, way in zip(references, ways, strict=True):
        _dots(axes, way, moments, style.rgb(colors[reference.id]), told, apart)
    return step


def _outline(axes: Any, mover: Mover, moments: Array, told: list[Array], apart: float) -> None:
    """A body's outlines, the paler the later, until it stands still; within its first part's the number of seconds.

    Args:
        told, apart: as `_dots` takes them.
    """
    from matplotlib.patches import Polygon

    until = moments[: 1 + int(np.searchsorted(moments, mover.motion.last))]
    for part, rings in enumerate(outlines(mover, until)):
        for time, ring in zip(until, rings, strict=True):
            alpha = 0.9 - 0.7 * float(time / moments[-1])
            axes.add_patch(Polygon(ring, closed=True, fill=False, ec=MOVER, lw=0.9, alpha=alpha, zorder=2.9))
            if part == 0 and _room(place := ring.mean(axis=0), told, apart):
                axes.annotate(f"{time:g}", place, ha="center", va="center", fontsize=6.5, color=MOVER, zorder=2.9)


def _dots(axes: Any, way: Array, moments: Array, color: Any, told: list[Array], apart: float) -> None:
    """Dots on a path (k, 3) at those moments that it is still under way, with the number of seconds beside.

    Args:
        told: places (2,) that have a number, to which its own are added.
        apart: from those that another must be, for both to be read [m].
    """
    for time, x, y in _places(way, moments):
        axes.plot(x, y, "o", ms=4.0, mfc="white", mec=color, mew=1.2, zorder=7)
        if _room(np.array([x, y]), told, apart):
            axes.annotate(
                f"{time:g}", (x, y), xytext=(3, 4), textcoords="offset points", fontsize=6.5, color=style.INK, zorder=8
            )


def _room(place: Array, told: list[Array], apart: float) -> bool:
    """Whether a number at a place (2,) can be read; if so, the place is noted."""
    free = all(np.hypot(*(place - other)) >= apart for other in told)
    if free:
        told.append(place)
    return free


def _places(way: Array, moments: Array) -> Iterator[NDArray[np.float64]]:
    at = moments[moments <= way[-1, 2]]
    yield from np.column_stack([at, *(np.interp(at, way[:, 2], way[:, k]) for k in (0, 1))])
