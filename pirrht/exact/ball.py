"""Solve the continuous-time equation on a grid in space: `Laplace psi = k^2 psi`, isotropic noise, no drift.

A sum over the 26 neighbours of a grid point, with a weight for faces, one for edges and one for corners of the cell, is
exact for spherical waves of orders 0 to 7, so that plane exponentials exp(k.x) of every direction decay at the right
rate. Next to walls and the goal's rim the six arms along the axes end there (Shortley and Weller), and the rate of
their sum is corrected on average over all directions. All weights are positive, and so is psi. Since psi itself falls
below 1e-300, log psi is relaxed, by successive over-relaxation with the factor that suits the decay of psi per cell.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import spherical_in

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.errors import OptionError
from pirrht.exact.grid import TUNING, Domain, Equation, Progress, Settling, affordable, cubic, ignore_progress, slopes
from pirrht.freespace import FreeSpace
from pirrht.geometry.blocks import lattice
from pirrht.jit.jit import kernel
from pirrht.problem import Problem

WHOLE, CUT, KNOWN = -1, 0, -2  # kinds of points; rows of cut ones count from CUT


class Lattice(NamedTuple):
    """log psi on a grid in space."""

    corner: Array  # (3,) place of point (0, 0, 0) [m]
    spacing: float  # h [m]
    goal: Array  # (4,) centre and radius of the ball [m]
    log_psi: Array  # (nx, ny, nz) [nats]; minus infinity at places that are not free
    row: IntArray  # (nx, ny, nz) row of a point whose arms are cut, or its kind
    arms: Array  # (K, 6) length of cut points' arms [m]
    ends: Array  # (K, 6) log psi at ends that are no grid points [nats]; NaN at those that are


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or one that keeps v to 0.5 %; refuses too many points."""
    length = 1.0 / Equation.of(problem).wavenumber
    default = min(TUNING.ball_lengths * length, TUNING.point_radii * space.scene.robot_radius)
    reason = f"psi falls by a factor e in {length:.2g} m"
    return affordable(space.scene, default if spacing is None else spacing, reason)


def grid_of(problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress) -> Lattice:
    """Solve in continuous time on a grid of this spacing [m]."""
    equation = Equation.of(problem)
    domain = Domain.of(space)
    return solve(domain, wavenumber=equation.wavenumber, wall=equation.wall, spacing=spacing, progress=progress)


def weights_of(kh: float) -> tuple[float, float, float]:
    """Weigh neighbours across faces, edges and corners of a cell, for k times the spacing.

    The sum of a spherical wave of order l over an orbit of the cube's symmetries is i_l(kr) times the cubic harmonic of
    that order, which is there for l = 0, 4 and 6 only.
    """
    squares = np.array([1.0, 2.0, 3.0])  # of the distances of neighbours, in spacings
    fourth = 1.0 / squares - 0.6
    sixth = np.array([0.0, 0.0, 1.0 / 27.0]) + fourth / 22.0 - 1.0 / 105.0
    radial = np.array([spherical_in(order, kh * np.sqrt(squares)) / kh**order for order in (0, 4, 6)])
    sums = np.array([6.0, 12.0, 8.0]) * radial * np.array([np.ones(3), fourth, sixth])
    face, edge, corner = np.linalg.solve(sums, [1.0, 0.0, 0.0])
    return float(face), float(edge), float(corner)


def solve(
    domain: Domain, *, wavenumber: float, wall: float, spacing: float, progress: Progress = ignore_progress
) -> Lattice:
    """Solve `Laplace psi = k^2 psi` with psi = 1 on the rim of the goal and exp(-wall) at walls and border.

    k in [1/m], the wall phi/lambda [nats] may be infinite, h is in [m]. OptionError: it does not settle.
    """
    lower, goal = domain.lower, domain.goal
    shape = tuple(np.maximum(np.ceil((domain.upper - lower) / spacing - 1e-9).astype(int), 2) + 1)
    clearance = _sampled(domain, lower, spacing, shape)
    to_goal = _distances(lower - goal.center, spacing, shape)

    free = (clearance > 0.0) & (to_goal > goal.radius)
    log_psi = np.where(to_goal <= goal.radius, 0.0, np.where(free, -wavenumber * (to_goal - goal.radius), -wall))
    row = np.full(shape, KNOWN, dtype=np.int64)
    whole = free & _surrounded(free)
    row[whole] = WHOLE
    places = np.argwhere(free & ~whole)
    row[tuple(places.T)] = np.arange(len(places))
    arms, ends = _cut(domain, lower, spacing, places, free, wall)

    kh = wavenumber * spacing
    radius = math.cos(math.pi / max(shape)) / math.cosh(kh)  # spectral, of Jacobi's iteration
    factor = 2.0 / (1.0 + math.sqrt(1.0 - radius * radius))
    found = Lattice(lower.astype(float), spacing, np.array([*goal.center, goal.radius]), log_psi, row, arms, ends)
    rate = wavenumber * wavenumber * (1.0 + kh * kh / 20.0)
    weights = weights_of(kh)
    settling = Settling(progress, TUNING.ball_settled)
    for sweep in range(TUNING.ball_sweeps):
        change = _relax(found, weights, rate, factor, bool(sweep % 2))
        settling.note(change)
        if change < TUNING.ball_settled:
            return found
    raise OptionError(f"the solution has not settled after {TUNING.ball_sweeps} sweeps; choose a smaller spacing")


