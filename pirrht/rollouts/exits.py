"""Judge whether and where a path leaves within a step: into the goal, a wall or a moving obstacle."""

import math
from functools import cache
from typing import Any

from pirrht.geometry.world import NOTHING_MOVES
from pirrht.jit.jit import part
from pirrht.jit.streams import normals
from pirrht.rollouts.step import KernelSpec

from pirrht.rollouts.first_exit import (  # isort: skip
    COLLISION, GOAL, INSIDE, at_crossing, bridge_exit, distances, endpoint_exit, line_of, rim_along, sweep_exit,
    towards_exit,
)  # fmt: skip


@cache
def ended_for(kind: KernelSpec) -> Any:
    """Build the kernel that ends a step at its crossing, so that only noise until then [s] enters dQ/dP."""
    n = kind.n
    m = kind.m
    moving = kind.moving is not None
    along_line = kind.along_line

    isotropic = kind.traits.point  # the noise of a step is its displacement; then an exit cuts both alike

    @part
    def in_plane(scratch, arena, dt, exit, share, variance, moving_wall, state):  # type: ignore[no-untyped-def]
        """End a step whose noise is its displacement; `moving_wall`: row 0 of moving walls is met."""
        x = scratch.x
        moved = scratch.moved
        f = scratch.f
        y = scratch.y
        B = scratch.B

        dx = moved[0] - x[0] - f[0] * dt
        dy = moved[1] - x[1] - f[1] * dt

        if moving and moving_wall:  # at its distance then
            gap, ux, uy, vx, vy = scratch.walls[0]
            met = max(gap, 0.0) - share * dt * ((vx - f[0]) * ux + (vy - f[1]) * uy), -ux, -uy
        else:
            met = towards_exit(arena, x[0], x[1], exit)
        radius = arena.radius if exit == GOAL else 0.0
        state, dx, dy = at_crossing(met, radius, (dx, dy), share, math.sqrt(variance), state)
        y[0] = (B[0, 0] * dx + B[1, 0] * dy) * dt / variance
        y[1] = (B[0, 1] * dx + B[1, 1] * dy) * dt / variance
        moved[0] = x[0] + f[0] * dt * share + dx
        moved[1] = x[1] + f[1] * dt * share + dy

        return state, dt * share

    @part
    def on_line(scratch, arena, dt, share, rates, state):  # type: ignore[no-untyped-def]
        """End a step along a line at the goal's rim; other noise is that of a bridge."""
        xx, xy, yy = rates
        x = scratch.x
        moved = scratch.moved
        y = scratch.y
        B = scratch.B
        column = scratch.column

        ex, ey, alone = line_of((xx * dt, xy * dt, yy * dt))
        if not alone:
            return state, dt
        size = xx + yy
        to_rim = rim_along(arena, x[0], x[1], ex, ey)
        spread, noisy, other = math.sqrt(share * (1.0 - share) * dt), 0.0, 0.0
        for j in range(m):
            z = other
            if j % 2 == 0:
                state, z, other = normals(state)
            column[j] = z
            noisy += (B[0, j] * ex + B[1, j] * ey) * (share * y[j] + spread * z)
        for j in range(m):
            along = (B[0, j] * ex + B[1, j] * ey) / size
            y[j] = share * y[j] + spread * column[j] + along * (to_rim - noisy)
        for j in range(n):
            moved[j] = x[j]
            for k in range(m):
                moved[j] += B[j, k] * y[k]
        return state, dt * share

    @part
    def ended(scratch, arena, dt, exit, share, rates, moving_wall, state):  # type: ignore[no-untyped-def]
        xx, xy, yy = rates
        if isotropic and xy * dt == 0.0 and xx * dt == yy * dt:
            return in_plane(scratch, arena, dt, exit, share, xx * dt, moving_wall, state)
        if along_line and exit == GOAL:
            return on_line(scratch, arena, dt, share, rates, state)
        return state, dt

    return ended


@cache
def exits(kind: KernelSpec) -> Any:
    """Build the kernel that judges a step by how it moved.

    It takes length and time [s] of a step, what `motion` returns, and what is clear before: distances or clearance. It
    returns the stream's state, exit, share of the step, time [s] for which its noise counts, log probability that no
    wall was met, and what is clear at its end.
    """
    noisy_position, moving, along_line = kind.noisy_position, kind.moving is not None, kind.along_line
    among = kind.moving or NOTHING_MOVES
    ended = ended_for(kind)
    bridge_among, sweep_among, clearance_among = among.bridge, among.sweep, among.clearance

    @part
    def on_bridge(setup, tables, scratch, step, rates, clear, state):  # type: ignore[no-untyped-def]
        """Judge a step along the Brownian bridge between its ends."""
        (dt, now), (before, room), weighed = step, clear, tables.weighed

        arena = setup.world
        x = scratch.x[0]
        y = scratch.x[1]
        mx = scratch.moved[0]
        my = scratch.moved[1]

        cov = (rates[0] * dt, rates[1] * dt, rates[2] * dt)
        after = distances(arena, mx, my)
        wall = False
        until = dt

        state, exit, share, missed = bridge_exit(arena, (x, y, mx, my), before, after, cov, weighed, state, along_line)
        if moving:
            way = (x, y, mx, my)
            rule = (along_line, weighed)
            state, hit, alive = bridge_among(
                setup.world.moving, scratch.watch, way, now, dt, cov, rule, state, scratch.walls
            )
            if hit <= 1.0 and (exit == INSIDE or hit < share):
                exit, share, wall = COLLISION, hit, True
            elif exit != COLLISION:
                missed += share * alive
        if exit != INSIDE:
            state, until = ended(scratch, arena, dt, exit, share, rates, wall, state)
        return state, exit, share, until, missed, (after, room)

    @part
    def on_path(setup, scratch, step, move, clear):  # type: ignore[no-untyped-def]
        """Judge a step without position noise along its path: exit, share, and what is clear at its end."""
        (dt, now), (arrived, ahead, turn, _), (before, room) = step, move, clear

        x = scratch.x[0]
        y = scratch.x[1]
        mx = scratch.moved[0]
        my = scratch.moved[1]

        exit, share = GOAL, ahead
        if not arrived:
            exit, share, room = sweep_exit(setup.world, x, y, mx, my, turn, room)
        if moving:
            hit = sweep_among(setup.world.moving, scratch.watch, (x, y, mx, my, turn), now, dt, share)
            if hit <= share:
                exit, share = COLLISION, hit
        return exit, share, (before, room)

    @part
    def judge(setup, tables, scratch, step, move, clear, state):  # type: ignore[no-untyped-def]
        (dt, now), until = step, 0.0 if move[0] else step[0]
        if not setup.bridge:
            mx = scratch.moved[0]
            my = scratch.moved[1]
            exit = endpoint_exit(setup.world, mx, my)
            if moving and clearance_among(setup.world.moving, mx, my, now + dt) <= 0.0:
                exit = COLLISION
            return state, exit, 1.0, until, 0.0, (distances(setup.world, mx, my), clear[1])
        if noisy_position:
            return on_bridge(setup, tables, scratch, step, move[3], clear, state)
        exit, share, clear = on_path(setup, scratch, step, move, clear)
        return state, exit, share, until, 0.0, clear

    return judge
