"""Step psi back in time: `psi(x, t) = e^(-q dt/lambda) sum_y N(y - x) S(x, y) psi(y, t + dt) + sum_g share_g psi_g`.

A sum over points closer than the Gaussian N is wide is exact but for rounding, even where psi is a steep exponential.
S is the probability that a path survives: a Brownian bridge, also relative to a moving wall, misses one from which its
ends have clearances d and e, each at its own time, with probability 1 - exp(-2 d e / (b^2 dt)). Solids in one direction
from a path's beginning are one wall, at the clearance of the nearest; each direction has a factor of its own.

psi_g is 1 at the goal and exp(-phi/lambda) at walls. Around a boundary that is alone psi is known: K_0(k rho)/K_0(k r)
around the goal's disc, exp(-(m + n) d) at a flat wall from which noise and its own speed carry a path away with a drift
of m b^2, n^2 = m^2 + k^2. So share_g is what the sum over grid points is short of that, which includes the sum's error
at the kink there. Of two boundaries within reach a path meets either first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.exact.boundaries import JUMP, boundaries_of, patch_of, poses_at, solids_near, to_border
from pirrht.exact.grid import TUNING, polynomial, to_rim
from pirrht.jit.jit import inlined, kernel


class Step(NamedTuple):
    """A step in time."""

    dt: float  # [s]
    b: float  # noise [m/sqrt(s)]
    rate: float  # q/lambda [nats/s]
    wall: float  # phi/lambda [nats]; may be infinite
    deviation: float  # b sqrt(dt) along each axis [m]
    cutoff: float  # boundaries and ends further away do not matter [m]


@inlined
def step_of(dt, equation):  # type: ignore[no-untyped-def]
    """Return a step of dt [s]; `equation` is an `Equation` or another `Step`."""
    b, rate = equation.b, equation.rate
    deviation = b * math.sqrt(dt)
    return Step(dt, b, rate, equation.wall, deviation, (TUNING.cutoff + math.sqrt(2.0 * rate * dt)) * deviation)


def taps_along(count: int, first: float, spacing: float, low: float, high: float, step: Step) -> Array:
    """Weights of points up to R before and after each along an axis, (2 R + 1, count filled up to whole tiles).

    Args: `first`, coordinate of the first point, `spacing` h, `low` and `high` border [m]; `step`, whose reach is R.
    """
    R = math.ceil(step.cutoff / spacing)
    offset = spacing * np.arange(-R, R + 1)[:, None]
    weight = spacing / (step.deviation * math.sqrt(2.0 * math.pi)) * np.exp(-0.5 * (offset / step.deviation) ** 2)
    here = first + spacing * np.arange(TUNING.tile * -(-count // TUNING.tile))
    out = np.repeat(weight, len(here), axis=1)
    for d, e in ((here - low, here + offset - low), (high - here, high - here - offset)):
        out *= -np.expm1(-2.0 * np.maximum(d, 0.0) * np.maximum(e, 0.0) / step.deviation**2)
    return out


def smooth(log_psi: Array, weight: Array, taps_x: Array, taps_y: Array, loss: float) -> Array:
    """log(e^-loss sum_y N(y - x) psi(y)) of psi = weight exp(log_psi), (nx, ny), axis by axis, with `taps_along`."""
    log_psi, weight = _along_rows(log_psi, weight, taps_y)
    log_psi, weight = _along_rows(log_psi.T.copy(), weight.T.copy(), taps_x)
    return np.where(weight > 0.0, log_psi - loss, -np.inf).T.copy()


@kernel
def _along_rows(log_psi, weight, taps):  # type: ignore[no-untyped-def]
    """Convolve rows of psi = weight exp(log_psi), (n, m), with taps (2 R + 1, m); the result as two such factors."""
    (n, m), width, tile, reach = log_psi.shape, taps.shape[0], TUNING.tile, taps.shape[0] // 2
    out, sign, window, row = np.full((n, m), -math.inf), np.zeros((n, m)), np.empty(tile + width - 1), np.empty(tile)
    for i in range(n):
        for q in range(0, m, tile):
            low, high = max(q - reach, 0), min(q + tile + reach, m)
            top = log_psi[i, low:high].max()
            if top == -math.inf:
                continue
            window[:], row[:] = 0.0, 0.0
            for e in range(low, high):
                window[e - q + reach] = weight[i, e] * math.exp(log_psi[i, e] - top)
            for t in range(width):
                for e in range(tile):
                    row[e] += taps[t, q + e] * window[t + e]
            for e in range(min(tile, m - q)):
                if row[e] != 0.0:
                    out[i, q + e], sign[i, q + e] = top + math.log(abs(row[e])), math.copysign(1.0, row[e])
    return out, sign


@kernel
def meet_boundaries(surroundings, step, t, later, out):  # type: ignore[no-untyped-def]
    """Correct `out` of `smooth` where solids, the goal, or a border that costs are within reach; minus infinity inside.

    Args: t, when the step begins [s]; `later` and `out`, log psi at its end and its beginning, 2 x (nx, ny) [nats].
    """
    (nx, ny), frame, tile = out.shape, surroundings.frame, TUNING.tile
    begin, end = poses_at(surroundings.solids, t + JUMP), poses_at(surroundings.solids, t + step.dt - JUMP)
    margin = math.ceil(step.cutoff / frame.spacing)
    reach = step.cutoff + 0.5 * math.sqrt(2.0) * tile * frame.spacing
    for i0 in range(0, nx, tile):
        for j0 in range(0, ny, tile):
            i1, j1 = min(i0 + tile, nx), min(j0 + tile, ny)
            x, y = frame.x0 + 0.5 * (i0 + i1 - 1) * frame.spacing, frame.y0 + 0.5 * (j0 + j1 - 1) * frame.spacing
            near = solids_near(surroundings, begin, end, x, y, reach)
            bordered = step.wall < math.inf and to_border(surroundings, x, y) < reach
            if len(near) == 0 and not bordered and to_rim(frame, x, y) >= reach:
                continue
            patch = patch_of(surroundings, later, near, begin, end, (i0, j0, i1, j1), margin)
            least = patch.base + math.log(TUNING.underflow)
            for i in range(i0, i1):
                for j in range(j0, j1):
                    x, y = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
                    free, met = boundaries_of(surroundings, step, patch, x, y)
                    paid = step.wall < math.inf and len(met.distance) > 0
                    if not free:
                        out[i, j] = -math.inf
                    elif met.goals > 0 or met.solid or paid or out[i, j] <= least:  # else `taps_along` has all walls
                        out[i, j] = _before(surroundings, step, patch, met, x, y, i - i0, j - j0)
                        if out[i, j] <= least:
                            own = patch_of(surroundings, later, near, begin, end, (i, j, i + 1, j + 1), margin)
                            out[i, j] = _before(surroundings, step, own, met, x, y, 0, 0)


@kernel
def log_psi_before(surroundings, step, t, later, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (2,) [m] and t [s], a step before `later` (nx, ny) [nats]; -phi/lambda in walls.

    Its gradient [1/m] goes to slope (2,).
    """
    frame, solids = surroundings.frame, surroundings.solids
    begin, end = poses_at(solids, t), poses_at(solids, t + step.dt - JUMP)
    near = solids_near(surroundings, begin, end, x[0], x[1], step.cutoff)
    i, j = math.floor((x[0] - frame.x0) / frame.spacing + 0.5), math.floor((x[1] - frame.y0) / frame.spacing + 0.5)
    margin = math.ceil(step.cutoff / frame.spacing + 0.5)
    patch = patch_of(surroundings, later, near, begin, end, (i, j, i + 1, j + 1), margin)
    slope[0], slope[1] = 0.0, 0.0
    free, met = boundaries_of(surroundings, step, patch, x[0], x[1])
    if not free:
        return -step.wall
    value = _before(surroundings, step, patch, met, x[0], x[1], 0, 0)
    e = TUNING.difference * step.deviation
    for d in met.distance:
        e = min(e, 0.005 * d)
    for k in range(2 if value > -math.inf else 0):
        for side in (-e, e):
            px, py = x[0] + side * (1 - k), x[1] + side * k
            met = boundaries_of(surroundings, step, patch, px, py)[1]
            slope[k] += 0.5 / side * _before(surroundings, step, patch, met, px, py, 0, 0)
    return value


