"""Compiled local optimisation of a car's trajectory, and the linear feedback that holds noisy paths near it.

Differential dynamic programming (Mayne, Int. J. Control 1966) on the steps of rollouts: theta' = theta + g u dt, and
the position moves by V dt along the heading in between. The running cost is q + R u^2 / 2 and a price on clearances
that noise would use up. The quadratic model of the cost-to-go yields u = u_ref + K (x - x_ref).

Where a car sways, its control is u + 2 sqrt(3) r (t / dt - 1/2) at t within a step. That costs R (u^2 + r^2) / 2 per
second and turns the way by -g r dt / sqrt(12) more. The best r is linear in the state and u. A step is then the arc
over its chord, which is shorter by a share of (g u dt)^2 / 24.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import entry_of_piece
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.proposals.clearance_cost import price
from pirrht.rollouts.first_exit import COLLISION
from pirrht.rollouts.general.law import STEEP, homing
from pirrht.rollouts.sweep import sweep_exit
from pirrht.systems.heading import wrapped
from pirrht.topology.cuts import key_of_segment

ACROSS = 1.0 / math.sqrt(3.0)  # turn of the path by sway, as a share of half a step's turn by as much control
LEAST_CURVATURE = 0.2  # Q_uu is kept above this share of R dt, so that gains stay finite
HALVINGS = 6  # of the step of a line search


class Car(NamedTuple):
    """Numbers of a problem with unicycle dynamics that guides are optimised for."""

    speed: float  # V [m/s]
    gain: float  # g = 1/rho, turn rate per control [rad/s]
    effort: float  # R [cost/s]
    rate: float  # q [cost/s]
    margin: float  # clearance below which a point costs something [m]
    least: float  # clearance below which the barrier goes on as a parabola [m]
    price: float  # cost rate of the barrier at a clearance of 1 m [cost/s]
    spacing: float  # at most, of the points of a step whose clearance is priced [m]
    tolerance: float  # an expected gain below this ends the iterations [cost]
    sways: bool  # whether the control may rise or fall within a step


class Course(NamedTuple):
    """Trajectory of T steps and the feedback around it; kernels write into it."""

    states: Array  # (T+1, 3) x, y [m] and theta [rad]; its first row is the start
    control: Array  # (T,) u, a turn rate in units of the car's gain
    gains: Array  # (T, 3) K of u = control + K (x - states) [1/m], [1/m], [1/rad]
    spread: Array  # (T,) standard deviation left to the noise by the later cost, as a share of the passive one
    change: Array  # (T,) the best change of each control
    sway: Array  # (T,) r, by which the control rises over each step, over sqrt(12)
    sway_gains: Array  # (T, 4) of r = sway + sway_gains (x - states, u - control) [1/m], [1/m], [1/rad], [1]
    sway_spread: Array  # (T,) share left of the standard deviation of the noise of r
    sway_change: Array  # (T,) the best change of each sway


def empty_course(T: int) -> Course:
    """Return a course of T steps from zeros, states (T+1, 3) [m], [rad] included; its noise is the passive one."""
    none = np.zeros(T)
    return Course(
        states=np.zeros((T + 1, 3)), control=none.copy(), gains=np.zeros((T, 3)), spread=np.ones(T), change=none.copy(),
        sway=none.copy(), sway_gains=np.zeros((T, 4)), sway_spread=np.ones(T), sway_change=none.copy(),
    )  # fmt: skip


@kernel
def class_of(setup, states, length):  # type: ignore[no-untyped-def]
    """Return the additive class key of the first `length` steps of states (T+1, 3) [m], by the cuts of rollouts."""
    key = np.int64(0)
    for i in range(length):
        key += key_of_segment(setup.cuts, states[i, 0], states[i, 1], states[i + 1, 0], states[i + 1, 1])
    return key


@kernel
def is_free(setup, car, states, length):  # type: ignore[no-untyped-def]
    """Check that the first `length` steps of states (T+1, 3) [m], [rad], lines or arcs, touch nothing."""
    for i in range(length):
        turn = states[i + 1, 2] - states[i, 2] if car.sways else 0.0
        outcome, _ = sweep_exit(setup.arena, states[i, 0], states[i, 1], states[i + 1, 0], states[i + 1, 1], turn)
        if outcome == COLLISION:
            return False
    return True


@inlined
def _points(car, dt):  # type: ignore[no-untyped-def]
    """Return the number of points at which the clearance of a step is priced; its end is the last."""
    return max(1, math.ceil(car.speed * dt / car.spacing - 1e-9))


@inlined
def _way(car, theta, u, r, dt):  # type: ignore[no-untyped-def]
    """Return the velocity (x, y) [m/s] along the chord of a step, and half the angle of its arc [rad]."""
    half = 0.5 * car.gain * u * dt
    if not car.sways:
        return car.speed * math.cos(theta + half), car.speed * math.sin(theta + half), 0.0
    middle, speed = theta + half - 0.5 * car.gain * r * dt * ACROSS, car.speed * (1.0 - half * half / 6.0)
    return speed * math.cos(middle), speed * math.sin(middle), half


@kernel
def forward_pass(setup, car, times, course, length, step, tried):  # type: ignore[no-untyped-def]
    """Drive from the start under u = control + step * change + K (x - states); past `length` towards the goal centre.

    States (T+1, 3) [m], [rad], controls and sways (T,) go to `tried`, whose first state is the start; `times` (T+1,)
    [s].
    Returns: steps that end outside the goal (-1 if it is never entered), cost, cost with clearance priced [cost].
    """
    (gx, gy), radius, field = setup.arena.goal, setup.arena.radius, setup.arena.field
    nominal, control, gains, _, change, sway, sway_gains, _, sway_change = course
    states, applied, swayed = tried.states, tried.control, tried.sway
    x, y, theta = states[0, 0], states[0, 1], states[0, 2]
    cost, priced = 0.0, 0.0
    for i in range(times.shape[0] - 1):
        dt = times[i + 1] - times[i]
        s = entry_of_piece(x, y, theta, 0.0, car.speed * dt, gx, gy, radius)
        if s < np.inf:
            share = car.rate * s / car.speed
            applied[i], swayed[i] = 0.0, 0.0
            return i, cost + share, priced + share
        r = 0.0
        if i < length:
            ex, ey, et = x - nominal[i, 0], y - nominal[i, 1], wrapped(theta - nominal[i, 2])
            u = control[i] + step * change[i]
            u += gains[i, 0] * ex + gains[i, 1] * ey
            u += gains[i, 2] * et
            r = sway[i] + step * sway_change[i] + sway_gains[i, 3] * (u - control[i])
            r = max(-STEEP, min(STEEP, r + sway_gains[i, 0] * ex + sway_gains[i, 1] * ey + sway_gains[i, 2] * et))
        else:
            u = homing(x, y, theta, gx, gy, radius, car.gain) / car.gain
        u = max(-STEEP, min(STEEP, u))
        applied[i], swayed[i] = u, r
        running = (car.rate + 0.5 * car.effort * u * u + 0.5 * car.effort * r * r) * dt
        cost, priced = cost + running, priced + running
        dx, dy, half = _way(car, theta, u, r, dt)
        points = _points(car, dt)
        for k in range(1, points + 1):
            t = dt * k / points
            aside = half * t * (1.0 - t / dt)
            at, to = x + t * dx + aside * dy, y + t * dy - aside * dx
            priced += car.price * price(field, car.margin, car.least, at, to, False)[0] * dt / points
        x, y, theta = x + dx * dt, y + dy * dt, theta + car.gain * u * dt
        states[i + 1, 0], states[i + 1, 1], states[i + 1, 2] = x, y, theta
    return -1, np.inf, np.inf


@kernel
def _arrival(setup, car, x, y, theta):  # type: ignore[no-untyped-def]
    """Expand the cost q s / V of the way s to the goal's rim straight ahead: gradient (3), Hessian (6) in the state."""
    (gx, gy), radius = setup.arena.goal, setup.arena.radius
    tx, ty = math.cos(theta), math.sin(theta)
    along = (gx - x) * tx + (gy - y) * ty
    off = max(radius * radius - (gx - x) ** 2 - (gy - y) ** 2 + along * along, 1e-4 * radius * radius)
    s = along - math.sqrt(off)
    nx, ny = (x + s * tx - gx) / radius, (y + s * ty - gy) / radius
    head, side = nx * tx + ny * ty, -nx * ty + ny * tx
    head = min(head, -0.05)
    sx, sy, st = -nx / head, -ny / head, -s * side / head
    # The hit point moves by h = [I, s t'] + t (sx, sy, st); differentiating |hit - g|^2 = r^2 twice gives the Hessian.
    h00, h01, h02 = 1.0 + tx * sx, tx * sy, -s * ty + tx * st
    h10, h11, h12 = ty * sx, 1.0 + ty * sy, s * tx + ty * st
    scale = -1.0 / (radius * head)
    xx = scale * (h00 * h00 + h10 * h10)
    xy = scale * (h00 * h01 + h10 * h11)
    yy = scale * (h01 * h01 + h11 * h11)
    xt = scale * (h00 * h02 + h10 * h12 + radius * side * sx)
    yt = scale * (h01 * h02 + h11 * h12 + radius * side * sy)
    tt = scale * (h02 * h02 + h12 * h12 + radius * (2.0 * side * st - s * head))
    w = car.rate / car.speed
    return w * sx, w * sy, w * st, w * xx, w * xy, w * xt, w * yy, w * yt, w * tt


