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
from pirrht.rollouts.first_exit import (
    COLLISION,
    GOAL,
    INSIDE,
    at_crossing,
    bridge_exit,
    distances,
    endpoint_exit,
    line_of,
    rim_along,
)
from pirrht.rollouts.general.kind import KernelSpec
from pirrht.rollouts.sweep import sweep_onward


@cache
def bodies_for(kind: KernelSpec) -> Any:
    """Build the kernel that lists the moving obstacles that a step may meet, and counts them."""
    noisy_position, along_line = kind.noisy_position, kind.along_line

    @part
    def bodies_of(setup, leads, scratch, now, cov, turn, i, close):  # type: ignore[no-untyped-def]
        x, moved, held, listed, traffic = scratch.x, scratch.moved, scratch.held, scratch.listed, setup.world.moving
        way = math.sqrt((moved[0] - x[0]) ** 2 + (moved[1] - x[1]) ** 2)
        if not noisy_position:
            way *= 1.0 + abs(turn)
            return list_around(leads.nearby, traffic.J, i, x[0], x[1], way, close, held, listed)
        spread = math.sqrt(0.5 * FAR * (cov[0] + cov[2] if along_line else max(cov[0], cov[2])))
        if way + spread > leads.nearby.cutoff:
            close = list_everybody(traffic.J, held, listed)
            look_around(traffic, listed, close, x[0], x[1], now, spread, scratch.near)
        return close

    return bodies_of


@cache
def ended_for(kind: KernelSpec) -> Any:
    """Build kernels that end a step at its crossing: without this the rest of it would enter dQ/dP as noise."""
    n, m, moving = kind.n, kind.m, kind.moving

    @part
    def ended_in_plane(scratch, arena, dt, exit, share, cov, by_body, body, state):  # type: ignore[no-untyped-def]
        """End a step whose noise is its displacement."""
        x, moved, f, y, B = scratch.x, scratch.moved, scratch.f, scratch.y, scratch.B
        dx, dy = moved[0] - x[0] - f[0] * dt, moved[1] - x[1] - f[1] * dt
        if moving and by_body:
            near, spread = scratch.near, math.sqrt(cov[0])
            state, dx, dy = at_moving_wall(near, body, (dx, dy), (f[0], f[1]), dt, share, spread, state)
        else:
            state, dx, dy = at_crossing(arena, (x[0], x[1]), (dx, dy), exit, share, math.sqrt(cov[0]), state)
        y[0] = (B[0, 0] * dx + B[1, 0] * dy) * dt / cov[0]
        y[1] = (B[0, 1] * dx + B[1, 1] * dy) * dt / cov[0]
        moved[0], moved[1] = x[0] + f[0] * dt * share + dx, x[1] + f[1] * dt * share + dy
        return state, dt * share

    @part
    def ended_on_line(scratch, arena, dt, share, rates, state):  # type: ignore[no-untyped-def]
        """End a step along a line at the goal's rim; other noise is that of a bridge."""
        (xx, xy, yy), x, moved, y, B, column = rates, scratch.x, scratch.moved, scratch.y, scratch.B, scratch.column
        ex, ey, alone = line_of((xx * dt, xy * dt, yy * dt))
        if not alone:
            return state, dt
        size, to_rim = xx + yy, rim_along(arena, x[0], x[1], ex, ey)
        spread, noisy = math.sqrt(share * (1.0 - share) * dt), 0.0
        for j in range(m):
            if j % 2 == 0:
                state, z, other = normals(state)
            else:
                z = other
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

    return ended_in_plane, ended_on_line


@cache
def exits(kind: KernelSpec) -> Any:
    """Build the kernel that judges a step by how it moved.

    It returns the stream's state, exit, share of the step, time [s] for which its noise counts, log probability that no
    wall was met, distances (noisy positions) and clearance (others) at its end, and the count of moving obstacles near.
    """
    noisy_position, moving, along_line = kind.noisy_position, kind.moving, kind.along_line
    isotropic = kind.n == 2 and kind.m == 2  # the noise of a step is its displacement; then an exit cuts both alike
    bodies_of = bodies_for(kind)
    ended_in_plane, ended_on_line = ended_for(kind)

    @part
    def at_end(setup, scratch, arena, dt, now):  # type: ignore[no-untyped-def]
        """Judge a step where it ends."""
        moved = scratch.moved
        exit, share = endpoint_exit(arena, moved[0], moved[1])
        if moving and moving_clearance(setup.world.moving, moved[0], moved[1], now + dt) <= 0.0:
            exit = COLLISION
        return exit, share

    @part
    def on_bridge(setup, leads, scratch, arena, dt, now, rates, before, close, state):  # type: ignore[no-untyped-def]
        """Judge a step along the Brownian bridge between its ends."""
        (xx, xy, yy), x, moved = rates, scratch.x, scratch.moved
        cov, after = (xx * dt, xy * dt, yy * dt), distances(arena, moved[0], moved[1])
        until, by_body, body = dt, False, 0
        state, exit, share, missed = bridge_exit(
            arena, (x[0], x[1], moved[0], moved[1]), before, after, cov, leads.weighed, state, along_line
        )
        if moving and close > 0:
            state, hit, body, alive = met_on_bridge(
                setup.world.moving, scratch.listed, close, scratch.near, (x[0], x[1], moved[0], moved[1]), dt, cov,
                (along_line, leads.weighed), state,
            )  # fmt: skip
            if hit <= 1.0 and (exit == INSIDE or hit < share):
                exit, share, by_body = COLLISION, hit, True
            elif exit != COLLISION:
                missed += share * alive
        if isotropic and exit != INSIDE and cov[1] == 0.0 and cov[0] == cov[2]:
            state, until = ended_in_plane(scratch, arena, dt, exit, share, cov, by_body, body, state)
        elif along_line and exit == GOAL:
            state, until = ended_on_line(scratch, arena, dt, share, rates, state)
        return state, exit, share, until, missed, after

    @part
    def judge(setup, leads, scratch, arena, dt, now, i, way, before, room, close, state):  # type: ignore[no-untyped-def]
        (arrived, ahead, turn, (xx, xy, yy)), x, moved = way, scratch.x, scratch.moved
        exit, share, until, missed = INSIDE, 1.0, 0.0 if arrived else dt, 0.0
        if moving and (setup.bridge or not noisy_position):
            close = bodies_of(setup, leads, scratch, now, (xx * dt, xy * dt, yy * dt), turn, i, close)
        if not setup.bridge:
            exit, share = at_end(setup, scratch, arena, dt, now)
            before = distances(arena, moved[0], moved[1])
        elif noisy_position:
            state, exit, share, until, missed, before = on_bridge(
                setup, leads, scratch, arena, dt, now, (xx, xy, yy), before, close, state
            )
        elif arrived:
            exit, share = GOAL, ahead
        else:
            exit, share, room = sweep_onward(arena, x[0], x[1], moved[0], moved[1], turn, room)
        if moving and not noisy_position and setup.bridge and close > 0:
            hit = met_on_path(
                setup.world.moving, scratch.listed, close, (x[0], x[1], moved[0], moved[1], turn), now, dt, share
            )
            if hit <= share:
                exit, share = COLLISION, hit
        return state, exit, share, until, missed, before, room, close

    return judge
