"""Solve the continuous-time equation on a planar grid: `q psi/lambda = tr(BB' Hess psi)/2`, isotropic noise, no drift.

It is `Laplace psi = k^2 psi`; near every grid point psi is a sum of I_n(kr) cos(n t) and I_n(kr) sin(n t). Stencil
weights are exact for the eight lowest of these (Trefftz, or flexible local approximation: Tsukerman, IEEE Trans.
Magnetics 2005), so that plane exponentials exp(k.x) of every direction are solved almost exactly on a grid as coarse as
their decay length, where differences or upwinding would err by tens of per cent. Arms of a stencil end at walls and at
the goal's rim: no boundary is moved to the grid. Unknowns are chi = psi exp(s) with s a length to the goal in units of
1/k, since psi itself falls below 1e-300. Arms of a point that all but touches a wall would end in nearly one place, and
errors of a tenth of a micrometer would decide on the sign of psi: theirs begin at a place further off the wall.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.optimize.elementwise import find_root
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu
from scipy.special import hyp0f1

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.errors import OptionError
from pirrht.exact.grid import TUNING, Domain, Equation, Frame, affordable, frame_at, in_goal
from pirrht.freespace import FreeSpace
from pirrht.geometry.blocks import lattice
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import kernel
from pirrht.problem import Problem

ARMS = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)])
CLOSE = 1e-7  # of that end [m]


def ends_of_arms(
    domain: Domain, points: Array, rows: IntArray, heads: Array, spacing: float
) -> tuple[Array, BoolArray]:
    """End arms of points (K, 2) towards heads (k, 2) at walls or rim: ends (k, 2) [m], if at the rim.

    `rows` (k,) are the points that arms belong to, `spacing` is h [m].
    """
    ends, at_goal = _cut(domain, points[rows], heads)
    short = ~at_goal & (np.hypot(*(ends - points[rows]).T) < TUNING.hug * spacing)
    hugging = np.unique(rows[short])

    again = np.isin(rows, hugging)
    around = points[hugging, None] + 0.5 * spacing * np.vstack([np.zeros(2), ARMS])
    free_by = domain.clearance(around.reshape(-1, 2)).reshape(around.shape[:2])
    best = np.argmax(np.where(domain.goal.contains(around), -np.inf, free_by), axis=1)
    starts = around[np.searchsorted(hugging, rows[again]), best[np.searchsorted(hugging, rows[again])]]
    ends[again], at_goal[again] = _cut(domain, starts, heads[again])
    return ends, at_goal


def _cut(domain: Domain, tails: Array, heads: Array) -> tuple[Array, BoolArray]:
    """Cut lines from free tails to heads at a wall or the rim, 3 x (k, 2) [m]; tell if at the rim."""
    clearance = domain.clearance
    span = heads - tails
    full = np.hypot(*span.T)
    unit = span / full[:, None]
    to_goal = domain.goal.center - tails
    along = np.sum(to_goal * unit, axis=1)
    inside = domain.goal.radius**2 - (np.sum(to_goal**2, axis=1) - along**2)
    to_rim = np.where(inside > 0.0, along - np.sqrt(np.maximum(inside, 0.0)), np.inf)
    to_rim[(to_rim < 0.0) | (to_rim > full + CLOSE)] = np.inf
    at_head = clearance(heads)
    to_wall = np.where(at_head <= CLOSE, full, np.inf)
    crosses = np.flatnonzero(at_head < 0.0)

    if len(crosses) > 0:
        root = find_root(
            lambda t, k: clearance(tails[k] + t[:, None] * unit[k]), (np.zeros(len(crosses)), full[crosses]),
            args=(crosses,), tolerances={"fatol": CLOSE},
        )  # fmt: skip
        to_wall[crosses] = np.nan_to_num(root.x)
    length = np.clip(np.minimum(to_rim, to_wall), CLOSE, full)
    return tails + length[:, None] * unit, to_rim <= to_wall


ComplexArray = NDArray[np.complex128]
WHOLE = ARMS @ np.array([1.0, 1j])  # arms as x + iy


class Expansion(NamedTuple):
    """Near every free grid point psi = exp(shift) * (a sum of eight solutions of the equation)."""

    frame: Frame
    wavenumber: float  # k [1/m]
    least: float  # a slope is never that of a place nearer to a wall [m]
    owner: IntArray  # (nx, ny) free point that speaks for a grid point; -1 where none is near
    place: IntArray  # (K, 2) grid indices of the K free points
    coefficients: Array  # (K, 8) of 1, cos t, sin t, cos 2t, sin 2t, cos 3t, sin 3t, cos 4t
    shift: Array  # (K,) [nats]; -inf where psi is 0


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or one that keeps v to 0.5 % and u to 2 %; refuses too many points."""
    reason = f"psi falls by a factor e in {1.0 / Equation.of(problem).wavenumber:.2g} m"
    return affordable(space.scene, default_spacing(problem, space.scene) if spacing is None else spacing, reason)


