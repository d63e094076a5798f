"""Places and times that may be of use to a robot on its way from a start to a goal among bodies that move.

Whatever lies on a way costs at least what it takes to be there in time, and on to the goal at the best speed.
"""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import jitable, kernel
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.geometry.traffic import disc_of, piece_of, traffic_clearance

SLOWER = 0.5  # excess of cost that half of the other draws stay below, as a share of the unhindered cost
BESIDE = 0.3  # share of the others that lie beside a body ...
NEAR = 4.0  # ... so many robot radii away from the disc around it at most
TRIES = 32  # to draw a state that may be of use
ACROSS = (0.0, -0.9, 0.9, -0.5, 0.5)  # where passages are driven through, as a share of the room to either side
ALONG = (0.0, 3.0, -3.0)  # and how far from their narrowest chord [robot radii]
SPEEDS = (4.0, 3.0, 2.2, 1.8, 1.5, 1.25, 1.0, 0.75, 0.5)  # how fast on the way there, as a share of the best speed
MOST = 2.5  # times the unhindered cost that such a way may cost at least
OFFERED = 256  # states in passages, the cheapest


class Useful(NamedTuple):
    """Which places at which times cost a robot no more than so much, by what is between start and goal at least."""

    start: tuple[float, float]  # [m]
    begin: float  # when it is left [s]
    goal: tuple[float, float]  # [m]
    q: float  # [cost/s]
    r: float  # [cost s/m^2]
    meter: float  # [cost/m] of a way that nothing hinders
    most: float  # [cost]

    @classmethod
    def of(cls, numbers: tuple[float, ...], scene: Scene, origin: Array, multiple: float) -> Useful:
        """Up to a multiple of the cost between an origin (3,) [m, m, s] and the goal without anything in the way.

        `numbers` are q, r, the limit of speeds and the best speed.
        """
        q, r, _, pace = numbers
        meter = q / pace + 0.5 * r * pace
        (sx, sy, begin), (gx, gy) = origin.tolist(), scene.goal.center.tolist()
        return cls((sx, sy), begin, (gx, gy), q, r, meter, multiple * meter * math.hypot(gx - sx, gy - sy))

    def cost(self, x: float, y: float, t: float) -> float:
        """Of a way over a place at a time, at least [cost]."""
        return _cost(self, x, y, t)

    def __call__(self, x: float, y: float, t: float) -> bool:
        """Whether it is little enough."""
        return _is_of_use(self, x, y, t)


@jitable
def _cost(useful: Useful, x: float, y: float, t: float) -> float:
    """What `Useful.cost` says."""
    since = t - useful.begin
    away = (x - useful.start[0]) ** 2 + (y - useful.start[1]) ** 2
    ahead = math.hypot(useful.goal[0] - x, useful.goal[1] - y)
    return useful.q * since + 0.5 * useful.r * away / max(since, 1e-9) + useful.meter * ahead


@jitable
def _is_of_use(useful: Useful, x: float, y: float, t: float) -> bool:
    """Whether a place at a time costs little enough."""
    return t > useful.begin and _cost(useful, x, y, t) <= useful.most


@jitable
def _serves(
    useful: Useful, frame: tuple[float, float, float, float], radius: float, x: float, y: float, t: float
) -> bool:
    """Whether a place at a time is of use, inside a frame and off the goal."""
    low_x, low_y, far_x, far_y = frame
    inside = low_x < x < far_x and low_y < y < far_y
    return inside and _is_of_use(useful, x, y, t) and math.hypot(useful.goal[0] - x, useful.goal[1] - y) > radius


@kernel
def _first_of_use(useful, numbers, frame, radius, chances, out):  # type: ignore[no-untyped-def]
    """Write the first place and time (3,) of use that `chances` (k, 3) lead to; whether there is one.

    They are uniform in a frame (x, y, X, Y) [m] off a goal of a radius [m], and in the time that is left.
    """
    x, y, far_x, far_y = frame
    for i in range(chances.shape[0]):
        px, py = x + (far_x - x) * chances[i, 0], y + (far_y - y) * chances[i, 1]
        soonest = math.hypot(px - useful.start[0], py - useful.start[1]) / numbers[2]
        t = useful.begin + soonest + chances[i, 2] * max(useful.most / useful.q - soonest, 0.0)
        if _serves(useful, frame, radius, px, py, t):
            out[0], out[1], out[2] = px, py, t
            return True
    return False


@kernel
def _first_beside(useful, traffic, frame, radius, chances, which, out):  # type: ignore[no-untyped-def]
    """The same of places and times beside bodies `which` (k,), where these are then."""
    for i in range(chances.shape[0]):
        t = useful.begin + chances[i, 2] * max(useful.most / useful.q, 0.0)
        px, py, _, _, _, _, _ = piece_of(traffic, which[i], t)
        angle = 2.0 * math.pi * chances[i, 0]
        away = disc_of(traffic, which[i]) + chances[i, 1] ** 2 * NEAR * traffic.robot
        px, py = px + away * math.cos(angle), py + away * math.sin(angle)
        if _serves(useful, frame, radius, px, py, t):
            out[0], out[1], out[2] = px, py, t
            return True
    return False


def drawn(numbers: tuple[float, ...], space: FreeSpace, origin: Array, rng: np.random.Generator) -> Array | None:
    """A random place and time (3,) [m, m, s]; some lie beside a body that moves, where ways around it bend.

    It costs no more on the way than some multiple of what nothing in the way would cost; None if none is found.
    """
    scene, J = space.scene, space.traffic.J
    (left, low), (right, high) = scene.lower.tolist(), scene.upper.tolist()
    beside, chance = J > 0 and rng.random() < BESIDE, rng.random()
    useful = Useful.of(numbers, scene, origin, 1.0 + SLOWER * chance / max(1.0 - chance, 1e-3))
    chances = rng.random((TRIES, 3))
    found, frame = np.empty(3), (left, low, right, high)
    if not beside:
        return found if _first_of_use(useful, numbers, frame, scene.goal.radius, chances, found) else None
    which = rng.integers(J, size=TRIES)
    return found if _first_beside(useful, space.traffic, frame, scene.goal.radius, chances, which, found) else None


def offered(numbers: tuple[float, ...], passages: Passages, space: FreeSpace, origin: Array) -> Array:
    """Places across and along passages at many times (l, 3) [m, m, s], where nothing is then: the cheapest."""
    left, right = passages.chords()
    start, radius, useful = origin[:2], space.scene.robot_radius, Useful.of(numbers, space.scene, origin, MOST)
    half = 0.5 * (right - left) * (1.0 - 2.0 * radius / np.maximum(passages.width, 2.0 * radius))[:, None]
    ahead = np.column_stack([np.cos(passages.heading), np.sin(passages.heading)])
    ahead *= np.where(np.sum(ahead * (passages.place - start), axis=1) < 0.0, -1.0, 1.0)[:, None]
    found = []
    for across, along, speed in product(ACROSS, ALONG, SPEEDS):
        middle = passages.place + across * half
        places, late = middle + along * radius * ahead, along * radius / (speed * numbers[3])
        for (x, y), away in zip(places.tolist(), np.hypot(*(middle - start).T).tolist(), strict=True):
            t = useful.begin + away / (speed * numbers[3]) + late
            if useful(x, y, t) and traffic_clearance(space.traffic, x, y, t) > 0.0:
                found.append((useful.cost(x, y, t), x, y, t))
    found.sort()
    return np.array([row[1:] for row in found[:OFFERED]]).reshape(-1, 3)
