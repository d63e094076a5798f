"""Solve the discrete-time problem in the plane: `psi(x) = exp(-q dt/lambda) E[psi(x + b dw)]`, exit where a step ends.

phi(x) = exp(-q dt/lambda) E[...] is smooth on both sides of a wall; psi jumps from phi to exp(-phi/lambda) at a wall
and to 1 at the goal's rim. The expectation is a sum over grid points, exact up to exp(-2 pi^2 width^2) for a Gaussian
wider than a spacing; close to a jump the points weigh what their cubic interpolation polynomials integrate to over the
right part of their cells. The sum is taken axis by axis until nothing changes. Each tile of 16 x 16 points has an
exponent of its own, since phi falls below 1e-300.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact.grid import (
    Domain,
    Frame,
    Progress,
    affordable,
    derivative,
    frame_at,
    ignore_progress,
    in_cells,
    in_goal,
    polynomial,
)
from pirrht.freespace import FreeSpace
from pirrht.jit.jit import inlined, kernel
from pirrht.problem import Problem

PER_STEP = 3.0  # default points per standard deviation of a step
BEYOND = 6.5  # a step is cut off so many deviations beyond the one that the law asks for
PARTS = 8  # cells cut by a wall or by the rim are integrated over so many parts each way
MARGIN = 3  # grid points beyond the border
SETTLED = 1e-7  # largest change of log phi in a round [nats]
ROUNDS = 20_000


class Lattice(NamedTuple):
    """log phi on a grid that reaches beyond the border."""

    frame: Frame
    log_phi: Array  # (nx, ny) [nats]


def _deviation(problem: Problem, dt: float) -> float:
    """Standard deviation of a step along each axis [m]."""
    return float(problem.dynamics.B_c(np.zeros(2))[0, 0]) * math.sqrt(dt)


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or a share of a step's deviation in dt [s]; refuses too many points."""
    assert dt is not None
    deviation = _deviation(problem, dt)
    reason = f"noise carries a step {deviation:.2g} m"
    return affordable(space.scene, deviation / PER_STEP if spacing is None else spacing, reason, ", a longer --dt")


def grid_of(
    problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress = ignore_progress
) -> Lattice:
    """Solve a problem with steps of dt [s] on a grid of this spacing [m], (nx, ny) [nats]."""
    assert not callable(problem.q)
    assert dt is not None
    loss, wall = problem.q * dt / problem.temperature, problem.phi / problem.temperature
    return solve(Domain.of(space), deviation=_deviation(problem, dt), loss=loss, wall=wall, spacing=spacing)


