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
from pirrht.gates import PASSED, Gates, aim
from pirrht.jit import as_jitable, kernel
from pirrht.noise import normal, stream
from pirrht.problem import Problem, unit_rate
from pirrht.riccati import STEEP, homing, wrapped
from pirrht.scene import Array


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

    control: Array  # (H, T, m) tapes; for references with gates or a law what is added to these
    drift: Array  # (H, T, m) a = B_c^-1 G_c u, the same in noise units, where the gain is constant
    times: Array  # (T+1,) ends of the steps, from 0 [s]
    active: NDArray[np.int64]  # (H,) number of steps before a row of `control` is zero for good
    first: NDArray[np.int64]  # (H+1,) first sample drawn around each reference; the last entry is S
    gates: Gates  # what to head for, one after the other, instead of the tape
    speed: float  # towards a gate [m/s]
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
    now: Array  # (S, m) control now, integrated over the first `window` steps: noise, and the guide at the start
    span: Array  # (S,) time of these steps until the exit [s]


class Kernels(NamedTuple):
    """Compiled rollouts of one kind of dynamics."""

    sample: Callable[..., None]  # fills Paths for a range of samples
    control: Callable[..., None]  # weighted sum of the controls that samples carried
    trace: Callable[..., None]  # states of chosen samples
    added: Callable[..., None]  # weighted sum of what noise added to the controls of the guides


