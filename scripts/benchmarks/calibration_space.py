"""A ball at random states of random scenes in space: boxes, pillars, and walls with a window.

Plans are compared with the exact solution as those of `calibration_rectangle`. The grid's error is the difference
between the default spacing and one of 1.4 times that, which is at least the former's own if it is of first order.
"""

import argparse
from itertools import product

import numpy as np
from benchmarks.calibration_rectangle import records, table

from pirrht import Goal, Kind, Obstacle, Problem, Sampling, Scene
from pirrht.arrays import Array
from pirrht.steering.pieces import SpaceLine
from pirrht.systems.ball import Ball

SIZE = np.array([5.2, 3.6, 2.8])  # of a room [m]; with more, psi at b = 0.2 needs more points than a grid can have
RADIUS, WALL = 0.2, 0.2  # of the ball, and thickness of a wall [m]
NOISES = (0.2, 0.35, 0.5)
SCENES, STATES, PLANS = 10, 4, 10
GIVEN = {"limit": 1.0, "spacings": (1.4, 1.0), "sampling": Sampling(samples=300, least=60.0)}  # as commands do


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    states = []
    for seed, noise in product(range(options.scenes or SCENES), options.noises or NOISES):
        problem = Problem(dynamics=Ball(b=noise), scene=scene(options.first_seed + seed), R=2.0 * np.eye(3))
        counts = options.first_seed + seed, options.states or STATES, options.plans or PLANS
        of = {"scene": problem.scene.name, "noise": noise}
        states += [of | one for one in records(problem, SpaceLine.of(problem), *counts, **GIVEN)]
    return table(states)


def scene(seed: int) -> Scene:
    """A wall with a window in two of three scenes, and some boxes and pillars."""
    rng = np.random.default_rng([seed, 631])
    boxes = []
    if seed % 3:
        x = rng.uniform(2.2, 2.8)
        top = rng.choice([2.1, SIZE[2]])
        width, height = rng.uniform(0.65, 1.0, 2)
        y = rng.uniform(0.5, SIZE[1] - 0.5 - width)
        z = rng.uniform(0.4, top - 0.4 - height)
        walls = [(0.0, 0.0, SIZE[1], z), (0.0, z + height, SIZE[1], top), (0.0, z, y, z + height)]
        walls.append((y + width, z, SIZE[1], z + height))
        boxes += [((x, a, low), (x + WALL, b, high)) for a, low, b, high in walls]
    for _ in range(rng.integers(2, 5)):
        side = rng.uniform(0.2, 0.5)
        corner = np.array([rng.choice([1.3, 3.4]), rng.uniform(0.3, 2.8), 0.0])
        boxes.append((corner, (*(corner[:2] + side), SIZE[2])))  # a pillar
    for _ in range(rng.integers(1, 4)):
        size = rng.uniform(0.3, 0.8, 3)
        corner = np.array([rng.choice([1.2, 3.2]), *rng.uniform(0.0, (SIZE - size)[1:])])
        boxes.append((corner, corner + size))
    inner = {"lower": np.full(3, RADIUS), "upper": SIZE - RADIUS, "robot_radius": RADIUS}
    goal = Goal(center=np.array([4.6, *rng.uniform(0.8, (2.8, 2.0))]), radius=0.3)
    start = np.array([0.6, *rng.uniform(0.6, (3.0, 2.2))])
    solids = tuple(_box(f"box {k}", np.array(low), np.array(high)) for k, (low, high) in enumerate(boxes))
    return Scene(name=f"space{seed}", obstacles=solids, goal=goal, start=start, **inner)


def _box(name: str, low: Array, high: Array) -> Obstacle:
    where = {"position": (low + high) / 2.0, "size": (high - low) / 2.0, "rotation": np.eye(3)}
    return Obstacle(name=name, kind=Kind.BOX, **where)
