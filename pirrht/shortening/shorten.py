"""Shorten a path inside its homology class by the method that suits its steering."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import Curves, along
from pirrht.shortening import chain, in_time
from pirrht.shortening.dubins_legs import SHORT, Pieces
from pirrht.shortening.dubins_shortcut import in_rows, shortcut
from pirrht.shortening.polyline import taut_polyline
from pirrht.steering.along_arcs import ARCS
from pirrht.steering.along_legs import Legs
from pirrht.steering.dubins import Dubins
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.in_time import InTime
from pirrht.steering.rover import RoverSteering
from pirrht.steering.steering import Steering
from pirrht.steering.straight_line import StraightLine
from pirrht.steering.tracked import Tracked

AHEAD = 4  # corners of an earlier path that it may go on from


def polish(path: Any, steering: Steering, space: FreeSpace) -> Any:
    """Shorten a path (k consecutive curves, (k, P) pieces, into the goal) inside its class; never longer [m].

    Every new piece is certified by the clearance field, which is FCL's distance less its error bound.
    """
    return shorten(steering, path, space)


@singledispatch
def shorten(steering: Steering, path: Any, space: FreeSpace) -> Any:
    """Shorten paths of one steering method; `shorten.register` adds a method.

    Straight lines of a system of two states are shortened like a point's, others by the method's own connections.
    """
    if steering.motion is ARCS and steering.n == 2 and not np.any(path.curvature):
        return _straight(steering, path, space)
    return chain.cheapest_chain(path, steering, space)


def resumes(steering: Steering) -> bool:
    """Tell whether paths of a method are shortened much faster from an earlier path of the class."""
    return isinstance(steering, InTime | RoverSteering | Tracked) or searches(steering)


def resume(x: Array, path: Any, steering: Steering, checker: EdgeChecker) -> Any:
    """Find the cheapest path from x (n,) near an earlier one into the goal, in any class; None if there is none."""
    if isinstance(steering, InTime):
        return in_time.resumed(x, path, steering, checker)
    if isinstance(steering, RoverSteering):
        return resumed_along_arcs(x, path, steering, checker)
    if isinstance(steering, Tracked):
        return _over_corners(x, path, steering, checker)
    return chain.resumed(x, path, steering, checker.space)


def searches(steering: Steering) -> bool:
    """Tell whether paths of a method are shortened by searching."""
    return shorten.dispatch(type(steering)) is shorten.dispatch(object) and not (
        steering.motion is ARCS and steering.n == 2
    )


@shorten.register(StraightLine)
def _straight(steering: Steering, path: Curves, space: FreeSpace) -> Curves:
    points = np.vstack([path.start[:, :2], _end(path)])
    short = taut_polyline(points, space)
    found: Curves = steering.connect(short[:-1], short[1:])  # type: ignore[assignment]
    return found


def _over_corners(x: Array, path: Curves, steering: Tracked, checker: EdgeChecker) -> Curves | None:
    """Go straight from x (2,), near a path's start, to the furthest next corner that is free to go to, and on."""
    count = min(AHEAD, len(path.cost))
    legs = steering.connect(np.repeat(x[None], count, axis=0), path.heads[:count])
    free = checker.inspect(legs, np.arange(count) == len(path.cost) - 1).free
    if not free.any():
        return None
    k = int(np.flatnonzero(free)[-1])
    corners = np.vstack([x, path.heads[k:]])
    found: Curves = steering.connect(corners[:-1], corners[1:])  # type: ignore[assignment]
    return found


@shorten.register
def _(steering: Dubins, path: Curves, space: FreeSpace) -> Curves:
    return shortcut(path, steering, space)


@shorten.register
def _(steering: RoverSteering, path: Curves, space: FreeSpace) -> Curves:
    """The cheapest of those that are shortened like a car's, by the rover's radii; its guides do the rest."""
    found = [steering.priced(shortcut(path, Dubins(V=1.0, rho=radius), space)) for radius in steering.radii]
    return min([path, *found], key=lambda one: float(one.cost.sum()))


@shorten.register
def _(steering: InTime, path: Legs, space: FreeSpace) -> Legs:
    return in_time.taut_in_time(path, steering, space)


def _end(path: Curves) -> Array:
    x, y, theta = path.start[-1]
    s = float(path.length[-1].sum())
    return np.array([x + s * np.cos(theta), y + s * np.sin(theta)])


STATIONS = 10  # places of a path that words lead to
REACH = 2.0  # how far along it they are spread [m]
ROWS = ("start", "curvature", "length", "tails", "heads")  # of curves


def resumed_along_arcs(x: Array, path: Curves, steering: RoverSteering, checker: EdgeChecker) -> Curves | None:
    """Find the cheapest path from x (3,) that joins an earlier one into the goal, in any class; None if none is free.

    A word leads back to it; the kept rest of the path is not judged.
    """
    keep = path.length.ravel() > SHORT
    curvature, length = path.curvature.ravel()[keep], path.length.ravel()[keep]
    ends = np.cumsum(length)
    if not len(ends) or ends[-1] <= REACH:
        return None
    poses = [path.start[0]]
    for kappa, s in zip(curvature[:-1], length[:-1], strict=True):
        poses.append(np.array(along(*poses[-1], kappa, s)))
    starts, alone = np.array(poses), {"curvature": curvature[:, None], "length": length[:, None]}
    price = steering.priced(Curves(start=starts, cost=length, tails=starts, heads=starts, **alone)).cost
    places = REACH * np.arange(1, STATIONS + 1) / STATIONS
    piece = np.searchsorted(ends, places, side="right")
    into = places - (ends[piece] - length[piece])
    heads = np.array([along(*starts[i], curvature[i], s) for i, s in zip(piece, into, strict=True)])
    words = steering.connect(np.repeat(x[None], STATIONS, axis=0), heads)
    rest = price.sum() - np.cumsum(price)[piece] + price[piece] * (1.0 - into / length[piece])
    free = checker.inspect(words, np.zeros(STATIONS, dtype=bool)).free
    if not free.any():
        return None
    k = int(np.argmin(np.where(free, words.cost + rest, np.inf)))
    i = int(piece[k])
    left = np.r_[length[i] - into[k], length[i + 1 :]]
    kept = in_rows(Pieces(np.vstack([heads[k], starts[i + 1 :]]), curvature[i:], left), 1.0)
    pairs = {name: np.vstack([getattr(words, name)[k], getattr(kept, name)]) for name in ROWS}
    return steering.priced(Curves(cost=np.r_[words.cost[k], kept.cost], **pairs))
