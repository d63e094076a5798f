"""Clearance cost of steps: those that are skipped cost nothing."""

import numpy as np
import pytest
from discs import scattered
from tilted import cluttered

from pirrht import FreeSpace, Problem, Sampling, path_integral
from pirrht.geometry.disc import DISC
from pirrht.jit.jit import kernel
from pirrht.proposals.walls import barrier, clearance_costs
from pirrht.systems.rover import Rover

POINTS = 4
scratch, cost, expand = clearance_costs(DISC, 2, None)
near = DISC.near


@kernel
def both(setup, task, steps, out):
    """Write to out (k, 2) the cost of steps (k, 8), and that without skipping any."""
    space = scratch(setup)
    walls = space[0]
    for s in range(len(steps)):
        x, y, dx, dy, bx, by, begin, dt = steps[s]
        total = 0.0
        out[s, 0] = cost(setup, task, ((x, y), (dx, dy), (bx, by), begin, dt), POINTS, space)
        for k in range(1, POINTS + 1):
            t = k / POINTS
            w = 0.5 * t * (1.0 - t) * dt
            count = near(setup.world.static, (x + t * dx + w * bx, y + t * dy + w * by), task.margin, walls)
            for i in range(count):
                total += barrier(walls[i, 0], task)[0]
        out[s, 1] = task.price * total * dt / POINTS


@kernel
def found(setup, task, steps, out):
    """Write to out (k,) whether any wall has a price on steps (k, 8), by their derivatives."""
    space, g, H = scratch(setup), np.zeros(6), np.zeros((6, 6))
    for s in range(len(steps)):
        x, y, dx, dy, bx, by, begin, dt = steps[s]
        out[s] = expand(setup, task, ((x, y), (dx, dy), (bx, by), begin, dt), POINTS, space, g, H)


@pytest.mark.parametrize("space", [FreeSpace.of(scattered(1)), cluttered(None, 2)], ids=["discs", "tilted"])
def test_no_step_is_skipped_that_costs_anything(space):
    """50 000 random steps of seed 0, inside and outside of obstacles and of the workspace."""
    problem = Problem(dynamics=Rover(b=0.03), scene=space.scene, R=np.diag([2.0, 0.5]))
    integral, rng, k = path_integral(problem, space, Sampling()), np.random.default_rng(0), 50_000
    low, high = space.scene.lower - 0.2, space.scene.upper + 0.2
    moves, bows = rng.uniform(-0.4, 0.4, (k, 2)), rng.uniform(-2.0, 2.0, (k, 2))
    steps = np.column_stack([rng.uniform(low, high, (k, 2)), moves, bows, np.full((k, 2), 0.1)])
    costs, any_wall = np.empty((k, 2)), np.empty(k, np.bool_)
    both(integral.setup, integral.guidance.tasks[1.0], steps, costs)
    found(integral.setup, integral.guidance.tasks[1.0], steps, any_wall)
    np.testing.assert_array_equal(costs[:, 0], costs[:, 1])
    np.testing.assert_array_equal(any_wall, costs[:, 1] > 0.0)
    assert 0.1 < np.mean(any_wall) < 0.9
