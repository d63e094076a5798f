"""What a step of a rollout cannot do without: its normal numbers, and the arithmetic of the paper's kernel."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pirrht.clearance import Field, clearance
from pirrht.noise import normal, stream
from pirrht.threads import mapped

STEPS = 60


@njit(nogil=True, error_model="numpy")
def _normals(first, last):  # type: ignore[no-untyped-def]
    """Two normals per step."""
    total = 0.0
    for s in range(first, last):
        state = stream(np.uint64(1), s)
        for _ in range(STEPS):
            state, one = normal(state)
            state, other = normal(state)
            total += one + other
    return total


@njit(nogil=True, error_model="numpy")
def _steps(field, goal, a, dt, noise, first, last):  # type: ignore[no-untyped-def]
    """The same with the step, its likelihood ratios (a: (H, 2)), one look-up and the distance to the goal."""
    root, total, H = math.sqrt(dt), 0.0, a.shape[0]
    ratio = np.empty(H)
    for s in range(first, last):
        state = stream(np.uint64(1), s)
        x, y = goal
        for _ in range(STEPS):
            state, one = normal(state)
            state, other = normal(state)
            dx, dy = one * root, other * root
            for h in range(H):
                ratio[h] += a[h, 0] * (dx - 0.5 * a[h, 0] * dt) + a[h, 1] * (dy - 0.5 * a[h, 1] * dt)
            x, y = x + noise * dx, y + noise * dy
            total += min(clearance(field, x, y), (x - goal[0]) ** 2 + (y - goal[1]) ** 2)
        total += ratio[0]
    return total


def normals(samples: int, threads: int) -> int:
    """Draw what `samples` paths of 60 steps need; number of steps."""
    mapped(lambda part: _normals(*part), _parts(samples, threads), threads)
    return samples * STEPS


def steps(field: Field, goal: tuple[float, float], classes: int, samples: int, threads: int) -> int:
    """Simulate `samples` paths of 60 steps that nothing ends; number of steps."""
    a = np.ones((classes, 2))
    mapped(lambda part: _steps(field, goal, a, 0.1, 0.01, *part), _parts(samples, threads), threads)
    return samples * STEPS


def _parts(samples: int, threads: int) -> list[tuple[int, int]]:
    edges = np.linspace(0, samples, 2 * threads + 1).astype(int).tolist()
    return list(zip(edges[:-1], edges[1:], strict=True))