@kernel
def backward_pass(setup, car, times, course, length, damping):  # type: ignore[no-untyped-def]
    """Backward pass: the best change of each control and its feedback gains; returns the gain expected [cost].

    It writes the first `length` rows of change (T,), gains (T, 3), spread (T,) and those of the sway; `times` (T+1,)
    are ends of steps [s], `damping` is added to the controls' curvature, as a share of R dt.
    """
    field = setup.arena.field
    states, control, gains, spread, change, sway, sway_gains, sway_spread, sway_change = course
    x, y, theta = states[length, 0], states[length, 1], states[length, 2]
    v0, v1, v2, s00, s01, s02, s11, s12, s22 = _arrival(setup, car, x, y, theta)
    expected = 0.0
    for i in range(length - 1, -1, -1):
        dt = times[i + 1] - times[i]
        h = 0.5 * car.gain * dt
        x, y = states[i, 0], states[i, 1]
        dx, dy, half = _way(car, states[i, 2], control[i], sway[i], dt)
        a, b = -dy * dt, dx * dt  # how the next position moves with the heading in between
        # First the cost-to-go as a function of x, y, the heading t in between and the next heading v2 belongs to.
        g0, g1, gt = v0, v1, a * v0 + b * v1
        m00, m01, m11 = s00, s01, s11
        m0t, m1t = a * s00 + b * s01, a * s01 + b * s11
        mtt = a * m0t + b * m1t - (v0 * dx + v1 * dy) * dt
        cross = a * s02 + b * s12
        points, bowing = _points(car, dt), 0.0
        for k in range(1, points + 1):
            t = dt * k / points
            bulge = t * (1.0 - t / dt)
            aside = half * bulge
            at, to = x + t * dx + aside * dy, y + t * dy - aside * dx
            value, px, py, xx, xy, yy = price(field, car.margin, car.least, at, to, False)
            if value > 0.0:
                w = car.price * dt / points
                bowing += w * h * bulge * (px * dy - py * dx)
                jx, jy = aside * dx - t * dy, t * dx + aside * dy
                g0, g1, gt = g0 + w * px, g1 + w * py, gt + w * (px * jx + py * jy)
                m00, m01, m11 = m00 + w * xx, m01 + w * xy, m11 + w * yy
                m0t, m1t = m0t + w * (xx * jx + xy * jy), m1t + w * (xy * jx + yy * jy)
                mtt += w * (xx * jx * jx + 2.0 * xy * jx * jy + yy * jy * jy - t * (px * dx + py * dy))
        # Then as a function of x, y, theta and u: t = theta + h u, and the next heading is theta + 2 h u.
        q0, q1, q2 = g0, g1, gt + v2
        m02, m12, m22 = m0t + s02, m1t + s12, mtt + 2.0 * cross + s22
        c0, c1 = h * (m0t + 2.0 * s02), h * (m1t + 2.0 * s12)
        c2 = h * (mtt + 3.0 * cross + 2.0 * s22)
        slope = car.effort * control[i] * dt + h * (gt + 2.0 * v2)
        bow = car.effort * dt * (1.0 + damping) + h * h * (mtt + 4.0 * cross + 4.0 * s22)
        least = LEAST_CURVATURE * car.effort * dt
        if car.sways:
            shorter = -h * h / 3.0 * (v0 * dx + v1 * dy) * dt
            slope, bow = slope + bowing + shorter * control[i], bow + shorter
            # And as a function of r, which turns t alone: the best r for every x, y, theta and u is put in its place.
            lever = -h * ACROSS
            e0, e1, e2 = lever * m0t, lever * m1t, lever * (mtt + cross)
            rise, both = car.effort * sway[i] * dt + lever * gt, lever * h * (mtt + 2.0 * cross)
            stiff = max(car.effort * dt * (1.0 + damping) + lever * lever * mtt, least)
            sway_change[i], sway_spread[i] = -rise / stiff, math.sqrt(min(1.0, car.effort * dt / stiff))
            l0, l1, l2, lu = -e0 / stiff, -e1 / stiff, -e2 / stiff, -both / stiff
            sway_gains[i, 0], sway_gains[i, 1], sway_gains[i, 2], sway_gains[i, 3] = l0, l1, l2, lu
            expected -= 0.5 * rise * sway_change[i]
            q0, q1, q2 = q0 + sway_change[i] * e0, q1 + sway_change[i] * e1, q2 + sway_change[i] * e2
            m00, m01, m02, m11, m12, m22 = (
                m00 + e0 * l0, m01 + e0 * l1, m02 + e0 * l2, m11 + e1 * l1, m12 + e1 * l2, m22 + e2 * l2,
            )  # fmt: skip
            c0, c1, c2 = c0 + lu * e0, c1 + lu * e1, c2 + lu * e2
            slope, bow = slope + both * sway_change[i], bow + both * lu
        bow = max(bow, least)
        step = -slope / bow
        k0, k1, k2 = -c0 / bow, -c1 / bow, -c2 / bow
        change[i], gains[i, 0], gains[i, 1], gains[i, 2] = step, k0, k1, k2
        spread[i] = math.sqrt(min(1.0, car.effort * dt / bow))
        expected -= 0.5 * slope * step
        # With the bow above as the curvature in u, the best response leaves the Schur complement.
        v0, v1, v2 = q0 + c0 * step, q1 + c1 * step, q2 + c2 * step
        s00, s01, s02 = m00 + c0 * k0, m01 + c0 * k1, m02 + c0 * k2
        s11, s12, s22 = m11 + c1 * k1, m12 + c1 * k2, m22 + c2 * k2
    return expected


