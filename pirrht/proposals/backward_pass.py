"""Backward pass of the optimisation: a quadratic model of the cost-to-go, the best response to it and its feedback.

A step leads from x (n,) under a change of its noise (modes,) to J (n, n + modes) of both; v (n,) and W (n, n) are
gradient and Hessian of the cost-to-go, g and Q those of it before the step, of state and noise.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import borrowing, inlined, kernel, part
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.proposals.clearance_cost import clearance_costs
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.tuning import TUNING
from pirrht.rollouts.general.kind import KernelSpec


@borrowing
def diagonalise(A, vectors):  # type: ignore[no-untyped-def]
    """Write the eigenvalues of symmetric A (m, m) to its diagonal, by Jacobi's rotations; `vectors` (m, m) in columns.

    The rest of A is scratch.
    """
    m = A.shape[0]
    for i in range(m):
        for j in range(m):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(TUNING.jacobi_sweeps):
        off, size = 0.0, 0.0
        for i in range(m):
            size += A[i, i] * A[i, i]
            for j in range(i):
                off += A[i, j] * A[i, j]
        if off <= 1e-28 * size:
            return
        for i in range(m):
            for j in range(i):
                if A[i, j] == 0.0:
                    continue
                half = 0.5 * (A[j, j] - A[i, i]) / A[i, j]
                t = (1.0 if half >= 0.0 else -1.0) / (abs(half) + math.sqrt(half * half + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(m):
                    A[k, i], A[k, j] = c * A[k, i] - s * A[k, j], s * A[k, i] + c * A[k, j]
                for k in range(m):
                    A[i, k], A[j, k] = c * A[i, k] - s * A[j, k], s * A[i, k] + c * A[j, k]
                for k in range(m):
                    one, other = vectors[k, i], vectors[k, j]
                    vectors[k, i], vectors[k, j] = c * one - s * other, s * one + c * other


@borrowing
def recompose(A, vectors, out):  # type: ignore[no-untyped-def]
    """Write V diag(A) V' to out (m, m), of the diagonal of A (m, m) and vectors V (m, m) in columns."""
    m = A.shape[0]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += vectors[i, k] * A[k, k] * vectors[j, k]
            out[i, j] = total


@inlined
def add_product(A, B, out):  # type: ignore[no-untyped-def]
    """Add A' B (p, q) of A (k, p) and B (k, q) to `out`."""
    for i in range(A.shape[1]):
        for e in range(A.shape[0]):
            one = A[e, i]
            for j in range(B.shape[1]):
                out[i, j] += one * B[e, j]


@inlined
def add_transformed(A, v, out):  # type: ignore[no-untyped-def]
    """Add A' v (p,) of A (k, p) and v (k,) to `out`."""
    for e in range(A.shape[0]):
        for i in range(A.shape[1]):
            out[i] += A[e, i] * v[e]


class ClearanceCost(NamedTuple):
    """Clearance cost of a step as a function of six numbers: both positions and the loss of velocity."""

    slope: Array  # (6,)
    bend: Array  # (6, 6)
    chain: Array  # (6, 2 n) derivatives of these numbers in the states before and after
    bent: Array  # (6, 2 n) bend times chain
    cross: Array  # (n, n)


PRICE: Any = ClearanceCost


@borrowing
def add_after(price, costate, P):  # type: ignore[no-untyped-def]
    """Add the price of the state after a step to gradient (n,) and Hessian (n, n) of the cost-to-go."""
    n = costate.shape[0]
    price.bent[:, :] = 0.0
    add_product(price.bend, price.chain, price.bent)
    add_transformed(price.chain[:, n:], price.slope, costate)
    add_product(price.chain[:, n:], price.bent[:, n:], P)


@borrowing
def through_step(costate, P, J, S, lead, g, Q):  # type: ignore[no-untyped-def]
    """Write J' P J + S to Q and the gradient to g; `lead` (n, N) is scratch."""
    n = costate.shape[0]
    lead[:, :] = 0.0
    add_product(P, J[:n], lead)
    copy_rows(S, Q)
    add_product(J[:n], lead, Q)
    copy_row(J[n], g)
    add_transformed(J[:n], costate, g)


