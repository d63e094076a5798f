"""Draw paths of the optimally controlled process with a grid's law, and the classes they take.

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

from pirrht.arrays import Array, IntArray
from pirrht.exact.grid import in_goal
from pirrht.exact.moving_look import March, look, poses_of
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.field import Field, clearance
from pirrht.jit.jit import as_jitable, inlined, kernel
from pirrht.jit.streams import normals, stream, uniform
from pirrht.moving.bodies import clearance_from
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE
from pirrht.topology.crossings import straight_turns
from pirrht.topology.homology import Homology
from pirrht.topology.tracks import turns_of_step

CANDIDATES = 64  # ends that one discrete step is chosen from
LONGEST = 100_000  # steps of a path
CAREFUL = 0.15  # deviation of a step as a share of the clearance, in continuous time ...
SHORTEST = 1e-7  # ... but no step is shorter [s]


class Process(NamedTuple):
    """The controlled process, and how paths of it are drawn."""

    field: Field
    parameters: Array  # (k,) that the drift reads
    gain: Array  # lambda R^-1 G_c', (m, m) [control per nats/state]
    G: Array  # G_c, (m, m) [state/s per control]
    B: Array  # B_c, (m, m) [state/sqrt(s)]
    wall: float  # phi/lambda [nats]
    step: float  # of a path [s]; in continuous time at most


@cache
def walker(look: Any, drift: Callable[..., None], discrete: bool) -> Any:
    """Build the kernel (grid, `Process`, markers (M, 2) [m], start (n,), seed, turns, outcome) over paths.

    It adds the turns of paths, and of the straight lines from their ends to the goal point, to turns (S, M) [turns],
    zeros before, and fills outcomes (S,). `look` is (grid, x (n,), slope (n,)) -> log psi [nats], `drift` f (x, p, out)
    [state/s]; `discrete` paths are those of the discrete-time problem.
    """
    move = as_jitable(drift)

    @kernel
    def continuous(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        field, gain, G, B, step = process.field, process.gain, process.G, process.B, process.step
        n, m = x.shape[0], G.shape[0]
        look(grid, x, slope)
        if n == m:
            root = CAREFUL * clearance(field, x[0], x[1]) / B[0, 0]
            step = max(min(step, root * root), SHORTEST)
        move(x, process.parameters, f)
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
    def stepwise(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        field, gain, G, B, step = process.field, process.gain, process.G, process.B, process.step
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
            log_psi = look(grid, y, slope) if outcome == INSIDE else (0.0 if outcome == GOAL else -process.wall)
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
    def walk(grid, process, markers, x0, seed, turns, outcome):  # type: ignore[no-untyped-def]
        slope, f, x = np.zeros(x0.shape[0]), np.zeros(x0.shape[0]), np.zeros(x0.shape[0])
        for s in range(outcome.shape[0]):
            state = stream(seed, s)
            x[:] = x0
            outcome[s] = INSIDE
            for _ in range(LONGEST):
                before_x, before_y = x[0], x[1]
                state, outcome[s] = advance(grid, process, x, slope, f, state)
                for k in range(markers.shape[0]):
                    ax, ay = before_x - markers[k, 0], before_y - markers[k, 1]
                    bx, by = x[0] - markers[k, 0], x[1] - markers[k, 1]
                    turns[s, k] += turns_of_chord(ax, ay, bx, by)
                if outcome[s] != INSIDE:
                    for k in range(markers.shape[0]):
                        mx, my = markers[k, 0], markers[k, 1]
                        turns[s, k] += straight_turns(x[0], x[1], mx, my, grid.frame.goal_x, grid.frame.goal_y)
                    break

    return walk


@inlined
def _end(grid, field, x):  # type: ignore[no-untyped-def]
    """Judge where a step has led to: a collision comes first."""
    if clearance(field, x[0], x[1]) <= 0.0:
        return COLLISION
    return GOAL if in_goal(grid.frame, x) else INSIDE


def classes_of(
    grid: March,
    gain: Array,
    homology: Homology,
    x: Array,
    t: float,
    step: float,
    samples: int,
    seed: int,
) -> tuple[IntArray, IntArray]:
    """Classes (S, M) [turns] and outcomes (S,) of paths that leave x (2,) [m] at t [s] under the optimal law.

    `gain` is lambda R^-1 G_c', (2, 2) [control per nats/state], `step` that of a path at most [s].
    """
    turns, outcome = np.zeros((samples, homology.M)), np.zeros(samples, dtype=np.int64)
    here = np.array([x[0], x[1], t])
    arrival = homology.arrival(here)
    _walk(grid, gain, homology.markers, homology.tracks, homology.goal, x, t, step, arrival, seed, turns, outcome)
    return np.rint(turns - homology.base(here)).astype(np.int64), outcome


@kernel
def _walk(grid, gain, markers, tracks, goal, x0, t0, longest, arrival, seed, turns, outcome):  # type: ignore[no-untyped-def]
    """Fill turns (S, M + J), zeros before, with those of paths closed at the goal point, and outcomes (S,).

    Waiting at the goal counts for the path if it comes before the base's `arrival` [s], else for the base, negative.
    """
    M, J = markers.shape[0], tracks.J
    slope, state = np.zeros(2), np.zeros(3)
    b = grid.step.b
    pose = np.empty((grid.begin.shape[1], 4))
    for s in range(outcome.shape[0]):
        draws = stream(seed, s)
        state[0], state[1], state[2] = x0[0], x0[1], t0
        outcome[s] = GOAL if in_goal(grid.frame, state) else INSIDE
        for _ in range(LONGEST):
            if outcome[s] != INSIDE:
                break
            poses_of(grid, state[2], pose)
            free_by = _clearance(grid, pose, state[0], state[1])
            if free_by <= 0.0:
                outcome[s] = COLLISION
                break
            root = CAREFUL * free_by / b
            dt = max(min(longest, root * root), SHORTEST)
            look(grid, state, slope)
            draws, w, z = normals(draws)
            x, y, t = state[0], state[1], state[2]
            state[0] += (gain[0, 0] * slope[0] + gain[0, 1] * slope[1]) * dt + b * math.sqrt(dt) * w
            state[1] += (gain[1, 0] * slope[0] + gain[1, 1] * slope[1]) * dt + b * math.sqrt(dt) * z
            state[2] += dt
            for k in range(M):
                mx, my = markers[k, 0], markers[k, 1]
                turns[s, k] += turns_of_chord(x - mx, y - my, state[0] - mx, state[1] - my)
            for k in range(J):
                turns[s, M + k] += turns_of_step(tracks, k, x, y, t, state[0], state[1], state[2])
            if in_goal(grid.frame, state):
                outcome[s] = GOAL
        for k in range(M):
            turns[s, k] += straight_turns(state[0], state[1], markers[k, 0], markers[k, 1], goal[0], goal[1])
        for k in range(J):
            t = state[2]
            turns[s, M + k] += turns_of_step(tracks, k, state[0], state[1], t, goal[0], goal[1], t)
            early, late = min(t, arrival), max(t, arrival)
            wait = turns_of_step(tracks, k, goal[0], goal[1], early, goal[0], goal[1], late)
            turns[s, M + k] += wait if t < arrival else -wait


@inlined
def _clearance(grid, pose, x, y):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from all solids, posed (1 + J, 4), and the border [m]."""
    room = grid.room
    out = min(min(x - room.left, room.right - x), min(y - room.low, room.high - y))
    for k in range(room.bodies.owner.shape[0]):
        out = min(out, clearance_from(room.bodies, k, pose, x, y))
    return out
