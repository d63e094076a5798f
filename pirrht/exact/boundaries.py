"""Step psi back in time: `psi(x, t) = e^(-q dt/lambda) sum_y N(y - x) S(x, y) psi(y, t + dt) + sum_g share_g psi_g`.

S is the probability that a path survives: a Brownian bridge, also relative to a moving wall, misses one from which its
ends have clearances d and e, each at its own time, with probability 1 - exp(-2 d e / (b^2 dt)). Boundaries are rows of
a table: the goal, four borders of the workspace, then solids. Solids of the static world are body 0, and each moving
obstacle is one. Those in one direction from a path's beginning are one wall, at the clearance of the nearest; each
direction has a factor of its own.

psi_g is 1 at the goal and exp(-phi/lambda) at walls. Around a boundary that is alone psi is known: K_0(k rho)/K_0(k r)
around the goal's disc, exp(-(m + n) d) at a flat wall from which noise and its own speed carry a path away with a drift
of m b^2, n^2 = m^2 + k^2. So share_g is what the sum over grid points is short of that, its error at the kink included.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import kve

from pirrht.arrays import Array, IntArray
from pirrht.exact.grid import TUNING, Frame, place_at, to_rim
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Scene
from pirrht.geometry.walls import products, stands_apart
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.distances import clearance_of_solid, offset_of_solid, piece_of, turned_back
from pirrht.moving.obstacles import MovingObstacleArrays

SOLID = 5  # row of the first solid; the goal's is 0
JUMP = 1e-9  # a repeated motion is judged so much away from where it starts over [s]


class MovingDomain(NamedTuple):
    """Everything that paths can meet."""

    frame: Frame  # of the grid, and the goal's disc
    border: tuple[float, float, float, float]  # x and y of the workspace's lower, then of its upper corner [m]
    solids: MovingObstacleArrays  # K solids of 1 + J bodies, each in its body's frame
    owner: IntArray  # (K,) body of each
    around_goal: Array  # (n,) K_0(k rho)/K_0(k r) at distances rho - r of 0, 1, ... times ...
    pitch: float  # ... so much [m]


class Patch(NamedTuple):
    """Points that paths from a rectangle of the grid can reach in a step, and the solids that they can meet."""

    first: tuple[int, int]  # grid indices of its first point
    width: int  # points that a path from one place can reach, along each axis
    psi: Array  # (k, l) at the end of the step, over exp(base)
    base: float  # [nats]
    near: IntArray  # (c,) solids within reach
    ahead: Array  # (5 + c, k, l) clearances from boundaries at the end of the step [m]
    begin: Array  # (1 + J, 4) poses of bodies at the beginning of the step, as of `poses_at`
    end: Array  # (1 + J, 4) and at its end


class Boundaries(NamedTuple):
    """B boundaries within reach of a place, and the dependence of a path's survival and payment on them."""

    goals: int  # 1 if the first is the goal, else 0; others are walls
    member: IntArray  # (5 + c,) boundary that a row of the table belongs to; -1: none
    distance: Array  # (B,) [m]
    speed: Array  # (B,) growth of the distance while a path stays [m/s]
    steepness: Array  # (B,) m + n of psi at a wall that is alone [1/m]


def moving_domain(scene: Scene, frame: Frame, cutoff: float, wavenumber: float) -> MovingDomain:
    """Gather what surrounds paths in a scene, for distances up to a cutoff [m] and k [1/m] of psi."""
    pitch = min(frame.radius, 1.0 / wavenumber) / 1024.0  # interpolation errs by 1e-7
    rim = wavenumber * frame.radius

    e = wavenumber * pitch * np.arange(4.0 + 3.0 * cutoff / pitch)
    around_goal = kve(0, rim + e) / kve(0, rim) * np.exp(-e)
    still = Motion(rows=np.zeros((1, 4)))
    static = [Mover(name="static", solids=tuple(scene.obstacles), motion=still)] if scene.obstacles else []
    every = *static, *scene.movers
    owner = np.repeat(np.arange(len(every)), [len(body.solids) for body in every])
    left, low, right, high = np.concatenate([scene.lower, scene.upper]).astype(float).tolist()
    solids = MovingObstacleArrays.around(scene.footprint, every, cutoff)
    return MovingDomain(frame, (left, low, right, high), solids, owner, around_goal, pitch)


