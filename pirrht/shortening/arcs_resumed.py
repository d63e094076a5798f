"""What is left of a path of arcs, from a state near it: a word leads back to it, to where that is cheapest."""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import Curves, along
from pirrht.shortening.dubins_legs import SHORT, Pieces
from pirrht.shortening.dubins_shortcut import in_rows
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.rover import RoverSteering

STATIONS = 10  # places of a path that words lead to
REACH = 2.0  # how far along it they are spread [m]
ROWS = ("start", "curvature", "length", "tails", "heads")  # of curves


def resumed(x: Array, path: Curves, steering: RoverSteering, checker: EdgeChecker) -> Curves | None:
    """The cheapest path from x (3,) that joins an earlier one into the goal, whatever its class; None if none is free.

    Free is the word that joins; what is kept of the path is not judged.
    """
    keep = path.length.ravel() > SHORT
    curvature, length = path.curvature.ravel()[keep], path.length.ravel()[keep]
    ends = np.cumsum(length)
    if not len(ends) or ends[-1] <= REACH:
        return None
    starts = _poses(path.start[0], curvature, length)
    price = steering.priced(_one_each(starts, curvature, length)).cost
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
    return steering.priced(_after(words, k, kept))


def _poses(start: Array, curvature: Array, length: Array) -> Array:
    """Where consecutive pieces (k,) begin, (k, 3)."""
    poses = [start]
    for kappa, s in zip(curvature[:-1], length[:-1], strict=True):
        poses.append(np.array(along(*poses[-1], kappa, s)))
    return np.array(poses)


def _one_each(starts: Array, curvature: Array, length: Array) -> Curves:
    """Pieces (k,) as curves of one piece."""
    return Curves(
        start=starts, curvature=curvature[:, None], length=length[:, None], cost=length, tails=starts, heads=starts
    )


def _after(words: Curves, k: int, kept: Curves) -> Curves:
    """The k-th word and what it leads to, as one path."""
    pairs = {name: np.vstack([getattr(words, name)[k], getattr(kept, name)]) for name in ROWS}
    return Curves(cost=np.r_[words.cost[k], kept.cost], **pairs)
