"""psi among moving bodies by plain simulation: fine Euler steps, judged at their ends, under any law, weighed exactly.

The law is that of a grid, held for a while; the likelihood ratio makes up for it, so that an estimate is right however
wrong the grid may be. Where a path is looked at at the ends of steps only, walls and goal seem further away by
0.5826 b sqrt(dt) (Broadie, Glasserman and Kou, Mathematical Finance 1997), and are moved closer by as much.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.exact.boundaries import clearance_at, poses_at
from pirrht.exact.desirability import Desirability
from pirrht.exact.moving_point import evaluate
from pirrht.jit.jit import kernel
from pirrht.jit.streams import normals, stream

EARLY = 0.5826
STEP = 2e-4  # [s]
HELD = 10  # steps for which a control is held
LATE = 60.0  # a path that lasts longer counts for nothing [s]


def sampled_log_psi(grid: Desirability, x: Array, t: float, samples: int, seed: int = 0) -> tuple[float, float]:
    """log psi at x (2,) [m] and t [s] by samples, and its standard error [nats]."""
    out = np.empty(samples)
    _walk(grid.grid, grid.problem.temperature, x, t, seed, out)
    most = out.max()
    weight = np.exp(out - most)
    mean = weight.mean()
    return float(most + np.log(mean)), float(weight.std() / math.sqrt(samples) / mean)


@kernel
def _walk(grid, temperature, x0, t0, seed, out):  # type: ignore[no-untyped-def]
    """Fill `out` (S,) with log weights of paths of a point whose R is lambda / b^2 [nats]."""
    frame, b, wall = grid.surroundings.frame, grid.step.b, grid.step.wall
    early = EARLY * b * math.sqrt(STEP)
    slope, state = np.zeros(2), np.zeros(3)
    for s in range(len(out)):
        draws = stream(seed, s)
        state[0], state[1], state[2] = x0[0], x0[1], t0
        out[s] = -math.inf
        weight, held = 0.0, 0
        while state[2] < LATE:
            if held == 0:
                evaluate(grid, state, slope)
                held = HELD
            held -= 1
            draws, w, z = normals(draws)
            ux, uy = b * b * slope[0], b * b * slope[1]
            root = b * math.sqrt(STEP)
            state[0] += ux * STEP + root * w
            state[1] += uy * STEP + root * z
            state[2] += STEP
            weight -= grid.step.rate * STEP + (slope[0] * w + slope[1] * z) * root
            weight -= 0.5 * (ux * slope[0] + uy * slope[1]) * STEP
            if math.sqrt((state[0] - frame.goal_x) ** 2 + (state[1] - frame.goal_y) ** 2) <= frame.radius + early:
                out[s] = weight
                break
            pose = poses_at(grid.surroundings.solids, state[2])
            if clearance_at(grid.surroundings, pose, state[0], state[1]) <= early:
                out[s] = weight - wall
                break
