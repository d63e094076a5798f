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

from pirrht.clearance import Field
from pirrht.cuts import Cuts, key_of_step
from pirrht.dynamics import no_drift
from pirrht.exits import GOAL as REACHED
from pirrht.exits import INSIDE, at_crossing, bridge_exit, distances, endpoint_exit, survivors_slope, sweep_exit
from pirrht.jit import as_jitable, kernel
from pirrht.noise import normal, stream
from pirrht.problem import Problem, unit_rate
from pirrht.riccati import STEEP, homing, wrapped
from pirrht.scene import Array

AHEAD = 0.03  # a corner counts as passed this far before it [m]


class World(NamedTuple):
    """What a rollout needs to know of scene and problem."""

    field: Field
    goal: tuple[float, float]  # centre [m]
    goal_radius: float
    cuts: Cuts
    parameters: Array  # p of the dynamics
    gain: Array  # (m, m) B_c^-1 G_c, if constant
    inverse: Array  # (m, m) G_c^-1 B_c, if constant
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
    count: NDArray[np.int64]  # type: ignore[assignment]  # (H,) number of corners; 0: follow the tape
    speed: float  # towards a corner [m/s]
    reach: float  # walls push within about this distance [m]; 0: they do not
    window: int  # leading steps over which the control now is averaged
    law: Array  # (H, T, 9) of a car: a, its slopes in x, y, theta, the state they are for, spread and its log
    led: NDArray[np.int64]  # (H,) number of steps that the law covers, then towards the goal; 0: follow the tape


class Paths(NamedTuple):
    """What is kept of S sampled paths; kernels write into it."""

    work: Array  # (S,) integral of q up to the exit [cost]
    log_ratio: Array  # (S, H) log dQ_g/dP of each path under each reference
    key: NDArray[np.int64]  # (S,) class of the path itself, as an additive key
    outcome: NDArray[np.int8]  # (S,) Outcome
    steps: NDArray[np.int32]  # (S,) steps taken, the exit's included
    now: Array  # (S, m) mean control carried in the first `window` steps, without what the nearest wall accounts for


class Kernels(NamedTuple):
    """Compiled rollouts of one kind of dynamics."""

    sample: Callable[..., None]  # fills Paths for a range of samples
    control: Callable[..., None]  # weighted sum of the controls that samples carried
    trace: Callable[..., None]  # states of chosen samples


