"""Solve for a car on positions and headings: `q psi/lambda = V (cos th psi_x + sin th psi_y) + b^2/2 psi_thth`.

Noise acts on the heading only, so psi moves along straight rays and is smoothed over headings, in turn (Strang: half a
smoothing, a ray of length V tau, half a smoothing). Rays interpolate v = -lambda log psi, smooth where psi changes by
many factors of e per grid point: cubic in space, kept between the values around it where v has a kink. A ray that meets
a wall or the goal ends there. Sweeps in place, in alternating directions, go on until v no longer changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pirrht.arrays import Array, IntArray
from pirrht.errors import OptionError
from pirrht.exact.grid import (
    TUNING,
    Frame,
    Progress,
    derivative,
    frame_at,
    ignore_progress,
    in_cells,
    in_goal,
    polynomial,
)
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import clearance
from pirrht.jit.jit import inlined, kernel
from pirrht.problem import Problem
from pirrht.rollouts.first_exit import GOAL, INSIDE, sweep_exit
from pirrht.systems.unicycle import Unicycle


class Headings(NamedTuple):
    """v on a grid of positions and headings."""

    frame: Frame
    temperature: float  # lambda [cost]
    value: Array  # (nx, ny, nt) v [cost]; headings 2 pi k / nt


class Rays(NamedTuple):
    """Fate of the ray that leaves each grid point at each heading."""

    fate: NDArray[np.int8]  # (nx, ny, nt) INSIDE or the Outcome; -1 at points in a wall
    share: NDArray[np.float32]  # (nx, ny, nt) share of the ray until then
    own_i: IntArray  # (nx, ny) the free point that speaks for a point in a wall
    own_j: IntArray  # (nx, ny)
    cost: float  # q tau of a whole ray [cost]
    temperature: float  # lambda [cost]
    ceiling: float  # v is cut off there [cost]


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or one at which the grid smears paths less than the noise does.

    OptionError if there is a step dt, the spacing is too coarse, or the grid would have too many points.
    """
    if dt is not None:
        raise OptionError("no grid solves the discrete-time problem of a car; use the exit rule bridge")
    d = problem.dynamics
    assert isinstance(d, Unicycle)
    sideways = d.b * d.V / math.sqrt(3.0)  # deviation from the straight line after a second
    needed = sideways / TUNING.sideways_points
    h = min(needed, TUNING.car_radii * space.scene.robot_radius) if spacing is None else spacing
    finest = min(h, needed)
    size = [*(math.ceil(s / finest) + 1 for s in space.scene.upper - space.scene.lower), _directions(d, finest)]
    if h > needed * (1.0 + 1e-9) or math.prod(size) > TUNING.car_points:
        raise OptionError(
            f"noise b = {d.b:g} carries the car only {sideways:.2g} m sideways in a second, so the grid needs "
            f"points {finest:.2g} m apart, {size[0]} x {size[1]} x {size[2]} points, and can have "
            f"{TUNING.car_points:,}; choose more noise or a smaller workspace"
        )
    return h


def grid_of(
    problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress = ignore_progress
) -> Headings:
    """Solve for v (nx, ny, nt) [cost] of a car at a spacing [m], dt unused; OptionError if sweeps do not settle."""
    d = problem.dynamics
    assert isinstance(d, Unicycle)
    assert not callable(problem.q)
    lower, upper = space.scene.lower.astype(float), space.scene.upper.astype(float)
    nx, ny = np.ceil((upper - lower) / spacing - 1e-9).astype(int) + 1
    shape = nx, ny, _directions(d, spacing)
    tau = TUNING.ray * spacing / d.V
    ceiling = min(problem.phi, TUNING.worst_path * problem.q * float(np.sum(upper - lower)) / d.V)
    fate, share = np.zeros(shape, np.int8), np.ones(shape, np.float32)
    at = frame_at(lower, spacing, space.scene.goal)
    _trace(space.world, at, TUNING.ray * spacing, fate, share)
    free = fate[:, :, 0] >= 0
    owner = distance_transform_edt(~free, return_distances=False, return_indices=True)
    rays = Rays(fate, share, owner[0], owner[1], problem.q * tau, problem.temperature, ceiling)
    value = np.full(shape, ceiling)
    whole, half = (_taps(d.b * math.sqrt(s), tau, shape[2]) for s in (tau, 0.5 * tau))
    for done in range(TUNING.car_sweeps):
        if _sweep(value, value, rays, whole, done % 4) < TUNING.car_settled:
            out = np.empty_like(value)
            _sweep(value, out, rays, half, 0)
            out[~free] = out[owner[0][~free], owner[1][~free]]
            return Headings(at, problem.temperature, out)
    raise OptionError(f"the solution has not settled after {TUNING.car_sweeps} sweeps; choose a larger spacing")


