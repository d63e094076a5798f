"""Judge whether and where a path leaves within a step: into the goal, a wall or a moving obstacle."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from pirrht.jit.jit import part
from pirrht.jit.streams import FAR, normals
from pirrht.moving.broad_phase import list_around, list_everybody
from pirrht.moving.distances import moving_clearance
from pirrht.moving.exits import at_moving_wall, look_around, met_on_bridge, met_on_path
from pirrht.rollouts.step import KernelSpec

from pirrht.rollouts.first_exit import (  # isort: skip
    COLLISION, GOAL, INSIDE, at_crossing, bridge_exit, distances, endpoint_exit, line_of, rim_along, sweep_onward,
)  # fmt: skip


@cache
def obstacles_for(kind: KernelSpec) -> Any:
    """Build the kernel that lists the moving obstacles that a step may meet, and counts them."""
    noisy_position, along_line = kind.noisy_position, kind.along_line

    @part
    def obstacles_of(setup, tables, scratch, step, move, close):  # type: ignore[no-untyped-def]
        x, moved, held, listed, moving = scratch.x, scratch.moved, scratch.held, scratch.candidates, setup.world.moving
        (dt, now, i), (_, _, turn, (xx, _, yy)) = step, move
        length = math.sqrt((moved[0] - x[0]) ** 2 + (moved[1] - x[1]) ** 2)
        if not noisy_position:
            length *= 1.0 + abs(turn)
            return list_around(tables.obstacles, moving.J, i, x[0], x[1], length, close, held, listed)
        spread = math.sqrt(0.5 * FAR * (xx * dt + yy * dt if along_line else max(xx * dt, yy * dt)))
        if length + spread > tables.obstacles.cutoff:
            close = list_everybody(moving.J, held, listed)
            look_around(moving, listed, close, x[0], x[1], now, spread, scratch.near)
        return close

    return obstacles_of


@cache
def ended_for(kind: KernelSpec) -> Any:
    """Build the kernel that ends a step at its crossing: without this the rest of it would enter dQ/dP as noise.

    It returns the stream's state and the time [s] for which the step's noise counts.
    """
    n, m, moving, along_line = kind.n, kind.m, kind.moving, kind.along_line
    isotropic = kind.n == 2 and kind.m == 2  # the noise of a step is its displacement; then an exit cuts both alike

    @part
    def in_plane(scratch, arena, dt, exit, share, variance, wall, state):  # type: ignore[no-untyped-def]
        """End a step whose noise is its displacement; `wall` is the moving obstacle that is met, -1 if none."""
        x, moved, f, y, B, deviation = scratch.x, scratch.moved, scratch.f, scratch.y, scratch.B, math.sqrt(variance)
        dx, dy = moved[0] - x[0] - f[0] * dt, moved[1] - x[1] - f[1] * dt
        if moving and wall >= 0:
            state, dx, dy = at_moving_wall(scratch.near, wall, (dx, dy), (f[0], f[1]), dt, share, deviation, state)
        else:
            state, dx, dy = at_crossing(arena, (x[0], x[1]), (dx, dy), exit, share, deviation, state)
        y[0] = (B[0, 0] * dx + B[1, 0] * dy) * dt / variance
        y[1] = (B[0, 1] * dx + B[1, 1] * dy) * dt / variance
        moved[0], moved[1] = x[0] + f[0] * dt * share + dx, x[1] + f[1] * dt * share + dy
        return state, dt * share

    @part
    def on_line(scratch, arena, dt, share, rates, state):  # type: ignore[no-untyped-def]
        """End a step along a line at the goal's rim; other noise is that of a bridge."""
        (xx, xy, yy), x, moved, y, B, column = rates, scratch.x, scratch.moved, scratch.y, scratch.B, scratch.column
        ex, ey, alone = line_of((xx * dt, xy * dt, yy * dt))
        if not alone:
            return state, dt
        size, to_rim = xx + yy, rim_along(arena, x[0], x[1], ex, ey)
        spread, noisy, other = math.sqrt(share * (1.0 - share) * dt), 0.0, 0.0
        for j in range(m):
            z = other
            if j % 2 == 0:
                state, z, other = normals(state)
            column[j, 0] = z
            noisy += (B[0, j] * ex + B[1, j] * ey) * (share * y[j] + spread * z)
        for j in range(m):
            along = (B[0, j] * ex + B[1, j] * ey) / size
            y[j] = share * y[j] + spread * column[j, 0] + along * (to_rim - noisy)
        for j in range(n):
            moved[j] = x[j]
            for k in range(m):
                moved[j] += B[j, k] * y[k]
        return state, dt * share

    @part
    def ended(scratch, arena, dt, exit, share, rates, wall, state):  # type: ignore[no-untyped-def]
        xx, xy, yy = rates
        if isotropic and xy * dt == 0.0 and xx * dt == yy * dt:
            return in_plane(scratch, arena, dt, exit, share, xx * dt, wall, state)
        if along_line and exit == GOAL:
            return on_line(scratch, arena, dt, share, rates, state)
        return state, dt

    return ended


