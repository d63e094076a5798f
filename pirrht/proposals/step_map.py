"""Noise-free step of rollouts, for any system, and its first two derivatives by central differences.

A step has m modes of control in noise units, a = B_c^-1 G_c u (in input form s^-1 u), or 2 m where it sways: with
u + 2 sqrt(3) r (t/dt - 1/2) at t within a step, r leaves the end of the step and moves the mean over it, as the noise
of rollouts does (`rollouts.general.step`).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from pirrht.jit.jit import kernel, part
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.rollouts.general.kind import SWAY, KernelSpec, diffusion_of

NUDGE = 1e-4  # of a state, for differences [m], [rad], [m/s] ..


@cache
def step_of(kind: KernelSpec) -> tuple[Any, Any, Any]:
    """Build the kernels of one kind of dynamics: `velocity`, `advance` and `expand`."""
    drift, q, n, m, rows, midway = kind.drift, kind.q, kind.n, kind.m, kind.rows, kind.midway
    varying_rate, noisy_position = kind.varying_rate, kind.noisy_position
    varying = kind.diffusion_block is not None
    noise_at: Any = diffusion_of(kind) if varying else drift
    fixed = n - rows

    @kernel
    def velocity(setup, x, f):  # type: ignore[no-untyped-def]
        """Write the drift at x (n,) to f (n,) [state/s]; return q there [cost/s]."""
        f[:] = 0.0
        drift(x, setup.parameters, f)
        return q(x, setup.parameters) if varying_rate else setup.rate

    @part
    def inside(setup, x, a, dt, B, z):  # type: ignore[no-untyped-def]
        """Write the state at which the drift of a step from x (n,) is taken to z (n,), under noise B (rows, m)."""
        for j in range(n):
            z[j] = x[j]
        if setup.bridge and not noisy_position:
            for j in range(rows):
                for k in range(m):
                    mean = 0.5 * a[k] - (SWAY * a[m + k] if a.shape[0] > m else 0.0)
                    z[fixed + j] += dt * B[j, k] * mean

    @kernel
    def advance(setup, x, a, dt, B, f, out):  # type: ignore[no-untyped-def]
        """Write the state after a step of dt [s] from x (n,) under modes a to out (n,).

        B (2, rows, m) and f (n,) are scratch; B[0] keeps B of x, or where G is that of the middle, of the middle.
        Returns: cost of the states in it, q dt.
        """
        B, G = B[0], B[1]
        if varying:
            noise_at(x, setup.parameters, setup.inverse, G, B)
        else:
            copy_rows(setup.diffusion, B)
        f[:] = 0.0
        inside(setup, x, a, dt, B, out)
        drift(out, setup.parameters, f)
        if midway:
            for j in range(n):
                out[j] = x[j] + 0.5 * dt * f[j]
            for j in range(rows):
                for k in range(m):
                    out[fixed + j] += 0.5 * dt * B[j, k] * a[k]
            if varying:
                noise_at(out, setup.parameters, setup.inverse, G, B)
            if noisy_position or not setup.bridge:
                drift(out, setup.parameters, f)
        for j in range(n):
            out[j] = x[j] + dt * f[j]
        for j in range(rows):
            for k in range(m):
                out[fixed + j] += dt * B[j, k] * a[k]
        return dt * (q(x, setup.parameters) if varying_rate else setup.rate)

    @kernel
    def expand(setup, x, a, dt, costate, active, curved, J, S):  # type: ignore[no-untyped-def]
        """Differentiate `advance` in (x, a), N = n + modes, where B is constant: by differences of drift and q alone.

        Args, from `costate` on: (n,) weights of the next state's components; bits of the states that drift or q depend
        on; whether second derivatives are required; J (n+1, N) and S (N, N), filled with the first derivatives of the
        next state and of q dt, and the second ones of the weighted sum and q dt.
        """
        modes = a.shape[0]
        N, B, p = n + modes, setup.diffusion, setup.parameters
        z, mid, f, up, down = np.empty(n), np.empty(n), np.zeros(n), np.zeros(n), np.zeros(n)
        D, which = np.zeros((n, N)), np.empty(n, np.int64)
        inside(setup, x, a, dt, B, mid)
        copy_row(mid, z)
        drift(mid, p, f)
        here, rate = 0.0, q(x, p) if varying_rate else 0.0
        for j in range(n):
            here += costate[j] * f[j]
        J[:, :], S[:, :] = 0.0, 0.0
        count = 0
        for i in range(n):
            J[i, i] = 1.0
            D[i, i] = 1.0
            if (active >> i) & 1:
                which[count] = i
                count += 1
        halfway = setup.bridge and not noisy_position
        for j in range(rows):
            for k in range(m):
                J[fixed + j, n + k] = dt * B[j, k]
                if halfway:
                    D[fixed + j, n + k] = 0.5 * dt * B[j, k]
                    if modes > m:
                        D[fixed + j, n + m + k] = -SWAY * dt * B[j, k]
        sums, rates = np.zeros((n, 2)), np.zeros((n, 2))
        for c in range(count):
            i = which[c]
            z[i] = mid[i] + NUDGE
            drift(z, p, up)
            z[i] = mid[i] - NUDGE
            drift(z, p, down)
            z[i] = mid[i]
            for j in range(n):
                slope = 0.5 * dt * (up[j] - down[j]) / NUDGE
                if slope != 0.0:
                    for k in range(N):
                        J[j, k] += slope * D[i, k]
                sums[i, 0] += costate[j] * up[j]
                sums[i, 1] += costate[j] * down[j]
            if varying_rate:
                keep = x[i]
                x[i] = keep + NUDGE
                rates[i, 0] = q(x, p)
                x[i] = keep - NUDGE
                rates[i, 1] = q(x, p)
                x[i] = keep
                J[n, i] = 0.5 * dt * (rates[i, 0] - rates[i, 1]) / NUDGE
        if not curved:
            return
        scale = dt / (NUDGE * NUDGE)
        for c in range(count):
            i = which[c]
            for e in range(c + 1):
                k = which[e]
                if e == c:
                    bend = sums[i, 0] - 2.0 * here + sums[i, 1]
                    own = rates[i, 0] - 2.0 * rate + rates[i, 1]
                else:
                    bend = 2.0 * here - sums[i, 0] - sums[i, 1] - sums[k, 0] - sums[k, 1]
                    own = 2.0 * rate - rates[i, 0] - rates[i, 1] - rates[k, 0] - rates[k, 1]
                    for sign in (1.0, -1.0):
                        z[i], z[k] = mid[i] + sign * NUDGE, mid[k] + sign * NUDGE
                        drift(z, p, up)
                        z[i], z[k] = mid[i], mid[k]
                        for j in range(n):
                            bend += costate[j] * up[j]
                        if varying_rate:
                            at_i, at_k = x[i], x[k]
                            x[i], x[k] = at_i + sign * NUDGE, at_k + sign * NUDGE
                            own += q(x, p)
                            x[i], x[k] = at_i, at_k
                    bend, own = 0.5 * bend, 0.5 * own
                bend, own = scale * bend, scale * own
                if varying_rate:
                    S[i, k] += own
                    if i != k:
                        S[k, i] += own
                for r in range(N):
                    left, right = bend * D[i, r], bend * D[k, r]
                    if left != 0.0 or right != 0.0:
                        for s in range(N):
                            S[r, s] += left * D[k, s]
                            if i != k:
                                S[r, s] += right * D[i, s]

    @kernel
    def expand_any(setup, x, a, dt, costate, active, curved, J, S):  # type: ignore[no-untyped-def]
        """Differentiate `advance` in (x, a) for any B; arguments of `expand`."""
        modes = a.shape[0]
        N = n + modes
        z, c, nudge = np.empty(n), np.empty(modes), np.empty(N)
        B, f, ahead, behind = np.zeros((2, rows, m)), np.empty(n), np.empty(n), np.empty(n)
        up, down = np.empty(N), np.empty(N)
        rate = advance(setup, x, a, dt, B, f, ahead)
        here, size = rate, 0.0
        for j in range(n):
            here += costate[j] * ahead[j]
        for j in range(rows):
            for k in range(m):
                size = max(size, abs(B[0, j, k]))
        for i in range(N):
            nudge[i] = NUDGE if i < n else NUDGE / (dt * size)
        copy_row(x, z)
        copy_row(a, c)
        for i in range(N):
            h = nudge[i]
            if i < n:
                z[i] = x[i] + h
                more = advance(setup, z, a, dt, B, f, ahead)
                z[i] = x[i] - h
                less = advance(setup, z, a, dt, B, f, behind)
                z[i] = x[i]
            else:
                c[i - n] = a[i - n] + h
                more = advance(setup, x, c, dt, B, f, ahead)
                c[i - n] = a[i - n] - h
                less = advance(setup, x, c, dt, B, f, behind)
                c[i - n] = a[i - n]
            up[i], down[i], J[n, i] = more, less, 0.5 * (more - less) / h
            for j in range(n):
                J[j, i] = 0.5 * (ahead[j] - behind[j]) / h
                up[i] += costate[j] * ahead[j]
                down[i] += costate[j] * behind[j]
            S[i, i] = (up[i] - 2.0 * here + down[i]) / (h * h) if curved else 0.0
        for i in range(N):
            for k in range(i):
                S[i, k] = 0.0
                if curved:
                    total = 2.0 * here - up[i] - up[k] - down[i] - down[k]
                    for sign in (1.0, -1.0):
                        copy_row(x, z)
                        copy_row(a, c)
                        for e in (i, k):
                            if e < n:
                                z[e] += sign * nudge[e]
                            else:
                                c[e - n] += sign * nudge[e]
                        total += advance(setup, z, c, dt, B, f, ahead)
                        for j in range(n):
                            total += costate[j] * ahead[j]
                    S[i, k] = 0.5 * total / (nudge[i] * nudge[k])
                S[k, i] = S[i, k]

    return velocity, advance, expand_any if varying or midway else expand
