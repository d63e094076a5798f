"""One sampled path of any dynamics, under any lead and either exit rule.

A step is Euler-Maruyama's; where no noise acts on the position, the drift is that of the middle of the step's noise, so
that a car moves along the heading it has half-way, as the robot does. Where noise enters through inputs, B = G s, and
the equation is Stratonovich's, so is B (and the drift) that of the middle of the step; the increments y do not change.

That chain steers a car by one control per step, and what it cannot do makes v too high. With fitted steps, the heading
at the end of a step and its mean over the step are therefore drawn together, as those of a Brownian motion are: the
mean is off the middle by -B sway / sqrt(12), `sway` being noise of the same variance that is led likewise. So it is
with any other system whose noise does not act on its position; for a mass that is exact.

Other systems than cars and points are led by a law of any size (`records.law_width`): the noise of a step, m numbers or
with sways 2 m, has the mean (a + K (x - x_ref)) dt and the covariance L L' dt. Where noise acts on the position, steps
end at crossings, up to which only noise of the passive covariance has a likelihood ratio: there L is not used.
Nothing in the problem depends on the time, and noise makes a mass early or late: what counts is the step of the law
whose state is nearest, not the one that would be due. Beyond the last one `Dynamics.homing` takes over.

The control now is the mean of what paths apply on top of the part of their lead that changes fast, which is taken at
the start. Close to walls the linear law of a point among moving bodies changes faster than the optimal control does,
and only `Leads.trust` of it counts as such a part, beside what the walls push.

Where bodies move (`Kind.moving`) something does depend on the time, so that the step that is due counts, and every
system is led by a law. Every step asks the bodies near it, where they are when it begins and when it ends (`among`);
it ends when the motion of one of those that are near a noisy position changes.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.addresses import load_float64
from pirrht.compiled.copies import copy_row, copy_rows
from pirrht.compiled.float32 import ONE, ZERO
from pirrht.compiled.jit import kernel
from pirrht.compiled.linear import solve
from pirrht.compiled.streams import antithetic, fill_normals, normals, stream
from pirrht.geometry.arena import at
from pirrht.geometry.traffic import traffic_clearance
from pirrht.rollouts.among import (
    NEAR,
    SKIN,
    at_moving_wall,
    facing_among,
    look_around,
    met_on_bridge,
    met_on_way,
    with_moving,
)
from pirrht.rollouts.first_exit import (
    COLLISION,
    FAR,
    INSIDE,
    RIM,
    at_crossing,
    bridge_exit,
    distances,
    endpoint_exit,
    facing,
    fitting,
    line_of,
    rim_along,
    two_walls,
    wall_slope,
)
from pirrht.rollouts.first_exit import GOAL as REACHED
from pirrht.rollouts.gates import gate_slope
from pirrht.rollouts.general.kind import SWAY, Kind, diffusion_of, is_gated, takes_law
from pirrht.rollouts.general.law import nearest_of
from pirrht.rollouts.homing import STEEP, homing
from pirrht.rollouts.listed import forget, held_of, listing, surely
from pirrht.rollouts.records import FINER
from pirrht.rollouts.sweep import sweep_exit, sweep_onward, turn_of
from pirrht.rollouts.ways import KNOWN, PLACE, uphill
from pirrht.systems.dynamics import no_drift
from pirrht.systems.heading import wrapped
from pirrht.systems.unicycle import unicycle_drift
from pirrht.topology.cuts import key_of_step
from pirrht.topology.marks import key_among, open_sides

SOON = 1e-6  # a step is no shorter than this where motions change [s]
ABREAST = 8  # steps whose noise is drawn at once
LOST = 60.0  # nats by which a path is less likely under another reference, which then counts for nothing: dQ_g/dQ_h is
# a martingale, so that exp(-60) is also what is expected of it later


class Kept(NamedTuple):
    """What is written of one path; arrays without rows are left alone."""

    ratio: Array  # (H,) log dQ_g/dP under each reference
    states: Array  # (T+1, n)
    applied: Array  # (up to T, m) control carried up to the exit, as a mean over each step
    led_by: Array  # (up to T, m) the lead's part of it
    base: Array  # (m,) the lead's control at the start without the nearest wall


@cache
def any_path(kind: Kind) -> tuple[Any, Any]:
    """Kernels that simulate one path of any dynamics, and that make its scratch."""
    drift, q, n, m, rows, midway = kind.drift, kind.q, kind.n, kind.m, kind.rows, kind.midway
    varying_rate, noisy_position, angles, homing_of = kind.varying_rate, kind.noisy_position, kind.angles, kind.homing
    varying, gaining = kind.diffusion_block is not None, kind.control_block is not None  # B does, and B^-1 G
    drifting = drift is not no_drift
    along_line = rows > m and noisy_position and not drifting  # inputs may move the position to and fro alone
    gain_at: Any = kind.control_block if gaining else drift
    noise_at: Any = diffusion_of(kind) if varying else drift
    fixed = n - rows
    moving = kind.moving
    gated = is_gated(kind)
    turning = drift is unicycle_drift and rows == m == 1 and not moving
    car, leadable = turning and not gaining, takes_law(kind)
    bending = leadable and drifting and not noisy_position
    abreast = leadable and not noisy_position
    most = 2 * m if bending else m  # modes of a step's noise
    losing = leadable or car  # points are simulated in blocks, whose lanes all do the same
    nearest = nearest_of(n, angles)
    isotropic = n == 2 and m == 2  # the noise of a step is its displacement; then an exit cuts both alike

    @kernel
    def covariance(B):  # type: ignore[no-untyped-def]
        """Covariance (xx, xy, yy) of the position per second."""
        xx, xy, yy = 0.0, 0.0, 0.0
        for j in range(m):
            bx = B[0 - fixed, j] if fixed <= 0 else 0.0
            by = B[1 - fixed, j] if fixed <= 1 else 0.0
            xx, xy, yy = xx + bx * bx, xy + bx * by, yy + by * by
        return xx, xy, yy

    @kernel
    def scratch_of(setup, leads):  # type: ignore[no-untyped-def]
        """`one_path`'s: x, moved, f, y, G, D, B, a, aside, pushed, stage, lost, column, carried, of laws, of bodies."""
        H = leads.control.shape[0]
        x, moved, f, y = np.empty(n), np.empty(n), np.empty(n), np.empty(m)
        G, D, B, a = np.zeros((rows, m)), np.empty((m, m)), np.empty((rows, m)), np.empty((H, m))
        aside = np.zeros(H)
        column, carried, wide = np.empty((m, 1)), np.empty((m, 1)), np.zeros((H, 2 * m))
        home, white, drawn, beside = np.zeros(m), np.zeros(2 * m), np.zeros(2 * m), np.zeros(n)
        fresh = np.zeros(ABREAST * 2 * (m + 1))
        stage, lost, pushed = np.empty(H, np.int64), np.empty(H, np.bool_), np.empty(m)
        bodies = setup.traffic.J if moving else 0
        held, listed, near = held_of(bodies), np.empty(bodies, np.int64), np.empty((bodies, NEAR))
        among = held, listed, near, np.empty((leads.marks.weight.shape[0], 2))
        laws = wide, home, white, drawn, beside, fresh
        return x, moved, f, y, G, D, B, a, aside, pushed, stage, lost, column, carried, laws, among

    # One long function: every call with arrays would cost more than most of what stands in this loop.
    @kernel
    def one_path(setup, leads, origin, h, sample, keep, scratch):  # type: ignore[no-untyped-def]
        """Simulate one sample around reference h and write what of it is to be kept (`Kept`).

        Returns work, class key, outcome, steps of the grid taken, time until the exit in the last of them, and the
        logarithm of the probability that no wall was met on the way, where that is weighed.
        """
        ratio, states, applied, led_by, base = keep
        arena, p = at(setup.arena, 0.0), setup.parameters
        goal, radius = arena.goal, arena.radius
        cuts, times, drifts, controls = setup.cuts, leads.times, leads.drift, leads.control
        count, decay, active = leads.ways.count, leads.ways.decay, leads.active
        C, J = leads.ways.slope.shape[1], leads.ways.slope.shape[2]
        place, slope = leads.ways.place.ctypes.data, leads.ways.slope.ctypes.data
        reach, least, weighed = leads.reach, leads.least, leads.weighed
        law, led = leads.law, leads.led
        swaying = turning and least < np.inf
        H, T = controls.shape[0], controls.shape[1]
        weigh, draw, inverse = ratio.shape[0] > 0, states.shape[0] > 0, setup.inverse
        x, moved, f, y, G, D, B, a, aside, pushed, stage, lost, column, carried, laws, among = scratch
        (wide, home, white, drawn, beside, fresh), (held, listed, near, side) = laws, among
        bent = bending and setup.bridge and least < np.inf
        modes = most if bent else m
        slopes, there, shape = modes, modes + modes * n, modes + modes * n + n
        shape_inverse, end = shape + modes * modes, shape + 2 * modes * modes
        even = modes + modes % 2
        weights, rows_at, pitch = end + 2, law.ctypes.data, 8 * law.shape[2]
        copy_rows(setup.gain, D)
        copy_rows(setup.diffusion, B)
        f[:], pushed[:], stage[:] = 0.0, 0.0, 0
        lost[:] = False
        drifted = False  # whether f is that of x already
        copy_row(origin.x, x)
        copy_row(origin.x, moved)
        xx, xy, yy = covariance(B)
        steep = STEEP * D[0, 0]
        first, sign = antithetic(sample, leads.first[h], leads.mirrored)
        state, work, key, lasting = stream(origin.seed, first), 0.0, np.int64(0), 0.0
        owed, last = 0.0, 0  # share of a step of the grid for which half of the guide is missing in `led_by`
        before, room = distances(arena, x[0], x[1]), 0.0
        if moving:
            traffic, marks, begun = setup.traffic, leads.marks, origin.time
            body_key, close = np.int64(marks.opening), 0
            forget(held)
            open_sides(marks, goal, x[0], x[1], side)
        for j in range(n if draw else 0):
            states[0, j] = x[j]
        for i in range(T):
            whole, done, arena = times[i + 1] - times[i], 0.0, at(setup.arena, times[i + 1])
            left = whole
            for j in range(m):
                if i < applied.shape[0]:
                    applied[i, j] = 0.0
                if i < led_by.shape[0]:
                    led_by[i, j] = 0.0
            exit = INSIDE
            while left > 0.0 and exit == INSIDE:
                if varying:
                    noise_at(x, p, inverse, G, B)
                    xx, xy, yy = covariance(B)
                if gaining:
                    gain_at(x, p, G)
                    solve(B, G, D)
                if drifting and not drifted:
                    drift(x, p, f)
                dt = left
                gone, by_body = np.inf, False
                if moving:
                    now = begun + times[i] + done
                    if noisy_position:  # as far as noise carries a path that is not to be split, or walls push
                        within = max(3.0 * math.sqrt(max(xx, yy) * left), 3.0 * reach)
                        if surely(held, traffic.speed, x[0], x[1], now) < within:
                            close = listing(traffic, x[0], x[1], now, within + SKIN, held, listed)
                        gone, until_change = traffic.reach, np.inf
                        if close > 0:
                            gone, until_change = look_around(
                                traffic, listed, close, x[0], x[1], now, within, held, near
                            )
                if noisy_position and least < left:
                    scale = 1.0 / (9.0 * (xx + yy if along_line else max(xx, yy)))
                    gap = before[0]
                    if along_line and gap > 0.0 and scale * gap * gap < left:
                        gap = facing(arena.field, x[0], x[1], (xx, xy, yy))
                    if moving:
                        if along_line and scale * gone * gone < left:
                            gone = facing_among(near, close, (xx, xy, yy))
                        gap = min(gap, gone)
                    narrow = max(min(min(gap, before[1]), max(before[2], RIM * radius)), 0.0)
                    dt = fitting(narrow, left, least, scale)
                    if moving:
                        dt = min(dt, max(until_change - now, SOON))
                if moving and noisy_position:
                    dt = min(dt, max(held[4] - now, SOON))
                left -= dt
                root, until = math.sqrt(dt), dt
                cov = (xx * dt, xy * dt, yy * dt)
                # Survivors lean away from walls anyway: the push is B' grad log of what psi is proportional to there.
                sx, sy = 0.0, 0.0
                walls = (ONE, ZERO, ZERO, ONE, ZERO, ZERO)
                near_walls = noisy_position and reach > 0.0
                if near_walls:
                    c, wx, wy, d, vx, vy = two_walls(arena.field, x[0], x[1])
                    widest = np.float32(0.5 * math.sqrt(max(cov[0], cov[2])))
                    shift = np.float32(leads.beyond)
                    walls = (max(c + shift, widest), wx, wy, max(d + shift, widest), vx, vy)
                    if moving and close > 0:
                        walls = with_moving(walls, near, close, widest)
                        _, wx, wy, _, vx, vy = walls
                    sx, sy = wall_slope(walls[0], wx, wy, walls[3], vx, vy, reach)
                    for j in range(m):
                        bx = B[0 - fixed, j] if fixed <= 0 else 0.0
                        by = B[1 - fixed, j] if fixed <= 1 else 0.0
                        pushed[j] = bx * sx + by * sy
                homeward, headed = np.inf, False  # computed once, if a reference asks for it
                # a_g = B_c^-1 G_c u_g of every reference at this state; of the one followed, if nothing is weighed.
                for g in range(0 if weigh else h, H if weigh else h + 1):
                    lost[g] = lost[g] or (losing and weigh and ratio[g] < ratio[h] - LOST)
                    if lost[g]:  # never of h
                        continue
                    if noisy_position and count[g] > 0:
                        stage[g], sx, sy = uphill(
                            place + 4 * PLACE * g * C, slope + 4 * KNOWN * g * C * J, count[g] - 1, J, decay, goal,
                            stage[g], x[0], x[1], walls,
                        )  # fmt: skip
                        for j in range(m):
                            bx = B[0 - fixed, j] if fixed <= 0 else 0.0
                            by = B[1 - fixed, j] if fixed <= 1 else 0.0
                            a[g, j] = bx * sx + by * sy
                    elif car and led[g] > i:
                        ex, ey = x[0] - law[g, i, 4], x[1] - law[g, i, 5]
                        drive = law[g, i, 0] + law[g, i, 1] * ex + law[g, i, 2] * ey
                        et = wrapped(x[2] - law[g, i, 6])
                        drive += law[g, i, 3] * et
                        a[g, 0] = max(-steep, min(steep, drive))
                        drive = law[g, i, 9] + law[g, i, 10] * ex + law[g, i, 11] * ey + law[g, i, 12] * et
                        aside[g] = max(-steep, min(steep, drive))
                    elif car and led[g] > 0:
                        if homeward == np.inf:
                            bound = D[0, 0] * B[0, 0]
                            homeward = homing(x[0], x[1], x[2], goal[0], goal[1], radius, bound) / B[0, 0]
                        a[g, 0] = homeward
                    elif leadable and led[g] > 0:
                        s = stage[g]
                        if moving:
                            s = min(i * FINER + int(FINER * done / whole + 0.5), law.shape[1] - 1)
                            stage[g] = s
                        elif s < led[g]:
                            row, final = rows_at + pitch * law.shape[1] * g, min(led[g], law.shape[1] - 1)
                            s = nearest(row, pitch, min(s + FINER, final) if i > 0 else s, final, x, there, weights)
                            stage[g] = s
                        if s < led[g]:
                            row = rows_at + pitch * (law.shape[1] * g + s)
                            for k in range(n):
                                beside[k] = x[k] - load_float64(row, there + k)
                                if (angles >> k) & 1:
                                    beside[k] = wrapped(beside[k])
                            for j in range(modes):
                                total = load_float64(row, j)
                                for k in range(n):
                                    total += load_float64(row, slopes + j * n + k) * beside[k]
                                wide[g, j] = total
                            if gated:
                                at_x, at_y = x[0] - law[g, s, there], x[1] - law[g, s, there + 1]
                                sx, sy = gate_slope(law, g, s, end + 2 + n, at_x, at_y)
                                for j in range(m):
                                    wide[g, j] += B[0, j] * sx + B[1, j] * sy
                            for j in range(modes):
                                bound = load_float64(row, end + 1)
                                wide[g, j] = max(-bound, min(bound, wide[g, j]))
                        else:
                            if not headed:
                                homing_of(x, p, B, goal, radius, setup.pace, home)
                                headed = True
                            for j in range(modes):
                                wide[g, j] = home[j] if j < m else 0.0
                        for j in range(m):
                            a[g, j] = wide[g, j]
                    else:
                        for j in range(m):
                            a[g, j] = 0.0
                        for j in range(modes if leadable else 0):
                            wide[g, j] = 0.0
                    if i < active[g]:
                        for j in range(m):
                            a[g, j] += 0.0 if gaining else drifts[g, i, j]
                            for k in range(m if gaining else 0):
                                a[g, j] += D[j, k] * controls[g, i, k]
                    if near_walls and count[g] == 0 and (led[g] == 0 or gated):
                        for j in range(m):
                            a[g, j] += pushed[j]
                if owed > 0.0:  # over a step the guide is the mean of both ends, to second order
                    for j in range(m):
                        column[j, 0] = pushed[j] + leads.trust * (a[h, j] - pushed[j]) if gated else a[h, j]
                    if gaining:
                        solve(D, column, carried)
                    for j in range(m):
                        u = carried[j, 0] if gaining else 0.0
                        for k in range(0 if gaining else m):
                            u += inverse[j, k] * column[k, 0]
                        led_by[last, j] += 0.5 * owed * u
                    owed = 0.0
                if leadable:
                    for j in range(0, 0 if abreast else modes, 2):
                        state, z, other = normals(state)
                        white[j] = sign * z
                        if j + 1 < modes:
                            white[j + 1] = sign * other
                    if abreast:  # several steps at once: no other draws come between theirs
                        if i % ABREAST == 0:
                            state = fill_normals(state, ABREAST * even // 2, fresh)
                        for j in range(modes):
                            white[j] = sign * fresh[(i % ABREAST) * even + j]
                    row = rows_at + pitch * (law.shape[1] * h + stage[h])
                    for j in range(modes):
                        z = white[j]
                        if stage[h] < led[h] and not noisy_position:
                            z = 0.0
                            for k in range(modes):
                                z += load_float64(row, shape + j * modes + k) * white[k]
                        drawn[j] = z * root + (a[h, j] if j < m else wide[h, j]) * dt
                    for j in range(m):
                        y[j] = drawn[j]
                for j in range(0 if leadable else m):
                    if j % 2 == 0:
                        state, z, other = normals(state)
                    else:
                        z = other
                    z *= sign
                    if car and led[h] > i:
                        z *= law[h, i, 7]
                    y[j] = z * root + a[h, j] * dt
                # Where no noise acts on the position, it moves along the heading of the middle of the step, as the
                # robot does; but a step that enters the goal straight ahead ends before its noise matters.
                arrived, ahead, turn, sway, vx, vy = False, 1.0, 0.0, 0.0, f[0], f[1]
                if swaying:
                    sway = sign * other * root
                    if car and led[h] > i:
                        sway = law[h, i, 14] * sway + aside[h] * dt + law[h, i, 13] * (y[0] - a[h, 0] * dt)
                if not noisy_position and setup.bridge:
                    within = radius + math.sqrt(f[0] * f[0] + f[1] * f[1]) * dt
                    if (x[0] - goal[0]) ** 2 + (x[1] - goal[1]) ** 2 < within * within:
                        exit, ahead = sweep_exit(arena, x[0], x[1], x[0] + f[0] * dt, x[1] + f[1] * dt)
                        arrived = exit == REACHED
                    if arrived:
                        until = 0.0
                        for j in range(m):
                            y[j] = 0.0
                    elif drifting:
                        for j in range(n):
                            moved[j] = x[j]
                        for j in range(rows):
                            for k in range(m):
                                moved[fixed + j] += 0.5 * B[j, k] * y[k]
                        if swaying:
                            moved[2] -= B[0, 0] * sway * SWAY
                        for j in range(rows if bent else 0):
                            for k in range(m):
                                moved[fixed + j] -= SWAY * B[j, k] * drawn[m + k]
                        drift(moved, p, f)
                        if swaying:  # the chord of an arc is shorter than the arc
                            turn = B[0, 0] * y[0]
                            for j in range(2):
                                f[j] *= 1.0 - (turn * turn + B[0, 0] * B[0, 0] * dt) / 24.0
                if midway and not arrived:
                    for j in range(n):
                        moved[j] = x[j] + 0.5 * f[j] * dt
                    for j in range(rows):
                        for k in range(m):
                            moved[fixed + j] += 0.5 * B[j, k] * y[k]
                    if varying:
                        noise_at(moved, p, inverse, G, B)
                        xx, xy, yy = covariance(B)
                        cov = (xx * dt, xy * dt, yy * dt)
                    if drifting and (noisy_position or not setup.bridge):
                        drift(moved, p, f)
                for j in range(n):
                    moved[j] = x[j] + f[j] * dt
                for j in range(rows):
                    for k in range(m):
                        moved[fixed + j] += B[j, k] * y[k]
                if bent and not arrived:  # between two steps its velocity changes, and the way is no chord
                    drift(moved, p, f)
                    drifted = True
                    turn = turn_of(vx, vy, f[0], f[1], moved[0] - x[0], moved[1] - x[1], dt)
                # Each cut that is crossed adds a turn to the path's class, counter-clockwise positive.
                key += key_of_step(cuts, x[0], x[1], moved[0], moved[1])
                share = 1.0
                if moving and (setup.bridge or not noisy_position):
                    spread = 0.0
                    if noisy_position:
                        spread = math.sqrt(0.5 * FAR * (cov[0] + cov[2] if along_line else max(cov[0], cov[2])))
                    way = math.sqrt((moved[0] - x[0]) ** 2 + (moved[1] - x[1]) ** 2) + traffic.speed * dt
                    if not noisy_position:
                        way *= 1.0 + abs(turn)
                    if surely(held, traffic.speed, x[0], x[1], now) < way + spread or now + dt > held[4] + SOON:
                        more = np.inf if now + dt > held[4] + SOON and not noisy_position else way + spread + SKIN
                        close = listing(traffic, x[0], x[1], now, more, held, listed)
                        if noisy_position:
                            look_around(traffic, listed, close, x[0], x[1], now, spread, held, near)
                if not setup.bridge:
                    exit, share = endpoint_exit(arena, moved[0], moved[1])
                    if moving and traffic_clearance(setup.traffic, moved[0], moved[1], now + dt) <= 0.0:
                        exit = COLLISION
                    before = distances(arena, moved[0], moved[1])
                elif noisy_position:
                    after = distances(arena, moved[0], moved[1])
                    state, exit, share, missed = bridge_exit(
                        arena, x[0], x[1], moved[0], moved[1], before, after, cov, weighed, state, along_line
                    )
                    if moving and close > 0:
                        state, hit, body, alive = met_on_bridge(
                            traffic, listed, close, near, x[0], x[1], moved[0], moved[1], now, dt, cov, along_line,
                            weighed, state,
                        )  # fmt: skip
                        if hit <= 1.0 and (exit == INSIDE or hit < share):
                            exit, share, by_body = COLLISION, hit, True
                        elif exit != COLLISION:
                            missed += share * alive
                    lasting += missed
                    before = after
                    if isotropic and exit != INSIDE and cov[1] == 0.0 and cov[0] == cov[2]:
                        # Without this the rest of the step would enter dQ/dP as noise with a variance of a'a dt.
                        dx, dy = moved[0] - x[0] - f[0] * dt, moved[1] - x[1] - f[1] * dt
                        if moving and by_body:
                            state, dx, dy = at_moving_wall(
                                near, body, dx, dy, f[0], f[1], dt, share, math.sqrt(cov[0]), state
                            )
                        else:
                            state, dx, dy = at_crossing(
                                arena, x[0], x[1], dx, dy, exit, share, math.sqrt(cov[0]), state
                            )
                        y[0] = (B[0, 0] * dx + B[1, 0] * dy) * dt / cov[0]
                        y[1] = (B[0, 1] * dx + B[1, 1] * dy) * dt / cov[0]
                        moved[0], moved[1] = x[0] + f[0] * dt * share + dx, x[1] + f[1] * dt * share + dy
                        until = dt * share
                    elif along_line and exit == REACHED:
                        ex, ey, alone = line_of(cov)
                        if alone:  # likewise; to the rim along the line, other noise as of a bridge
                            until, size, to_rim = dt * share, xx + yy, rim_along(arena, x[0], x[1], ex, ey)
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
                elif arrived:
                    exit, share = REACHED, ahead
                elif turning:
                    exit, share = sweep_exit(arena, x[0], x[1], moved[0], moved[1], turn)
                else:
                    exit, share, room = sweep_onward(arena, x[0], x[1], moved[0], moved[1], turn, room)
                if moving:
                    if not noisy_position and setup.bridge and close > 0:
                        hit = met_on_way(traffic, listed, close, x[0], x[1], moved[0], moved[1], turn, now, dt, share)
                        if hit <= share:
                            exit, share = COLLISION, hit
                    part = done + (until if until > 0.0 else dt * share)
                    body_key += key_among(marks, goal, i, min(part / whole, 1.0), moved[0], moved[1], side)
                if weigh:
                    for g in range(H):
                        if lost[g]:
                            continue
                        if car and led[g] > i:
                            if until > 0.0:
                                off = (y[0] - a[g, 0] * dt) / law[g, i, 7]
                                ratio[g] += 0.5 * (y[0] * y[0] - off * off) / dt - law[g, i, 8]
                                off = sway - aside[g] * dt - law[g, i, 13] * (y[0] - a[g, 0] * dt)
                                ratio[g] += 0.5 * (sway * sway - (off / law[g, i, 14]) ** 2) / dt
                        elif leadable and not noisy_position and stage[g] < led[g]:
                            if until > 0.0:
                                gained, row = 0.0, rows_at + pitch * (law.shape[1] * g + stage[g])
                                for j in range(modes):
                                    white[j] = drawn[j] - (a[g, j] if j < m else wide[g, j]) * dt
                                for j in range(modes):
                                    off = 0.0
                                    for k in range(modes):
                                        off += load_float64(row, shape_inverse + j * modes + k) * white[k]
                                    gained += drawn[j] * drawn[j] - off * off
                                ratio[g] += 0.5 * gained / dt - load_float64(row, end)
                        else:
                            for j in range(m):
                                ratio[g] += a[g, j] * (y[j] - 0.5 * a[g, j] * until)
                if i < applied.shape[0]:
                    for j in range(m):
                        column[j, 0] = y[j]
                    if gaining:
                        solve(D, column, carried)
                    for j in range(m):
                        u = carried[j, 0] if gaining else 0.0
                        for k in range(0 if gaining else m):
                            u += inverse[j, k] * y[k]
                        applied[i, j] += u / whole
                if i < led_by.shape[0]:
                    for part in range(2 if i == 0 and done == 0.0 else 1):
                        for j in range(m):
                            column[j, 0] = pushed[j] + leads.trust * (a[h, j] - pushed[j]) if gated else a[h, j]
                            if part == 1 and near_walls:
                                column[j, 0] -= pushed[j]
                        if gaining:
                            solve(D, column, carried)
                        for j in range(m):
                            u = carried[j, 0] if gaining else 0.0
                            for k in range(0 if gaining else m):
                                u += inverse[j, k] * column[k, 0]
                            if part == 1:
                                base[j] = u
                            else:
                                led_by[i, j] += (0.5 if near_walls and exit == INSIDE else 1.0) * u * until / whole
                    if near_walls and exit == INSIDE:
                        owed, last = until / whole, i
                work += (q(x, p) if varying_rate else setup.rate) * dt * share
                done += until
                for j in range(n):
                    x[j] = moved[j]
            for j in range(n if draw else 0):
                states[i + 1, j] = x[j]
            if moving and (exit != INSIDE or i + 1 == T):
                key += body_key
            if exit != INSIDE:
                return work, key, exit, i + 1, done, lasting
        return work, key, 0, T, times[T] - times[T - 1], lasting

    return one_path, scratch_of