@cache
def exits(kind: KernelSpec) -> Any:
    """Build the kernel that judges a step by how it moved.

    Args of that: a step's (length [s], time [s], number), what `motion` returns, and what is clear before it:
        distances (noisy positions), clearance (others) and the count of moving obstacles near.
    Returns: the stream's state, exit, share of the step, time [s] for which its noise counts, log probability that no
        wall was met, and what is clear at its end.
    """
    noisy_position, moving, along_line = kind.noisy_position, kind.moving, kind.along_line
    obstacles_of, ended = obstacles_for(kind), ended_for(kind)

    @part
    def on_bridge(setup, tables, scratch, step, rates, clear, state):  # type: ignore[no-untyped-def]
        """Judge a step along the Brownian bridge between its ends."""
        (dt, _, _), (before, room, close), weighed = step, clear, tables.weighed
        arena, x, y, mx, my = setup.world, scratch.x[0], scratch.x[1], scratch.moved[0], scratch.moved[1]
        cov, after, wall, until = (rates[0] * dt, rates[1] * dt, rates[2] * dt), distances(arena, mx, my), -1, dt
        state, exit, share, missed = bridge_exit(arena, (x, y, mx, my), before, after, cov, weighed, state, along_line)
        if moving and close > 0:
            state, hit, body, alive = met_on_bridge(
                setup.world.moving, scratch.candidates, close, scratch.near, (x, y, mx, my), dt, cov,
                (along_line, weighed), state,
            )  # fmt: skip
            if hit <= 1.0 and (exit == INSIDE or hit < share):
                exit, share, wall = COLLISION, hit, body
            elif exit != COLLISION:
                missed += share * alive
        if exit != INSIDE:
            state, until = ended(scratch, arena, dt, exit, share, rates, wall, state)
        return state, exit, share, until, missed, (after, room, close)

    @part
    def on_path(setup, scratch, step, move, clear):  # type: ignore[no-untyped-def]
        """Judge a step without position noise along its path: exit, share, and what is clear at its end."""
        (dt, now, _), (arrived, ahead, turn, _), (before, room, close) = step, move, clear
        x, y, mx, my = scratch.x[0], scratch.x[1], scratch.moved[0], scratch.moved[1]
        exit, share = GOAL, ahead
        if not arrived:
            exit, share, room = sweep_onward(setup.world, x, y, mx, my, turn, room)
        if moving and close > 0:
            hit = met_on_path(setup.world.moving, scratch.candidates, close, (x, y, mx, my, turn), now, dt, share)
            if hit <= share:
                exit, share = COLLISION, hit
        return exit, share, (before, room, close)

    @part
    def judge(setup, tables, scratch, step, move, clear, state):  # type: ignore[no-untyped-def]
        (dt, now, _), (before, room, close), until = step, clear, 0.0 if move[0] else step[0]
        if not setup.bridge:
            mx, my = scratch.moved[0], scratch.moved[1]
            exit, share = endpoint_exit(setup.world, mx, my)
            if moving and moving_clearance(setup.world.moving, mx, my, now + dt) <= 0.0:
                exit = COLLISION
            return state, exit, share, until, 0.0, (distances(setup.world, mx, my), room, close)
        if moving:
            clear = before, room, obstacles_of(setup, tables, scratch, step, move, close)
        if noisy_position:
            return on_bridge(setup, tables, scratch, step, move[3], clear, state)
        exit, share, clear = on_path(setup, scratch, step, move, clear)
        return state, exit, share, until, 0.0, clear

    return judge
