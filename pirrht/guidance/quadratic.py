"""The quadratic model of the cost-to-go before a step: what it is made of, the best response to it, what that leaves.

A step leads from x (n,) under a change of its noise (modes,) to J (n, n + modes) of both; v (n,) and W (n, n) are
gradient and Hessian of the cost-to-go, g and Q those of it before the step, of state and noise.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

from pirrht.arrays import Array
from pirrht.compiled.jit import part
from pirrht.guidance.ddp import LEAST_CURVATURE
from pirrht.guidance.spectra import diagonalise, recompose


class Price(NamedTuple):
    """What the clearance of a step costs, by six numbers: where it begins, how it moves, and its loss of velocity."""

    slope: Array  # (6,)
    bend: Array  # (6, 6)
    chain: Array  # (6, 2 n) how these numbers follow from the states before and after
    bent: Array  # (6, 2 n) bend times chain
    cross: Array  # (n, n)


@cache
def composition(n: int) -> tuple[Any, Any, Any]:
    """Kernels that make g and Q: the price of the state after a step, the step itself, the price of that before."""

    @part
    def add_after(price, costate, P):  # type: ignore[no-untyped-def]
        slope, bend, chain, bent, _ = price
        for j in range(2 * n):
            for e in range(6):
                total = 0.0
                for k in range(6):
                    total += bend[e, k] * chain[k, j]
                bent[e, j] = total
        for j in range(n):
            for e in range(6):
                costate[j] += slope[e] * chain[e, n + j]
            for k in range(n):
                for e in range(6):
                    P[j, k] += chain[e, n + j] * bent[e, n + k]

    @part
    def through_step(costate, P, J, S, lead, g, Q):  # type: ignore[no-untyped-def]
        """By J' P J + S; only the lower half of Q is written."""
        N = J.shape[1]
        for j in range(n):
            for k in range(N):
                total = 0.0
                for e in range(n):
                    total += P[j, e] * J[e, k]
                lead[j, k] = total
        for j in range(N):
            g[j] = J[n, j]
            for e in range(n):
                g[j] += costate[e] * J[e, j]
            for k in range(j + 1):
                total = S[j, k]
                for e in range(n):
                    total += J[e, j] * lead[e, k]
                Q[j, k] = total

    @part
    def add_before(price, J, g, Q):  # type: ignore[no-untyped-def]
        """And what the state before has to do with that after."""
        (slope, _, chain, bent, cross), N = price, J.shape[1]
        for j in range(n):
            for k in range(n):
                cross[j, k] = 0.0
                for e in range(6):
                    cross[j, k] += chain[e, j] * bent[e, n + k]
        for j in range(n):
            for e in range(6):
                g[j] += slope[e] * chain[e, j]
            for k in range(j + 1):
                for e in range(6):
                    Q[j, k] += chain[e, j] * bent[e, k]
            for k in range(N):
                total = 0.0
                for e in range(n):
                    total += cross[j, e] * J[e, k]
                Q[max(j, k), min(j, k)] += total if k != j else 2.0 * total

    return add_after, through_step, add_before


@cache
def response(n: int) -> tuple[Any, Any]:
    """Kernels for the best response to g and Q of a step, and for the cost-to-go that it leaves."""

    @part
    def respond(course, i, passive, damping, g, Q, work, expected):  # type: ignore[no-untyped-def]
        """Write change, gains, share, inverse and volume of step i; the gain expected, with it [cost]."""
        (stiff, vectors, inverted, bows), modes = work, work[0].shape[0]
        for j in range(modes):
            for k in range(modes):
                stiff[j, k] = Q[n + j, n + k]
        diagonalise(stiff, vectors)
        course.volume[i] = 0.0
        for j in range(modes):
            bow = max(stiff[j, j] + damping * passive, LEAST_CURVATURE * passive)
            left = min(1.0, passive / bow)
            course.volume[i] += 0.5 * math.log(left)
            bows[j], stiff[j, j] = bow, math.sqrt(left)
        recompose(stiff, vectors, course.share[i])
        for j in range(modes):
            stiff[j, j] = 1.0 / stiff[j, j]
        recompose(stiff, vectors, course.inverse[i])
        for j in range(modes):
            stiff[j, j] = 1.0 / bows[j]
        recompose(stiff, vectors, inverted)
        change = course.change
        for j in range(modes):
            change[i, j] = 0.0
            for e in range(modes):
                change[i, j] -= inverted[j, e] * g[n + e]
            for k in range(n):
                total = 0.0
                for e in range(modes):
                    total -= inverted[j, e] * Q[n + e, k]
                course.gains[i, j, k] = total
            expected -= 0.5 * g[n + j] * change[i, j]
        return expected

    @part
    def leave(course, i, g, Q, v, W):  # type: ignore[no-untyped-def]
        """With the curvature above, the best response leaves the Schur complement."""
        modes = course.change.shape[1]
        for j in range(n):
            v[j] = g[j]
            for e in range(modes):
                v[j] += Q[n + e, j] * course.change[i, e]
            for k in range(n):
                total = Q[j, k]
                for e in range(modes):
                    total += Q[n + e, j] * course.gains[i, e, k]
                W[j, k] = total
        for j in range(n):
            for k in range(j):
                W[j, k] = 0.5 * (W[j, k] + W[k, j])
                W[k, j] = W[j, k]

    return respond, leave
