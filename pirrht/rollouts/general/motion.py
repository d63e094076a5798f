"""Where the noise of a step leads: Euler-Maruyama's step, by the drift and B of its middle where those are asked."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from pirrht.compiled.jit import part
from pirrht.rollouts.first_exit import GOAL
from pirrht.rollouts.general.kind import SWAY, Kind, diffusion_of
from pirrht.rollouts.sweep import sweep_exit, turn_of


@cache
def covariance_of(kind: Kind) -> Any:
    """The kernel (B) of the covariance (xx, xy, yy) of the position per second."""
    m, fixed = kind.m, kind.n - kind.rows

    @part
    def covariance(B):  # type: ignore[no-untyped-def]
        xx, xy, yy = 0.0, 0.0, 0.0
        for j in range(m):
            bx = B[0 - fixed, j] if fixed <= 0 else 0.0
            by = B[1 - fixed, j] if fixed <= 1 else 0.0
            xx, xy, yy = xx + bx * bx, xy + bx * by, yy + by * by
        return xx, xy, yy

    return covariance


@cache
def motion(kind: Kind) -> Any:
    """The kernel that writes where a step leads to `moved`.

    It tells whether the step enters the goal straight ahead, before its noise matters (then y = 0), the share of it
    until then, by how much its way bends [rad], and the covariance of the position per second.
    """
    n, m, rows, fixed = kind.n, kind.m, kind.rows, kind.n - kind.rows
    drift, drifting, midway, noisy_position = kind.drift, kind.drifting, kind.midway, kind.noisy_position
    varying, turning = kind.varying, kind.turning
    noise_at: Any = diffusion_of(kind) if varying else drift
    covariance = covariance_of(kind)

    @part
    def shaken(scratch, share):  # type: ignore[no-untyped-def]
        """Add a share of the step's noise to where it leads."""
        moved, B, y = scratch.moved, scratch.B, scratch.y
        for j in range(rows):
            for k in range(m):
                moved[fixed + j] += share * B[j, k] * y[k]

    @part
    def half_way(setup, leads, scratch, dt, sway, bent):  # type: ignore[no-untyped-def]
        """Take the drift of the middle of the step's noise, off it by its sway: where no noise acts on the position."""
        x, moved, f, B = scratch.x, scratch.moved, scratch.f, scratch.B
        swaying = turning and leads.least < math.inf
        for j in range(n):
            moved[j] = x[j]
        shaken(scratch, 0.5)
        if swaying:
            moved[2] -= B[0, 0] * sway * SWAY
        for j in range(rows if bent else 0):
            for k in range(m):
                moved[fixed + j] -= SWAY * B[j, k] * scratch.drawn[m + k]
        drift(moved, setup.parameters, f)
        turn = 0.0
        if swaying:  # the chord of an arc is shorter than the arc
            turn = B[0, 0] * scratch.y[0]
            for j in range(2):
                f[j] *= 1.0 - (turn * turn + B[0, 0] * B[0, 0] * dt) / 24.0
        return turn

    @part
    def move(setup, leads, scratch, arena, dt, sway, rates, bent):  # type: ignore[no-untyped-def]
        (xx, xy, yy), x, moved, f, y, p = rates, scratch.x, scratch.moved, scratch.f, scratch.y, setup.parameters
        goal, radius = arena.goal, arena.radius
        arrived, ahead, turn, vx, vy = False, 1.0, 0.0, f[0], f[1]
        if not noisy_position and setup.bridge:
            within = radius + math.sqrt(f[0] * f[0] + f[1] * f[1]) * dt
            if (x[0] - goal[0]) ** 2 + (x[1] - goal[1]) ** 2 < within * within:
                exit, ahead = sweep_exit(arena, x[0], x[1], x[0] + f[0] * dt, x[1] + f[1] * dt)
                arrived = exit == GOAL
            if arrived:
                for j in range(m):
                    y[j] = 0.0
            elif drifting:
                turn = half_way(setup, leads, scratch, dt, sway, bent)
        if midway and not arrived:
            for j in range(n):
                moved[j] = x[j] + 0.5 * f[j] * dt
            shaken(scratch, 0.5)
            if varying:
                noise_at(moved, p, setup.inverse, scratch.G, scratch.B)
                xx, xy, yy = covariance(scratch.B)
            if drifting and (noisy_position or not setup.bridge):
                drift(moved, p, f)
        for j in range(n):
            moved[j] = x[j] + f[j] * dt
        shaken(scratch, 1.0)
        if bent and not arrived:  # between two steps its velocity changes, and the way is no chord
            drift(moved, p, f)
            turn = turn_of(vx, vy, f[0], f[1], moved[0] - x[0], moved[1] - x[1], dt)
        return arrived, ahead, turn, (xx, xy, yy)

    return move