def empty_paths(S: int, H: int, m: int) -> Paths:
    """Room for S paths under H references."""
    return Paths(
        work=np.zeros(S),
        log_ratio=np.zeros((S, H)),
        key=np.zeros(S, np.int64),
        outcome=np.zeros(S, np.int8),
        steps=np.zeros(S, np.int32),
        now=np.zeros((S, m)),
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
    return _filling(block.tobytes(), len(block)) if isinstance(block, np.ndarray) else block


@cache  # kernels are built once per matrix
def _filling(data: bytes, m: int) -> Callable[..., None]:
    matrix = np.frombuffer(data).reshape(m, m)

    def fill(x, p, out):  # type: ignore[no-untyped-def]
        out[:, :] = matrix

    return fill


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
    varying, drifting = control_block is not None, drift is not no_drift
    gain_at: Any = control_block if varying else drift
    noise_at: Any = diffusion_block if varying else drift
    fixed = n - m
    car = n == 3 and m == 1 and not varying  # dx, dy along the heading, which is steered
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

    # One long function: every call with arrays would cost more than most of what stands in this loop.
    @kernel
    def one_path(world, guides, h, x0, seed, sample, ratio, states, applied, pushes):  # type: ignore[no-untyped-def]
        """Simulate one sample; fill `ratio` (H,), `states` (T+1, n), `applied` and `pushes` (up to T, m) if not empty.

        `applied` is the control carried, `pushes` the part of it that the nearest wall accounts for.
        """
        field, goal, radius, p = world.field, world.goal, world.goal_radius, world.parameters
        cuts, times, drifts, controls = world.cuts, guides.times, guides.drift, guides.control
        corners, beyond, count, active = guides.corners, guides.beyond, guides.count, guides.active
        speed, reach = guides.speed, guides.reach
        law, led = guides.law, guides.led
        H, T = controls.shape[0], controls.shape[1]
        weigh, draw, inverse = ratio.shape[0] > 0, states.shape[0] > 0, world.inverse
        x, moved, f, y = x0.copy(), x0.copy(), np.zeros(n), np.empty(m)
        G, D, B = np.zeros((m, m)), world.gain.copy(), world.diffusion.copy()
        a, pushed, stage = np.zeros((H, m)), np.zeros(m), np.zeros(H, np.int64)
        column, carried = np.empty((m, 1)), np.empty((m, 1))
        xx, xy, yy = covariance(B)
        steep = STEEP * D[0, 0]
        state, work, key = stream(seed, sample), 0.0, np.int64(0)
        before = distances(field, goal, radius, x[0], x[1])
        for j in range(n if draw else 0):
            states[0, j] = x[j]
        for i in range(T):
            dt = times[i + 1] - times[i]
            root, until = math.sqrt(dt), dt
            if varying:
                gain_at(x, p, G)
                noise_at(x, p, B)
                solve(B, G, D)
                xx, xy, yy = covariance(B)
            if drifting:
                drift(x, p, f)
            cov = (xx * dt, xy * dt, yy * dt)
            # The push B' grad log h away from the nearest wall, h = erf(c / reach): survivors lean that way anyway.
            near = noisy_position and (0.0 < before[0] < 3.0 * reach or 0.0 < before[1] < 3.0 * reach)
            if near:
                widest, c = math.sqrt(max(cov[0], cov[2])), min(before[0], before[1])
                gx, gy = survivors_slope(field, reach, widest, x[0], x[1], c)
                for j in range(m):
                    bx = B[0 - fixed, j] if fixed <= 0 else 0.0
                    by = B[1 - fixed, j] if fixed <= 1 else 0.0
                    pushed[j] = bx * gx + by * gy
            homeward = np.inf  # computed once, if a reference asks for it
            # a_g = B_c^-1 G_c u_g of every reference at this state; of the one followed, if nothing is weighed.
            for g in range(0 if weigh else h, H if weigh else h + 1):
                ends = count[g]
                if ends > 0:
                    s = stage[g]
                    dx, dy = corners[g, s, 0] - x[0], corners[g, s, 1] - x[1]
                    while s < ends - 1 and dx * beyond[g, s, 0] + dy * beyond[g, s, 1] < AHEAD:
                        s += 1
                        dx, dy = corners[g, s, 0] - x[0], corners[g, s, 1] - x[1]
                    stage[g] = s
                    scale = speed / max(math.sqrt(dx * dx + dy * dy), 1e-9)
                    for j in range(m):
                        a[g, j] = scale * (D[j, 0] * dx + (D[j, 1] * dy if m > 1 else 0.0))
                elif car and led[g] > i:
                    drive = law[g, i, 0] + law[g, i, 1] * (x[0] - law[g, i, 4]) + law[g, i, 2] * (x[1] - law[g, i, 5])
                    drive += law[g, i, 3] * wrapped(x[2] - law[g, i, 6])
                    a[g, 0] = max(-steep, min(steep, drive))
                elif car and led[g] > 0:
                    if homeward == np.inf:
                        bound = D[0, 0] * B[0, 0]
                        homeward = homing(x[0], x[1], x[2], goal[0], goal[1], radius, bound) / B[0, 0]
                    a[g, 0] = homeward
                else:
                    busy = i < active[g]
                    for j in range(m):
                        a[g, j] = drifts[g, i, j] if busy and not varying else 0.0
                        if varying and busy:
                            for k in range(m):
                                a[g, j] += D[j, k] * controls[g, i, k]
                if near:
                    for j in range(m):
                        a[g, j] += pushed[j]
            for j in range(m):
                state, z = normal(state)
                if car and led[h] > i:
                    z *= law[h, i, 7]
                y[j] = z * root + a[h, j] * dt
            # Where no noise acts on the position, it moves along the heading of the middle of the step, as the robot
            # does; but a step that enters the goal straight ahead ends before its noise matters.
            arrived, ahead = False, 1.0
            if not noisy_position and world.bridge:
                far = math.sqrt((x[0] - goal[0]) ** 2 + (x[1] - goal[1]) ** 2) - radius
                if far < math.sqrt(f[0] * f[0] + f[1] * f[1]) * dt:
                    exit, ahead = sweep_exit(field, goal, radius, x[0], x[1], x[0] + f[0] * dt, x[1] + f[1] * dt)
                    arrived = exit == REACHED
                if arrived:
                    until = 0.0
                    for j in range(m):
                        y[j] = 0.0
                elif drifting:
                    for j in range(n):
                        moved[j] = x[j]
                    for j in range(m):
                        for k in range(m):
                            moved[fixed + j] += 0.5 * B[j, k] * y[k]
                    drift(moved, p, f)
            for j in range(n):
                moved[j] = x[j] + f[j] * dt
            for j in range(m):
                for k in range(m):
                    moved[fixed + j] += B[j, k] * y[k]
            if i < applied.shape[0]:
                if varying:
                    for j in range(m):
                        column[j, 0] = y[j]
                    solve(D, column, carried)
                for j in range(m):
                    u = carried[j, 0] if varying else 0.0
                    if not varying:
                        for k in range(m):
                            u += inverse[j, k] * y[k]
                    applied[i, j] = u / dt
            if i < pushes.shape[0]:
                if varying and near:
                    for j in range(m):
                        column[j, 0] = pushed[j]
                    solve(D, column, carried)
                for j in range(m):
                    pushes[i, j] = carried[j, 0] if varying and near else 0.0
                    for k in range(m if near and not varying else 0):
                        pushes[i, j] += inverse[j, k] * pushed[k]
            # Each cut that is crossed adds a turn to the path's class, counter-clockwise positive.
            key += key_of_step(cuts, x[0], x[1], moved[0], moved[1])
            if not world.bridge:
                exit, share = endpoint_exit(field, goal, radius, moved[0], moved[1])
                if reach > 0.0:
                    before = distances(field, goal, radius, moved[0], moved[1])
            elif noisy_position:
                after = distances(field, goal, radius, moved[0], moved[1])
                state, exit, share = bridge_exit(
                    field, goal, radius, x[0], x[1], moved[0], moved[1], before, after, cov, state
                )
                before = after
                if isotropic and exit != INSIDE and cov[1] == 0.0 and cov[0] == cov[2]:
                    # Without this the rest of the step would enter dQ/dP as noise with a variance of a'a dt.
                    state, dx, dy = at_crossing(
                        field, goal, x[0], x[1], moved[0] - x[0] - f[0] * dt, moved[1] - x[1] - f[1] * dt,
                        exit, share, radius, math.sqrt(cov[0]), state,
                    )  # fmt: skip
                    y[0] = (B[0, 0] * dx + B[1, 0] * dy) * dt / cov[0]
                    y[1] = (B[0, 1] * dx + B[1, 1] * dy) * dt / cov[0]
                    moved[0], moved[1] = x[0] + f[0] * dt * share + dx, x[1] + f[1] * dt * share + dy
                    until = dt * share
            elif arrived:
                exit, share = REACHED, ahead
            else:
                exit, share = sweep_exit(field, goal, radius, x[0], x[1], moved[0], moved[1])
            if weigh:
                for g in range(H):
                    if car and led[g] > i:
                        if until > 0.0:
                            off = (y[0] - a[g, 0] * dt) / law[g, i, 7]
                            ratio[g] += 0.5 * (y[0] * y[0] - off * off) / dt - law[g, i, 8]
                    else:
                        for j in range(m):
                            ratio[g] += a[g, j] * (y[j] - 0.5 * a[g, j] * until)
            work += (q(x, p) if varying_rate else world.rate) * dt * share
            for j in range(n):
                x[j] = moved[j]
            for j in range(n if draw else 0):
                states[i + 1, j] = x[j]
            if exit != INSIDE:
                return work, key, exit, i + 1
        return work, key, 0, T

    @kernel
    def sample(world, guides, x0, seed, start, stop, paths):  # type: ignore[no-untyped-def]
        nothing = np.empty((0, 1))
        now, pushes = np.empty((guides.window, m)), np.empty((guides.window, m))
        h = 0
        for s in range(start, stop):
            while s >= guides.first[h + 1]:
                h += 1
            work, key, outcome, steps = one_path(
                world, guides, h, x0, seed, s, paths.log_ratio[s], nothing, now, pushes
            )
            paths.work[s], paths.key[s], paths.outcome[s], paths.steps[s] = work, key, outcome, steps
            for j in range(m):
                for i in range(min(steps, guides.window)):
                    share = (guides.times[i + 1] - guides.times[i]) / guides.times[guides.window]
                    paths.now[s, j] += share * (now[i, j] - pushes[i, j])

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
            _, _, _, steps = one_path(world, guides, h, x0, seed, s, ratio, nothing, applied, nothing)
            for i in range(steps):
                alive[g, i] += weight[c]
                for j in range(m):
                    total[g, i, j] += weight[c] * applied[i, j]

    @kernel
    def trace(world, guides, x0, seed, chosen, states, steps):  # type: ignore[no-untyped-def]
        nothing, ratio = np.empty((0, 1)), np.empty(0)
        for c in range(chosen.shape[0]):
            h = np.searchsorted(guides.first, chosen[c], side="right") - 1
            _, _, _, steps[c] = one_path(world, guides, h, x0, seed, chosen[c], ratio, states[c], nothing, nothing)

    return Kernels(sample, control, trace)