def _sampled(domain: Domain, lower: Array, spacing: float, shape: tuple[int, ...]) -> Array:
    """Sample the clearance at all grid points, layer by layer, [m]."""
    out = np.empty(shape)
    across = lattice(*shape[1:]).reshape(-1, 2)
    for i in range(shape[0]):
        points = lower + spacing * np.column_stack([np.full(len(across), i), across])
        out[i] = domain.clearance(points).reshape(shape[1:])
    return out


def _distances(corner: Array, spacing: float, shape: tuple[int, ...]) -> Array:
    """Distances of grid points from a place, where the first is at `corner` relative to it (3,) [m]."""
    x, y, z = (corner[k] + spacing * np.arange(n) for k, n in enumerate(shape))
    return np.asarray(np.sqrt(x[:, None, None] ** 2 + y[:, None] ** 2 + z**2))


def _surrounded(free: BoolArray) -> BoolArray:
    """Check of grid points that all 26 neighbours are free."""
    out = np.pad(free, 1)
    for axis in range(3):
        low, high = (np.roll(out, shift, axis) for shift in (1, -1))
        out = out & low & high
    return np.asarray(out[1:-1, 1:-1, 1:-1])


def _cut(
    domain: Domain, lower: Array, spacing: float, places: IntArray, free: BoolArray, wall: float
) -> tuple[Array, Array]:
    """Cut the arms of grid points (K, 3) at walls and rim: lengths (K, 6) [m], and log psi at their ends [nats]."""
    arms = np.full((len(places), 6), spacing)
    ends = np.full((len(places), 6), np.nan)
    points = lower + spacing * places
    most = np.array(free.shape) - 1
    axes = np.eye(3, dtype=np.int64)
    for a, axis in enumerate([*axes, *-axes]):
        heads = places + axis
        inside = np.all((heads >= 0) & (heads <= most), axis=1)
        open_head = np.zeros(len(places), dtype=np.bool_)
        open_head[inside] = free[tuple(heads[inside].T)]
        cut = np.flatnonzero(~open_head)
        tails = points[cut]
        share, at_goal = _exits(domain, tails, spacing * axis)
        arms[cut, a] = np.maximum(share, TUNING.ball_arm) * spacing
        ends[cut, a] = np.where(at_goal, 0.0, -wall)
    return arms, ends


def _exits(domain: Domain, tails: Array, span: Array) -> tuple[Array, BoolArray]:
    """Shares of steps from free tails (k, 3) by a span (3,) [m] until walls or the rim, and which of the two."""
    length = float(np.linalg.norm(span))
    to_goal = domain.goal.center - tails
    along = to_goal @ span / length
    inside = domain.goal.radius**2 - (np.sum(to_goal**2, axis=1) - along**2)
    to_rim = np.where(inside > 0.0, along - np.sqrt(np.maximum(inside, 0.0)), np.inf) / length
    to_rim[(to_rim < 0.0) | (to_rim > 1.0)] = np.inf

    low = np.zeros(len(tails))
    high = np.ones(len(tails))
    for _ in range(TUNING.ball_halvings):
        middle = 0.5 * (low + high)
        clear = domain.clearance(tails + middle[:, None] * span) > 0.0
        low = np.where(clear, middle, low)
        high = np.where(clear, high, middle)
    return np.minimum(to_rim, high), to_rim <= high


@kernel
def _of_neighbours(log_psi, weights, i, j, k):  # type: ignore[no-untyped-def]
    """Return what psi at a point is by all its neighbours, as a share of what it is."""
    here = log_psi[i, j, k]
    total = 0.0
    for a in range(-1, 2):
        for b in range(-1, 2):
            for c in range(-1, 2):
                apart = a * a + b * b + c * c
                if apart > 0:
                    total += weights[apart - 1] * math.exp(log_psi[i + a, j + b, k + c] - here)
    return total


@kernel
def _end_of_arm(grid, row, arm, i, j, k):  # type: ignore[no-untyped-def]
    """Return log psi [nats] at the end of an arm of a point, a neighbour or where it is cut, and its length [m]."""
    move = 1 if arm < 3 else -1
    axis = arm % 3
    if row >= CUT and not math.isnan(grid.ends[row, arm]):
        return grid.ends[row, arm], grid.arms[row, arm]
    at = grid.log_psi[
        i + (move if axis == 0 else 0), j + (move if axis == 1 else 0), k + (move if axis == 2 else 0)
    ]  # fmt: skip
    return at, grid.spacing


