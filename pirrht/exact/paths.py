"""Draw paths of the exact law on a grid, in continuous time, in steps, or with a control that is held.

Paths in continuous time are Euler-Maruyama steps, so short near a wall that the law, which grows as 1/distance, turns
them around. In discrete time the optimal transition is the passive one times psi at its end; it is drawn from many
normal ends around the one that the law points to, by their weights (Rubin's sampling and resampling). A control that is
held for a step is limited near walls as runs limit it (`control.held`), and collides as they do.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.control.held import NEAR_WALL, THROW
from pirrht.exact.boundaries import clearance_at, poses_at
from pirrht.exact.grid import TUNING
from pirrht.geometry.space import COLLISION, GOAL, INSIDE, StateKernels
from pirrht.jit.jit import as_jitable, inlined, kernel
from pirrht.jit.streams import normals, stream, uniform
from pirrht.topology.signature import SignatureKernels


class Process(NamedTuple):
    """The controlled process, and steps of paths of it."""

    static: Any  # free space of the footprint, unused among moving obstacles
    goal: tuple[float, ...]  # its centre (d,) [m]
    radius: float  # of its disc or ball [m]
    parameters: Array  # (k,) that the drift reads
    rate: Array  # lambda G_c R^-1 G_c', (m, m) [state/s per nats/state]
    B: Array  # B_c, (m, m) [state/sqrt(s)]
    wall: float  # phi/lambda [nats]
    step: float  # of a path [s]; in continuous time at most
    shortest: float  # in continuous time, near walls [s]
    margin: float  # by which walls that are hit are behind those of the law [m]
    gap: float  # to walls at which a held law is evaluated within the margin [m]


@cache
def walker(
    evaluate: Any, drift: Callable[..., None], how: str, moves: bool, states: StateKernels, classes: SignatureKernels,
    position: int = 2,
) -> Any:  # fmt: skip
    """Build the kernel (grid, `Process`, table, x0, seed, turns, x, outcome) that draws paths.

    Turns (S, M) [turns], zeros before, are about the obstacles of a signature with kernels `classes` and a `table`;
    x (S, n + 1) and outcomes (S,) are ends of paths. `evaluate` is that of a solver, `drift` f (x, p, out) [state/s];
    `how` is continuous, stepwise or held; `states` are the footprint's at states of the system, which begin with a
    position of so many numbers.
    """
    move, clearance, d = as_jitable(drift), states.clearance, position
    add_turns = classes.turns

    timed = inlined(lambda x: (x[0], x[1], x[-1]))
    if d == 3:
        timed = inlined(lambda x: (x[0], x[1], x[2], x[-1]))

    @kernel
    def length(a):  # type: ignore[no-untyped-def]
        total = 0.0
        for k in range(d):
            total = math.hypot(total, a[k])
        return total

    @kernel
    def clear(grid, process, x):  # type: ignore[no-untyped-def]
        if moves:
            return clearance_at(grid.domain, poses_at(grid.domain.solids, x[-1]), x[0], x[1])
        return clearance(process.static, x)

    @kernel
    def end(grid, process, x):  # type: ignore[no-untyped-def]
        if clear(grid, process, x) <= -process.margin:
            return COLLISION
        square = 0.0
        for k in range(d):
            square += (x[k] - process.goal[k]) ** 2
        return GOAL if square <= process.radius * process.radius else INSIDE

    @kernel
    def continuous(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        B = process.B
        step = process.step
        n = f.shape[0]
        m = process.B.shape[0]

        evaluate(grid, x, slope)
        if n == m:
            root = TUNING.wall_steps * clear(grid, process, x) / B[0, 0]
            step = max(min(step, root * root), process.shortest)
        move(x[:n], process.parameters, f)
        z = np.empty(m)
        for j in range(m):
            state, z[j], _ = normals(state)
        x[:n] += f * step
        x[n - m : n] += (process.rate @ slope[n - m :]) * step + (B @ z) * math.sqrt(step)
        x[n] += step
        return state

    @kernel
    def stepwise(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        evaluate(grid, x, slope)
        ahead = process.rate @ slope * process.step
        deviation = process.B[0, 0] * math.sqrt(process.step)

        ends = np.empty((TUNING.candidates, 2))
        weight = np.empty(TUNING.candidates)
        y = x.copy()

        for k in range(TUNING.candidates):
            state, z, w = normals(state)
            y[:2] = (x[0] + ahead[0] + deviation * z, x[1] + ahead[1] + deviation * w)

            outcome = end(grid, process, y)
            ends[k] = y[:2]

            log_psi = evaluate(grid, y, slope) if outcome == INSIDE else (0.0 if outcome == GOAL else -process.wall)
            passive = ((y[0] - x[0]) ** 2 + (y[1] - x[1]) ** 2) / deviation**2
            weight[k] = log_psi + 0.5 * (z * z + w * w - passive)
        weight = np.exp(weight - weight.max())
        state, u = uniform(state)
        left, k = u * weight.sum(), 0
        while k < TUNING.candidates - 1 and left >= weight[k]:
            left -= weight[k]
            k += 1
        x[:2] = ends[k]
        x[2] += process.step
        return state

    @kernel
    def direction(grid, process, x, c, away):  # type: ignore[no-untyped-def]
        y = x.copy()
        for k in range(d):
            y[k] += process.gap
            away[k] = (clear(grid, process, y) - c) / process.gap
            y[k] = x[k]
        away /= max(length(away), 0.1)
        return away

    @kernel
    def held(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        y = x.copy()
        away = np.zeros(d)
        deviation = process.B[0, 0] * math.sqrt(process.step)

        if moves:  # walls are judged where the step ends
            y[d] += process.step
        c = clear(grid, process, y)
        near = c < NEAR_WALL * deviation
        if near:
            direction(grid, process, y, c, away)
            back, into = away, c
            for _ in range(4):  # within the margin; a second wall may be near
                if into > 0.0:
                    break
                y[:d] += (process.gap - into) * back
                into = clear(grid, process, y)
                back = direction(grid, process, y, into, np.zeros(d))
        evaluate(grid, y, slope)
        move(x[:d], process.parameters, f)
        ahead = (f + process.rate @ slope) * process.step
        if near:
            thrown = away @ ahead
            along = ahead - thrown * away
            along *= min(1.0, THROW * deviation / max(length(along), 1e-12))
            most = min(THROW * deviation, thrown)
            y[:d] = x[:d] + most * away
            if thrown > 0.0:
                most = min(most, max(0.5 * (clear(grid, process, y) + most - c), 0.0))  # half of the way through a gap
            ahead = along + most * away
        for k in range(d):
            state, z, _ = normals(state)
            x[k] += ahead[k] + deviation * z
        x[d] += process.step
        return state

    advance = {"continuous": continuous, "stepwise": stepwise, "held": held}[how]

    @kernel
    def walk(grid, process, table, x0, seed, turns, ends, outcome):  # type: ignore[no-untyped-def]
        slope = np.zeros(x0.shape[0] - 1)
        f = np.zeros(x0.shape[0] - 1)

        for s in range(outcome.shape[0]):
            state = stream(seed, s)
            x = x0.copy()
            outcome[s] = end(grid, process, x)
            for _ in range(TUNING.path_steps):
                if outcome[s] != INSIDE:
                    break
                before = timed(x)
                state = advance(grid, process, x, slope, f, state)
                add_turns(table, before, timed(x), turns[s])
                outcome[s] = end(grid, process, x)
            ends[s] = x

    return walk
