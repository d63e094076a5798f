"""Compiled rollouts: noisy paths around references, their cost, and how likely each reference makes them.

Everything is expressed in noise units: with a = B_c^-1 G_c u and the path's own increments y = a dt + dw, a step is
x + f dt + B y, and log dQ_g/dP grows by a_g'y - a_g'a_g dt / 2 for every reference g (paper, Girsanov's theorem).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.clearance import Field, clearance
from pirrht.exits import INSIDE, at_crossing, bridge_exit, distances, endpoint_exit, sweep_exit
from pirrht.jit import as_jitable, kernel, source_token
from pirrht.noise import normal, stream
from pirrht.problem import Problem, unit_rate
from pirrht.scene import Array


AHEAD = 0.03  # a corner counts as passed this far before it [m]


class World(NamedTuple):
    """What a rollout needs to know of scene and problem."""

    field: Field
    goal: Array  # (2,) [m]
    goal_radius: float
    markers: Array  # (M, 2) [m]
    weights: NDArray[np.int64]  # (M,) additive keys of one turn around each marker
    parameters: Array  # p of the dynamics
    gain: Array  # (m, m) B_c^-1 G_c, if constant
    diffusion: Array  # (m, m) B_c, if constant
    rate: float  # q, if constant [cost/s]
    bridge: bool  # exit rule: along the step, or at its end


class Guides(NamedTuple):
    """H references that samples are drawn around: control guides of T steps, or corners to head for."""

    control: Array  # (H, T, m)
    drift: Array  # (H, T, m) a = B_c^-1 G_c u, the same in noise units, where the gain is constant
    times: Array  # (T+1,) ends of the steps, from 0 [s]
    active: NDArray[np.int64]  # (H,) number of steps before a tape is zero for good
    first: NDArray[np.int64]  # (H+1,) first sample drawn around each reference; the last entry is S
    corners: Array  # (H, C, 2) what to head for, one after the other, instead of the tape [m]
    beyond: Array  # (H, C, 2) normal of the line past which a corner is behind
    count: NDArray[np.int64]  # (H,) number of corners; 0: follow the tape
    speed: float  # towards a corner [m/s]
    reach: float  # walls push within about this distance [m]; 0: they do not


class Paths(NamedTuple):
    """What is kept of S sampled paths; kernels write into it."""

    work: Array  # (S,) integral of q up to the exit [cost]
    log_ratio: Array  # (S, H) log dQ_g/dP of each path under each reference
    key: NDArray[np.int64]  # (S,) class of the path itself, as an additive key
    outcome: NDArray[np.int8]  # (S,) Outcome
    steps: NDArray[np.int32]  # (S,) steps taken, the exit's included


class Kernels(NamedTuple):
    """Compiled rollouts of one kind of dynamics."""

    sample: Callable[..., None]  # fills Paths for a range of samples
    control: Callable[..., None]  # weighted sum of the controls that samples carried
    trace: Callable[..., None]  # states of chosen samples


def empty_paths(S: int, H: int) -> Paths:
    """Room for S paths under H references."""
    return Paths(
        np.zeros(S), np.zeros((S, H)), np.zeros(S, np.int64), np.zeros(S, np.int8), np.zeros(S, np.int32)
    )


def kernels_for(problem: Problem) -> Kernels:
    """The compiled rollouts of a problem; built once per kind of dynamics and cost rate."""
    d = problem.dynamics
    constant = d.constant
    gain = None if constant else as_jitable(_function(d.control_block))
    noise = None if constant else as_jitable(_function(d.diffusion_block))
    q = as_jitable(problem.q) if callable(problem.q) else unit_rate
    return _build(as_jitable(d.drift), gain, noise, q, d.n, d.m, callable(problem.q), d.noisy_position)


@kernel
def solve(A, Y, X):  # type: ignore[no-untyped-def]
    """Solve A X = Y for small A (m, m) by elimination with row pivots; Y, X (m, k)."""
    m = A.shape[0]
    work = A.copy()
    for i in range(m):
        for k in range(Y.shape[1]):
            X[i, k] = Y[i, k]
    for i in range(m):
        pivot = i
        for r in range(i + 1, m):
            if abs(work[r, i]) > abs(work[pivot, i]):
                pivot = r
        for c in range(m):
            work[i, c], work[pivot, c] = work[pivot, c], work[i, c]
        for k in range(Y.shape[1]):
            X[i, k], X[pivot, k] = X[pivot, k], X[i, k]
        for r in range(m):
            if r != i:
                factor = work[r, i] / work[i, i]
                for c in range(i, m):
                    work[r, c] -= factor * work[i, c]
                for k in range(Y.shape[1]):
                    X[r, k] -= factor * X[i, k]
    for i in range(m):
        for k in range(Y.shape[1]):
            X[i, k] /= work[i, i]


def _function(block: Array | Callable[..., None]) -> Callable[..., None]:
    if isinstance(block, np.ndarray):
        matrix = block

        def fill(x, p, out):  # type: ignore[no-untyped-def]
            out[:, :] = matrix

        return fill
    return block


@cache
def _build(
    drift: Callable[..., None],
    control_block: Callable[..., None] | None,
    diffusion_block: Callable[..., None] | None,
    q: Callable[..., float],
    n: int,
    m: int,
    varying_rate: bool,
    noisy_position: bool,
) -> Kernels:
    varying = control_block is not None
    gain_at: Any = control_block if varying else drift
    noise_at: Any = diffusion_block if varying else drift
    token = source_token(drift, gain_at, noise_at, q)
    fixed = n - m
    isotropic = n == 2 and m == 2  # the noise of a step is its displacement; then an exit cuts both alike

    @kernel
    def blocks(world, x, G, D, B):  # type: ignore[no-untyped-def]
        """D = B_c^-1 G_c and B = B_c at x."""
        gain_at(x, world.parameters, G)
        noise_at(x, world.parameters, B)
        solve(B, G, D)

    @kernel
    def position_covariance(B, dt, cov):  # type: ignore[no-untyped-def]
        """Covariance (xx, xy, yy) of the position over one step of dt."""
        cov[0], cov[1], cov[2] = 0.0, 0.0, 0.0
        for j in range(m):
            bx = B[0 - fixed, j] if fixed <= 0 else 0.0
            by = B[1 - fixed, j] if fixed <= 1 else 0.0
            cov[0] += bx * bx * dt
            cov[1] += bx * by * dt
            cov[2] += by * by * dt

    @kernel
    def push(world, guides, x, B, cov, out):  # type: ignore[no-untyped-def]
        """Drift B' grad log h away from the nearest wall, h = erf(c / reach): what surviving paths do by themselves."""
        for j in range(m):
            out[j] = 0.0
        if guides.reach <= 0.0:
            return
        c = clearance(world.field, x[0], x[1])
        if c > 3.0 * guides.reach:
            return
        c = max(c, 0.5 * math.sqrt(max(cov[0], cov[2]))) / guides.reach
        slope = 2.0 / (math.sqrt(math.pi) * guides.reach) * math.exp(-c * c) / math.erf(c)
        h = world.field.spacing
        gx = (clearance(world.field, x[0] + h, x[1]) - clearance(world.field, x[0] - h, x[1])) / (2.0 * h)
        gy = (clearance(world.field, x[0], x[1] + h) - clearance(world.field, x[0], x[1] - h)) / (2.0 * h)
        for j in range(m):
            bx = B[0 - fixed, j] if fixed <= 0 else 0.0
            by = B[1 - fixed, j] if fixed <= 1 else 0.0
            out[j] = slope * (bx * gx + by * gy)

    @kernel
    def lean(guides, g, i, x, D, pushed, stage, out):  # type: ignore[no-untyped-def]
        """a = B_c^-1 G_c u of reference g in step i at state x, into out (m,); stage (H,) says which corner is next."""
        if guides.count[g] > 0:
            s = stage[g]
            dx, dy = guides.corners[g, s, 0] - x[0], guides.corners[g, s, 1] - x[1]
            while s < guides.count[g] - 1 and dx * guides.beyond[g, s, 0] + dy * guides.beyond[g, s, 1] < AHEAD:
                s += 1
                dx, dy = guides.corners[g, s, 0] - x[0], guides.corners[g, s, 1] - x[1]
            stage[g] = s
            scale = guides.speed / max(math.sqrt(dx * dx + dy * dy), 1e-9)
            for j in range(m):
                out[j] = pushed[j] + scale * (D[j, 0] * dx + (D[j, 1] * dy if m > 1 else 0.0))
            return
        for j in range(m):
            out[j] = pushed[j]
            if i < guides.active[g]:
                if not varying:
                    out[j] += guides.drift[g, i, j]
                else:
                    for k in range(m):
                        out[j] += D[j, k] * guides.control[g, i, k]

    @kernel
    def one_path(world, guides, h, x0, seed, sample, ratio, states, applied):  # type: ignore[no-untyped-def]
        """Simulate one sample; `ratio` (H,), `states` (T+1, n) and `applied` (T, m) are filled if not empty."""
        _ = token
        H, T = guides.control.shape[0], guides.control.shape[1]
        M = world.markers.shape[0]
        x, moved, f, y = x0.copy(), x0.copy(), np.empty(n), np.empty(m)
        G, D, B = np.zeros((m, m)), world.gain.copy(), world.diffusion.copy()
        a, pushed, stage = np.empty(m), np.empty(m), np.zeros(H, np.int64)
        column, carried = np.empty((m, 1)), np.empty((m, 1))
        cov = np.zeros(3)
        state = stream(seed, sample)
        work, key = 0.0, np.int64(0)
        before = distances(world.field, world.goal, world.goal_radius, x[0], x[1])
        if states.shape[0] > 0:
            for j in range(n):
                states[0, j] = x[j]
        for i in range(T):
            dt = guides.times[i + 1] - guides.times[i]
            root, until = np.sqrt(dt), dt
            if varying:
                blocks(world, x, G, D, B)
            position_covariance(B, dt, cov)
            drift(x, world.parameters, f)
            push(world, guides, x, B, cov, pushed)
            lean(guides, h, i, x, D, pushed, stage, a)
            for j in range(m):
                state, z = normal(state)
                y[j] = z * root + a[j] * dt
            for j in range(n):
                moved[j] = x[j] + f[j] * dt
            for j in range(m):
                for k in range(m):
                    moved[fixed + j] += B[j, k] * y[k]
            if applied.shape[0] > 0:
                for j in range(m):
                    column[j, 0] = y[j]
                solve(D, column, carried)
                for j in range(m):
                    applied[i, j] = carried[j, 0] / dt
            for k in range(M):
                bx, by = world.goal[0] - world.markers[k, 0], world.goal[1] - world.markers[k, 1]
                ax, ay = x[0] - world.markers[k, 0], x[1] - world.markers[k, 1]
                cx, cy = moved[0] - world.markers[k, 0], moved[1] - world.markers[k, 1]
                side, other = ax * by - ay * bx, cx * by - cy * bx
                if (side > 0.0) != (other > 0.0):
                    share = side / (side - other)
                    px, py = ax + share * (cx - ax), ay + share * (cy - ay)
                    if px * bx + py * by < 0.0:
                        key += world.weights[k] if other > 0.0 else -world.weights[k]
            if not world.bridge:
                exit, share = endpoint_exit(world.field, world.goal, world.goal_radius, moved[0], moved[1])
            elif noisy_position:
                after = distances(world.field, world.goal, world.goal_radius, moved[0], moved[1])
                state, exit, share = bridge_exit(
                    world.field,
                    world.goal,
                    world.goal_radius,
                    x[0],
                    x[1],
                    moved[0],
                    moved[1],
                    before,
                    after,
                    cov,
                    state,
                )
                before = after
                if exit != INSIDE and isotropic and cov[1] == 0.0 and cov[0] == cov[2]:
                    # Without this the rest of the step would enter dQ/dP as noise with a variance of a'a dt.
                    state, dx, dy = at_crossing(
                        world.field, world.goal, x[0], x[1], moved[0] - x[0] - f[0] * dt, moved[1] - x[1] - f[1] * dt,
                        exit, share, world.goal_radius, np.sqrt(cov[0]), state,
                    )  # fmt: skip
                    y[0] = (B[0, 0] * dx + B[1, 0] * dy) * dt / cov[0]
                    y[1] = (B[0, 1] * dx + B[1, 1] * dy) * dt / cov[0]
                    moved[0], moved[1] = x[0] + f[0] * dt * share + dx, x[1] + f[1] * dt * share + dy
                    until = dt * share
            else:
                exit, share = sweep_exit(
                    world.field, world.goal, world.goal_radius, x[0], x[1], moved[0], moved[1]
                )
            for g in range(ratio.shape[0]):
                lean(guides, g, i, x, D, pushed, stage, a)
                for j in range(m):
                    ratio[g] += a[j] * (y[j] - 0.5 * a[j] * until)
            work += (q(x, world.parameters) if varying_rate else world.rate) * dt * share
            for j in range(n):
                x[j] = moved[j]
            if states.shape[0] > 0:
                for j in range(n):
                    states[i + 1, j] = x[j]
            if exit != INSIDE:
                return work, key, exit, i + 1
        return work, key, 0, T

    @kernel
    def sample(world, guides, x0, seed, start, stop, paths):  # type: ignore[no-untyped-def]
        nothing = np.empty((0, 1))
        h = 0
        for s in range(start, stop):
            while s >= guides.first[h + 1]:
                h += 1
            work, key, outcome, steps = one_path(
                world, guides, h, x0, seed, s, paths.log_ratio[s], nothing, nothing
            )
            paths.work[s], paths.key[s], paths.outcome[s], paths.steps[s] = work, key, outcome, steps

    @kernel
    def control(world, guides, x0, seed, chosen, group, weight, total, alive):  # type: ignore[no-untyped-def]
        """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
        nothing, ratio = np.empty((0, 1)), np.empty(0)
        applied = np.zeros((guides.control.shape[1], m))
        h = 0
        for c in range(chosen.shape[0]):
            s, g = chosen[c], group[c]
            while s >= guides.first[h + 1]:
                h += 1
            _, _, _, steps = one_path(world, guides, h, x0, seed, s, ratio, nothing, applied)
            for i in range(steps):
                alive[g, i] += weight[c]
                for j in range(m):
                    total[g, i, j] += weight[c] * applied[i, j]

    @kernel
    def trace(world, guides, x0, seed, chosen, states, steps):  # type: ignore[no-untyped-def]
        nothing, ratio = np.empty((0, 1)), np.empty(0)
        for c in range(chosen.shape[0]):
            h = np.searchsorted(guides.first, chosen[c], side="right") - 1
            _, _, _, steps[c] = one_path(world, guides, h, x0, seed, chosen[c], ratio, states[c], nothing)

    return Kernels(sample, control, trace)