@kernel
def poses_at(solids, t):  # type: ignore[no-untyped-def]
    """Return x, y [m], cosine and sine of the yaw of all bodies at t [s], (1 + J, 4)."""
    out = np.empty((solids.J, 4))
    for j in range(solids.J):
        out[j, 0], out[j, 1], yaw, _, _, _, _ = piece_of(solids, j, t)
        out[j, 2:] = (math.cos(yaw), math.sin(yaw))
    return out


@inlined
def clearance_from(domain, k, pose, x, y):  # type: ignore[no-untyped-def]
    """Return the clearance of the robot's centre at (x, y) [m] from solid k [m], minus its radius deep inside."""
    u, v = _in_body(pose, domain.owner[k], x, y)
    return clearance_of_solid(domain.solids, k, u, v)


@inlined
def _in_body(pose, owner, x, y):  # type: ignore[no-untyped-def]
    """Return a point (x, y) in a body's own frame [m]."""
    return turned_back(pose[owner, 2], pose[owner, 3], x - pose[owner, 0], y - pose[owner, 1])


@inlined
def to_border(domain, x, y):  # type: ignore[no-untyped-def]
    """Distance of (x, y) from the border of the workspace [m], negative outside."""
    left, low, right, high = domain.border
    return min(min(x - left, right - x), min(y - low, high - y))