def empty_paths(S: int, H: int, m: int) -> Paths:
    """Room for S paths under H references."""
    return Paths(
        work=np.zeros(S),
        log_ratio=np.zeros((S, H)),
        key=np.zeros(S, np.int64),
        outcome=np.zeros(S, np.int8),
        steps=np.zeros(S, np.int32),
        now=np.zeros((S, m)),
        span=np.zeros(S),
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
    def one_path(world, guides, h, x0, seed, sample, ratio, states, applied, led_by, base):  # type: ignore[no-untyped-def]
        """Simulate one sample; fill `ratio` (H,), `states` (T+1, n), `applied` and `led_by` (up to T, m) if not empty.

        `applied` is the control carried up to the exit, as a mean over each step, `led_by` the guide's part of it;
        `base` (m,) is the guide's control at the start without the nearest wall.
        Returns work, class key, outcome, steps taken, time until the exit in the last of them.
        """
        field, goal, radius, p = world.field, world.goal, world.goal_radius, world.parameters
        cuts, times, drifts, controls = world.cuts, guides.times, guides.drift, guides.control
        corner, forth, outward, target = (
            guides.gates.corner, guides.gates.ahead, guides.gates.outward, guides.gates.target,
        )  # fmt: skip
        count, decay, table, active = guides.gates.count, guides.gates.decay, guides.gates.mean, guides.active
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
            hurry = 1.0
            if near:
                widest, c = math.sqrt(max(cov[0], cov[2])), min(before[0], before[1])
                gx, gy, width = survivors_slope(field, reach, widest, x[0], x[1], c)
                hurry = math.sqrt(
                    1.0 + (math.pi / (decay * width)) ** 2
                )  # exp(-sqrt(k^2 + (pi/width)^2) r) in a channel
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
                    dx, dy = corner[g, s, 0] - x[0], corner[g, s, 1] - x[1]
                    along = dx * forth[g, s, 0] + dy * forth[g, s, 1]
                    while s < ends - 1 and along < PASSED:
                        s += 1
                        dx, dy = corner[g, s, 0] - x[0], corner[g, s, 1] - x[1]
                        along = dx * forth[g, s, 0] + dy * forth[g, s, 1]
                    stage[g] = s
                    if s < ends - 1:
                        nx, ny = outward[g, s, 0], outward[g, s, 1]
                        far, beside = target[g, s, 0], target[g, s, 1]
                        shift = aim(along, -(dx * nx + dy * ny), far, beside, decay, table)
                        dx, dy = dx + shift * nx, dy + shift * ny
                    scale = hurry * speed / max(math.sqrt(dx * dx + dy * dy), 1e-9)
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
                    for j in range(m):
                        a[g, j] = 0.0
                if i < active[g]:
                    for j in range(m):
                        a[g, j] += 0.0 if varying else drifts[g, i, j]
                        for k in range(m if varying else 0):
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
            if i < applied.shape[0]:
                for j in range(m):
                    column[j, 0] = y[j]
                if varying:
                    solve(D, column, carried)
                for j in range(m):
                    u = carried[j, 0] if varying else 0.0
                    for k in range(0 if varying else m):
                        u += inverse[j, k] * y[k]
                    applied[i, j] = u / dt
            if i < led_by.shape[0]:
                for part in range(2 if i == 0 else 1):
                    for j in range(m):
                        column[j, 0] = a[h, j] - (pushed[j] if part == 1 and near else 0.0)
                    if varying:
                        solve(D, column, carried)
                    for j in range(m):
                        u = carried[j, 0] if varying else 0.0
                        for k in range(0 if varying else m):
                            u += inverse[j, k] * column[k, 0]
                        if part == 1:
                            base[j] = u
                        else:
                            led_by[i, j] = u * until / dt
            work += (q(x, p) if varying_rate else world.rate) * dt * share
            for j in range(n):
                x[j] = moved[j]
            for j in range(n if draw else 0):
                states[i + 1, j] = x[j]
            if exit != INSIDE:
                return work, key, exit, i + 1, until
        return work, key, 0, T, times[T] - times[T - 1]

    @kernel
    def sample(world, guides, x0, seed, start, stop, paths):  # type: ignore[no-untyped-def]
        nothing = np.empty((0, 1))
        window, times = guides.window, guides.times
        applied, led_by, base = np.empty((window, m)), np.empty((window, m)), np.empty(m)
        h = 0
        for s in range(start, stop):
            while s >= guides.first[h + 1]:
                h += 1
            work, key, outcome, steps, last = one_path(
                world, guides, h, x0, seed, s, paths.log_ratio[s], nothing, applied, led_by, base
            )
            paths.work[s], paths.key[s], paths.outcome[s], paths.steps[s] = work, key, outcome, steps
            for i in range(min(steps, window)):
                dt = times[i + 1] - times[i]
                alive = last if i == steps - 1 else dt
                paths.span[s] += alive
                for j in range(m):
                    paths.now[s, j] += dt * (applied[i, j] - led_by[i, j]) + alive * base[j]

    @kernel
    def control(world, guides, x0, seed, chosen, group, weight, total, alive):  # type: ignore[no-untyped-def]
        """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
        nothing, ratio = np.empty((0, 1)), np.empty(0)
        applied, base = np.zeros((guides.control.shape[1], m)), np.empty(m)
        h = 0
        for c in range(chosen.shape[0]):
            s, g = chosen[c], group[c]
            while s >= guides.first[h + 1]:
                h += 1
            _, _, _, steps, _ = one_path(world, guides, h, x0, seed, s, ratio, nothing, applied, nothing, base)
            for i in range(steps):
                alive[g, i] += weight[c]
                for j in range(m):
                    total[g, i, j] += weight[c] * applied[i, j]

    @kernel
    def trace(world, guides, x0, seed, chosen, states, steps):  # type: ignore[no-untyped-def]
        nothing, ratio, base = np.empty((0, 1)), np.empty(0), np.empty(m)
        for c in range(chosen.shape[0]):
            h = np.searchsorted(guides.first, chosen[c], side="right") - 1
            _, _, _, steps[c], _ = one_path(
                world, guides, h, x0, seed, chosen[c], ratio, states[c], nothing, nothing, base
            )

    @kernel
    def added(world, guides, x0, seed, chosen, weight, total):  # type: ignore[no-untyped-def]
        """Add weight times what noise added to the control of its guide to total[guide] (H, T, m)."""
        nothing, ratio, T = np.empty((0, 1)), np.empty(0), guides.control.shape[1]
        applied, led_by, base = np.zeros((T, m)), np.zeros((T, m)), np.empty(m)
        for c in range(chosen.shape[0]):
            h = np.searchsorted(guides.first, chosen[c], side="right") - 1
            _, _, _, steps, _ = one_path(world, guides, h, x0, seed, chosen[c], ratio, nothing, applied, led_by, base)
            for i in range(steps):
                for j in range(m):
                    total[h, i, j] += weight[c] * (applied[i, j] - led_by[i, j])

    return Kernels(sample, control, trace, added)
