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

import numpy as np

from pirrht.arrays import Array
from pirrht.exact.boundaries import (
    GOAL,
    WALL,
    Step,
    boundaries_of,
    distances_ahead,
    patch_of,
    psi_around_goal,
    solids_near,
    to_border,
)
from pirrht.exact.grid import TUNING, to_rim
from pirrht.jit.jit import inlined, kernel


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


@kernel
def smooth(later, into, known, taps_x, taps_y, loss, out):  # type: ignore[no-untyped-def]
    """Fill `out` with log(e^-loss sum_y N(y - x) psi(y)), psi = into exp(later) + known, axis by axis.

    Args: `later`, `into`, `known` and `out`, 4 x (nx, ny); `taps_x` and `taps_y` of `taps_along`; loss [nats].
    """
    (nx, ny), tile = later.shape, TUNING.tile
    rows, columns = -(-nx // tile), -(-ny // tile)
    psi, power = np.zeros((rows * tile, columns * tile)), np.full((rows, columns), -math.inf)
    for p in range(rows):
        for q in range(columns):
            i0, j0, i1, j1 = p * tile, q * tile, min((p + 1) * tile, nx), min((q + 1) * tile, ny)
            most = known[i0:i1, j0:j1].max()
            top = max(later[i0:i1, j0:j1].max(), math.log(most) if most > 0.0 else -math.inf)
            power[p, q], factor = top, math.exp(-top) if most > 0.0 else 0.0
            if top > -math.inf:
                for i in range(i0, i1):
                    for j in range(j0, j1):
                        psi[i, j] = into[i, j] * math.exp(later[i, j] - top) + known[i, j] * factor
    psi, power = _along_rows(psi, power, taps_y)
    psi, power = _along_rows(psi.T.copy(), power.T.copy(), taps_x)
    for i in range(nx):
        for j in range(ny):
            value = psi[j, i]
            out[i, j] = power[j // tile, i // tile] - loss + math.log(value) if value > 0.0 else -math.inf


@kernel
def _along_rows(psi, power, taps):  # type: ignore[no-untyped-def]
    """Convolve rows of psi (n, m) with taps (2 R + 1, m); `power` (p, q) [nats] is the exponent of each tile."""
    width, tile = taps.shape[0], TUNING.tile
    around = -(-(width // 2) // tile)
    window, row, factor = np.zeros((2 * around + 1) * tile), np.empty(tile), np.empty(2 * around + 1)
    out, raised = np.zeros(psi.shape), np.full(power.shape, -math.inf)
    for p in range(power.shape[0]):
        for q in range(power.shape[1]):
            q0, q1, most = max(q - around, 0), min(q + around + 1, power.shape[1]), 0.0
            top = power[p, q0:q1].max()
            if top == -math.inf:
                continue
            window[:] = 0.0
            for t in range(q0, q1):
                factor[t - q0] = math.exp(power[p, t] - top)
            for i in range(p * tile, (p + 1) * tile):
                for t in range(q0, q1):
                    for e in range(tile):
                        window[(t - q + around) * tile + e] = psi[i, t * tile + e] * factor[t - q0]
                row[:] = 0.0
                for t in range(width):
                    first = around * tile - width // 2 + t
                    for e in range(tile):
                        row[e] += taps[t, q * tile + e] * window[first + e]
                for e in range(tile):
                    out[i, q * tile + e] = row[e]
                    most = max(most, abs(row[e]))
            if most > 0.0:
                out[p * tile : (p + 1) * tile, q * tile : (q + 1) * tile] /= most
                raised[p, q] = top + math.log(most)
    return out, raised


@kernel
def meet_boundaries(surroundings, step, begin, end, later, out):  # type: ignore[no-untyped-def]
    """Correct `out` of `smooth` where solids, the goal, or a border that costs are within reach; minus infinity inside.

    Args: `begin` and `end`, poses of all bodies, 2 x (1 + J, 4), as of `frames_of`; `later` and `out`, log psi at the
        end and the beginning of the step, 2 x (nx, ny) [nats].
    """
    (nx, ny), frame, tile = out.shape, surroundings.frame, TUNING.tile
    margin = math.ceil(step.cutoff / frame.spacing)
    reach = step.cutoff + 0.5 * math.sqrt(2.0) * tile * frame.spacing
    for i0 in range(0, nx, tile):
        for j0 in range(0, ny, tile):
            i1, j1 = min(i0 + tile, nx), min(j0 + tile, ny)
            x, y = frame.x0 + 0.5 * (i0 + i1 - 1) * frame.spacing, frame.y0 + 0.5 * (j0 + j1 - 1) * frame.spacing
            near = solids_near(surroundings.bodies, begin, end, x, y, reach)
            bordered = step.wall < math.inf and to_border(surroundings, x, y) < reach
            if len(near) == 0 and not bordered and to_rim(frame, x, y) >= reach:
                continue
            patch = patch_of(surroundings, later, near, begin, end, (i0, j0, i1, j1), margin)
            for i in range(i0, i1):
                for j in range(j0, j1):
                    x, y = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
                    known, met = boundaries_of(surroundings, step, patch, x, y)
                    if not known:
                        out[i, j] = -math.inf
                    elif _matters(met, step) or out[i, j] <= patch.base + math.log(TUNING.underflow):
                        out[i, j] = _before(surroundings, step, patch, met, x, y, i - i0, j - j0)
                        if out[i, j] <= patch.base + math.log(TUNING.underflow):
                            own = patch_of(surroundings, later, near, begin, end, (i, j, i + 1, j + 1), margin)
                            out[i, j] = _before(surroundings, step, own, met, x, y, 0, 0)


@inlined
def _matters(met, step):  # type: ignore[no-untyped-def]
    """Tell whether boundaries do more than a border that no path survives, which `taps_along` accounts for."""
    return len(met.kind) > 0 and (met.kind[0] <= WALL or step.wall < math.inf)


@kernel
def log_psi_before(surroundings, step, begin, end, later, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (2,) [m], a step before `later` (nx, ny) [nats]; its gradient [1/m] goes to slope (2,).

    -phi/lambda in walls. `begin` and `end` are poses of all bodies, 2 x (1 + J, 4), as of `frames_of`.
    """
    frame = surroundings.frame
    near = solids_near(surroundings.bodies, begin, end, x[0], x[1], step.cutoff)
    i, j = math.floor((x[0] - frame.x0) / frame.spacing + 0.5), math.floor((x[1] - frame.y0) / frame.spacing + 0.5)
    margin = math.ceil(step.cutoff / frame.spacing + 0.5)
    patch = patch_of(surroundings, later, near, begin, end, (i, j, i + 1, j + 1), margin)
    slope[0], slope[1] = 0.0, 0.0
    known, met = boundaries_of(surroundings, step, patch, x[0], x[1])
    if not known:
        return -step.wall
    value = _before(surroundings, step, patch, met, x[0], x[1], 0, 0)
    e = TUNING.difference * step.deviation
    for g in range(len(met.kind)):
        e = min(e, 0.005 * met.distance[g])
    for k in range(2 if value > -math.inf else 0):
        for side in (-1.0, 1.0):
            px, py = x[0] + side * e * (1 - k), x[1] + side * e * k
            met = boundaries_of(surroundings, step, patch, px, py)[1]
            slope[k] += side / (2.0 * e) * _before(surroundings, step, patch, met, px, py, 0, 0)
    return value


@kernel
def _before(surroundings, step, patch, met, x, y, i0, j0):  # type: ignore[no-untyped-def]
    """log psi [nats] at the beginning of a step at (x, y) [m] with `Boundaries`; (i0, j0) of `patch` is first in reach.

    `short` (B,) are the sums that the shares of boundaries are short of.
    """
    frame, width, B, variance = surroundings.frame, 2 * patch.margin + 1, len(met.kind), step.deviation**2
    ahead, psi, around_goal = np.empty((B, width, width)), patch.psi, patch.around_goal
    distances_ahead(surroundings, patch, met, i0, j0, ahead)
    distance, kind, steepness, paying = met.distance, met.kind, met.steepness, step.wall < math.inf
    short, whole, weight = np.zeros(B), 0.0, np.empty((2, width))
    for a in range(width):
        dx = frame.x0 + (patch.i0 + i0 + a) * frame.spacing - x
        dy = frame.y0 + (patch.j0 + j0 + a) * frame.spacing - y
        scale = frame.spacing / (math.sqrt(2.0 * math.pi) * step.deviation)
        weight[0, a] = scale * math.exp(-0.5 * dx * dx / variance)
        weight[1, a] = scale * math.exp(-0.5 * dy * dy / variance)
    for a in range(width):
        for c in range(width):
            gauss = weight[0, a] * weight[1, c]
            total = gauss * psi[i0 + a, j0 + c]
            for g in range(B):
                pays = paying or kind[g] == GOAL
                if total > 0.0 or pays:
                    alive = _survival(distance[g], ahead[g, a, c], variance)
                    total *= alive
                    if pays and alive > 0.0:
                        goal = kind[g] == GOAL
                        alone = around_goal[i0 + a, j0 + c] if goal else math.exp(-steepness[g] * ahead[g, a, c])
                        short[g] += gauss * alive * alone
            whole += total
    value = patch.base - step.rate * step.dt + math.log(whole) if whole > 0.0 else -math.inf
    for g in range(B):
        if paying or kind[g] == GOAL:
            value = _log_sum(value, _log_share(surroundings, step, met, g, short[g]))
    return value


@kernel
def _log_share(surroundings, step, met, g, short):  # type: ignore[no-untyped-def]
    """log(share_g psi_g) of boundary g [nats], whose share is short of a sum; paths meet others with half a chance."""
    if met.kind[g] == GOAL:
        alone = psi_around_goal(surroundings.around_goal, surroundings.pitch, met.distance[g])
    else:
        alone = math.exp(-met.steepness[g] * met.distance[g])
    share = alone - math.exp(-step.rate * step.dt) * short
    if share < TUNING.kernel_sum * alone:
        return -math.inf
    for h in range(len(met.kind)):
        if h != g:
            share *= 1.0 - 0.5 * _meeting(met.distance[h], met.speed[h], step)
    return math.log(share) - (0.0 if met.kind[g] == GOAL else step.wall)


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
