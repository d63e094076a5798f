"""Simulate one path of any dynamics, under any proposal control and either exit rule.

Steps are Euler-Maruyama's. Where no noise acts on the position, the drift is that of the middle of the step's noise: a
car moves along the heading it has half-way. A Stratonovich equation takes B and drift of the middle too; the increments
y stay. One control per step would make v too high, so fitted steps draw the state at their end and its mean over the
step together: the mean is off the middle by -B sway / sqrt(12), `sway` being led noise of the same variance. For a mass
that is exact.

Systems other than points follow a law (`records.law_width`): the noise of a step, m numbers or with sways 2 m,
has the mean (a + K (x - x_ref)) dt and the covariance L L' dt. Where noise acts on the position, steps end at
crossings, up to which only passive noise has a likelihood ratio: there L is not used. Without moving obstacles the
nearest state's step counts, since noise moves a mass early or late; with them (`moving`) the step that is due.
Beyond the last step `Dynamics.homing` takes over.

The control now is the mean of what paths apply on top of the fast-changing part of their lead, which is taken at the
start. Among moving obstacles that is only a share of a point's linear law (`counted`), since close to walls the
law changes faster than the optimal control, and mostly nothing of a steady one (`guidance.near_walls`). Every step
queries the moving obstacles near it (`among`); it ends when the motion of one changes that is near a noisy position.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import borrowing, load_float64, part
from pirrht.jit.streams import antithetic, stream
from pirrht.jit.vectors import copy_row, copy_rows, solve
from pirrht.moving.broad_phase import begin_list
from pirrht.moving.exits import look_anew
from pirrht.rollouts.first_exit import INSIDE, distances
from pirrht.rollouts.general.exits import exits
from pirrht.rollouts.general.kind import KernelSpec, diffusion_of, is_gated, is_steady, takes_law
from pirrht.rollouts.general.law import aims, columns_of, rows_of
from pirrht.rollouts.general.scratch import ABREAST, scratch_for
from pirrht.rollouts.general.step import NO_WALLS, covariance_of, length_for, motion, noise_for, walls_for
from pirrht.topology.crossings import key_of_step
from pirrht.topology.moving_crossings import key_among, open_sides


@cache
def log_ratios(kind: KernelSpec) -> Any:
    """Build the kernel that adds a step to log dQ_g/dP (H,), up to the time `until` at which a path leaves."""
    n, m, noisy_position, leadable = kind.n, kind.m, kind.noisy_position, takes_law(kind)

    _, _, matvec, axpy = rows_of(n, m, kind.modes)

    @part
    def add_log_ratios(keep, leads, scratch, h, i, dt, until, modes):  # type: ignore[no-untyped-def]
        ratio = keep.ratio
        law, led, y, drawn, a = leads.law, leads.led, scratch.y, scratch.drawn, scratch.a
        wide, white = scratch.wide, scratch.white
        wide_at = wide.ctypes.data
        _, _, _, inverse, end = columns_of(n, modes)
        rows_at, pitch = law.ctypes.data, 8 * law.shape[2]
        for g in range(ratio.shape[0]):
            if scratch.lost[g]:
                continue
            if leadable and not noisy_position and scratch.stage[g] < led[g]:
                if until > 0.0:
                    gained, row = 0.0, rows_at + pitch * (law.shape[1] * g + scratch.stage[g])
                    noise, size = scratch.fresh.ctypes.data + 8 * (modes + modes % 2) * (i % ABREAST), dt
                    if g != h:  # from what was drawn under h, the noise that g would have had to draw
                        axpy(white.ctypes.data, drawn.ctypes.data, 1.0, wide_at + 8 * wide.shape[1] * g, -dt, modes)
                        matvec(scratch.off.ctypes.data, row + 8 * inverse, white.ctypes.data, modes)
                        noise, size = scratch.off.ctypes.data, 1.0
                    for j in range(modes):
                        one = load_float64(noise, j)
                        gained += drawn[j] * drawn[j] - size * one * one
                    ratio[g] += 0.5 * gained / dt - load_float64(row, end)
            else:
                for j in range(m):
                    ratio[g] += a[g, j] * (y[j] - 0.5 * a[g, j] * until)

    return add_log_ratios


@cache
def recorder(kind: KernelSpec) -> Any:
    """Build kernels that add a step's control, and its lead's part, to means over steps of the grid.

    Where walls push, the lead over a step is the mean of both ends, to second order: the next step adds the second half
    (`owed`). Among moving obstacles a share `counted` of a point's law is taken, of a steady one of what walls push.
    """
    m, noisy_position, state_dependent_gain = kind.m, kind.noisy_position, kind.state_dependent_gain
    gated, steady = is_gated(kind), is_steady(kind)

    @part
    def to_controls(scratch, inverse):  # type: ignore[no-untyped-def]
        """Turn `column`, of a, into controls, in `carried`."""
        column, carried = scratch.column, scratch.carried
        if state_dependent_gain:
            solve(scratch.D, column, carried)
        else:
            for j in range(m):
                carried[j, 0] = 0.0
                for k in range(m):
                    carried[j, 0] += inverse[j, k] * column[k, 0]

    @part
    def taken(scratch, h, counted, without):  # type: ignore[no-untyped-def]
        """Write the fast-changing part of the lead to `column`, perhaps without what walls push."""
        pushed, a = scratch.pushed, scratch.a
        for j in range(m):
            pushing = counted * pushed[j] if steady else pushed[j]
            scratch.column[j, 0] = pushing + counted * (a[h, j] - pushed[j]) if gated else a[h, j]
            if without:
                scratch.column[j, 0] -= pushing

    @part
    def relax(led_by, inverse, scratch, h, counted, owed, last):  # type: ignore[no-untyped-def]
        """Add the half owed to the last step."""
        if owed > 0.0:
            taken(scratch, h, counted, False)
            to_controls(scratch, inverse)
            for j in range(m):
                led_by[last, j] += 0.5 * owed * scratch.carried[j, 0]

    @part
    def record(keep, inverse, scratch, leads, h, where, until, inside):  # type: ignore[no-untyped-def]
        """Add a step of `until` seconds, of a path's first one also the lead without walls; return the share owed."""
        (i, whole, first), carried, near_walls = where, scratch.carried, noisy_position and leads.reach > 0.0
        owes = near_walls and inside and i < keep.led_by.shape[0]
        if i < keep.applied.shape[0]:
            for j in range(m):
                scratch.column[j, 0] = scratch.y[j]
            to_controls(scratch, inverse)
            for j in range(m):
                keep.applied[i, j] += carried[j, 0] / whole
        if i < keep.led_by.shape[0]:
            taken(scratch, h, leads.counted, False)
            to_controls(scratch, inverse)
            for j in range(m):
                keep.led_by[i, j] += (0.5 if owes else 1.0) * carried[j, 0] * until / whole
            if first:
                taken(scratch, h, leads.counted, near_walls)
                to_controls(scratch, inverse)
                for j in range(m):
                    keep.base[j] = carried[j, 0]
        return until / whole if owes else 0.0

    return relax, record


