"""Shorten a path inside its homology class by the method that suits its steering."""

from __future__ import annotations

from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.shortening import chain, in_time
from pirrht.shortening.polyline import taut_polyline
from pirrht.steering.arcs import ARCS
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.in_time import InTime
from pirrht.steering.steering import Steering


def shorten(path: Any, steering: Steering, checker: EdgeChecker) -> Any:
    """Shorten a path (consecutive motions into the goal) inside its class; it never costs more.

    Every new piece is certified by the clearance field, which is FCL's distance less its error bound.
    """
    if isinstance(steering, InTime):
        return in_time.taut_in_time(path, steering, checker)
    if _straight(steering) and not np.any(path.curvature):
        length, (x, y, theta) = path.length[-1].sum(), path.start[-1]
        end = np.array([x + length * np.cos(theta), y + length * np.sin(theta)])
        short = taut_polyline(np.vstack([path.start[:, :2], end]), checker.around)
        return steering.connect(short[:-1], short[1:])
    return chain.cheapest_chain(path, steering, checker)


def resumes(steering: Steering) -> bool:
    """Tell whether paths of a method are shortened much faster from an earlier path of the class."""
    return isinstance(steering, InTime) or not steering.drives or not (steering.compiled or _straight(steering))


def resume(x: Array, path: Any, steering: Steering, checker: EdgeChecker) -> Any:
    """Find the cheapest path from x (n,) near an earlier one into the goal, in any class; None if there is none."""
    if isinstance(steering, InTime):
        return in_time.resumed(x, path, steering, checker)
    return chain.resumed(x, path, steering, checker)


def _straight(steering: Steering) -> bool:
    """Tell whether motions are those of a point, whose paths are polylines."""
    return steering.motion is ARCS and steering.n == 2