def solve(domain: Domain, *, deviation: float, loss: float, wall: float, spacing: float) -> Lattice:
    """Solve the discrete-time problem for log phi, (nx, ny) [nats]; OptionError if the rounds do not settle.

    Args: deviation b sqrt(dt) [m]; loss q dt/lambda and wall phi/lambda [nats], which may be infinite; spacing h [m].
    """
    tilt = math.sqrt(2.0 * loss)
    taps = math.ceil((tilt + BEYOND) * deviation / spacing)
    offset = np.arange(-taps, taps + 1) * spacing / deviation
    log_taps = -0.5 * offset**2
    log_taps -= np.log(np.exp(log_taps).sum())
    margin = MARGIN if wall > 700.0 else taps
    corner = domain.lower - margin * spacing
    count = np.ceil((domain.upper - corner) / spacing).astype(int) + 1 + margin
    size = TILE * -(-count // TILE)
    into, at_goal = _weights(domain, corner, size, spacing)
    known = at_goal + math.exp(-wall) * (1.0 - into - at_goal)
    phi, power = np.zeros(tuple(size)), np.full(tuple(size // TILE), -np.inf)
    before = np.full(tuple(size), -np.inf)
    g = np.exp(log_taps)
    for done in range(ROUNDS):
        phi, power = one_round(phi, power, into, known, g, loss)
        if done % 8 == 7:
            now = logarithm(phi, power)
            with np.errstate(invalid="ignore"):
                change = float(np.nanmax(np.abs(now - before)[: count[0], : count[1]]))
            if change < 8 * SETTLED:
                return Lattice(frame_at(corner, spacing, domain.goal), now)
            before = now
    raise OptionError(f"the solution has not settled after {ROUNDS} rounds; choose a longer dt")


def _weights(domain: Domain, corner: Array, size: Array, spacing: float) -> tuple[Array, Array]:
    """Weights of points for free space outside the goal, and for the goal; 2 x (nx, ny)."""
    index = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1).reshape(-1, 2)
    points = corner + spacing * index
    free_by = np.maximum(domain.clearance(points), -1.0).reshape(size[0], size[1])
    into, at_goal = np.zeros((size[0], size[1])), np.zeros((size[0], size[1]))
    _integrate(free_by, corner / spacing, spacing, domain.goal.center, domain.goal.radius, into, at_goal)
    return into, at_goal


@kernel
def _integrate(free_by, origin, spacing, goal, radius, into, at_goal):  # type: ignore[no-untyped-def]
    """Integrate the cubic Lagrange polynomials of the points around each cell."""
    nx, ny = free_by.shape
    base = np.empty((PARTS, 4))
    for a in range(PARTS):
        for k in range(4):
            base[a, k] = polynomial((a + 0.5) / PARTS, k - 1)
    one = np.empty(4)
    for k in range(4):
        one[k] = base[:, k].mean()
    free, inside = np.empty((4, 4)), np.empty((4, 4))
    step = spacing / PARTS
    for i in range(1, nx - 2):
        for j in range(1, ny - 2):
            low = min(min(free_by[i, j], free_by[i + 1, j]), min(free_by[i, j + 1], free_by[i + 1, j + 1]))
            high = max(max(free_by[i, j], free_by[i + 1, j]), max(free_by[i, j + 1], free_by[i + 1, j + 1]))
            if high <= 0.0:
                continue
            mx, my = (origin[0] + i + 0.5) * spacing - goal[0], (origin[1] + j + 0.5) * spacing - goal[1]
            rim = math.sqrt(mx * mx + my * my) - radius
            if low >= 0.0 and abs(rim) > spacing:
                for k in range(4):
                    for e in range(4):
                        if rim > 0.0:
                            into[i - 1 + k, j - 1 + e] += one[k] * one[e]
                        else:
                            at_goal[i - 1 + k, j - 1 + e] += one[k] * one[e]
                continue
            free[:, :] = 0.0
            inside[:, :] = 0.0
            for a in range(PARTS):
                u = (a + 0.5) / PARTS
                for b in range(PARTS):
                    v = (b + 0.5) / PARTS
                    c = (free_by[i, j] * (1 - u) + free_by[i + 1, j] * u) * (1 - v)
                    c += (free_by[i, j + 1] * (1 - u) + free_by[i + 1, j + 1] * u) * v
                    x, y = (origin[0] + i + u) * spacing - goal[0], (origin[1] + j + v) * spacing - goal[1]
                    open_share = min(max(0.5 + c / step, 0.0), 1.0)
                    goal_share = min(max(0.5 + (radius - math.sqrt(x * x + y * y)) / step, 0.0), 1.0)
                    for k in range(4):
                        for e in range(4):
                            weight = open_share * base[a, k] * base[b, e] / PARTS**2
                            free[k, e] += weight * (1.0 - goal_share)
                            inside[k, e] += weight * goal_share
            into[i - 1 : i + 3, j - 1 : j + 3] += free
            at_goal[i - 1 : i + 3, j - 1 : j + 3] += inside


@kernel
def look(grid, x, slope):  # type: ignore[no-untyped-def]
    """log phi [nats] at x (2,), 0 in the goal; its gradient [1/m] goes to slope (2,)."""
    slope[0], slope[1] = 0.0, 0.0
    if in_goal(grid.frame, x):
        return 0.0
    nx, ny = grid.log_phi.shape
    fx, fy = in_cells(grid.frame, x)
    i, j = min(max(int(fx), 1), nx - 3), min(max(int(fy), 1), ny - 3)
    value, h = 0.0, grid.frame.spacing
    for k in range(-1, 3):
        px, dx = polynomial(fx - i, k), derivative(fx - i, k)
        for e in range(-1, 3):
            py, dy = polynomial(fy - j, e), derivative(fy - j, e)
            entry = grid.log_phi[i + k, j + e]
            value += px * py * entry
            slope[0] += dx * py * entry / h
            slope[1] += px * dy * entry / h
    if not math.isfinite(value):
        slope[0], slope[1] = 0.0, 0.0
        return -math.inf
    return value


TILE = 16  # points along each side of a tile


def one_round(phi: Array, power: Array, into: Array, known: Array, taps: Array, loss: float) -> tuple[Array, Array]:
    """Apply `phi = exp(-loss) E[psi]` once with psi = into phi + known; returns phi and power.

    Args: phi (nx, ny), to be multiplied by exp(power), power (nx/TILE, ny/TILE) [nats]; into and known (nx, ny); taps
        (2 R + 1,), weights of the Gaussian along each axis; loss, q dt/lambda [nats].
    """
    source, first = np.empty_like(phi), np.empty_like(power)
    _combine(phi, power, into, known, source, first)
    middle, second = np.empty_like(phi), np.empty_like(power)
    _along_y(source, first, taps, middle, second)
    out, third = np.empty_like(phi), np.empty_like(power)
    _along_x(middle, second, taps, out, third)
    return out, third - loss


def logarithm(phi: Array, power: Array) -> Array:
    """log phi at every point, (nx, ny) [nats], of phi (nx, ny) and power (nx/TILE, ny/TILE) [nats]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        value: Array = np.log(np.maximum(phi, 0.0)) + np.kron(power, np.ones((TILE, TILE)))
    return value


@kernel
def _combine(phi, power, into, known, out, raised):  # type: ignore[no-untyped-def]
    """psi = into * phi + known, tile by tile with a new exponent."""
    for a in range(power.shape[0]):
        for b in range(power.shape[1]):
            i, j = a * TILE, b * TILE
            most = 0.0
            for k in range(i, i + TILE):
                for e in range(j, j + TILE):
                    most = max(most, known[k, e])
            base = max(power[a, b], math.log(most) if most > 0.0 else -math.inf)
            raised[a, b] = base
            if base == -math.inf:
                out[i : i + TILE, j : j + TILE] = 0.0
                continue
            old, new = math.exp(power[a, b] - base), math.exp(-base) if most > 0.0 else 0.0
            for k in range(i, i + TILE):
                for e in range(j, j + TILE):
                    out[k, e] = into[k, e] * phi[k, e] * old + known[k, e] * new


@kernel
def _along_y(source, power, taps, out, raised):  # type: ignore[no-untyped-def]
    """Convolve every row with the taps."""
    reach = taps.shape[0] // 2
    wide = -(-reach // TILE)
    window = np.zeros((2 * wide + 1) * TILE)
    for a in range(power.shape[0]):
        for b in range(power.shape[1]):
            base = -math.inf
            for c in range(max(b - wide, 0), min(b + wide + 1, power.shape[1])):
                base = max(base, power[a, c])
            most = 0.0
            for k in range(a * TILE, (a + 1) * TILE):
                if base == -math.inf:
                    out[k, b * TILE : (b + 1) * TILE] = 0.0
                    continue
                window[:] = 0.0
                for c in range(max(b - wide, 0), min(b + wide + 1, power.shape[1])):
                    factor = math.exp(power[a, c] - base)
                    at = (c - b + wide) * TILE
                    for e in range(TILE):
                        window[at + e] = source[k, c * TILE + e] * factor
                for e in range(TILE):
                    total = 0.0
                    first = wide * TILE + e - reach
                    for t in range(taps.shape[0]):
                        total += taps[t] * window[first + t]
                    out[k, b * TILE + e] = total
                    most = max(most, abs(total))
            raised[a, b] = _normalise(out, a, b, base, most)


@kernel
def _along_x(source, power, taps, out, raised):  # type: ignore[no-untyped-def]
    """Convolve every column with the taps."""
    reach = taps.shape[0] // 2
    wide = -(-reach // TILE)
    factor = np.zeros(2 * wide + 1)
    for a in range(power.shape[0]):
        low, high = max(a - wide, 0), min(a + wide + 1, power.shape[0])
        for b in range(power.shape[1]):
            base = -math.inf
            for c in range(low, high):
                base = max(base, power[c, b])
            out[a * TILE : (a + 1) * TILE, b * TILE : (b + 1) * TILE] = 0.0
            most = 0.0
            if base > -math.inf:
                for c in range(low, high):
                    factor[c - a + wide] = math.exp(power[c, b] - base)
                for k in range(a * TILE, (a + 1) * TILE):
                    for t in range(max(k - reach, 0), min(k + reach + 1, source.shape[0])):
                        f = taps[t - k + reach] * factor[t // TILE - a + wide]
                        for e in range(b * TILE, (b + 1) * TILE):
                            out[k, e] += f * source[t, e]
                    for e in range(b * TILE, (b + 1) * TILE):
                        most = max(most, abs(out[k, e]))
            raised[a, b] = _normalise(out, a, b, base, most)


@inlined
def _normalise(out, a, b, base, most):  # type: ignore[no-untyped-def]
    """Scale a tile to a greatest entry of one; its exponent."""
    if most == 0.0:
        return -math.inf
    for k in range(a * TILE, (a + 1) * TILE):
        for e in range(b * TILE, (b + 1) * TILE):
            out[k, e] /= most
    return base + math.log(most)
