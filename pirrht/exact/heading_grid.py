"""The car on a grid of positions and headings: `q psi/lambda = V (cos th psi_x + sin th psi_y) + b^2/2 psi_thth`.

Noise acts on the heading only, so psi is moved along straight rays and smoothed over headings, in turn (Strang: half a
smoothing, a ray of length V tau, half a smoothing). The rays interpolate v = -lambda log psi, which is smooth where psi
changes by many factors of e from one grid point to the next: cubic in space, kept between the values around it where
v has a kink. A ray that meets a wall or the goal ends there. Sweeps over the grid, in place and in alternating
directions, go on until v no longer changes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from pirrht.arrays import Array
from pirrht.compiled.jit import inlined, kernel
from pirrht.errors import OptionError
from pirrht.exact.domain import Domain
from pirrht.geometry.arena import Arena
from pirrht.geometry.field import Field, clearance
from pirrht.rollouts.first_exit import GOAL, INSIDE, sweep_exit

BEYOND = 6.5  # smoothing is cut off so many deviations beyond a turn rate of FASTEST
FASTEST = 4.0  # [rad/s]
WORST = 10.0  # v is cut off at this many times q x (sum of the sides of the workspace) / V
RAY = 2.0  # length of a ray in spacings
ROUNDS = 500  # sweeps at most


class Headings(NamedTuple):
    """v on a grid of positions and headings."""

    x0: float  # position of point (0, 0) [m]
    y0: float
    spacing: float  # h [m]
    goal_x: float  # centre of the goal's disc [m]
    goal_y: float
    radius: float  # of the disc [m]
    temperature: float  # lambda [cost]
    value: Array  # (nx, ny, nt) v [cost]; headings 2 pi k / nt


def solve(
    field: Field,
    domain: Domain,
    *,
    speed: float,
    noise: float,
    rate: float,
    temperature: float,
    phi: float,
    spacing: float,
    headings: int,
    accuracy: float = 1e-4,
) -> Headings:
    """Solve for v.

    Args:
        field: clearance field of the scene.
        domain: workspace and goal.
        speed: V [m/s].
        noise: b [rad/sqrt(s)].
        rate: q [cost/s].
        temperature: lambda [cost].
        phi: final cost off the goal.
        spacing: h [m]; rays are RAY spacings long.
        headings: their number.
        accuracy: sweeps end when v changes by less [cost].
    """
    tau = RAY * spacing / speed
    lower, sides = domain.lower, domain.upper - domain.lower
    nx, ny = np.ceil(sides / spacing - 1e-9).astype(int) + 1
    ceiling = min(phi, WORST * rate * float(np.sum(sides)) / speed)
    fate, share = np.zeros((nx, ny, headings), np.int8), np.ones((nx, ny, headings), np.float32)
    centre, radius = (float(domain.goal.center[0]), float(domain.goal.center[1])), float(domain.goal.radius)
    _trace(field, centre, radius, lower[0], lower[1], spacing, RAY * spacing, fate, share)
    free = fate[:, :, 0] >= 0
    owner = distance_transform_edt(~free, return_distances=False, return_indices=True)
    value = np.full((nx, ny, headings), ceiling)
    whole, half = (_taps(noise * math.sqrt(s), tau, headings) for s in (tau, 0.5 * tau))
    cost = rate * tau
    for done in range(ROUNDS):
        change = _sweep(value, value, fate, share, owner[0], owner[1], whole, cost, temperature, ceiling, done % 4)
        if change < accuracy:
            out = np.empty_like(value)
            _sweep(value, out, fate, share, owner[0], owner[1], half, cost, temperature, ceiling, 0)
            out[~free] = out[owner[0][~free], owner[1][~free]]
            return Headings(float(lower[0]), float(lower[1]), spacing, *centre, radius, temperature, out)
    raise OptionError(f"the solution has not settled after {ROUNDS} sweeps; choose a larger spacing")


def _taps(deviation: float, tau: float, headings: int) -> Array:
    """Weights of a Gaussian on the headings' grid, (2 R + 1,)."""
    width = 2.0 * math.pi / headings
    reach = min(math.ceil((BEYOND * deviation + FASTEST * tau) / width), headings // 2 - 1)
    weights: Array = np.exp(-0.5 * (np.arange(-reach, reach + 1) * width / deviation) ** 2)
    weights /= weights.sum()
    return weights


ARENA: Any = Arena


@kernel
def _trace(field, goal, radius, x0, y0, h, length, fate, share):  # type: ignore[no-untyped-def]
    """How the ray from every point ends, and after which share of it; -1 for points in a wall."""
    nx, ny, nt = fate.shape
    for i in range(nx):
        for j in range(ny):
            x, y = x0 + i * h, y0 + j * h
            for k in range(nt):
                if _blocked(field, x, y):
                    fate[i, j, k] = -1
                    continue
                th = 2.0 * math.pi * k / nt
                if (x - goal[0]) ** 2 + (y - goal[1]) ** 2 <= radius * radius:
                    fate[i, j, k], share[i, j, k] = GOAL, 0.0
                    continue
                end, s = sweep_exit(
                    ARENA(field, goal, radius), x, y, x + length * math.cos(th), y + length * math.sin(th)
                )
                fate[i, j, k], share[i, j, k] = end, s


@inlined
def _blocked(field, x, y):  # type: ignore[no-untyped-def]
    return clearance(field, x, y) <= 0.0


@kernel
def _sweep(value, out, fate, share, own_i, own_j, taps, cost, temperature, ceiling, order):  # type: ignore[no-untyped-def]
    """One round over all positions: rays, then smoothing over headings. The greatest change of v."""
    nx, ny, nt = value.shape
    reach = taps.shape[0] // 2
    ray, weight = np.empty(nt), np.empty(nt + 2 * reach)
    change = 0.0
    for a in range(nx):
        i = a if order % 2 == 0 else nx - 1 - a
        for b in range(ny):
            j = b if order // 2 == 0 else ny - 1 - b
            if fate[i, j, 0] < 0:
                out[i, j, :] = ceiling
                continue
            least = ceiling
            for k in range(nt):
                end = fate[i, j, k]
                if end == INSIDE:
                    th = 2.0 * math.pi * k / nt
                    ahead = _cubic(value, own_i, own_j, i, j, RAY * math.cos(th), RAY * math.sin(th), k)
                    ray[k] = min(cost + ahead, ceiling)
                else:
                    ray[k] = share[i, j, k] * cost if end == GOAL else ceiling
                least = min(least, ray[k])
            if share[i, j, 0] == 0.0 and fate[i, j, 0] == GOAL:
                out[i, j, :] = 0.0
                continue
            for k in range(nt):
                weight[reach + k] = math.exp((least - ray[k]) / temperature)
            for k in range(reach):
                weight[k], weight[reach + nt + k] = weight[nt + k], weight[reach + k]
            for k in range(nt):
                total = 0.0
                for t in range(2 * reach + 1):
                    total += taps[t] * weight[k + t]
                if total > 1e-290:
                    new = min(least - temperature * math.log(total), ceiling)
                else:
                    new = _far(ray, taps, k, temperature, ceiling)
                change = max(change, abs(new - value[i, j, k]))
                out[i, j, k] = new
    return change


@kernel
def _far(ray, taps, k, temperature, ceiling):  # type: ignore[no-untyped-def]
    """The same sum where the best heading of all is too far ahead to scale by."""
    nt, reach = ray.shape[0], taps.shape[0] // 2
    least = ceiling
    for t in range(taps.shape[0]):
        least = min(least, ray[(k + t - reach) % nt])
    total = 0.0
    for t in range(taps.shape[0]):
        total += taps[t] * math.exp((least - ray[(k + t - reach) % nt]) / temperature)
    return min(least - temperature * math.log(total), ceiling)


@inlined
def _cubic(value, own_i, own_j, i, j, dx, dy, k):  # type: ignore[no-untyped-def]
    """v at (i + dx, j + dy) of heading k, kept between the four values around; walls repeat what is next to them."""
    nx, ny, _ = value.shape
    p, q = math.floor(i + dx), math.floor(j + dy)
    u, v = i + dx - p, j + dy - q
    total, low, high = 0.0, math.inf, -math.inf
    for c in range(-1, 3):
        wx = _lagrange(u, c)
        row = 0.0
        for d in range(-1, 3):
            s, t = min(max(p + c, 0), nx - 1), min(max(q + d, 0), ny - 1)
            entry = value[own_i[s, t], own_j[s, t], k]
            row += _lagrange(v, d) * entry
            if (c == 0 or c == 1) and (d == 0 or d == 1):
                low, high = min(low, entry), max(high, entry)
        total += wx * row
    return min(max(total, low), high)


@inlined
def _lagrange(t, c):  # type: ignore[no-untyped-def]
    """Polynomial of point c of -1, 0, 1, 2 at t."""
    if c == -1:
        return -t * (t - 1.0) * (t - 2.0) / 6.0
    if c == 0:
        return (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
    if c == 1:
        return -(t + 1.0) * t * (t - 2.0) / 2.0
    return (t + 1.0) * t * (t - 1.0) / 6.0


@inlined
def _derived(t, c):  # type: ignore[no-untyped-def]
    """Its derivative."""
    if c == -1:
        return -(3.0 * t * t - 6.0 * t + 2.0) / 6.0
    if c == 0:
        return (3.0 * t * t - 4.0 * t - 1.0) / 2.0
    if c == 1:
        return -(3.0 * t * t - 2.0 * t - 2.0) / 2.0
    return (3.0 * t * t - 1.0) / 6.0


@kernel
def look(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,), 0 in the goal; its gradient [1/m, 1/m, 1/rad] goes to slope (3,)."""
    slope[0], slope[1], slope[2] = 0.0, 0.0, 0.0
    if (x[0] - grid.goal_x) ** 2 + (x[1] - grid.goal_y) ** 2 <= grid.radius * grid.radius:
        return 0.0
    nx, ny, nt = grid.value.shape
    fx, fy, ft = (x[0] - grid.x0) / grid.spacing, (x[1] - grid.y0) / grid.spacing, x[2] * nt / (2.0 * math.pi)
    i, j, k = min(max(int(fx), 0), nx - 2), min(max(int(fy), 0), ny - 2), math.floor(ft)
    total, along_x, along_y, along_t = 0.0, 0.0, 0.0, 0.0
    for a in range(-1, 3):
        px, dx = _lagrange(fx - i, a), _derived(fx - i, a)
        s = min(max(i + a, 0), nx - 1)
        for b in range(-1, 3):
            py, dy = _lagrange(fy - j, b), _derived(fy - j, b)
            t = min(max(j + b, 0), ny - 1)
            value, turning = 0.0, 0.0
            for c in range(-1, 3):
                entry = grid.value[s, t, (k + c) % nt]
                value += _lagrange(ft - k, c) * entry
                turning += _derived(ft - k, c) * entry
            total += px * py * value
            along_x += dx * py * value
            along_y += px * dy * value
            along_t += px * py * turning
    scale = -1.0 / grid.temperature
    slope[0], slope[1] = scale * along_x / grid.spacing, scale * along_y / grid.spacing
    slope[2] = scale * along_t * nt / (2.0 * math.pi)
    return scale * total
