"""Solve for a car on positions and headings: `q psi/lambda = V (cos th psi_x + sin th psi_y) + b^2/2 psi_thth`.

Noise acts on the heading only, so psi moves along straight rays and is smoothed over headings, in turn (Strang: half a
smoothing, a ray of length V tau, half a smoothing). Rays interpolate v = -lambda log psi, smooth where psi changes by
many factors of e per grid point: cubic in space, kept between the values around it where v has a kink. A ray that meets
a wall or the goal ends there. Sweeps in place, in alternating directions, go on until v no longer changes.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from pirrht.arrays import Array, BoolArray
from pirrht.errors import OptionError
from pirrht.exact.grid import TUNING, Frame, Progress, Settling, cubic, frame_at, in_goal, interpolate, place_at
from pirrht.freespace import FreeSpace
from pirrht.geometry.space import BLOCKED, FREE, GOAL, INSIDE, UNSURE, SpaceKernels, pose_at
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import survival
from pirrht.problem import Problem
from pirrht.systems.unicycle import Unicycle


class Headings(NamedTuple):
    """log psi on a grid of positions and headings."""

    frame: Frame
    log_psi: Array  # (nx, ny, nt) [nats]; headings 2 pi k / nt


class Rays(NamedTuple):
    """Rays that leave each grid point at each heading."""

    ended: Array  # (nx, ny, nt) v where the ray meets goal or wall [cost]; nan: nowhere, -1: it begins in a wall
    cost: float  # q tau of a whole ray [cost]
    temperature: float  # lambda [cost]
    ceiling: float  # v is cut off there [cost]


def spacing_for(problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Return the requested spacing [m], or one that smears paths less than noise does; OptionError if none will do."""
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


def grid_of(problem: Problem, space: FreeSpace, spacing: float, _: float | None, progress: Progress) -> Headings:
    """Solve for log psi of a car at a spacing [m]; OptionError if sweeps do not settle."""
    d, scene = problem.dynamics, space.scene
    assert isinstance(d, Unicycle)
    assert not callable(problem.q)
    nx, ny = np.ceil((scene.upper - scene.lower) / spacing - 1e-9).astype(int) + 1
    shape = (nx, ny, _directions(d, spacing))
    tau = TUNING.ray * spacing / d.V
    ceiling = min(problem.phi, TUNING.worst_path * problem.q * float(np.sum(scene.upper - scene.lower)) / d.V)
    rays = Rays(np.full(shape, np.nan), problem.q * tau, problem.temperature, ceiling)
    frame = frame_at(scene.lower.astype(float), spacing, scene.goal)
    gaps = np.empty((2, 0, 0, 0))
    tracing(space.static.kernels, d.reads(space.static.kernels.turns))(space.world, frame, rays)
    if space.static.kernels.turns:
        gaps = turning_gaps(space, frame, rays)
    value = np.where(rays.ended == 0.0, 0.0, ceiling)
    blocked = rays.ended < 0.0
    # Walls repeat what is next to them, at the same heading.
    apart = (1.0, 1.0, float(sum(shape)))
    nearest = tuple(distance_transform_edt(blocked, apart, return_distances=False, return_indices=True)[:, blocked])
    whole, half = (_taps(d.b * math.sqrt(s), tau, shape[2]) for s in (tau, 0.5 * tau))
    settling = Settling(progress, TUNING.car_settled)
    for done in range(TUNING.car_sweeps):
        change = _sweep(value, value, rays, gaps, (whole, d.b**2 * tau), done % 4)
        settling.note(change)
        value[blocked] = value[nearest]
        if change < TUNING.car_settled:
            out = value.copy()
            _sweep(value, out, rays, gaps, (half, 0.5 * d.b**2 * tau), 0)
            out[blocked] = out[nearest]
            return Headings(frame, out / -problem.temperature)
    raise OptionError(f"the solution has not settled after {TUNING.car_sweeps} sweeps; choose a larger spacing")


def _directions(d: Unicycle, spacing: float) -> int:
    """Headings so close together that the noise of one ray spans one of them."""
    return max(TUNING.headings, math.ceil(2.0 * math.pi / (d.b * math.sqrt(TUNING.ray * spacing / d.V))))


