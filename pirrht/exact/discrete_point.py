"""Solve the discrete-time problem in the plane: `psi(x) = exp(-q dt/lambda) E[psi(x + b dw)]`, exit where a step ends.

phi(x) = exp(-q dt/lambda) E[...] is smooth on both sides of a wall; psi jumps from phi to exp(-phi/lambda) at a wall
and to 1 at the goal's rim. Close to a jump the points of the sum weigh what their cubic interpolation polynomials
integrate to over the right part of their cells. Gaussian steps (`smooth`) are taken until nothing changes: sums over
points closer than the Gaussian is wide are exact but for rounding, even where psi is a steep exponential.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import correlate1d

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact import grid as grids
from pirrht.exact.grid import TUNING, Domain, Equation, Frame, Progress, Settling, cubic, in_goal
from pirrht.freespace import FreeSpace
from pirrht.geometry.blocks import lattice
from pirrht.jit.jit import inlined, kernel
from pirrht.problem import Problem

EVERY = 8  # steps from one comparison of log phi to the next


class Step(NamedTuple):
    """A step in time."""

    dt: float  # [s]
    b: float  # noise [m/sqrt(s)]
    rate: float  # q/lambda [nats/s]
    wall: float  # phi/lambda [nats]; may be infinite
    deviation: float  # b sqrt(dt) along each axis [m]
    cutoff: float  # boundaries and ends further away do not matter [m]


class Lattice(NamedTuple):
    """log phi on a grid that reaches beyond the border."""

    frame: Frame
    log_phi: Array  # (nx, ny, 1) [nats]


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
    n, m = log_psi.shape
    width = taps.shape[0]
    tile = TUNING.tile
    reach = taps.shape[0] // 2

    out = np.full((n, m), -math.inf)
    sign = np.zeros((n, m))
    window = np.empty(m + tile + width)
    row = np.empty(m + tile)

    for i in range(n):
        least = math.inf
        for e in range(m):
            least = min(least, log_psi[i, e] if log_psi[i, e] > -1e299 else math.inf)  # less is nothing
        span = m if log_psi[i].max() + math.log(TUNING.underflow) < least else tile  # so many share one exponent
        for q in range(0, m, span):
            low = max(q - reach, 0)
            high = min(q + span + reach, m)
            top = log_psi[i, low:high].max()
            if top == -math.inf:
                continue
            window[:], row[:] = 0.0, 0.0
            for e in range(low, high):
                window[e - q + reach] = weight[i, e] * math.exp(log_psi[i, e] - top)
            for t in range(width):
                for e in range(span):
                    row[e] += taps[t, q + e] * window[t + e]
            for e in range(min(span, m - q)):
                if row[e] != 0.0:
                    out[i, q + e] = top + math.log(abs(row[e]))
                    sign[i, q + e] = math.copysign(1.0, row[e])
    return out, sign


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or a share of a step's deviation in dt [s]; refuses too many points."""
    assert dt is not None
    deviation = Equation.of(problem).b * math.sqrt(dt)
    default = deviation / TUNING.discrete_points
    reason = f"noise carries a step {deviation:.2g} m"

    return grids.affordable(space.scene, default if spacing is None else spacing, reason, ", a longer step dt")


def grid_of(problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress) -> Lattice:
    """Solve for log phi with steps of dt [s] and a spacing [m]; OptionError if it does not settle."""
    assert dt is not None
    equation = Equation.of(problem)
    domain = Domain.of(space)
    step = step_of(dt, equation)
    margin = math.ceil(step.cutoff / spacing) + 1
    corner = domain.lower - margin * spacing
    size = np.ceil((domain.upper - corner) / spacing).astype(int) + 1 + margin
    clearance = domain.clearance(corner + spacing * lattice(*size).reshape(-1, 2)).reshape(tuple(size))
    free, goal = _integrated(clearance, corner - domain.goal.center, domain.goal.radius, spacing)
    known = goal + math.exp(-equation.wall) * (1.0 - free - goal)
    taps = [taps_along(n, 0.0, spacing, -math.inf, math.inf, step) for n in size]

    now = np.full(free.shape, -np.inf)
    before = np.full(free.shape, -np.inf)
    floor = np.full(free.shape, -np.inf)

    np.log(np.abs(known), out=floor, where=known != 0.0)
    settling = Settling(progress, EVERY * TUNING.discrete_settled)
    for done in range(1, TUNING.discrete_steps + 1):
        top = np.maximum(np.maximum(now, floor), -1e300)  # finite, so that differences from it are numbers
        now = smooth(
            top, free * np.exp(now - top) + np.sign(known) * np.exp(floor - top), taps[0], taps[1], equation.rate * dt
        )
        if done % EVERY == 0:
            change = grids.largest_change(now, before)
            settling.note(change)
            if change < EVERY * TUNING.discrete_settled:
                return Lattice(grids.frame_at(corner, spacing, domain.goal), now[:, :, None])
            before = now
    raise OptionError(f"the solution has not settled after {TUNING.discrete_steps} rounds; choose a longer dt")


def _integrated(clearance: Array, corner: Array, radius: float, spacing: float) -> tuple[Array, Array]:
    """Integrate the cubic polynomials of points over free space outside the goal, and over the goal, 2 x (nx, ny).

    `clearance` (nx, ny) [m] is interpolated linearly within cells; `corner` (2,) [m] is relative to the goal's centre.
    """
    parts, (nx, ny) = TUNING.cell_parts, clearance.shape
    free = np.zeros((nx, ny))
    goal = np.zeros((nx, ny))

    for u, v in itertools.product((np.arange(parts) + 0.5) / parts, repeat=2):
        clear = _along_both(clearance, [1.0 - u, u], [1.0 - v, v], -1)
        x, y = (corner[k] + spacing * (np.arange(n) + t) for k, n, t in ((0, nx, u), (1, ny, v)))
        depths = clear, radius - np.hypot(x[:, None], y)  # in free space, and in the goal
        outside, inside = (np.clip(0.5 + depth * parts / spacing, 0.0, 1.0) for depth in depths)
        p, q = (np.array(cubic(t)[::-1]) / parts for t in (u, v))
        free += _along_both(outside * (1.0 - inside), p, q, 0)
        goal += _along_both(outside * inside, p, q, 0)
    return free, goal


def _along_both(values: Array, p: Any, q: Any, origin: int) -> Array:
    """Correlate values (nx, ny) with weights p along x and q along y."""
    return np.asarray(correlate1d(correlate1d(values, p, axis=0, origin=origin), q, axis=1, origin=origin))


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log phi [nats] at x (2,), 0 in the goal; its gradient [1/m] goes to slope (2,)."""
    slope[:] = 0.0
    value = 0.0 if in_goal(grid.frame, x) else grids.interpolate(grid.log_phi, grid.frame, x, slope)
    if not math.isfinite(value):
        slope[:] = 0.0
        return -math.inf
    return value