@kernel
def _before(surroundings, step, patch, met, x, y, i0, j0):  # type: ignore[no-untyped-def]
    """log psi [nats] at the beginning of a step at (x, y) [m] with `Boundaries`; (i0, j0) of `patch` is first in reach.

    `short` (B,) are the sums that the shares of boundaries are short of.
    """
    frame, width, B, variance = surroundings.frame, patch.width, len(met.distance), step.deviation**2
    short, whole, weight, paying = np.zeros(B), 0.0, np.empty((2, width)), step.wall < math.inf
    ahead = np.full((B, width, width), math.inf)
    for r in range(len(met.member)):
        if met.member[r] < 0:
            continue
        known, least = patch.ahead[r, i0 : i0 + width, j0 : j0 + width], ahead[met.member[r]]
        for a in range(width):
            for c in range(width):
                least[a, c] = min(least[a, c], known[a, c])
    for a in range(width):
        dx = frame.x0 + (patch.i0 + i0 + a) * frame.spacing - x
        dy = frame.y0 + (patch.j0 + j0 + a) * frame.spacing - y
        scale = frame.spacing / (math.sqrt(2.0 * math.pi) * step.deviation)
        weight[0, a] = scale * math.exp(-0.5 * dx * dx / variance)
        weight[1, a] = scale * math.exp(-0.5 * dy * dy / variance)
    distance, goals, psi = met.distance, met.goals, patch.psi
    for a in range(width):
        for c in range(width):
            gauss = weight[0, a] * weight[1, c]
            total = gauss * psi[i0 + a, j0 + c]
            for g in range(B):
                pays = paying or g < goals
                if total > 0.0 or pays:
                    alive = _survival(distance[g], ahead[g, a, c], variance)
                    total *= alive
                    if pays and alive > 0.0:
                        short[g] += gauss * alive * _alone(surroundings, met, g, ahead[g, a, c])
            whole += total
    value = patch.base - step.rate * step.dt + math.log(whole) if whole > 0.0 else -math.inf
    for g in range(B if paying else met.goals):
        value = _log_sum(value, _log_share(surroundings, step, met, g, short[g]))
    return value


