"""Draw paths of the optimally controlled process with a grid's law.

In continuous time they are Euler-Maruyama steps, so short near a wall that the law, which grows as 1/distance, turns
them around. In discrete time the optimal transition is the passive one times psi at its end; it is drawn from many
normal ends around the one that the law points to, by their weights (Rubin's sampling and resampling).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.exact.grid import TUNING, in_goal
from pirrht.exact.moving_point import clearance_at, poses_of
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.field import Field, clearance
from pirrht.jit.jit import as_jitable, kernel
from pirrht.jit.streams import normals, stream, uniform
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE
from pirrht.topology.tracks import turns_of_step


class Process(NamedTuple):
    """The controlled process, and steps of paths of it."""

    field: Field  # unused among moving obstacles
    parameters: Array  # (k,) that the drift reads
    gain: Array  # lambda R^-1 G_c', (m, m) [control per nats/state]
    G: Array  # G_c, (m, m) [state/s per control]
    B: Array  # B_c, (m, m) [state/sqrt(s)]
    wall: float  # phi/lambda [nats]
    step: float  # of a path [s]; in continuous time at most


@cache
def walker(evaluate: Any, drift: Callable[..., None], discrete: bool, moves: bool) -> Any:
    """Build the kernel (grid, `Process`, markers (M, 2) [m], J tracks, x0, seed, turns, x, outcome) that draws paths.

    S paths leave state and time x0 (n + 1,); turns (S, M + J) [turns], zeros before, are about markers and tracks, x
    (S, n + 1) and outcomes (S,) their ends. `evaluate` is (grid, x, slope (n,)) -> log psi [nats], `drift` f (x, p,
    out) [state/s]; `discrete` paths are those of the discrete-time problem.
    """
    move = as_jitable(drift)

    @kernel
    def clear(grid, process, x):  # type: ignore[no-untyped-def]
        if moves:
            pose = np.empty((grid.begin.shape[1], 4))
            poses_of(grid, x[-1], pose)
            return clearance_at(grid.surroundings, pose, x[0], x[1])
        return clearance(process.field, x[0], x[1])

    @kernel
    def end(grid, process, x):  # type: ignore[no-untyped-def]
        if clear(grid, process, x) <= 0.0:
            return COLLISION
        return GOAL if in_goal(grid.frame, x) else INSIDE

    @kernel
    def continuous(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        G, B, step = process.G, process.B, process.step
        n, m = f.shape[0], G.shape[0]
        evaluate(grid, x, slope)
        if n == m:
            root = TUNING.wall_steps * clear(grid, process, x) / B[0, 0]
            step = max(min(step, root * root), TUNING.shortest_path_step)
        move(x[:n], process.parameters, f)
        rate = G @ (process.gain @ slope[n - m :])
        for i in range(n):
            x[i] += f[i] * step
        for j in range(m):
            state, z, _ = normals(state)
            for i in range(m):
                x[n - m + i] += B[i, j] * z * math.sqrt(step)
        for i in range(m):
            x[n - m + i] += rate[i] * step
        x[n] += step
        return state

    @kernel
    def stepwise(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        evaluate(grid, x, slope)
        ahead = process.G @ (process.gain @ slope) * process.step
        deviation = process.B[0, 0] * math.sqrt(process.step)
        ends, weight, y = np.empty((TUNING.candidates, 2)), np.empty(TUNING.candidates), x.copy()
        for k in range(TUNING.candidates):
            square = 0.0
            for i in range(2):
                state, z, _ = normals(state)
                y[i] = x[i] + ahead[i] + deviation * z
                square += z * z - ((ahead[i] + deviation * z) / deviation) ** 2
            outcome, ends[k] = end(grid, process, y), y[:2]
            log_psi = evaluate(grid, y, slope) if outcome == INSIDE else (0.0 if outcome == GOAL else -process.wall)
            weight[k] = log_psi + 0.5 * square
        weight = np.exp(weight - weight.max())
        state, u = uniform(state)
        left, k = u * weight.sum(), 0
        while k < TUNING.candidates - 1 and left >= weight[k]:
            left -= weight[k]
            k += 1
        x[:2] = ends[k]
        x[2] += process.step
        return state

    advance = stepwise if discrete else continuous

    @kernel
    def walk(grid, process, markers, tracks, x0, seed, turns, ends, outcome):  # type: ignore[no-untyped-def]
        slope, f, M = np.zeros(x0.shape[0] - 1), np.zeros(x0.shape[0] - 1), markers.shape[0]
        for s in range(outcome.shape[0]):
            state, x = stream(seed, s), x0.copy()
            outcome[s] = end(grid, process, x)
            for _ in range(TUNING.path_steps):
                if outcome[s] != INSIDE:
                    break
                before_x, before_y, before = x[0], x[1], x[-1]
                state = advance(grid, process, x, slope, f, state)
                for k in range(M):
                    mx, my = markers[k, 0], markers[k, 1]
                    turns[s, k] += turns_of_chord(before_x - mx, before_y - my, x[0] - mx, x[1] - my)
                for k in range(turns.shape[1] - M):
                    turns[s, M + k] += turns_of_step(tracks, k, before_x, before_y, before, x[0], x[1], x[-1])
                outcome[s] = end(grid, process, x)
            ends[s] = x

    return walk