@kernel
def clearance_at(domain, pose, x, y):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from all solids, posed (1 + J, 4), and from the border [m]."""
    out = to_border(domain, x, y)
    for k in range(domain.owner.shape[0]):
        out = min(out, clearance_from(domain, k, pose, x, y))
    return out


@kernel
def solids_near(domain, begin, end, x, y, cutoff):  # type: ignore[no-untyped-def]
    """Solids that are within reach of (x, y) [m] at the beginning or the end of a step."""
    near, count = np.empty(domain.owner.shape[0], dtype=np.int64), 0
    for k in range(near.shape[0]):
        if min(clearance_from(domain, k, begin, x, y), clearance_from(domain, k, end, x, y)) < cutoff:
            near[count] = k
            count += 1
    return near[:count]


@kernel
def patch_of(domain, later, near, begin, end, corners, margin):  # type: ignore[no-untyped-def]
    """Return the `Patch` of grid points from (i0, j0) to (i1, j1), end excluded, and a margin around them."""
    i0 = corners[0] - margin
    j0 = corners[1] - margin
    frame = domain.frame

    k = corners[2] - i0 + margin
    m = corners[3] - j0 + margin
    psi = np.zeros((k, m))
    ahead = np.empty((SOLID + near.shape[0], k, m))

    a0 = max(i0, 0)
    b0 = max(j0, 0)
    a1 = min(i0 + k, later.shape[0])
    b1 = min(j0 + m, later.shape[1])

    base = later[a0:a1, b0:b1].max() if a0 < a1 and b0 < b1 else -math.inf
    for i in range(k):
        for j in range(m):
            x, y = place_at(frame, i0 + i, j0 + j)
            _to_rows(domain, near, end, x, y, ahead[:, i, j])
            if base > -math.inf and a0 <= i0 + i < a1 and b0 <= j0 + j < b1:
                psi[i, j] = math.exp(later[i0 + i, j0 + j] - base)
    return Patch((i0, j0), 2 * margin + 1, psi, base, near, ahead, begin, end)


@inlined
def _to_rows(domain, near, pose, x, y, out):  # type: ignore[no-untyped-def]
    """Fill `out` (5 + c,) with distances of (x, y) [m] from goal, borders and solids."""
    left, low, right, high = domain.border

    out[:SOLID] = (to_rim(domain.frame, x, y), x - left, right - x, y - low, high - y)

    for n in range(near.shape[0]):
        out[SOLID + n] = clearance_from(domain, near[n], pose, x, y)


@kernel
def boundaries_of(domain, step, patch, x, y):  # type: ignore[no-untyped-def]
    """Tell whether (x, y) [m] is free, and return the `Boundaries` within reach of it."""
    rows = SOLID + len(patch.near)
    most = 1 + TUNING.directions
    noise = step.b * step.b

    now = np.empty(rows)
    then = np.empty(rows)
    member = np.full(rows, -1)

    _to_rows(domain, patch.near, patch.begin, x, y, now)
    _to_rows(domain, patch.near, patch.end, x, y, then)

    away = np.zeros((rows, 2))
    distance = np.empty(most)
    speed = np.empty(most)
    steepness = np.empty(most)

    _directions(domain, patch, x, y, now, away)
    goals = n = 1 if now[0] < step.cutoff else 0
    if goals > 0:
        member[0], distance[0] = 0, now[0]
    while n < most:
        at = -1
        for k in range(1, rows):
            if member[k] < 0 and now[k] < step.cutoff and (at < 0 or now[k] < now[at]):
                at = k
        if at < 0:
            break
        later = math.inf
        for k in range(1, rows):
            along, square, other = products(away[k], away[at], 2)
            if member[k] < 0 and (k == at or (now[k] < step.cutoff and not stands_apart(along, square, other))):
                member[k], later = n, min(later, then[k])
        distance[n] = now[at]
        speed[n] = (later - now[at]) / step.dt
        drift = speed[n] / noise
        if step.wall < math.inf and at >= SOLID:
            drift += 0.5 * _curvature(domain, patch, at - SOLID, x, y, away[at])
        steepness[n] = drift + math.sqrt(drift * drift + 2.0 * step.rate / noise)
        n += 1
    return now.min() > 0.0, Boundaries(goals, member, distance[:n], speed[:n], steepness[:n])


@kernel
def _directions(domain, patch, x, y, now, away):  # type: ignore[no-untyped-def]
    """Fill `away` (5 + c, 2) [m] with vectors to (x, y) from borders, `now` away [m], and nearest points of solids."""
    away[1, 0] = now[1]
    away[2, 0] = -now[2]
    away[3, 1] = now[3]
    away[4, 1] = -now[4]

    for k in range(len(patch.near)):
        owner = domain.owner[patch.near[k]]
        u, v = _in_body(patch.begin, owner, x, y)
        ex, ey, _, _ = offset_of_solid(domain.solids, patch.near[k], u, v)
        c = patch.begin[owner, 2]
        s = patch.begin[owner, 3]
        away[SOLID + k] = (c * ex - s * ey, s * ex + c * ey)


@kernel
def _curvature(domain, patch, k, x, y, away):  # type: ignore[no-untyped-def]
    """Laplacian [1/m], at least 0, of the clearance from the k-th solid half-way from (x, y) [m] to it, `away` (2,)."""
    k = patch.near[k]
    e = TUNING.curvature_arm * domain.solids.robot
    share = 0.5 * (1.0 - domain.solids.robot / math.hypot(away[0], away[1]))
    x = x - share * away[0]
    y = y - share * away[1]
    total = -4.0 * clearance_from(domain, k, patch.begin, x, y)
    for side in (-e, e):
        total += clearance_from(domain, k, patch.begin, x + side, y)
        total += clearance_from(domain, k, patch.begin, x, y + side)
    return max(total / (e * e), 0.0)


@kernel
def meet_boundaries(domain, step, t, later, out):  # type: ignore[no-untyped-def]
    """Correct `out` of `smooth` where solids, the goal, or a border that costs are within reach; minus infinity inside.

    Args: t, when the step begins [s]; `later` and `out`, log psi at its end and its beginning, 2 x (nx, ny) [nats].
    """
    (nx, ny), frame, tile = out.shape, domain.frame, TUNING.tile
    begin = poses_at(domain.solids, t + JUMP)
    end = poses_at(domain.solids, t + step.dt - JUMP)
    margin = math.ceil(step.cutoff / frame.spacing)
    reach = step.cutoff + 0.5 * math.sqrt(2.0) * tile * frame.spacing
    for i0 in range(0, nx, tile):
        for j0 in range(0, ny, tile):
            i1 = min(i0 + tile, nx)
            j1 = min(j0 + tile, ny)
            x, y = place_at(frame, 0.5 * (i0 + i1 - 1), 0.5 * (j0 + j1 - 1))
            near = solids_near(domain, begin, end, x, y, reach)
            bordered = step.wall < math.inf and to_border(domain, x, y) < reach
            if len(near) == 0 and not bordered and to_rim(frame, x, y) >= reach:
                continue
            patch = patch_of(domain, later, near, begin, end, (i0, j0, i1, j1), margin)
            least = patch.base + math.log(TUNING.underflow)
            for i in range(i0, i1):
                for j in range(j0, j1):
                    x, y = place_at(frame, i, j)
                    free, met = boundaries_of(domain, step, patch, x, y)
                    if not free:
                        out[i, j] = -math.inf
                    elif len(met.distance) > 0 or out[i, j] <= least:
                        out[i, j] = _before(domain, step, patch, met, x, y, i - i0, j - j0)
                        if out[i, j] <= least:
                            own = patch_of(domain, later, near, begin, end, (i, j, i + 1, j + 1), margin)
                            out[i, j] = _before(domain, step, own, met, x, y, 0, 0)


@kernel
def log_psi_before(domain, step, t, later, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (2,) [m] and t [s], -phi/lambda in walls; `later` (nx, ny) [nats], slope (2,) [1/m]."""
    frame, solids = domain.frame, domain.solids
    begin = poses_at(solids, t)
    end = poses_at(solids, t + step.dt - JUMP)
    near = solids_near(domain, begin, end, x[0], x[1], step.cutoff)

    i = math.floor((x[0] - frame.x0) / frame.spacing + 0.5)
    j = math.floor((x[1] - frame.y0) / frame.spacing + 0.5)
    patch = patch_of(
        domain, later, near, begin, end, (i, j, i + 1, j + 1), math.ceil(step.cutoff / frame.spacing + 0.5)
    )

    slope[:2] = 0.0
    free, met = boundaries_of(domain, step, patch, x[0], x[1])
    if not free:
        return -step.wall
    value = _before(domain, step, patch, met, x[0], x[1], 0, 0)
    e = TUNING.difference * step.deviation
    for d in met.distance:
        e = min(e, 0.005 * d)
    for k in range(2 if value > -math.inf else 0):
        for side in (-e, e):
            px = x[0] + side * (1 - k)
            py = x[1] + side * k
            met = boundaries_of(domain, step, patch, px, py)[1]
            slope[k] += 0.5 / side * _before(domain, step, patch, met, px, py, 0, 0)
    return value