@borrowing
def add_before(price, J, g, Q):  # type: ignore[no-untyped-def]
    """Add the price of the state before a step, and its coupling to the state after."""
    n = J.shape[0] - 1
    before = price.chain[:, :n]
    price.cross[:, :] = 0.0
    add_product(before, price.bent[:, n:], price.cross)
    add_transformed(before, price.slope, g[:n])
    add_product(before, price.bent[:, :n], Q[:n, :n])
    for j in range(n):
        for k in range(J.shape[1]):
            total = 0.0
            for e in range(n):
                total += price.cross[j, e] * J[e, k]
            Q[j, k] += total
            Q[k, j] += total


@borrowing
def respond(course, i, passive, damping, g, Q, work):  # type: ignore[no-untyped-def]
    """Write change, gains, share, inverse and volume of step i, by the best response to g and Q.

    Returns: the gain that is expected of it [cost].
    """
    (stiff, vectors, inverted, bows), modes, least = work, work[0].shape[0], TUNING.least_curvature * passive
    n, expected = g.shape[0] - modes, 0.0
    copy_rows(Q[n:, n:], stiff)
    diagonalise(stiff, vectors)
    course.volume[i] = 0.0
    for j in range(modes):
        bows[j] = max(stiff[j, j] + damping * passive, least)
        left = min(1.0, passive / bows[j])
        course.volume[i] += 0.5 * math.log(left)
        stiff[j, j] = math.sqrt(left)
    recompose(stiff, vectors, course.share[i])
    for j in range(modes):
        stiff[j, j] = 1.0 / stiff[j, j]
    recompose(stiff, vectors, course.inverse[i])
    for j in range(modes):
        stiff[j, j] = -1.0 / bows[j]
    recompose(stiff, vectors, inverted)
    course.change[i], course.gains[i] = 0.0, 0.0
    add_transformed(inverted, g[n:], course.change[i])
    add_product(inverted, Q[n:, :n], course.gains[i])
    for j in range(modes):
        expected -= 0.5 * g[n + j] * course.change[i, j]
    return expected


@borrowing
def leave(course, i, g, Q, v, W):  # type: ignore[no-untyped-def]
    """Write the Schur complement, the cost-to-go that the best response leaves, to v and W."""
    n = v.shape[0]
    copy_row(g[:n], v)
    copy_rows(Q[:n, :n], W)
    add_transformed(Q[n:, :n], course.change[i], v)
    add_product(Q[n:, :n], course.gains[i], W)
    for j in range(n):
        for k in range(j):
            W[j, k] = W[k, j] = 0.5 * (W[j, k] + W[k, j])