def _taps(deviation: float, tau: float, headings: int) -> Array:
    """Weights of a Gaussian on the headings' grid, (2 R + 1,)."""
    width = 2.0 * math.pi / headings
    reach = min(math.ceil((TUNING.car_cutoff * deviation + TUNING.fastest_turn * tau) / width), headings // 2 - 1)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * width / deviation) ** 2)
    return np.asarray(weights / weights.sum())


@cache
def tracing(space: SpaceKernels, reads: tuple[int, ...]) -> Any:
    """Build the kernel (arena, frame, rays) that traces rays, by kernels of a footprint and what they read of a car."""
    sweep, clearance = space.sweep, space.clearance
    pose, headings = pose_at(reads), space.turns

    @kernel
    def fits(arena, x, y, count):  # type: ignore[no-untyped-def]
        """Check whether the robot may be at a place at one of so many headings."""
        for k in range(count if headings else 1):
            if clearance(arena.static, pose((x, y, 2.0 * math.pi * k / count))) > 0.0:
                return True
        return False

    @kernel
    def trace(arena, frame, rays):  # type: ignore[no-untyped-def]
        """Trace the ray from every point, for `rays.ended`."""
        (nx, ny, nt), length = rays.ended.shape, TUNING.ray * frame.spacing
        for i in range(nx):
            for j in range(ny):
                x, y = place_at(frame, i, j)

                if not fits(arena, x, y, nt):
                    rays.ended[i, j, :] = -1.0
                elif in_goal(frame, (x, y)):
                    rays.ended[i, j, :] = 0.0
                else:
                    for k in range(nt):
                        th = 2.0 * math.pi * k / nt
                        ahead = (x + length * math.cos(th), y + length * math.sin(th), th)
                        end, share, _ = sweep(arena, pose((x, y, th)), pose(ahead), 0.0, 0.0)
                        if end != INSIDE:
                            rays.ended[i, j, k] = share * rays.cost if end == GOAL else rays.ceiling

    return trace


def turning_gaps(space: FreeSpace, frame: Frame, rays: Rays) -> Array:
    """Return by how much a car may turn left and right at each grid point until it meets a wall, (2, nx, ny, nt) [rad].

    Exact distances of the footprint judge what the clearances of its cover leave open: `rays.ended` is negative at
    poses in a wall, and where a ray is free nan.
    """
    shape = rays.ended.shape
    nx, ny, nt = shape
    width = 2.0 * math.pi / nt
    x, y = (at + frame.spacing * np.arange(n) for at, n in ((frame.x0, nx), (frame.y0, ny)))
    poses = np.stack(np.meshgrid(x, y, width * np.arange(nt), indexing="ij"), axis=-1)

    def free(at: Array) -> BoolArray:
        verdicts = np.empty(len(at), dtype=np.int64)
        judging(space.static.kernels)(space.static, np.ascontiguousarray(at), verdicts)
        unsure = np.flatnonzero(verdicts == UNSURE)
        verdicts[unsure] = np.where(space.collision.free(at[unsure]), FREE, BLOCKED)
        return np.asarray(verdicts == FREE)

    inside = rays.ended != 0.0
    clear = np.ones(shape, dtype=bool)
    clear[inside] = free(poses[inside])
    met = np.flatnonzero((rays.ended.ravel() == rays.ceiling) & clear.ravel())
    ahead = TUNING.ray * frame.spacing * np.arange(1, TUNING.ray_checks + 1) / TUNING.ray_checks
    begun = poses.reshape(-1, 3)[met, None]
    heading = begun[..., 2:]
    along = begun + ahead[:, None] * np.concatenate((np.cos(heading), np.sin(heading), 0.0 * heading), axis=-1)
    rays.ended.ravel()[met[free(along.reshape(-1, 3)).reshape(len(met), -1).all(axis=1)]] = np.nan
    rays.ended[~clear] = -1.0

    gaps = np.full((2, *shape), np.inf)
    for side, gap in zip((1, -1), gaps, strict=True):
        edge = clear & ~np.roll(clear, -side, axis=2)
        at = poses[edge]
        low = np.zeros(len(at))
        high = np.full(len(at), width)
        for _ in range(TUNING.turn_halvings):
            middle = 0.5 * (low + high)
            turned = free(at + np.outer(side * middle, [0.0, 0.0, 1.0]))
            low, high = np.where(turned, middle, low), np.where(turned, high, middle)
        gap[~clear] = 0.0
        gap[edge] = 0.5 * (low + high)
        _pass_on(gap, clear & ~edge, side, width)
    return gaps


@kernel
def _pass_on(gap, through, side, width):  # type: ignore[no-untyped-def]
    """Write the angles of headings `through` which a turn goes on to the next one, from those of that [rad]."""
    nx, ny, nt = gap.shape
    for i in range(nx):
        for j in range(ny):
            for step in range(2 * nt):
                k = (-side * step) % nt
                if through[i, j, k]:
                    gap[i, j, k] = gap[i, j, (k + side) % nt] + width


@cache
def judging(space: SpaceKernels) -> Any:
    """Build the kernel (static, poses (k, 3), out (k,)) that writes FREE, UNSURE or BLOCKED."""
    certify = space.certify

    @kernel
    def judged(static, poses, out):  # type: ignore[no-untyped-def]
        for i in range(len(poses)):
            out[i] = certify(static, (poses[i, 0], poses[i, 1], poses[i, 2]))

    return judged


@kernel
def _sweep(value, out, rays, gaps, smoothing, order):  # type: ignore[no-untyped-def]
    """Follow rays and smooth over headings at all positions in turn; return the greatest change of v [cost].

    `gaps` as of `turning_gaps`, empty where headings do not matter; `smoothing`: weights of headings, variance [rad^2].
    """
    taps, _ = smoothing
    walled = gaps.shape[1] > 0
    nx, ny, nt = value.shape
    reach = taps.shape[0] // 2

    ray = np.empty(nt + 2 * reach)
    weight = np.empty(nt + 2 * reach)
    change = 0.0

    for a in range(nx):
        i = a if order % 2 == 0 else nx - 1 - a
        for b in range(ny):
            j = b if order // 2 == 0 else ny - 1 - b
            if rays.ended[i, j, 0] == 0.0 or (rays.ended[i, j, 0] < 0.0 and not walled):  # in the goal or in a wall
                continue
            for k in range(nt):
                ray[reach + k] = rays.ended[i, j, k]
                if ray[reach + k] < 0.0:
                    ray[reach + k] = rays.ceiling
                elif math.isnan(ray[reach + k]):
                    th = 2.0 * math.pi * k / nt
                    ahead = _cubic(value, i, j, TUNING.ray * math.cos(th), TUNING.ray * math.sin(th), k)
                    ray[reach + k] = min(rays.cost + ahead, rays.ceiling)
            ray[:reach] = ray[nt : reach + nt]
            ray[reach + nt :] = ray[reach : 2 * reach]
            least = ray.min()
            for k in range(nt + 2 * reach):
                weight[k] = math.exp((least - ray[k]) / rays.temperature)
            for k in range(nt):
                if walled and rays.ended[i, j, k] < 0.0:
                    continue
                sides = (gaps[0, i, j, k], gaps[1, i, j, k]) if walled else (math.inf, math.inf)
                new = (
                    _between_gaps(weight, k, sides, smoothing, rays, least)
                    if min(sides[0], sides[1]) < math.inf
                    else _over_headings(ray, weight, k, taps, rays, least)
                )
                change = max(change, abs(new - value[i, j, k]))
                out[i, j, k] = new
    return change


@inlined
def _between_gaps(weight, k, sides, smoothing, rays, least):  # type: ignore[no-untyped-def]
    """Return v at heading k from weights of headings around it, less those of turns that meet a wall [cost]."""
    taps, variance = smoothing
    width = taps.shape[0]
    nt = weight.shape[0] + 1 - width
    total = 0.0
    for t in range(width):
        total += taps[t] * weight[k + t] * _misses(sides[0], sides[1], (t - width // 2) * 2.0 * math.pi / nt, variance)
    return rays.ceiling if total <= 0.0 else min(least - rays.temperature * math.log(total), rays.ceiling)


@inlined
def _over_headings(ray, weight, k, taps, rays, least):  # type: ignore[no-untyped-def]
    """Return v at heading k from what rays find at headings around it, and their weights [cost]."""
    width = taps.shape[0]
    best, total = least, 0.0
    for t in range(width):
        total += taps[t] * weight[k + t]
    if total <= 1e-290:  # the best heading of all is too far ahead to scale by
        best, total = ray[k : k + width].min(), 0.0
        for t in range(width):
            total += taps[t] * math.exp((best - ray[k + t]) / rays.temperature)
    return min(best - rays.temperature * math.log(total), rays.ceiling)


@inlined
def _misses(left, right, turn, variance):  # type: ignore[no-untyped-def]
    """Return the probability that headings between, a bridge of a variance [rad^2], stay off walls on both sides."""
    return survival(left, left - turn, variance) * survival(right, right + turn, variance)


@inlined
def _cubic(value, i, j, dx, dy, k):  # type: ignore[no-untyped-def]
    """v at (i + dx, j + dy) of heading k, kept between the four values around."""
    nx, ny, _ = value.shape
    p = math.floor(i + dx)
    q = math.floor(j + dy)
    weight_x = cubic(i + dx - p)
    weight_y = cubic(j + dy - q)
    total, low, high = 0.0, math.inf, -math.inf
    for c in range(4):
        row, s = 0.0, min(max(p + c - 1, 0), nx - 1)
        for d in range(4):
            entry = value[s, min(max(q + d - 1, 0), ny - 1), k]
            row += weight_y[d] * entry
            if 1 <= c <= 2 and 1 <= d <= 2:
                low = min(low, entry)
                high = max(high, entry)
        total += weight_x[c] * row
    return min(max(total, low), high)


@kernel
def evaluate(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,), 0 in the goal; its gradient [1/m, 1/m, 1/rad] goes to slope (3,)."""
    if in_goal(grid.frame, x):
        slope[:] = 0.0
        return 0.0
    return interpolate(grid.log_psi, grid.frame, x, slope)
