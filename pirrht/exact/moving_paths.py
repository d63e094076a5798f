"""Paths under the optimal law among moving bodies, and the ways around standing and moving obstacles they take."""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.compiled.jit import inlined, kernel
from pirrht.compiled.streams import normals, stream
from pirrht.exact.domain import in_goal
from pirrht.exact.moving_look import March, look, poses_of
from pirrht.exact.optimal_paths import CAREFUL, LONGEST, SHORTEST
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.bodies import clearance_from
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE
from pirrht.topology.cuts import straight_turns
from pirrht.topology.homology import Homology
from pirrht.topology.moving import MovingHomology
from pirrht.topology.tracks import turns_of_step


def classes_of(
    grid: March,
    gain: Array,
    homology: Homology,
    moving: MovingHomology,
    x: Array,
    t: float,
    step: float,
    samples: int,
    seed: int,
) -> tuple[IntArray, IntArray]:
    """Classes (S, M + J) [turns] and outcomes (S,) of paths that leave x (2,) [m] at t [s] under the optimal law.

    Args:
        grid: the solution.
        gain: lambda R^-1 G_c', (2, 2) [control per nats/state].
        homology: M standing markers.
        moving: J moving ones.
        x: where all paths begin, (2,) [m].
        t: when [s].
        step: of a path at most [s].
        samples: S.
        seed: of the noise.
    """
    M, J = homology.M, moving.J
    turns, outcome = np.zeros((samples, M + J)), np.zeros(samples, dtype=np.int64)
    arrival = moving.arrival(x, t)
    _walk(grid, gain, homology.markers, moving.tracks, moving.goal, x, t, step, arrival, seed, turns, outcome)
    base = np.concatenate([homology.straight(x[None])[0], moving.base(x, t, arrival)])
    return np.rint(turns - base).astype(np.int64), outcome


@kernel
def _walk(grid, gain, markers, tracks, goal, x0, t0, longest, arrival, seed, turns, outcome):  # type: ignore[no-untyped-def]
    """Fill turns (S, M + J), zeros before, with those of paths closed at the goal point, and outcomes (S,).

    Of the standstill after arrival, that of the path counts where it comes before the base's `arrival` [s], and that of
    the base, with the opposite sign, where the path comes later.
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