@kernel
def _of_arms(grid, row, rate, i, j, k):  # type: ignore[no-untyped-def]
    """Return what psi at a point is by the ends of its six arms, as a share of what it is."""
    here = grid.log_psi[i, j, k]
    total = 0.0
    own = rate
    for axis in range(3):
        end, ahead = _end_of_arm(grid, row, axis, i, j, k)
        other, behind = _end_of_arm(grid, row, axis + 3, i, j, k)
        own += 2.0 / (ahead * behind)
        total += 2.0 / (ahead + behind) * (math.exp(end - here) / ahead + math.exp(other - here) / behind)
    return total / own


@kernel
def _relax(grid, weights, rate, factor, backwards):  # type: ignore[no-untyped-def]
    """Relax log psi at all free points once, in order or backwards; return the largest change [nats]."""
    log_psi = grid.log_psi
    _, ny, nz = log_psi.shape
    worst = 0.0
    for step in range(log_psi.size):
        at = log_psi.size - 1 - step if backwards else step
        i = at // (ny * nz)
        j = at // nz % ny
        k = at % nz
        row = grid.row[i, j, k]
        if row == KNOWN:
            continue
        share = _of_neighbours(log_psi, weights, i, j, k) if row == WHOLE else _of_arms(grid, row, rate, i, j, k)
        change = math.log(max(1.0 + factor * (share - 1.0), 0.5 * share))
        log_psi[i, j, k] += change
        worst = max(worst, abs(change))
    return worst


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,); its gradient [1/m] goes to slope (3,). Minus infinity inside of a wall.

    Between points that are all free log psi is interpolated by cubics; next to a wall psi is taken along the axes from
    the nearest free point, through the ends of its arms.
    """
    slope[:3] = 0.0
    square = 0.0
    for axis in range(3):
        square += (x[axis] - grid.goal[axis]) ** 2
    if square <= grid.goal[3] ** 2:
        return 0.0
    h = grid.spacing
    shape = grid.log_psi.shape
    place = ((x[0] - grid.corner[0]) / h, (x[1] - grid.corner[1]) / h, (x[2] - grid.corner[2]) / h)
    i = min(max(int(place[0]), 0), shape[0] - 2)
    j = min(max(int(place[1]), 0), shape[1] - 2)
    k = min(max(int(place[2]), 0), shape[2] - 2)
    whole = i > 0 and j > 0 and k > 0 and i < shape[0] - 2 and j < shape[1] - 2 and k < shape[2] - 2
    if whole:
        for a in range(-1, 3):
            for b in range(-1, 3):
                for c in range(-1, 3):
                    whole = whole and grid.row[i + a, j + b, k + c] != KNOWN
    if whole:
        return _between(grid, i, j, k, place, slope)
    return _next_to_wall(grid, i, j, k, place, slope)


@kernel
def _between(grid, i, j, k, place, slope):  # type: ignore[no-untyped-def]
    """Interpolate log psi and its slope by cubics between free points."""
    u = place[0] - i
    v = place[1] - j
    w = place[2] - k
    along_x = cubic(u)
    along_y = cubic(v)
    along_z = cubic(w)
    rise_x = slopes(u)
    rise_y = slopes(v)
    rise_z = slopes(w)
    total = 0.0
    for a in range(4):
        for b in range(4):
            for c in range(4):
                entry = grid.log_psi[i + a - 1, j + b - 1, k + c - 1]
                total += along_x[a] * along_y[b] * along_z[c] * entry
                slope[0] += rise_x[a] * along_y[b] * along_z[c] * entry / grid.spacing
                slope[1] += along_x[a] * rise_y[b] * along_z[c] * entry / grid.spacing
                slope[2] += along_x[a] * along_y[b] * rise_z[c] * entry / grid.spacing
    return total


@kernel
def _next_to_wall(grid, i, j, k, place, slope):  # type: ignore[no-untyped-def]
    """Extend psi along the axes from the nearest free corner of a cell; minus infinity if none is free."""
    nearest = math.inf
    at = (0, 0, 0)
    for a in range(2):
        for b in range(2):
            for c in range(2):
                away = (place[0] - i - a) ** 2 + (place[1] - j - b) ** 2 + (place[2] - k - c) ** 2
                if grid.row[i + a, j + b, k + c] != KNOWN and away < nearest:
                    nearest = away
                    at = (i + a, j + b, k + c)
    if nearest == math.inf:
        return -math.inf
    here = grid.log_psi[at[0], at[1], at[2]]
    row = grid.row[at[0], at[1], at[2]]
    total = 1.0
    for axis in range(3):
        end, ahead = _end_of_arm(grid, row, axis, *at)
        other, behind = _end_of_arm(grid, row, axis + 3, *at)
        s = (place[axis] - at[axis]) * grid.spacing
        front = math.exp(end - here) - 1.0
        bend = (front / ahead + (math.exp(other - here) - 1.0) / behind) / (ahead + behind)
        rise = front / ahead - bend * ahead
        total += s * (rise + s * bend)
        slope[axis] = rise + 2.0 * s * bend
    total = max(total, 1e-5 * math.sqrt(slope[0] ** 2 + slope[1] ** 2 + slope[2] ** 2))
    for axis in range(3):
        slope[axis] /= total
    return here + math.log(total)
