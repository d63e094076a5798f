"""Draw paths of the optimally controlled process with a grid's law.

In continuous time they are Euler-Maruyama steps, so short near a wall that the law, which grows as 1/distance, turns
them around. In discrete time the optimal transition is the passive one times psi at its end; it is drawn from many
normal ends around the one that the law points to, by their weights (Rubin's sampling and resampling).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.exact.boundaries import clearance_at, poses_at
from pirrht.exact.grid import TUNING
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.field import clearance
from pirrht.jit.jit import as_jitable, kernel
from pirrht.jit.streams import normals, stream, uniform
from pirrht.outcome import Outcome
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE
from pirrht.topology.tracks import turns_of_step

if TYPE_CHECKING:
    from pirrht.exact.desirability import Desirability
    from pirrht.topology.homology import Homology


class Process(NamedTuple):
    """The controlled process, and steps of paths of it."""

    field: Any  # clearance `Field`, unused among moving obstacles
    goal: tuple[float, float, float]  # centre of the disc and its radius [m]
    parameters: Array  # (k,) that the drift reads
    rate: Array  # lambda G_c R^-1 G_c', (m, m) [state/s per nats/state]
    B: Array  # B_c, (m, m) [state/sqrt(s)]
    wall: float  # phi/lambda [nats]
    step: float  # of a path [s]; in continuous time at most


def arrived(desirability: Desirability, homology: Homology, x0: Array, samples: int, seed: int) -> tuple[Array, Array]:
    """Draw paths from state and time x0 (n + 1,); return turns (k, M) and ends (k, n + 1) of those in the goal."""
    problem, scene, d = desirability.problem, desirability.space.scene, desirability.problem.dynamics
    moves, G = desirability.moves, d.G_c(x0[:-1])
    step = desirability.dt or (TUNING.moving_path_step if moves else TUNING.path_step)
    goal = float(scene.goal.center[0]), float(scene.goal.center[1]), float(scene.goal.radius)
    process = Process(
        desirability.space.field, goal, np.asarray(d.parameters, dtype=float), G @ desirability.gain, d.B_c(x0[:-1]),
        problem.phi / problem.temperature, step,
    )  # fmt: skip
    turns, ends = np.zeros((samples, homology.M)), np.empty((samples, len(x0)))
    outcome = np.zeros(samples, dtype=np.int64)
    walk = _walker(desirability.evaluate, d.drift, desirability.dt is not None, moves)
    walk(desirability.grid, process, homology.markers, homology.tracks, x0, seed, turns, ends, outcome)
    return turns[outcome == Outcome.GOAL], ends[outcome == Outcome.GOAL]


@cache
def _walker(evaluate: Any, drift: Callable[..., None], discrete: bool, moves: bool) -> Any:
    """Build the kernel (grid, `Process`, markers (M, 2) [m], J tracks, x0, seed, turns, x, outcome) that draws paths.

    Turns (S, M + J) [turns], zeros before, are about markers and tracks; x (S, n + 1) and outcomes (S,) are ends of
    paths. `evaluate` is that of a solver, `drift` f (x, p, out) [state/s]; `discrete` paths solve the problem in steps.
    """
    move = as_jitable(drift)

    @kernel
    def clear(grid, process, x):  # type: ignore[no-untyped-def]
        if moves:
            return clearance_at(grid.surroundings, poses_at(grid.surroundings.solids, x[-1]), x[0], x[1])
        return clearance(process.field, x[0], x[1])

    @kernel
    def end(grid, process, x):  # type: ignore[no-untyped-def]
        gx, gy, radius = process.goal
        if clear(grid, process, x) <= 0.0:
            return COLLISION
        return GOAL if (x[0] - gx) ** 2 + (x[1] - gy) ** 2 <= radius * radius else INSIDE

    @kernel
    def continuous(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        B, step, n, m = process.B, process.step, f.shape[0], process.B.shape[0]
        evaluate(grid, x, slope)
        if n == m:
            root = TUNING.wall_steps * clear(grid, process, x) / B[0, 0]
            step = max(min(step, root * root), TUNING.shortest_path_step)
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
        ahead, deviation = process.rate @ slope * process.step, process.B[0, 0] * math.sqrt(process.step)
        ends, weight, y = np.empty((TUNING.candidates, 2)), np.empty(TUNING.candidates), x.copy()
        for k in range(TUNING.candidates):
            state, z, w = normals(state)
            y[0], y[1] = x[0] + ahead[0] + deviation * z, x[1] + ahead[1] + deviation * w
            outcome, ends[k] = end(grid, process, y), y[:2]
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
                ax, ay, at = x[0], x[1], x[-1]
                state = advance(grid, process, x, slope, f, state)
                for k in range(M):
                    mx, my = markers[k, 0], markers[k, 1]
                    turns[s, k] += turns_of_chord(ax - mx, ay - my, x[0] - mx, x[1] - my)
                for k in range(M, turns.shape[1]):
                    turns[s, k] += turns_of_step(tracks, k - M, ax, ay, at, x[0], x[1], x[-1])
                outcome[s] = end(grid, process, x)
            ends[s] = x

    return walk
