"""Backward pass of the optimisation: a quadratic model of the cost-to-go, the best response to it and its feedback.

A step leads from x (n,) under a change of its noise (modes,) to J (n, n + modes) of both; v (n,) and W (n, n) are
gradient and Hessian of the cost-to-go, g and Q those of it before the step, of state and noise.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.geometry.space import pose_at
from pirrht.jit import vectors
from pirrht.jit.jit import borrowing, inlined, kernel, part
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.tuning import TUNING
from pirrht.proposals.walls import clearance_costs
from pirrht.rollouts.step import KernelSpec


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
                    one = vectors[k, i]
                    other = vectors[k, j]
                    vectors[k, i] = c * one - s * other
                    vectors[k, j] = s * one + c * other
                for k in range(m):
                    A[i, k], A[j, k] = c * A[i, k] - s * A[j, k], s * A[i, k] + c * A[j, k]


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


@borrowing
def through_step(v, W, K, S, lead, g, Q):  # type: ignore[no-untyped-def]
    """Write K' W K + S to Q and the gradient to g, whose rest is the last row of K; `lead` is scratch."""
    most = W.shape[0]
    lead[:, :] = 0.0
    add_product(W, K[:most], lead)
    copy_rows(S, Q)
    add_product(K[:most], lead, Q)
    copy_row(K[most], g)
    add_transformed(K[:most], v, g)


@borrowing
def respond(course, i, passive, damping, g, Q, work):  # type: ignore[no-untyped-def]
    """Write change, gains, share, inverse and volume of step i, the best response to g and Q; its gain [cost]."""
    stiff, vectors, inverted, bows = work
    modes = work[0].shape[0]
    least = TUNING.least_curvature * passive

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
    velocity, expand, expand_end, _ = forward_pass(kind)
    n, m, noisy_position = kind.n, kind.m, kind.noisy_position
    scratch_walls, _, expand_clearance = clearance_costs(kind.space, len(kind.reads), kind.moving)
    reads, numbers, position = np.array(kind.reads), len(kind.reads), kind.space.position
    pose, combined = pose_at(kind.reads), vectors.combined(numbers)

    @kernel
    def _follow(setup, x, z, bends, chain):  # type: ignore[no-untyped-def]
        """Write derivatives of poses and loss of rates in the states x, z (n,) of a step to `chain` (3 k, 2 n)."""
        for k in range(numbers):
            chain[k, reads[k]] = chain[numbers + k, n + reads[k]] = 1.0

        up = np.zeros(n)
        down = np.zeros(n)
        nudge = TUNING.nudge

        for end in range(2 if bends else 0):
            at = x.copy() if end == 0 else z.copy()
            sign = 1.0 - 2.0 * end

            for i in range(n):
                here = at[i]
                at[i] = here + nudge
                velocity(setup, at, up)
                at[i] = here - nudge
                velocity(setup, at, down)
                at[i] = here
                for k in range(numbers):
                    chain[2 * numbers + k, end * n + i] = 0.5 * sign * (up[reads[k]] - down[reads[k]]) / nudge

    @part
    def add_clearance(setup, task, states, i, times, points, work, v, W):  # type: ignore[no-untyped-def]
        """Expand the clearance cost of a step in its states (2 n,), by position and velocity; return whether any."""
        f, other, walls, bends, slope, bend, chain, bent = work
        here = pose(states[i])
        loss = combined(0.0, here, 0.0, here)
        if bends:
            velocity(setup, states[i], f)
            velocity(setup, states[i + 1], other)
            loss = combined(1.0, pose(f), -1.0, pose(other))
        step = (here, combined(1.0, pose(states[i + 1]), -1.0, here), loss, times[i], times[i + 1] - times[i])
        near = expand_clearance(setup, task, step, points, walls, slope, bend)
        if near:
            _follow(setup, states[i], states[i + 1], bends, chain)
            bent[:, :] = 0.0
            add_product(bend, chain, bent)
            add_transformed(chain, slope, v)
            add_product(chain, bent, W)
        return near

    @kernel
    def backward(setup, task, times, course, length, points, damping):  # type: ignore[no-untyped-def]
        """Find the best change of each control and its feedback; return the expected gain [cost].

        It writes the first `length` rows of change, gains, share, inverse and volume; `times` (T+1,) are ends of steps
        [s], `damping` is added to the controls' curvature, as a share of lambda dt.
        """
        states = course.states
        control = course.control
        aims = course.aims
        modes = course.control.shape[1]

        N = n + modes
        size = 3 * numbers
        bends = not noisy_position and modes > m
        expected = 0.0

        v = np.zeros(n)
        W = np.zeros((n, n))
        costate = np.zeros(2 * n)
        P = np.zeros((2 * n, 2 * n))

        K = np.zeros((2 * n + 1, N))
        S = np.zeros((N, N))
        Q = np.zeros((N, N))
        g = np.zeros(N)

        lead = np.zeros((2 * n, N))
        stiff = np.zeros((modes, modes))
        ends = (
            np.zeros(n), np.zeros(n), scratch_walls(setup), bends, np.zeros(size), np.zeros((size, size)),
            np.zeros((size, 2 * n)), np.zeros((size, 2 * n)),
        )  # fmt: skip
        work = stiff, stiff.copy(), stiff.copy(), np.zeros(modes)
        for j in range(n):
            K[j, j] = 1.0  # of the state before a step; below is J, and the derivatives of q dt
        if task.hold == 0.0:
            expand_end(setup, task.far, states[length], v, W)
        for i in range(length - 1, -1, -1):
            dt = times[i + 1] - times[i]
            passive = task.temperature * dt
            costate[:], P[:, :] = 0.0, 0.0
            first = 0 if add_clearance(setup, task, states, i, times, points, ends, costate, P) else n
            for j in range(n):
                costate[n + j] += v[j]
                for k in range(n):
                    P[n + j, n + k] += W[j, k]
            for j in range(position if task.hold > 0.0 else 0):
                k = reads[j]
                costate[n + k] += 2.0 * task.hold * dt * (states[i + 1, k] - aims[i + 1, j])
                P[n + k, n + k] += 2.0 * task.hold * dt
            expand(setup, (states[i], control[i], dt, costate[n:]), task.active, task.curved, K[n:], S)
            through_step(costate[first:], P[first:, first:], K[first:], S, lead[first:], g, Q)
            for j in range(modes):
                g[n + j] += passive * control[i, j]
                Q[n + j, n + j] += passive
            expected += respond(course, i, passive, damping, g, Q, work)
            leave(course, i, g, Q, v, W)
        return expected

    return backward
