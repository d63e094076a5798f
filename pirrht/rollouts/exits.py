"""Judge whether and where a path leaves within a step: into the goal, a wall or a moving obstacle."""

import math
from functools import cache
from typing import Any

from pirrht.geometry.space import COLLISION, GOAL, INSIDE, pose_at
from pirrht.geometry.world import NOTHING_MOVES
from pirrht.jit import vectors
from pirrht.jit.jit import part
from pirrht.jit.streams import FAR, normals
from pirrht.rollouts.first_exit import at_crossing, at_crossing_in_space
from pirrht.rollouts.step import Clear, KernelSpec, in_plane, of_pose, pose_noise


@cache
def ended_for(kind: KernelSpec) -> Any:
    """Build the kernel that ends a step at its crossing, so that only noise until then [s] enters dQ/dP."""
    n, m, _, _ = kind.sizes
    moving = kind.moving is not None
    along_line = kind.along_line

    isotropic = kind.traits.point  # the noise of a step is its displacement; then an exit cuts both alike
    pose, flat, noise = pose_at(kind.reads), in_plane(len(kind.reads)), pose_noise(kind)
    towards_exit, rim = kind.space.exit, kind.space.rim
    px, py = kind.position[:2]
    in_space = len(kind.position) == 3

    @part
    def as_point(scratch, arena, dt, exit, share, variance, moving_wall, state):  # type: ignore[no-untyped-def]
        """End a step whose noise is its displacement; `moving_wall`: row 0 of moving walls is met."""
        x = scratch.x
        f = scratch.f

        dx = scratch.moved[0] - x[0] - f[0] * dt
        dy = scratch.moved[1] - x[1] - f[1] * dt

        if moving and moving_wall:  # at its distance then
            gap, ux, uy, _, vx, vy, _ = scratch.walls[0]
            met = max(gap, 0.0) - share * dt * ((vx - f[0]) * ux + (vy - f[1]) * uy), -ux, -uy
        else:
            met = towards_exit(arena, pose(x), exit)
        state, dx, dy = at_crossing(
            met, arena.radius if exit == GOAL else 0.0, (dx, dy), share, math.sqrt(variance), state
        )
        scratch.y[0] = (scratch.B[0, 0] * dx + scratch.B[1, 0] * dy) * dt / variance
        scratch.y[1] = (scratch.B[0, 1] * dx + scratch.B[1, 1] * dy) * dt / variance
        scratch.moved[0] = x[0] + f[0] * dt * share + dx
        scratch.moved[1] = x[1] + f[1] * dt * share + dy

        return state, dt * share

    @part
    def as_ball(scratch, arena, dt, exit, share, variance, moving_wall, state):  # type: ignore[no-untyped-def]
        """End a step in space whose noise is its displacement."""
        x, f, B = scratch.x, scratch.f, scratch.B
        if moving and moving_wall:
            gap, ux, uy, uz, vx, vy, vz = scratch.walls[0]
            nears = (vx - f[0]) * ux + (vy - f[1]) * uy + (vz - f[2]) * uz
            met = max(gap, 0.0) - share * dt * nears, -ux, -uy, -uz
        else:
            met = towards_exit(arena, pose(x), exit)
        end = (
            scratch.moved[0] - x[0] - f[0] * dt, scratch.moved[1] - x[1] - f[1] * dt,
            scratch.moved[2] - x[2] - f[2] * dt,
        )  # fmt: skip
        state, ex, ey, ez = at_crossing_in_space(
            met, arena.radius if exit == GOAL else 0.0, end, share, math.sqrt(variance), state
        )
        end = (ex, ey, ez)
        for k in range(3):
            scratch.moved[k] = x[k] + f[k] * dt * share + end[k]
            scratch.y[k] = (B[0, k] * end[0] + B[1, k] * end[1] + B[2, k] * end[2]) * dt / variance
        return state, dt * share

    @part
    def on_line(scratch, arena, dt, share, rates, state):  # type: ignore[no-untyped-def]
        """End a step along a line at the goal's rim; other noise is that of a bridge."""
        B = scratch.B

        (ex, ey), to_rim, alone = rim(arena, pose(scratch.x), noise.scaled(rates, dt))
        if not alone:
            return state, dt
        xx, _, yy = flat(rates)
        size = xx + yy
        spread, noisy, other = math.sqrt(share * (1.0 - share) * dt), 0.0, 0.0
        for j in range(m):
            z = other
            if j % 2 == 0:
                state, z, other = normals(state)
            scratch.column[j] = z
            noisy += (B[px, j] * ex + B[py, j] * ey) * (share * scratch.y[j] + spread * z)
        for j in range(m):
            along = (B[px, j] * ex + B[py, j] * ey) / size
            scratch.y[j] = share * scratch.y[j] + spread * scratch.column[j] + along * (to_rim - noisy)
        for j in range(n):
            scratch.moved[j] = scratch.x[j]
            for k in range(m):
                scratch.moved[j] += B[j, k] * scratch.y[k]
        return state, dt * share

    @part
    def ended(scratch, arena, dt, exit, share, rates, moving_wall, state):  # type: ignore[no-untyped-def]
        if in_space:
            xx, xy, xz, yy, yz, zz = rates
            equal = isotropic and xy == 0.0 and xz == 0.0 and yz == 0.0 and xx == yy and yy == zz
            return as_ball(scratch, arena, dt, exit, share, xx * dt, moving_wall, state) if equal else (state, dt)
        xx, xy, yy = flat(rates)
        if isotropic and xy * dt == 0.0 and xx * dt == yy * dt:
            return as_point(scratch, arena, dt, exit, share, xx * dt, moving_wall, state)
        return on_line(scratch, arena, dt, share, rates, state) if along_line and exit == GOAL else (state, dt)

    return ended