COURSE: Any = Course


@kernel
def optimise(setup, car, times, key, rounds, course, length):  # type: ignore[no-untyped-def]
    """Improve a trajectory of class `key` in place; it never leaves its class, nor the free space in its class, again.

    Args:
        times: (T+1,) ends of the steps [s].
        key: additive class key that the result must have.
        rounds: at most so many backward passes.
        course: the trajectory followed, its gains used until the first backward pass; overwritten.
        length: steps that it prescribes.

    Returns: steps that end outside the goal (-1: it does not get there), cost, cost with clearance priced [cost],
        backward passes, whether it is of its class and touches nothing.
    """
    states, control, sway = course.states, course.control, course.sway
    T = control.shape[0]
    other, tried, swayed = np.zeros((T + 1, 3)), np.zeros(T), np.zeros(T)
    trial = COURSE(
        other, tried, course.gains, course.spread, course.change, swayed, course.sway_gains, course.sway_spread,
        course.sway_change,
    )  # fmt: skip
    copy_row(states[0], other[0])
    steps, cost, priced = forward_pass(setup, car, times, course, length, 0.0, trial)
    if steps < 0:
        return -1, np.inf, np.inf, 0, False
    copy_row(tried, control)
    copy_row(swayed, sway)
    copy_rows(other, states)
    right = class_of(setup, states, steps) == key
    sound = right and is_free(setup, car, states, steps)
    damping, done, again = 0.0, 0, False
    for _ in range(rounds):
        done += 1
        expected = backward_pass(setup, car, times, course, steps, damping)
        if expected < car.tolerance:
            break
        better, step = False, 1.0
        for _ in range(HALVINGS):
            n, c, p = forward_pass(setup, car, times, course, steps, step, trial)
            if n >= 0 and p < priced - 0.1 * step * expected:
                same = class_of(setup, other, n) == key
                clear = same and is_free(setup, car, other, n)
                if clear or (not sound and (same or not right)):
                    better, right, sound, steps, cost, priced = True, same, clear, n, c, p
                    break
            step *= 0.5
        if better:
            copy_row(tried, control)
            copy_row(swayed, sway)
            copy_rows(other, states)
            damping = 0.0 if damping < 0.01 else damping / 8.0
            again = damping > 0.0
        else:
            damping = max(0.1, 8.0 * damping)
            if damping > 1e4:
                if not again:
                    break
                damping, again = 0.0, False  # steps that were too long where the damping rose may not be so here
    backward_pass(setup, car, times, course, steps, 0.0)
    return steps, cost, priced, done, sound