@cache
def backward_pass(kind: KernelSpec) -> Any:
    """Build the backward pass of one kind of dynamics."""
    velocity, expand, arrival, _ = forward_pass(kind)
    n, m = kind.n, kind.m
    noisy_position, by_inputs = kind.noisy_position, kind.input_form
    scratch_walls, _, expand_clearance = clearance_costs(kind.moving)

    @kernel
    def _end(setup, task, x, v, W):  # type: ignore[no-untyped-def]
        """Expand `arrival` at x (n,), to v (n,) and W (n, n), by central differences if it has no kink."""
        if noisy_position and not by_inputs:
            ax, ay = x[0] - setup.world.goal[0], x[1] - setup.world.goal[1]
            away = math.sqrt(ax * ax + ay * ay)
            v[:], W[:, :] = 0.0, 0.0
            if away > setup.world.radius:
                v[0], v[1], bent = task.far * ax / away, task.far * ay / away, task.far / (away * away * away)
                W[0, 0], W[1, 1], W[0, 1] = bent * ay * ay, bent * ax * ax, -bent * ax * ay
                W[1, 0] = W[0, 1]
            return
        z, f, up, down = x.copy(), np.zeros(n), np.empty(n), np.empty(n)
        here, h = arrival(setup, task, x, f), TUNING.nudge
        for i in range(n):
            z[i] = x[i] + h
            up[i] = arrival(setup, task, z, f)
            z[i] = x[i] - h
            down[i] = arrival(setup, task, z, f)
            z[i] = x[i]
            v[i], W[i, i] = 0.5 * (up[i] - down[i]) / h, (up[i] - 2.0 * here + down[i]) / (h * h)
            for k in range(i):
                z[i], z[k] = x[i] + h, x[k] + h
                total = 2.0 * here - up[i] - up[k] - down[i] - down[k] + arrival(setup, task, z, f)
                z[i], z[k] = x[i] - h, x[k] - h
                total += arrival(setup, task, z, f)
                z[i], z[k] = x[i], x[k]
                W[i, k] = 0.5 * total / (h * h)
                W[k, i] = W[i, k]

    @kernel
    def _follow(setup, x, z, bends, chain):  # type: ignore[no-untyped-def]
        """Write derivatives of positions and loss of velocity in the states x, z (n,) of a step to `chain` (6, 2 n)."""
        for k in range(2):
            chain[k, k] = chain[2 + k, n + k] = 1.0
        if not bends:
            return
        up, down, nudge = np.zeros(n), np.zeros(n), TUNING.nudge
        for end in range(2):
            at, sign = x.copy() if end == 0 else z.copy(), 1.0 - 2.0 * end
            for i in range(n):
                here = at[i]
                at[i] = here + nudge
                velocity(setup, at, up)
                at[i] = here - nudge
                velocity(setup, at, down)
                at[i] = here
                for k in range(2):
                    chain[4 + k, end * n + i] = 0.5 * sign * (up[k] - down[k]) / nudge

    @part
    def clearance_cost(setup, task, states, i, times, points, price, work):  # type: ignore[no-untyped-def]
        """Expand the clearance cost of a step in the states before and after it; return whether there is any."""
        f, other, walls, bends = work
        x, y, bx, by = states[i, 0], states[i, 1], 0.0, 0.0
        dx, dy = states[i + 1, 0] - x, states[i + 1, 1] - y
        if bends:
            velocity(setup, states[i], f)
            velocity(setup, states[i + 1], other)
            bx, by = f[0] - other[0], f[1] - other[1]
        step = (x, y, dx, dy, bx, by, times[i], times[i + 1] - times[i])
        near = expand_clearance(setup, task, step, points, walls, price.slope, price.bend)
        if near:
            _follow(setup, states[i], states[i + 1], bends, price.chain)
        return near

    @kernel
    def backward(setup, task, times, course, length, points, damping):  # type: ignore[no-untyped-def]
        """Find the best change of each control and its feedback; return the expected gain [cost].

        It writes the first `length` rows of change, gains, share, inverse and volume; `times` (T+1,) are ends of steps
        [s], `damping` is added to the controls' curvature, as a share of lambda dt.
        """
        states, control, aims = course.states, course.control, course.aims
        modes = control.shape[1]
        N, bends = n + modes, not noisy_position and modes > m
        v, W, costate, P = np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
        J, S, Q, g = np.zeros((n + 1, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros(N)
        lead, stiff = np.zeros((n, N)), np.zeros((modes, modes))
        ends = np.zeros(n), np.zeros(n), scratch_walls(setup), bends
        work = stiff, stiff.copy(), stiff.copy(), np.zeros(modes)
        price = PRICE(np.zeros(6), np.zeros((6, 6)), np.zeros((6, 2 * n)), np.zeros((6, 2 * n)), np.zeros((n, n)))
        expected = 0.0
        if task.hold == 0.0:
            _end(setup, task, states[length], v, W)
        for i in range(length - 1, -1, -1):
            dt = times[i + 1] - times[i]
            near = clearance_cost(setup, task, states, i, times, points, price, ends)
            copy_row(v, costate)
            copy_rows(W, P)
            if task.hold > 0.0:
                for j in range(2):
                    costate[j] += 2.0 * task.hold * dt * (states[i + 1, j] - aims[i + 1, j])
                    P[j, j] += 2.0 * task.hold * dt
            if near:
                add_after(price, costate, P)
            expand(setup, (states[i], control[i], dt, costate), task.active, task.curved, J, S)
            through_step(costate, P, J, S, lead, g, Q)
            if near:
                add_before(price, J, g, Q)
            passive = task.temperature * dt
            for j in range(modes):
                g[n + j] += passive * control[i, j]
                Q[n + j, n + j] += passive
            expected += respond(course, i, passive, damping, g, Q, work)
            leave(course, i, g, Q, v, W)
        return expected

    return backward