def _directions(d: Unicycle, spacing: float) -> int:
    """Headings so close together that the noise of one ray spans one of them."""
    return max(TUNING.headings, math.ceil(2.0 * math.pi / (d.b * math.sqrt(TUNING.ray * spacing / d.V))))


def _taps(deviation: float, tau: float, headings: int) -> Array:
    """Weights of a Gaussian on the headings' grid, (2 R + 1,)."""
    width = 2.0 * math.pi / headings
    reach = min(math.ceil((TUNING.car_cutoff * deviation + TUNING.fastest_turn * tau) / width), headings // 2 - 1)
    weights: Array = np.exp(-0.5 * (np.arange(-reach, reach + 1) * width / deviation) ** 2)
    weights /= weights.sum()
    return weights


@kernel
def _trace(arena, frame, length, fate, share):  # type: ignore[no-untyped-def]
    """Trace the ray from every point: how it ends, and after which share of it; -1 for points in a wall."""
    nx, ny, nt = fate.shape
    for i in range(nx):
        for j in range(ny):
            x, y = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
            for k in range(nt):
                if clearance(arena.field, x, y) <= 0.0:
                    fate[i, j, k] = -1
                    continue
                th = 2.0 * math.pi * k / nt
                if in_goal(frame, (x, y)):
                    fate[i, j, k], share[i, j, k] = GOAL, 0.0
                    continue
                end, s = sweep_exit(arena, x, y, x + length * math.cos(th), y + length * math.sin(th))
                fate[i, j, k], share[i, j, k] = end, s


@kernel
def _sweep(value, out, rays, taps, order):  # type: ignore[no-untyped-def]
    """One round over all positions: rays, then smoothing over headings. The greatest change of v."""
    fate, share, own_i, own_j = rays.fate, rays.share, rays.own_i, rays.own_j
    cost, temperature, ceiling = rays.cost, rays.temperature, rays.ceiling
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
                    ahead = _cubic(value, own_i, own_j, i, j, TUNING.ray * math.cos(th), TUNING.ray * math.sin(th), k)
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
    """Smooth where the best heading of all is too far ahead to scale by."""
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
        wx = polynomial(u, c)
        row = 0.0
        for d in range(-1, 3):
            s, t = min(max(p + c, 0), nx - 1), min(max(q + d, 0), ny - 1)
            entry = value[own_i[s, t], own_j[s, t], k]
            row += polynomial(v, d) * entry
            if (c == 0 or c == 1) and (d == 0 or d == 1):
                low, high = min(low, entry), max(high, entry)
        total += wx * row
    return min(max(total, low), high)


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,), 0 in the goal; its gradient [1/m, 1/m, 1/rad] goes to slope (3,)."""
    slope[0], slope[1], slope[2] = 0.0, 0.0, 0.0
    if in_goal(grid.frame, x):
        return 0.0
    nx, ny, nt = grid.value.shape
    fx, fy = in_cells(grid.frame, x)
    ft = x[2] * nt / (2.0 * math.pi)
    i, j, k = min(max(int(fx), 0), nx - 2), min(max(int(fy), 0), ny - 2), math.floor(ft)
    total, along_x, along_y, along_t = 0.0, 0.0, 0.0, 0.0
    for a in range(-1, 3):
        px, dx = polynomial(fx - i, a), derivative(fx - i, a)
        s = min(max(i + a, 0), nx - 1)
        for b in range(-1, 3):
            py, dy = polynomial(fy - j, b), derivative(fy - j, b)
            t = min(max(j + b, 0), ny - 1)
            value, turning = 0.0, 0.0
            for c in range(-1, 3):
                entry = grid.value[s, t, (k + c) % nt]
                value += polynomial(ft - k, c) * entry
                turning += derivative(ft - k, c) * entry
            total += px * py * value
            along_x += dx * py * value
            along_y += px * dy * value
            along_t += px * py * turning
    scale = -1.0 / grid.temperature
    slope[0], slope[1] = scale * along_x / grid.frame.spacing, scale * along_y / grid.frame.spacing
    slope[2] = scale * along_t * nt / (2.0 * math.pi)
    return scale * total
