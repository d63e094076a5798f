"""Paths of the optimally controlled process, drawn with a grid's law, and the ways around the obstacles they take.

In continuous time they are Euler-Maruyama steps, so short near a wall that the law, which grows as 1/distance, turns
them around. In discrete time the optimal transition is the passive one times psi at its end; it is drawn from many
normal ends around the one that the law points to, by their weights (Rubin's sampling and resampling).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from pirrht.compiled.jit import as_jitable, inlined, kernel
from pirrht.compiled.streams import normals, stream, uniform
from pirrht.geometry.field import clearance
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE

CANDIDATES = 64  # ends that one discrete step is chosen from
LONGEST = 100_000  # steps of a path
CAREFUL = 0.15  # deviation of a step as a share of the clearance, in continuous time ...
SHORTEST = 1e-7  # ... but no step is shorter [s]


@cache
def walker(look: Any, drift: Callable[..., None], discrete: bool) -> Any:
    """The compiled loop over paths for one kind of grid and dynamics.

    Its arguments: grid, clearance field, markers (M, 2), parameters of the drift, gain, G, B (m, m each), phi/lambda,
    the start (n,), step [s], seed; it fills the turns (S, M) around the markers and outcomes (S,).
    """
    move = as_jitable(drift)

    @kernel
    def continuous(grid, field, p, gain, G, B, wall, step, x, slope, f, state):  # type: ignore[no-untyped-def]
        n, m = x.shape[0], G.shape[0]
        look(grid, x, slope)
        if n == m:
            room = CAREFUL * clearance(field, x[0], x[1]) / B[0, 0]
            step = max(min(step, room * room), SHORTEST)
        move(x, p, f)
        rate = G @ (gain @ slope[n - m :])
        for i in range(n):
            x[i] += f[i] * step
        for j in range(m):
            state, z, _ = normals(state)
            for i in range(m):
                x[n - m + i] += B[i, j] * z * math.sqrt(step)
        for i in range(m):
            x[n - m + i] += rate[i] * step
        return state, _end(grid, field, x)

    @kernel
    def stepwise(grid, field, p, gain, G, B, wall, step, x, slope, f, state):  # type: ignore[no-untyped-def]
        look(grid, x, slope)
        ahead = G @ (gain @ slope) * step
        deviation = B[0, 0] * math.sqrt(step)
        ends, total = np.empty((CANDIDATES, 3)), 0.0
        top = -math.inf
        y = np.empty(2)
        for k in range(CANDIDATES):
            square = 0.0
            for i in range(2):
                state, z, _ = normals(state)
                ends[k, i] = x[i] + ahead[i] + deviation * z
                square += z * z - ((ahead[i] + deviation * z) / deviation) ** 2
                y[i] = ends[k, i]
            outcome = _end(grid, field, y)
            log_psi = look(grid, y, slope) if outcome == INSIDE else (0.0 if outcome == GOAL else -wall)
            ends[k, 2] = log_psi + 0.5 * square
            top = max(top, ends[k, 2])
        for k in range(CANDIDATES):
            total += math.exp(ends[k, 2] - top)
        state, u = uniform(state)
        u *= total
        k = -1
        while u >= 0.0 and k < CANDIDATES - 1:
            k += 1
            u -= math.exp(ends[k, 2] - top)
        x[0], x[1] = ends[k, 0], ends[k, 1]
        return state, _end(grid, field, x)

    advance = stepwise if discrete else continuous

    @kernel
    def walk(grid, field, markers, p, gain, G, B, wall, x0, step, seed, turns, outcome):  # type: ignore[no-untyped-def]
        slope, f, x = np.zeros(x0.shape[0]), np.zeros(x0.shape[0]), np.zeros(x0.shape[0])
        for s in range(outcome.shape[0]):
            state = stream(seed, s)
            x[:] = x0
            outcome[s] = INSIDE
            for _ in range(LONGEST):
                before_x, before_y = x[0], x[1]
                state, outcome[s] = advance(grid, field, p, gain, G, B, wall, step, x, slope, f, state)
                for k in range(markers.shape[0]):
                    ax, ay = before_x - markers[k, 0], before_y - markers[k, 1]
                    bx, by = x[0] - markers[k, 0], x[1] - markers[k, 1]
                    turns[s, k] += math.atan2(ax * by - ay * bx, ax * bx + ay * by) / (2.0 * math.pi)
                if outcome[s] != INSIDE:
                    turns[s, :] += _to_center(grid, markers, x)
                    break

    return walk


@inlined
def _end(grid, field, x):  # type: ignore[no-untyped-def]
    """Where a step has led to: a collision comes first."""
    if clearance(field, x[0], x[1]) <= 0.0:
        return COLLISION
    inside = (x[0] - grid.goal_x) ** 2 + (x[1] - grid.goal_y) ** 2 <= grid.radius * grid.radius
    return GOAL if inside else INSIDE


@inlined
def _to_center(grid, markers, x):  # type: ignore[no-untyped-def]
    """Turns of the straight line from x to the centre of the goal."""
    out = np.empty(markers.shape[0])
    for k in range(markers.shape[0]):
        ax, ay = x[0] - markers[k, 0], x[1] - markers[k, 1]
        bx, by = grid.goal_x - markers[k, 0], grid.goal_y - markers[k, 1]
        out[k] = math.atan2(ax * by - ay * bx, ax * bx + ay * by) / (2.0 * math.pi)
    return out