@cache
def exits(kind: KernelSpec) -> Any:
    """Build the kernel that judges a step by how it moved.

    It takes length and time [s] of a step, what `motion` returns, and what is clear before: distances or clearance. It
    returns the stream's state, exit, share of the step, time [s] for which its noise counts, log probability that no
    wall was met, and what is clear at its end: distances, a clearance, and whether these are the distances there.
    """
    noisy_position, moving, along_line = kind.noisy_position, kind.moving is not None, kind.along_line
    ended = ended_for(kind)
    _, _, walls_among, bridge_among, sweep_among, clearance_among, *_ = kind.moving or NOTHING_MOVES
    space = kind.space
    swings, spread = space.turns and not noisy_position, space.spread
    bridge, sweep, end, distances = space.bridge, space.sweep, space.end, space.distances
    clearance, extent, combined = space.clearance, space.extent, vectors.combined(len(kind.reads))
    pose = pose_at(kind.reads)
    whole = of_pose(len(kind.reads))
    scaled = pose_noise(kind).scaled

    @part
    def on_bridge(setup, tables, scratch, step, rates, clear, state):  # type: ignore[no-untyped-def]
        """Judge a step along the Brownian bridge between its ends."""
        (dt, now), (before, room, _) = step, clear

        arena = setup.world
        here = pose(scratch.x)
        there = pose(scratch.moved)

        cov = scaled(rates, dt)
        after = distances(arena, there)
        wall = False
        until = dt

        state, exit, share, missed = bridge(arena, here, there, before, after, cov, tables.weighed, state, along_line)
        if moving:
            rule = (spread(arena.static, cov, along_line), tables.weighed)
            state, hit, alive = bridge_among(
                setup.world.moving, scratch.watch, (here, there), now, dt, whole(cov), rule, state, scratch.walls
            )
            if hit <= 1.0 and (exit == INSIDE or hit < share):
                exit, share, wall = COLLISION, hit, True
            elif exit != COLLISION:
                missed += share * alive
        if exit != INSIDE:
            state, until = ended(scratch, arena, dt, exit, share, rates, wall, state)
        return state, exit, share, until, missed, Clear(after, room, True)

    @part
    def on_path(setup, scratch, step, move, clear):  # type: ignore[no-untyped-def]
        """Judge a step without position noise along its path: exit, share, and what is clear at its end."""
        (dt, now), (arrived, ahead, turn, _), (before, room, _) = step, move, clear

        here = pose(scratch.x)
        there = pose(scratch.moved)

        exit, share = GOAL, ahead
        if not arrived:
            exit, share, room = sweep(setup.world, here, there, turn, room)
        if moving:
            hit = sweep_among(setup.world.moving, scratch.watch, (here, there, turn), now, dt, share)
            if hit <= share:
                exit, share = COLLISION, hit
        return exit, share, Clear(before, room, False)

    @part
    def on_swing(setup, tables, scratch, dt, rates, clear, ahead, state):  # type: ignore[no-untyped-def]
        """Judge a step whose noise turns the footprint on its way: exit, share, log probability that no wall was met.

        `clear` is what is free before it, `ahead` after it, as far as is known; it returns the latter, too.
        """
        cov = scaled(rates, dt)
        arena, (before, room, known), (_, left, _) = setup.world, clear, ahead
        room = max(room, before[0]) if known else room
        most = FAR * spread(arena.static, cov, False)
        if min(room, left) > 0.0 and 2.0 * room * left > most:
            return state, INSIDE, 1.0, 0.0, ahead
        here = pose(scratch.x)
        there = pose(scratch.moved)
        left = max(left, clearance(arena.static, there))
        if min(room, left) > 0.0 and 2.0 * room * left > most:
            return state, INSIDE, 1.0, 0.0, Clear(before, left, False)
        after = distances(arena, there)
        ahead = Clear(after, max(left, after[0]), True)
        before = before if known else distances(arena, here)
        state, exit, share, missed = bridge(arena, here, there, before, after, cov, tables.weighed, state, False)
        return state, exit, share, missed, ahead

    @part
    def on_swing_among(setup, tables, scratch, step, rates, state):  # type: ignore[no-untyped-def]
        """Judge such a step among moving obstacles: exit, share, log probability that none was met."""
        (dt, now), world = step, setup.world
        here = pose(scratch.x)
        there = pose(scratch.moved)
        cov = scaled(rates, dt)
        most = spread(world.static, cov, False)
        change = combined(1.0, there, -1.0, here)
        within = math.sqrt(FAR * most) + extent(world.static, change) + world.moving.speed * dt
        if walls_among(world.moving, scratch.watch, here, now, within, scratch.walls)[0] == 0:
            return state, INSIDE, 1.0, 0.0
        rule = (most, tables.weighed)
        state, hit, alive = bridge_among(
            world.moving, scratch.watch, (here, there), now, dt, whole(cov), rule, state, scratch.walls
        )
        return (state, COLLISION, hit, 0.0) if hit <= 1.0 else (state, INSIDE, 1.0, alive)

    @part
    def judge(setup, tables, scratch, step, move, clear, state):  # type: ignore[no-untyped-def]
        dt, now = step
        until = 0.0 if move.arrived else dt
        if not setup.bridge:
            there = pose(scratch.moved)
            exit = end(setup.world, there)
            if moving and clearance_among(setup.world.moving, there, now + dt) <= 0.0:
                exit = COLLISION
            return state, exit, 1.0, until, 0.0, Clear(distances(setup.world, there), clear.least, True)
        if noisy_position:
            return on_bridge(setup, tables, scratch, step, move.rates, clear, state)
        exit, share, after = on_path(setup, scratch, step, move, clear)
        missed = 0.0
        if swings and exit == INSIDE:
            state, exit, share, missed, after = on_swing(setup, tables, scratch, dt, move.rates, clear, after, state)
        if moving and swings and exit == INSIDE:
            state, exit, share, alive = on_swing_among(setup, tables, scratch, step, move.rates, state)
            missed += alive
        return state, exit, share, until, missed, after

    return judge