@kernel
def _log_share(surroundings, step, met, g, short):  # type: ignore[no-untyped-def]
    """log(share_g psi_g) of boundary g [nats], whose share is short of a sum; paths meet others with half a chance."""
    alone = _alone(surroundings, met, g, met.distance[g])
    share = alone - math.exp(-step.rate * step.dt) * short
    if share < TUNING.kernel_sum * alone:
        return -math.inf
    for h in range(len(met.distance)):
        if h != g:
            share *= 1.0 - 0.5 * _meeting(met.distance[h], met.speed[h], step)
    return math.log(share) - (0.0 if g < met.goals else step.wall)


@inlined
def _alone(surroundings, met, g, e):  # type: ignore[no-untyped-def]
    """psi at a distance e [m] from boundary g if nothing else is near."""
    if g >= met.goals:
        return math.exp(-met.steepness[g] * e)
    table, at = surroundings.around_goal, e / surroundings.pitch
    i, value = min(max(int(at), 1), table.shape[0] - 3), 0.0
    for c in range(-1, 3):
        value += polynomial(min(at - i, 2.0), c) * table[i + c]
    return value


@inlined
def _log_sum(a, b):  # type: ignore[no-untyped-def]
    """log(exp(a) + exp(b))."""
    high, low = max(a, b), min(a, b)
    return high if low == -math.inf else high + math.log1p(math.exp(low - high))


@inlined
def _survival(d, e, variance):  # type: ignore[no-untyped-def]
    """Probability that a bridge misses a wall from which its ends are d and e [m]; 0 beyond it."""
    if d <= 0.0 or e <= 0.0:
        return 0.0
    z = 2.0 * d * e / variance
    if z > 40.0:
        return 1.0
    return -math.expm1(-z) if z < 1e-3 else 1.0 - math.exp(-z)


@inlined
def _meeting(d, speed, step):  # type: ignore[no-untyped-def]
    """Probability that a path meets a wall d away [m] whose distance grows at a speed [m/s]."""
    width, ahead = step.deviation * math.sqrt(2.0), speed * step.dt
    mirrored = math.exp(min(-2.0 * d * speed / (step.b * step.b), 700.0)) * math.erfc((d - ahead) / width)
    return min(0.5 * (math.erfc((d + ahead) / width) + mirrored), 1.0)