def default_spacing(problem: Problem, scene: Scene) -> float:
    """Spacing that keeps v to 0.5 % and u to 2 % [m]."""
    return min(TUNING.point_lengths / Equation.of(problem).wavenumber, TUNING.point_radii * scene.robot_radius)


def grid_of(problem: Problem, space: FreeSpace, spacing: float, *_: object) -> Expansion:
    """Solve in continuous time on a grid of this spacing [m], (K, 8) coefficients."""
    equation = Equation.of(problem)
    return solve(Domain.of(space), wavenumber=equation.wavenumber, wall=equation.wall, spacing=spacing)


def solve(domain: Domain, *, wavenumber: float, wall: float, spacing: float) -> Expansion:
    """Solve `Laplace psi = k^2 psi` with psi = 1 on the rim of the goal and exp(-wall) at walls and border.

    k in [1/m], the wall phi/lambda [nats] may be infinite, h is in [m]. OptionError: h is too coarse.
    """
    lower, goal = domain.lower, domain.goal
    nx, ny = np.maximum(np.ceil((domain.upper - lower) / spacing - 1e-9).astype(int), 2) + 1
    index = lattice(nx, ny).reshape(-1, 2)
    points = lower + spacing * index

    free_by = domain.clearance(points)
    rim = np.hypot(*(points - goal.center).T) - goal.radius
    free = (free_by > CLOSE) & (rim > CLOSE)
    number = np.where(free, np.cumsum(free) - 1, -1)

    place = index[free]
    target = place[:, None, :] + ARMS
    flat = target[:, :, 0] * ny + target[:, :, 1]

    neighbour = number[flat]
    arms = np.broadcast_to(WHOLE, flat.shape).copy()
    log_end = np.zeros(flat.shape)

    cut = neighbour < 0
    rows = np.nonzero(cut)[0]
    ends, at_goal = ends_of_arms(domain, points[free], rows, points[flat[cut]], spacing)
    arms[cut] = (ends - points[free][rows]) @ [1.0, 1j] / spacing
    log_end[cut] = np.where(at_goal, 0.0, -wall)
    s = _lengths(neighbour, spacing * np.abs(arms), log_end, wavenumber)
    coefficients, below = _fit(neighbour, arms, log_end, s, wavenumber * spacing)
    # In a narrow corner psi is a smaller share of what is around it than the distance to the wall is of the spacing.
    gap = free_by[free] / spacing
    if np.any((below > 0.0) & (below > np.where(gap < TUNING.hug, gap, 0.0))):
        raise OptionError(f"the grid of {spacing:g} m is too coarse for this scene; choose a smaller spacing")
    number[free] = np.where(below > 0.0, -1, number[free])
    number = number.reshape(nx, ny)
    away, nearest = distance_transform_edt(number < 0, return_indices=True)
    owner = np.where(away <= TUNING.speaks, number[tuple(nearest)], -1)
    return Expansion(
        frame=frame_at(lower, spacing, goal), wavenumber=wavenumber, least=1e-5, owner=owner,
        place=place, coefficients=coefficients, shift=-s,
    )  # fmt: skip


def _lengths(neighbour: IntArray, length: Array, log_end: Array, wavenumber: float) -> Array:
    """Estimate -log psi at the free points, (K,): k times the length of arms to the goal or a wall [nats]."""
    K = len(neighbour)
    inner = neighbour >= 0
    rows, arms = np.nonzero(inner)
    out = np.where(inner, np.inf, wavenumber * length - log_end).min(axis=1, initial=np.inf)
    exits = np.flatnonzero(np.isfinite(out))
    weight = np.concatenate([wavenumber * length[rows, arms], out[exits]])
    tail = np.concatenate([neighbour[rows, arms], np.full(len(exits), K)])
    head = np.concatenate([rows, exits])

    return np.asarray(dijkstra(csr_matrix((weight, (tail, head)), shape=(K + 1, K + 1)), indices=K)[:K])


