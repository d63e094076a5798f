"""Desirability around a reference in space: log psi of one class on a coarse grid, and its ascent.

With constant q, psi solves `Laplace psi = k^2 psi`. It is relaxed on a grid whose arms end at walls and at the goal's
rim (Shortley and Weller), as log psi, since psi itself falls below 1e-300. Places nearer to another class's reference
cost more, so that the ascent keeps to its own class; what it leads elsewhere counts as what it is.

Samples follow the slope of log psi. Near a wall that grows like 1/c, which no coarse grid resolves. So the grid keeps
what is left without the wall drift of the two nearest walls, which is added where a sample is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.space import FREE, SpaceKernels
from pirrht.geometry.world import World
from pirrht.jit.jit import inlined, kernel
from pirrht.proposals.proposal import ProposalControl
from pirrht.proposals.tuning import TUNING
from pirrht.proposals.wall_drift import WallDrift
from pirrht.rollouts.first_exit import slope_for
from pirrht.rollouts.tables import KNOWN, PLACE, DesirabilityTubes, ProposalTables, grid_slope, tube_of


class Lattice(NamedTuple):
    """A grid in space, and what is known of its points."""

    lower: Array  # (3,) first point [m]
    spacing: float  # h [m]
    gap: Array  # (nx, ny, nz) clearance [m]
    rim: Array  # (nx, ny, nz) distance from the goal's rim [m], negative inside
    rate: Array  # (nx, ny, nz) k^2, more where another class's reference is nearer [1/m^2]
    log_psi: Array  # (nx, ny, nz) [nats]


LATTICE: Any = Lattice


@inlined
def _arm(grid, i, j, k, axis, move):  # type: ignore[no-untyped-def]
    """Return psi at the end of an arm over that at its point, its length [m], and whether it ends at the goal."""
    a = i + (move if axis == 0 else 0)
    b = j + (move if axis == 1 else 0)
    c = k + (move if axis == 2 else 0)
    gap = grid.gap[i, j, k]
    rim = grid.rim[i, j, k]
    if grid.rim[a, b, c] <= 0.0:
        share = rim / (rim - grid.rim[a, b, c])
        return math.exp(min(-grid.log_psi[i, j, k], TUNING.grid_greatest)), max(share, 0.1) * grid.spacing, True
    if grid.gap[a, b, c] <= 0.0:
        return 0.0, max(gap / (gap - grid.gap[a, b, c]), 0.1) * grid.spacing, False
    return math.exp(min(grid.log_psi[a, b, c] - grid.log_psi[i, j, k], TUNING.grid_greatest)), grid.spacing, False


@kernel
def weigh(grid, weights, source):  # type: ignore[no-untyped-def]
    """Write what psi at a point is by its neighbours (nx, ny, nz, 6) and by the goal, as shares of the first guess."""
    nx, ny, nz = grid.log_psi.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                weights[i, j, k, :] = 0.0
                source[i, j, k] = 0.0
                if grid.gap[i, j, k] <= 0.0 or grid.rim[i, j, k] <= 0.0:
                    continue
                own = grid.rate[i, j, k]
                for axis in range(3):
                    front, ahead, to_goal = _arm(grid, i, j, k, axis, 1)
                    back, behind, from_goal = _arm(grid, i, j, k, axis, -1)
                    own += 2.0 / (ahead * behind)
                    front *= 2.0 / (ahead * (ahead + behind))
                    back *= 2.0 / (behind * (ahead + behind))
                    source[i, j, k] += (front if to_goal else 0.0) + (back if from_goal else 0.0)
                    weights[i, j, k, 2 * axis] = 0.0 if to_goal else front
                    weights[i, j, k, 2 * axis + 1] = 0.0 if from_goal else back
                for arm in range(6):
                    weights[i, j, k, arm] /= own
                source[i, j, k] /= own


@kernel
def relax(share, weights, source, factor, backwards):  # type: ignore[no-untyped-def]
    """Relax psi, as shares of the first guess (nx, ny, nz), once, in order or backwards; return the largest change."""
    nx, ny, nz = share.shape
    worst = 0.0
    for row in range(1, nx - 1):
        i = nx - 1 - row if backwards else row
        for line in range(1, ny - 1):
            j = ny - 1 - line if backwards else line
            for point in range(1, nz - 1):
                k = nz - 1 - point if backwards else point
                w = weights[i, j, k]
                here = share[i, j, k]
                if here == 0.0:
                    continue
                along_x = w[0] * share[i + 1, j, k] + w[1] * share[i - 1, j, k]
                along_y = w[2] * share[i, j + 1, k] + w[3] * share[i, j - 1, k]
                along_z = w[4] * share[i, j, k + 1] + w[5] * share[i, j, k - 1]
                now = source[i, j, k] + along_x + along_y + along_z
                next_share = max(here + factor * (now - here), 0.5 * now)
                share[i, j, k] = next_share
                worst = max(worst, abs(next_share - here) / here)
    return worst


@kernel
def refine(coarse, grid):  # type: ignore[no-untyped-def]
    """Take log psi of free points from a grid of twice the spacing: the greatest around, from which it falls fast."""
    nx, ny, nz = grid.log_psi.shape
    cx, cy, cz = coarse.log_psi.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if grid.gap[i, j, k] <= 0.0 or grid.rim[i, j, k] <= 0.0:
                    continue
                most = grid.log_psi[i, j, k] - TUNING.grid_lower
                for a in range(2):
                    for b in range(2):
                        for c in range(2):
                            p = min((i + a) // 2, cx - 1)
                            q = min((j + b) // 2, cy - 1)
                            r = min((k + c) // 2, cz - 1)
                            most = max(most, coarse.log_psi[p, q, r])
                grid.log_psi[i, j, k] = most


@kernel
def to_line(line, x, y, z):  # type: ignore[no-untyped-def]
    """Return the nearest place on a line (k, 3) [m], its distance, and how far it is from there to the end."""
    nearest = math.inf
    place = (x, y, z)
    left = 0.0
    rest = 0.0
    for s in range(line.shape[0] - 2, -1, -1):
        ux = line[s + 1, 0] - line[s, 0]
        uy = line[s + 1, 1] - line[s, 1]
        uz = line[s + 1, 2] - line[s, 2]
        square = ux * ux + uy * uy + uz * uz
        along = (x - line[s, 0]) * ux + (y - line[s, 1]) * uy + (z - line[s, 2]) * uz
        share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
        here = (line[s, 0] + share * ux, line[s, 1] + share * uy, line[s, 2] + share * uz)
        apart = math.sqrt((x - here[0]) ** 2 + (y - here[1]) ** 2 + (z - here[2]) ** 2)
        length = math.sqrt(square)
        if apart < nearest:
            nearest, left, place = apart, rest + (1.0 - share) * length, here
        rest += length
    return place, nearest, left


@cache
def kernels_of(space: SpaceKernels) -> tuple[Any, Any, Any]:
    """Build kernels by those of a footprint: which places are seen, what points are like, and their slopes."""
    clearance, two_walls, certify_piece, wall_slope = space.clearance, space.walls, space.certify_piece, slope_for(3)

    @kernel
    def seen(static, line, places):  # type: ignore[no-untyped-def]
        """Return for places (j, 3) [m] the nearest ones on a line (k, 3), and whether a free piece joins both."""
        nearest = np.empty_like(places)
        free = np.empty(len(places), dtype=np.bool_)
        for i in range(len(places)):
            x, y, z = places[i, 0], places[i, 1], places[i, 2]
            here, _, _ = to_line(line, x, y, z)
            nearest[i, 0], nearest[i, 1], nearest[i, 2] = here
            free[i] = certify_piece(static, (x, y, z), here, False) == FREE
        return nearest, free

    @kernel
    def describe(world, grid, line, barriers, decay):  # type: ignore[no-untyped-def]
        """Write clearance, distance to the goal, k^2, and log psi by the length of the way over the line (k, 3)."""
        nx, ny, nz = grid.gap.shape
        h = grid.spacing
        square = decay * decay * (1.0 + decay * decay * h * h / 20.0)
        for i in range(nx):
            for j in range(ny):
                for k in range(nz):
                    x = grid.lower[0] + h * i
                    y = grid.lower[1] + h * j
                    z = grid.lower[2] + h * k
                    grid.gap[i, j, k] = clearance(world.static, (x, y, z))
                    dx = x - world.goal[0]
                    dy = y - world.goal[1]
                    dz = z - world.goal[2]
                    grid.rim[i, j, k] = math.sqrt(dx * dx + dy * dy + dz * dz) - world.radius
                    _, away, left = to_line(line, x, y, z)
                    grid.log_psi[i, j, k] = -decay * max(away + left - world.radius, 0.0)
                    grid.rate[i, j, k] = square
                    near = TUNING.grid_nearer * away
                    for b in range(barriers.shape[0]):
                        ex = x - barriers[b, 0]
                        ey = y - barriers[b, 1]
                        ez = z - barriers[b, 2]
                        if ex * ex + ey * ey + ez * ez < near * near:
                            grid.rate[i, j, k] = TUNING.grid_costlier * square
                            break
                    if grid.rim[i, j, k] <= 0.0:
                        grid.log_psi[i, j, k] = 0.0

    @kernel
    def slopes(world, grid, decay, offset, out):  # type: ignore[no-untyped-def]
        """Write the slope of log psi without wall drift [1/m] and whether it is known, out (nx, ny, nz, 4)."""
        nx, ny, nz = grid.gap.shape
        h = grid.spacing
        for i in range(nx):
            for j in range(ny):
                for k in range(nz):
                    place = (grid.lower[0] + h * i, grid.lower[1] + h * j, grid.lower[2] + h * k)
                    out[i, j, k, :] = np.float32(0.0)
                    if grid.gap[i, j, k] < TUNING.grid_clear * h:
                        continue
                    if grid.rim[i, j, k] <= 0.0:
                        away = max(grid.rim[i, j, k] + world.radius, 1e-9)
                        steep = (decay + 1.0 / world.radius) / away
                        for axis in range(3):
                            out[i, j, k, axis] = steep * (world.goal[axis] - place[axis])
                        out[i, j, k, 3] = 1.0
                        continue
                    c, n, d, m = two_walls(world.static, place)
                    least = np.float32(TUNING.closest)
                    push = wall_slope((max(c, least), n, max(d, least), m), offset)
                    square = 1e-9
                    for axis in range(3):
                        front, ahead, _ = _arm(grid, i, j, k, axis, 1)
                        back, behind, _ = _arm(grid, i, j, k, axis, -1)
                        if ahead == h and behind == h and front > 0.0 and back > 0.0:
                            rise = 0.5 * math.log(front / back) / h
                        else:
                            bend = ((front - 1.0) / ahead + (back - 1.0) / behind) / (ahead + behind)
                            rise = (front - 1.0) / ahead - bend * ahead
                        out[i, j, k, axis] = rise
                        square += rise * rise
                    # Where it costs more, the slope leads back, and no more steeply than elsewhere.
                    steep = decay / math.sqrt(square) if grid.rate[i, j, k] > 2.0 * decay * decay else 1.0
                    for axis in range(3):
                        out[i, j, k, axis] = min(steep, 1.0) * out[i, j, k, axis] - push[axis]
                    out[i, j, k, 3] = 1.0

    return seen, describe, slopes


@kernel
def extend(out):  # type: ignore[no-untyped-def]
    """Give points of out (nx, ny, nz, 4) that are not known the mean of known neighbours."""
    nx, ny, nz, _ = out.shape
    known = out[:, :, :, 3].copy()
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if known[i, j, k] > 0.0:
                    continue
                total = 0.0
                for a in range(max(i - 1, 0), min(i + 2, nx)):
                    for b in range(max(j - 1, 0), min(j + 2, ny)):
                        for c in range(max(k - 1, 0), min(k + 2, nz)):
                            if known[a, b, c] > 0.0:
                                total += 1.0
                                for axis in range(3):
                                    out[i, j, k, axis] += out[a, b, c, axis]
                if total > 0.0:
                    for axis in range(3):
                        out[i, j, k, axis] /= total
                    out[i, j, k, 3] = 1.0


def places_along(line: Array) -> Array:
    """Return places along a line (k, 3), not far from one to the next, (j, 3) [m]."""
    legs = zip(line[:-1], line[1:], strict=True)
    counts = np.ceil(np.linalg.norm(np.diff(line, axis=0), axis=1) / TUNING.grid_step).astype(int)
    shares = [np.arange(n)[:, None] / n for n in np.maximum(counts, 1).tolist()]
    return np.vstack([*((1.0 - t) * a + t * b for (a, b), t in zip(legs, shares, strict=True)), line[-1:]])


def barriers(space: FreeSpace, lines: Sequence[Array], own: int) -> Array:
    """Return places on lines of other classes that obstacles separate from one's own, (j, 3) [m].

    Where a stretch of another line is not seen from the own one, paths that change over from this to that before the
    stretch and after it may be of two classes: then what is between both lines tells the classes apart.
    """
    seen, *_ = kernels_of(space.static.kernels)
    line = lines[own]
    along = places_along(line)
    found = [np.empty((0, 3))]
    for other in (one for k, one in enumerate(lines) if k != own):
        places = places_along(other)
        nearest, free = seen(space.static, line, places)
        ends = np.flatnonzero(np.diff(free))  # the last before each change

        def class_by(i: int, places: Array = places, nearest: Array = nearest) -> tuple[int, ...]:
            """Return the class of the path that changes over at place i."""
            last = int(np.argmin(np.linalg.norm(along - nearest[i], axis=1)))
            return space.homology.winding(np.vstack([along[: last + 1], nearest[i], places[i:]]))

        for first, last in zip(ends[::2], ends[1::2], strict=False):
            if class_by(int(first)) != class_by(int(last) + 1):
                found.append(places[first + 1 : last + 1])
    return np.vstack(found)


def relaxed(space: FreeSpace, world: World, line: Array, others: Array, decay: float, spacing: float) -> Lattice:
    """Solve for log psi of the class of a line (k, 3), apart from other places (j, 3) [m], from coarse grids to fine.

    psi decays by k per meter [1/m].
    """
    lower = space.scene.lower
    shape = tuple(np.ceil((space.scene.upper - lower) / spacing - 1e-9).astype(int) + 1)
    grid: Lattice = LATTICE(lower, spacing, *(np.empty(shape) for _ in range(4)))
    _, describe, _ = kernels_of(space.static.kernels)
    describe(world, grid, line, others, decay)
    if grid.gap.size > TUNING.grid_coarsest:
        refine(relaxed(space, world, line, others, decay, 2.0 * spacing), grid)

    reach = math.cos(math.pi / max(shape)) / math.cosh(decay * spacing)  # spectral radius of Jacobi's iteration
    factor = 2.0 / (1.0 + math.sqrt(1.0 - reach * reach))
    weights = np.empty((*shape, 6))
    source = np.empty(shape)
    weigh(grid, weights, source)
    share = np.where((grid.gap > 0.0) & (grid.rim > 0.0), 1.0, 0.0)
    for sweep in range(TUNING.grid_sweeps):
        if relax(share, weights, source, factor, bool(sweep % 2)) < TUNING.grid_settled:
            break
    grid.log_psi[share > 0.0] += np.log(share[share > 0.0])
    return grid


@dataclass(frozen=True, slots=True, eq=False)
class DesirabilityGrid:
    """log psi of one class in an examined scene, and its slope without wall drift."""

    lower: Array  # (3,) first point [m]
    spacing: float  # h [m]
    log_psi: Array  # (nx, ny, nz) [nats]
    slope: Any  # (nx, ny, nz, 4) float32: slope of log psi without wall drift [1/m], one number unused

    @classmethod
    def of(
        cls, space: FreeSpace, world: World, lines: Sequence[Array], own: int, decay: float, offset: float
    ) -> "DesirabilityGrid":
        """Solve for the class of one of some references, lines (k, 3) [m] to the goal point.

        psi decays by k per meter [1/m]; walls push within about an offset [m].
        """
        span = space.scene.upper - space.scene.lower
        spacing = max(
            min(TUNING.grid_lengths / decay, TUNING.grid_spacings * space.static.spacing),
            float(np.prod(span) / TUNING.grid_points) ** (1.0 / 3.0),
        )
        grid = relaxed(space, world, lines[own], barriers(space, lines, own), decay, spacing)
        *_, slopes = kernels_of(space.static.kernels)
        out = np.zeros((*grid.log_psi.shape, KNOWN), np.float32)
        slopes(world, grid, decay, offset, out)
        for _ in range(2):
            extend(out)
        return cls(grid.lower, spacing, grid.log_psi, out)

    def at(self, x: Array) -> float:
        """Return log psi [nats] at the closest point to x (3,) [m]."""
        most = np.array(self.log_psi.shape) - 1
        i, j, k = np.clip(np.rint((x - self.lower) / self.spacing), 0, most).astype(int)
        return float(self.log_psi[i, j, k])


@dataclass(frozen=True, slots=True, eq=False)
class GridAscent(ProposalControl):
    """Ascent of the desirability of a class in space, G u = BB' grad log psi, less the wall drift."""

    grid: DesirabilityGrid
    gain: Array  # (m, 3) lambda R^-1 G' [m/s per nat/m]
    promise: float  # predicted log psi of the class, that of the grid at the start [nats]

    @classmethod
    def of(cls, grid: DesirabilityGrid, x: Array, push: WallDrift) -> "GridAscent":
        """Climb from x (n,)."""
        return cls(grid, push.gain(x), grid.at(x))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows of points along the last axis, and points of a row."""
        nx, ny, nz = self.grid.log_psi.shape
        return nx * ny, nz

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at x (n,), at any time."""
        return np.asarray(self.gain @ np.array(grid_slope(tube_of(self._tubes(), 0), *x[:3].tolist())))

    def pack(self, leads: ProposalTables, h: int) -> None:
        """Write the grid to the row in `ProposalTables.ways`."""
        own = self._tubes()
        leads.ways.count[h] = own.count[0]
        leads.ways.place[h, :2] = own.place[0]
        leads.ways.slope[h] = own.slope[0]

    def _tubes(self) -> DesirabilityTubes:
        grid = self.grid
        place = np.zeros((1, 2, PLACE), np.float32)
        place[0, 0, :4] = (*grid.lower, 1.0 / grid.spacing)
        place[0, 1, :3] = grid.log_psi.shape
        C, J = self.shape
        return DesirabilityTubes(np.array([C]), place, grid.slope.reshape(1, C, J, KNOWN), 0.0)