@kernel
def _before(domain, step, patch, met, x, y, i0, j0):  # type: ignore[no-untyped-def]
    """log psi [nats] at (x, y) [m] a step before, among `Boundaries`; (i0, j0) of `patch` is first in reach."""
    frame = domain.frame
    width = patch.width
    B = len(met.distance)
    variance = step.deviation**2

    short = np.zeros(B)  # shares are short of sums `short`
    whole = 0.0
    weight = np.empty((2, width))

    paying = step.wall < math.inf
    ahead = np.full((B, width, width), math.inf)

    for r in range(len(met.member)):
        if met.member[r] >= 0:
            for a in range(width):
                for c in range(width):
                    ahead[met.member[r], a, c] = min(ahead[met.member[r], a, c], patch.ahead[r, i0 + a, j0 + c])
    for a in range(width):
        dx = frame.x0 + (patch.first[0] + i0 + a) * frame.spacing - x
        dy = frame.y0 + (patch.first[1] + j0 + a) * frame.spacing - y
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
                        short[g] += gauss * alive * _alone(domain, met, g, ahead[g, a, c])
            whole += total
    value = patch.base - step.rate * step.dt + math.log(whole) if whole > 0.0 else -math.inf
    for g in range(B if paying else met.goals):
        value = np.logaddexp(value, _log_share(domain, step, met, g, short[g]))
    return value


@kernel
def _log_share(domain, step, met, g, short):  # type: ignore[no-untyped-def]
    """log(share_g psi_g) of boundary g [nats], whose share is short of a sum; paths meet others with half a chance."""
    alone = _alone(domain, met, g, met.distance[g])
    share = alone - math.exp(-step.rate * step.dt) * short
    if share < TUNING.kernel_sum * alone:
        return -math.inf
    for h in range(len(met.distance)):
        if h != g:
            share *= 1.0 - 0.5 * _meeting(met.distance[h], met.speed[h], step)
    return math.log(share) - (0.0 if g < met.goals else step.wall)


@inlined
def _alone(domain, met, g, e):  # type: ignore[no-untyped-def]
    """psi at a distance e [m] from boundary g if nothing else is near."""
    if g >= met.goals:
        return math.exp(-met.steepness[g] * e)
    table, at = domain.around_goal, e / domain.pitch
    i = min(int(at), table.shape[0] - 2)
    return table[i] + min(at - i, 1.0) * (table[i + 1] - table[i])


@inlined
def _survival(d, e, variance):  # type: ignore[no-untyped-def]
    """Probability that a bridge misses a wall from which its ends are d and e [m]; 0 beyond it."""
    z = 2.0 * max(d, 0.0) * max(e, 0.0) / variance
    return 1.0 if z > 40.0 else -math.expm1(-z)


@inlined
def _meeting(d, speed, step):  # type: ignore[no-untyped-def]
    """Probability that a path meets a wall d away [m] whose distance grows at a speed [m/s]."""
    width = step.deviation * math.sqrt(2.0)
    ahead = speed * step.dt
    mirrored = math.exp(min(-2.0 * d * speed / (step.b * step.b), 700.0)) * math.erfc((d - ahead) / width)
    return min(0.5 * (math.erfc((d + ahead) / width) + mirrored), 1.0)