def _fit(neighbour: IntArray, arms: ComplexArray, log_end: Array, s: Array, kh: float) -> tuple[Array, Array]:
    """Fit chi = psi exp(s) around every free point, (K, 8), by one sparse solution; negative part as a share (K,)."""
    K = len(neighbour)
    finite = np.where(np.isfinite(s), s, 0.0)
    inner = neighbour >= 0
    whole = inner.all(axis=1)

    common = np.linalg.inv(arm_basis(WHOLE[None, :], kh))[0]
    own = np.linalg.inv(arm_basis(arms[~whole], kh))
    weight = np.empty((K, len(ARMS)))
    weight[whole] = common[0]
    weight[~whole] = own[:, 0]
    rows, which = np.nonzero(inner)
    columns = neighbour[rows, which]
    known = np.where(inner, 0.0, np.exp(log_end + np.where(inner, 0.0, finite[:, None])))
    known[~np.isfinite(s)] = 0.0
    coupling = -weight[rows, which] * np.exp(finite[rows] - finite[columns])
    diagonal = np.arange(K)
    entries = np.concatenate([np.ones(K), coupling])
    matrix = csc_matrix((entries, (np.concatenate([diagonal, rows]), np.concatenate([diagonal, columns]))))
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    chi = factors.solve(np.sum(weight * known, axis=1))
    ends = known
    ends[rows, which] = chi[columns] * np.exp(finite[rows] - finite[columns])
    coefficients = np.empty((K, len(ARMS)))
    coefficients[whole] = ends[whole] @ common.T
    coefficients[~whole] = np.einsum("kij,kj->ki", own, ends[~whole])
    most = np.maximum(ends.max(axis=1), 1e-300)
    below = np.maximum(np.minimum(-chi, most) / most, 1e-300)
    return coefficients, np.where((chi > 0.0) | ~np.isfinite(s), 0.0, below)


def arm_basis(arms: ComplexArray, kh: float) -> Array:
    """Evaluate the eight solutions at ends of arms, x + iy in spacings (K, 8) -> (K, 8 arms, 8); kh is k times h."""
    t = (0.5 * kh * np.abs(arms)) ** 2
    powers = [arms**n * hyp0f1(n + 1, t) for n in range(5)]  # n! I_n(z) = (z/2)^n 0F1(; n + 1; z^2/4)
    columns = [powers[0].real, *(part for one in powers[1:4] for part in (one.real, one.imag)), powers[4].real]
    return np.stack(columns, axis=-1)


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (2,); its gradient [1/m] goes to slope (2,). Minus infinity far inside of a wall."""
    slope[0], slope[1] = 0.0, 0.0
    if in_goal(grid.frame, x):
        return 0.0
    nx, ny = grid.owner.shape
    fx = (x[0] - grid.frame.x0) / grid.frame.spacing
    fy = (x[1] - grid.frame.y0) / grid.frame.spacing
    o = grid.owner[min(max(int(fx + 0.5), 0), nx - 1), min(max(int(fy + 0.5), 0), ny - 1)]
    if o < 0 or grid.shift[o] == -math.inf:
        return -math.inf
    u = fx - grid.place[o, 0]
    v = fy - grid.place[o, 1]
    h = grid.frame.spacing
    c = grid.coefficients[o]
    kh = 0.25 * (grid.wavenumber * h) ** 2

    t = kh * (u * u + v * v)
    j = 1.0
    e = np.ones(6)  # e[n] = 0F1(; n + 1; t)
    term = np.ones(6)

    while term[0] > 1e-16 * e[0]:
        for n in range(6):
            term[n] *= t / (j * (n + j))
            e[n] += term[n]
        j += 1.0

    z = complex(u, v)
    power = 1.0 + 0.0j
    total = c[0] * e[0]
    down = 0.0j
    up = 2.0 * c[0] * complex(u, v) * e[1]

    for n in range(1, 5):  # the derivative along z lowers the order by one, that along its conjugate raises it
        own = complex(c[2 * n - 1], -c[2 * n] if n < 4 else 0.0) * power  # of z^n, over z
        total += (own * z).real * e[n]
        down += n * own * e[n - 1]
        up += own * z * z * e[n + 1] / (n + 1)
        power *= z
    gx = (down.real + kh * up.real) / h
    gy = (kh * up.imag - down.imag) / h
    total = max(total, grid.least * math.sqrt(gx * gx + gy * gy))
    slope[0] = gx / total
    slope[1] = gy / total

    return grid.shift[o] + math.log(total)
