"""Draw places and times that may be of use to a robot between a start and a goal among moving obstacles.

A path over a place at a time costs at least what it takes to be there in time, and on to the goal at the best speed.
"""

from __future__ import annotations

import math
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.geometry.world import NOTHING_MOVES, MovingKernels
from pirrht.jit.jit import inlined, jitable, kernel
from pirrht.steering.tuning import TUNING


class Useful(NamedTuple):
    """Places and times that cost a robot no more than a limit, by a lower bound between start and goal."""

    start: tuple[float, float]  # [m]
    begin: float  # when it is left [s]
    goal: tuple[float, float]  # [m]
    q: float  # [cost/s]
    r: float  # [cost s/m^2]
    meter: float  # [cost/m] of a way that nothing hinders
    most: float  # [cost]

    @classmethod
    def of(cls, numbers: tuple[float, ...], scene: Scene, origin: Array, multiple: float) -> Useful:
        """Bound by a multiple of the unhindered cost between an origin (3,) [m, m, s] and the goal.

        `numbers` are q, r, the limit of speeds and the best speed.
        """
        q, r, _, pace = numbers
        meter = q / pace + 0.5 * r * pace
        (sx, sy, begin), (gx, gy) = origin.tolist(), scene.goal.center.tolist()
        return cls((sx, sy), begin, (gx, gy), q, r, meter, multiple * meter * math.hypot(gx - sx, gy - sy))


@jitable
def _cost(useful: Useful, x: float, y: float, t: float) -> float:
    """Compute `Useful.cost`."""
    since = t - useful.begin
    away = (x - useful.start[0]) ** 2 + (y - useful.start[1]) ** 2
    ahead = math.hypot(useful.goal[0] - x, useful.goal[1] - y)
    return useful.q * since + 0.5 * useful.r * away / max(since, 1e-9) + useful.meter * ahead


@jitable
def _is_of_use(useful: Useful, x: float, y: float, t: float) -> bool:
    """Tell whether a place at a time costs little enough."""
    return t > useful.begin and _cost(useful, x, y, t) <= useful.most


@inlined
def _serves(useful, box, goal, x, y, t):  # type: ignore[no-untyped-def]
    """Tell whether a place at a time is of use, inside the workspace and off the goal."""
    inside = box[0] < x < box[2] and box[1] < y < box[3]
    return inside and _is_of_use(useful, x, y, t) and math.hypot(goal[0] - x, goal[1] - y) > goal[2]


@cache
def _draws(moving: MovingKernels | None) -> Any:
    """Build the kernel that writes a place and a time (k, 3) for every row of numbers between 0 and 1 (k, 9 + 4 l).

    Args of it: `useful`, unhindered; moving obstacles; `box`, frame (x, y, X, Y) [m] of the workspace, horizon of draws
        [s], and limit of speeds [m/s]; `goal`, its centre, its radius [m], and the share of draws moved into its disc.
    """
    among, disc = moving is not None, (moving or NOTHING_MOVES).disc

    @inlined
    def found(useful, traffic, box, goal, tries, near, out):  # type: ignore[no-untyped-def]
        """Write the first place and time (3,) of use that numbers (4 l,) lead to; whether there is one.

        They are uniform in the workspace off the goal, and in the time that is left, or `near` moving obstacles then.
        """
        x, y, far_x, far_y, horizon, speed = box
        latest = min(max(useful.most / useful.q, 0.0), horizon)
        for i in range(0, tries.shape[0], 4):
            px, py = x + (far_x - x) * tries[i], y + (far_y - y) * tries[i + 1]
            soonest = math.hypot(px - useful.start[0], py - useful.start[1]) / speed
            t = useful.begin + soonest + tries[i + 2] * max(latest - soonest, 0.0)
            if among and near:
                t, j = useful.begin + tries[i + 2] * latest, int(tries[i + 3] * traffic.J)
                px, py, away = disc(traffic, j, t)
                angle, away = 2.0 * math.pi * tries[i], away + tries[i + 1] ** 2 * TUNING.near * traffic.robot
                px, py = px + away * math.cos(angle), py + away * math.sin(angle)
            if _serves(useful, box, goal, px, py, t):
                out[0], out[1], out[2] = px, py, t
                return True
        return False

    @kernel
    def write_draws(unhindered, traffic, box, goal, chances, out):  # type: ignore[no-untyped-def]
        u, (x, y, far_x, far_y, horizon, _) = unhindered, box
        for i in range(out.shape[0]):
            row, drawn = chances[i], out[i]
            most = (1.0 + TUNING.excess * row[2] / max(1.0 - row[2], 1e-3)) * u.most
            useful = Useful(u.start, u.begin, u.goal, u.q, u.r, u.meter, most)
            near = row[1] < TUNING.near_share
            if row[0] < TUNING.uniform_share or not found(useful, traffic, box, goal, row[9:], near, drawn):
                drawn[0], drawn[1] = x + (far_x - x) * row[3], y + (far_y - y) * row[4]
                drawn[2] = u.begin + horizon * row[5]
            if row[6] < goal[3]:
                angle, away = 2.0 * math.pi * row[7], goal[2] * math.sqrt(row[8])
                drawn[0], drawn[1] = goal[0] + away * math.cos(angle), goal[1] + away * math.sin(angle)

    return write_draws


def drawn(
    numbers: tuple[float, ...],
    space: FreeSpace,
    origin: Array,
    horizon: float,
    rng: np.random.Generator,
    count: int,
    goal_share: float,
) -> Array:
    """Draw places and times (count, 3) [m, m, s]; some lie near a moving obstacle, where paths around it bend.

    Most cost no more on the path than some multiple of the unhindered cost, the others are uniform in the workspace and
    the horizon [s]; a share of all is moved into the goal's disc.
    """
    scene, out = space.scene, np.empty((count, 3))
    (x, y), radius = scene.goal.center.tolist(), scene.goal.radius
    box = (*scene.lower.tolist(), *scene.upper.tolist(), horizon, numbers[2])
    useful = Useful.of(numbers, scene, origin, 1.0)
    chances = rng.random((count, 9 + 4 * TUNING.tries))
    _draws(space.moving.kernels)(useful, space.moving, box, (x, y, radius, goal_share), chances, out)
    return out


def offered(numbers: tuple[float, ...], passages: Passages, space: FreeSpace, origin: Array) -> Array:
    """Places across and along passages at many times (l, 3) [m, m, s], free then: the cheapest."""
    left, right = passages.chords()
    start, radius = origin[:2], space.scene.robot_radius
    useful = Useful.of(numbers, space.scene, origin, TUNING.passage_cost)
    half = 0.5 * (right - left) * (1.0 - 2.0 * radius / np.maximum(passages.width, 2.0 * radius))[:, None]
    ahead = np.column_stack([np.cos(passages.heading), np.sin(passages.heading)])
    ahead *= np.where(np.sum(ahead * (passages.place - start), axis=1) < 0.0, -1.0, 1.0)[:, None]
    found = []
    for across, along, speed in product(TUNING.passage_offsets, TUNING.passage_places, TUNING.passage_paces):
        middle = passages.place + across * half
        places, late = middle + along * radius * ahead, along * radius / (speed * numbers[3])
        for (x, y), away in zip(places.tolist(), np.hypot(*(middle - start).T).tolist(), strict=True):
            t = useful.begin + away / (speed * numbers[3]) + late
            if _is_of_use(useful, x, y, t) and space.moving.clearance(x, y, t) > 0.0:
                found.append((_cost(useful, x, y, t), x, y, t))
    found.sort()
    return np.array([row[1:] for row in found[: TUNING.passage_states]]).reshape(-1, 3)
