"""Random scenes in which discs and boxes move about; a seed means a scene."""

from typing import Any

import numpy as np
from benchmarks.moving_text import World, mover, prepared

from pirrht.arrays import Array
from sim.scenario import Scenario

SIDES = np.array([10.0, 8.0])  # of the workspace [m]
START, GOAL = np.array([0.8, 4.0]), np.array([9.2, 4.0])  # [m]
ROOM = 1.0  # that bodies leave the start at first, beside their own size [m]
SIZES, SPEEDS, LEGS = (0.2, 0.4), (0.3, 1.0), (1.5, 4.0)  # radii [m], [m/s], lengths of legs [m]
TURNING = 1.0  # boxes turn no faster [rad/s]
ROBOT = 0.2  # radius [m]
STANDING = (
    '    <geom name="pillar" type="cylinder" size="0.4 0.3" pos="5 6 0.3"/>',
    '    <geom name="crate" type="box" size="0.5 0.3 0.3" pos="5 2 0.3"/>',
)
REPEATING = 0.5  # share of the bodies that go to and fro for ever


def moving_scene(seed: int, bodies: int) -> str:
    """MJCF of a scene of 10 x 8 m with so many bodies, every second one a disc, the others boxes."""
    rng = np.random.default_rng([seed, 54])
    parts = [_body(j, rng) for j in range(bodies)]
    return World(
        name=f"moving{seed}", radius=ROBOT, sides=SIDES, start=START, goal=GOAL, standing=STANDING, movers=parts
    ).text()


def moving_scenario(seed: int, bodies: int, given: dict[str, Any], robot: str | None = None) -> Scenario:
    """The scene ready to be planned in, under settings by name."""
    return prepared(f"moving{seed}", moving_scene(seed, bodies), given=given, robot=robot)


def _body(j: int, rng: np.random.Generator) -> tuple[str, str]:
    """A body and its motion, in MJCF."""
    size, name = rng.uniform(*SIZES), f"b{j}"
    if j % 2 == 0:
        shape = f'type="cylinder" size="{size:.4f} 0.3"'
    else:
        shape = f'type="box" size="{0.7 * size:.4f} {0.7 * size * rng.uniform(0.5, 1.0):.4f} 0.3"'
    rows = _rows(rng, size, turning=j % 2 == 1)
    again = rng.random() < REPEATING
    if again:
        back = rows[-2::-1].copy()
        back[:, 0] = 2.0 * rows[-1, 0] - back[:, 0]
        rows = np.vstack([rows, back])
    return mover(name, shape, rows, again)


def _rows(rng: np.random.Generator, size: float, *, turning: bool) -> Array:
    """A motion over three to six legs from a place away from the start, (k, 4)."""
    while True:
        place = rng.uniform(0.0, 1.0, 2) * SIDES
        if np.hypot(*(place - START)) > ROOM + size + ROBOT:
            break
    yaw = rng.uniform(-np.pi, np.pi) if turning else 0.0
    rows = [np.array([0.0, *place, yaw])]
    for _ in range(int(rng.integers(3, 7))):
        to = rng.uniform(0.0, 1.0, 2) * SIDES
        way = to - rows[-1][1:3]
        length = min(float(np.hypot(*way)), rng.uniform(*LEGS))
        duration = length / rng.uniform(*SPEEDS)
        turn = rng.uniform(-1.0, 1.0) * TURNING * duration if turning else 0.0
        step = np.array([duration, *(way * length / max(float(np.hypot(*way)), 1e-9)), turn])
        rows.append(rows[-1] + step)
    return np.array(rows)
