"""Random small scenes in which bodies cross the straight way just when the robot would come by; a seed means a scene.

Small enough for the exact grid. Bodies go along ways with corners at changing speeds, turn if they are bars, and stand
still in the end; two or three of them, beside what stands.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from benchmarks.moving_text import REACH, World, mover, prepared

from pirrht.arrays import Array
from sim.scenario import Scenario

SIDES = np.array([6.0, 5.0])  # of the workspace [m]
ROBOT = 0.1  # radius [m]
APART = (3.5, 4.6)  # start and goal [m]
EDGE = 0.5  # start, goal and corners of ways stay so far inside [m]
AROUND = 0.7  # when bodies cross, beside when the robot would come by at its best speed of 1 m/s [s]
SPEEDS, LEGS = (0.3, 1.0), (0.6, 1.6)  # [m/s], [s]
LAST = 6.0  # the last row at the latest [s]
DISCS, BARS, POSTS = (0.2, 0.4), (0.35, 0.7), (0.15, 0.35)  # radii, half lengths, radii [m]
THICK = 0.07  # half of a bar [m]
TURNING = 1.5  # bars turn no faster [rad/s]
CLEAR = 0.25  # beside bodies at start, at the beginning, and at the goal's rim in the end [m]


def oblique_scene(seed: int) -> str:
    """MJCF of the scene."""
    rng = np.random.default_rng([seed, 56])
    start, goal = _task(rng)
    bodies = [_body(j, start, goal, rng) for j in range(int(rng.integers(2, 4)))]
    posts = [_post(j, start, goal, rng) for j in range(int(rng.integers(0, 3)))]
    return World(
        name=f"oblique{seed}", radius=ROBOT, sides=SIDES, start=start, goal=goal, standing=posts, movers=bodies
    ).text()


def oblique_scenario(seed: int, given: Mapping[str, Any]) -> Scenario:
    """The scene ready to be planned in, under settings by name."""
    return prepared(f"oblique{seed}", oblique_scene(seed), given=given)


def _task(rng: np.random.Generator) -> tuple[Array, Array]:
    """Start and goal, (2,) each [m]."""
    while True:
        start, goal = EDGE + rng.random((2, 2)) * (SIDES - 2.0 * EDGE)
        if APART[0] <= np.hypot(*(goal - start)) <= APART[1]:
            return start, goal


def _body(j: int, start: Array, goal: Array, rng: np.random.Generator) -> tuple[str, str]:
    """A body and its motion, in MJCF."""
    bar, name = rng.random() < 0.4, f"b{j}"
    size = rng.uniform(*(BARS if bar else DISCS))
    while True:
        rows = _rows(start, goal, bar, rng)
        inside = np.all((rows[:, 1:3] > 0.0) & (rows[:, 1:3] < SIDES))
        away = np.hypot(*(rows[0, 1:3] - start)) > size + ROBOT + CLEAR
        open_end = np.hypot(*(rows[-1, 1:3] - goal)) > size + ROBOT + REACH + CLEAR
        if inside and away and open_end:
            break
    shape = f'type="box" size="{size:.4f} {THICK} 0.3"' if bar else f'type="cylinder" size="{size:.4f} 0.3"'
    return mover(name, shape, rows)


def _rows(start: Array, goal: Array, turns: bool, rng: np.random.Generator) -> Array:
    """Rows (k, 4) of a way that crosses the straight one, with corners before and after."""
    way, share = goal - start, rng.uniform(0.3, 0.75)
    at = share * float(np.hypot(*way)) + rng.uniform(-AROUND, AROUND)
    times, places = [at], [start + share * way]
    heading = np.arctan2(way[1], way[0]) + rng.choice([-1.0, 1.0]) * rng.uniform(0.5, np.pi - 0.5)
    back, ahead = heading + np.pi, heading
    while times[0] > 0.0:
        leg = min(rng.uniform(*LEGS), times[0])
        leg = times[0] if times[0] - leg < 0.2 else leg
        places.insert(0, places[0] + leg * rng.uniform(*SPEEDS) * np.array([np.cos(back), np.sin(back)]))
        times.insert(0, times[0] - leg)
        back += rng.uniform(-1.0, 1.0)
    for _ in range(int(rng.integers(1, 4))):
        leg = rng.uniform(*LEGS)
        if times[-1] + leg > LAST:
            break
        places.append(places[-1] + leg * rng.uniform(*SPEEDS) * np.array([np.cos(ahead), np.sin(ahead)]))
        times.append(times[-1] + leg)
        ahead += rng.uniform(-1.0, 1.0)
    rates = rng.uniform(-TURNING, TURNING, len(times) - 1) if turns else np.zeros(len(times) - 1)
    yaw = (rng.uniform(-np.pi, np.pi) if turns else 0.0) + np.concatenate([[0.0], np.cumsum(rates * np.diff(times))])
    return np.column_stack([np.array(times) - times[0], places, yaw])


def _post(j: int, start: Array, goal: Array, rng: np.random.Generator) -> str:
    """What stands, in MJCF."""
    while True:
        size, place = rng.uniform(*POSTS), rng.random(2) * SIDES
        if np.hypot(*(place - start)) > size + ROBOT + CLEAR and np.hypot(*(place - goal)) > size + ROBOT + REACH:
            at = f"{place[0]:.6f} {place[1]:.6f} 0.3"
            return f'    <geom name="post{j}" type="cylinder" size="{size:.4f} 0.3" pos="{at}"/>'