class Kept(NamedTuple):
    """Outputs of one path; arrays without rows are left alone."""

    ratio: Array  # (H,) log dQ_g/dP under each reference
    states: Array  # (T+1, n)
    applied: Array  # (up to T, m) control carried up to the exit, as a mean over each step
    led_by: Array  # (up to T, m) the lead's part of it
    base: Array  # (m,) the lead's control at the start without the nearest wall


@cache
def any_path(kind: KernelSpec) -> tuple[Any, Any]:
    """Build kernels that simulate one path of any dynamics, and that make its scratch."""
    drift, q, n, m, noisy_position = kind.drift, kind.q, kind.n, kind.m, kind.noisy_position
    varying, varying_rate, state_dependent_gain = kind.varying, kind.varying_rate, kind.state_dependent_gain
    drifting, curved_step, moving, most = kind.drifting, kind.curved_step, kind.moving, kind.modes
    gain_at: Any = kind.control_block if state_dependent_gain else drift
    noise_at: Any = diffusion_of(kind) if varying else drift
    covariance, move = covariance_of(kind), motion(kind)
    length_of, push_of, draw = length_for(kind), walls_for(kind), noise_for(kind)
    aim, judge, add_log_ratios = aims(kind), exits(kind), log_ratios(kind)
    relax, record = recorder(kind)

    @part
    def begin(setup, leads, origin, keep, scratch, arena):  # type: ignore[no-untyped-def]
        """Set the scratch to the start of a path."""
        x = scratch.x
        copy_rows(setup.gain, scratch.D)
        copy_rows(setup.diffusion, scratch.B)
        scratch.f[:], scratch.pushed[:], scratch.stage[:] = 0.0, 0.0, 0
        scratch.lost[:] = False
        copy_row(origin.x, x)
        copy_row(origin.x, scratch.moved)
        if moving:
            begin_list(scratch.held)
            look_anew(scratch.near)
            open_sides(leads.marks, arena.goal, x[0], x[1], scratch.side, scratch.spot)
        for j in range(n if keep.states.shape[0] > 0 else 0):
            keep.states[0, j] = x[j]

    @part
    def clear(keep, i):  # type: ignore[no-untyped-def]
        """Set the records of a step of the grid to zero."""
        for j in range(m):
            if i < keep.applied.shape[0]:
                keep.applied[i, j] = 0.0
            if i < keep.led_by.shape[0]:
                keep.led_by[i, j] = 0.0

    @part
    def look(setup, scratch, rates, drifted):  # type: ignore[no-untyped-def]
        """Find B, B^-1 G and the drift at a state; the covariance of the position per second."""
        x, p, B, D = scratch.x, setup.parameters, scratch.B, scratch.D
        if varying:
            noise_at(x, p, setup.inverse, scratch.G, B)
            rates = covariance(B)
        if state_dependent_gain:
            gain_at(x, p, scratch.G)
            solve(B, scratch.G, D)
        if drifting and not drifted:
            drift(x, p, scratch.f)
        return rates

    @part
    def prepare(setup, leads, scratch, known, before, left, now, i):  # type: ignore[no-untyped-def]
        """Evaluate the state: covariance per second, the step's length, moving obstacles near, the nearest walls."""
        rates, drifted, close, walls = known
        rates = look(setup, scratch, rates, drifted)
        dt, close = length_of(setup, leads, scratch, rates, before, left, now, i, close)
        if noisy_position and leads.reach > 0.0:
            walls = push_of(leads, scratch, setup.world, (rates[0] * dt, rates[1] * dt, rates[2] * dt), close)
        return rates, dt, close, walls

    @part
    def turned(setup, leads, scratch, i, share):  # type: ignore[no-untyped-def]
        """Return the additive key of moving obstacles that are passed by a share of step i of the grid."""
        if not moving:
            return np.int64(0)
        moved = scratch.moved
        goal, end = setup.world.goal, min(share, 1.0)
        return key_among(leads.marks, goal, i, end, moved[0], moved[1], scratch.side, scratch.spot)

    @borrowing
    def one_path(setup, leads, origin, h, sample, keep, scratch):  # type: ignore[no-untyped-def]
        """Simulate one sample around reference h and write `Kept`.

        Returns work, class key, outcome, steps of the grid taken, time until the exit in the last of them, and the log
            probability that no wall was met on the way, where that is weighed.
        """
        arena, times, x, moved = setup.world, leads.times, scratch.x, scratch.moved
        T, bent = leads.control.shape[1], curved_step and setup.bridge and leads.least < np.inf
        modes = most if bent else m
        begin(setup, leads, origin, keep, scratch, arena)
        first, sign = antithetic(sample, leads.first[h], leads.mirrored)
        state, work, key, log_survival = stream(origin.seed, first), 0.0, np.int64(0), 0.0
        owed, last = 0.0, 0  # share of a step of the grid for which half of the guide is missing in `led_by`
        known, before, room = (covariance(scratch.B), False, 0, NO_WALLS), distances(arena, x[0], x[1]), 0.0
        body_key = np.int64(leads.marks.opening if moving else 0)
        for i in range(T):
            whole, done = times[i + 1] - times[i], 0.0
            left, exit = whole, INSIDE
            clear(keep, i)
            while left > 0.0 and exit == INSIDE:
                now, where = origin.time + times[i] + done, (i, whole, i == 0 and done == 0.0)
                rates, dt, close, walls = prepare(setup, leads, scratch, known, before, left, now, i)
                left -= dt
                aim(setup, leads, scratch, keep.ratio, walls, h, i, done / whole, modes)
                relax(keep.led_by, setup.inverse, scratch, h, leads.counted, owed, last)
                state = draw(leads, scratch, state, sign, h, i, dt, modes)
                way = move(setup, leads, scratch, dt, rates, bent)
                # Each cut that is crossed adds a turn to the path's class, counter-clockwise positive.
                key += key_of_step(setup.cuts, x[0], x[1], moved[0], moved[1])
                state, exit, share, until, missed, before, room, close = judge(
                    setup, leads, scratch, arena, dt, now, i, way, before, room, close, state
                )
                known = way[3], bent and not way[0], close, walls
                body_key += turned(setup, leads, scratch, i, (done + (until if until > 0.0 else dt * share)) / whole)
                add_log_ratios(keep, leads, scratch, h, i, dt, until, modes)
                owed = record(keep, setup.inverse, scratch, leads, h, where, until, exit == INSIDE)
                last, log_survival = i, log_survival + missed
                work += (q(x, setup.parameters) if varying_rate else setup.rate) * dt * share
                done += until
                copy_row(moved, x)
            for j in range(n if keep.states.shape[0] > 0 else 0):
                keep.states[i + 1, j] = x[j]
            if exit != INSIDE:
                return work, key + body_key, exit, i + 1, done, log_survival
        return work, key + body_key, 0, T, times[T] - times[T - 1], log_survival

    return one_path, scratch_for(kind)
