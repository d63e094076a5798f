"""Answer for moving obstacles in space, convex solids on rows of poses, around a robot that is a ball.

In space and time, of four dimensions, what a body sweeps has codimension three, so that no path winds about it: moving
obstacles make no classes, and only block. Distances are closed forms; other obstacles are ruled out by the balls around
them. As in the plane, one that a noisy step may meet counts as a flat wall, which is exact for one that is flat.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Kind, Mover
from pirrht.geometry.polygon import variance_along
from pirrht.geometry.scene import Scene
from pirrht.geometry.shapes import Solids, offset_of, outside
from pirrht.geometry.space import BLOCKED, FREE, NEVER, UNSURE
from pirrht.geometry.world import WALL, MovingKernels, Pose, unwatched
from pirrht.jit.jit import borrowing, inlined, kernel, load_float64, load_int64, part
from pirrht.jit.records import Held
from pirrht.jit.streams import FAR, MIN_VARIANCE, survival
from pirrht.jit.vectors import combined, dot
from pirrht.moving.collision import MovingObstacles, jumps, radius_of, speed_bound
from pirrht.moving.distances import disc_of, fastest_of, in_solid, restart_of, row_of, solids_of
from pirrht.moving.exits import met
from pirrht.moving.tuning import BODY, PARTS, PIECE, SOLID, TUNING

_both = combined(3)
_dot = dot(3)


@inlined
def _apart(a, b):  # type: ignore[no-untyped-def]
    away = _both(1.0, b, -1.0, a)
    return math.sqrt(_dot(away, away))


@inlined
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _turned(w, q, v):  # type: ignore[no-untyped-def]
    """Turn a vector v by a unit quaternion of the scalar w and the vector q."""
    twice = _cross(q, v)
    return _both(1.0, _both(1.0, v, 2.0 * w, twice), 2.0, _cross(q, twice))


@inlined
def _three(at, i):  # type: ignore[no-untyped-def]
    return load_float64(at, i), load_float64(at, i + 1), load_float64(at, i + 2)


@inlined
def _on(pose, rates, dt):  # type: ignore[no-untyped-def]
    """Move a pose (place, w, q) on at rates (velocity, turns) [1/s] for dt [s]."""
    (place, w, q), (v, turns) = pose, rates
    place = _both(1.0, place, dt, v)
    half = 0.5 * dt * math.sqrt(_dot(turns, turns))
    if half == 0.0:
        return place, w, q
    c = math.cos(half)
    p = _both(0.5 * dt * math.sin(half) / half, turns, 0.0, turns)
    return place, c * w - _dot(p, q), _both(1.0, _both(c, q, w, p), 1.0, _cross(p, q))


@inlined
def piece_of(moving, j, t):  # type: ignore[no-untyped-def]
    """Return the pose of obstacle j at t [s], its rates, and until when these hold from then [s]."""
    low, high, end, now = row_of(moving, j, t, PIECE)
    at = moving.rows + 8 * PIECE * low
    pose = _three(at, 1), load_float64(at, 4), _three(at, 5)
    rates = _three(at, 8), _three(at, 11)
    past = now - load_float64(at, 0)
    if past < 0.0 or high == end:
        return pose, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), t - past if past < 0.0 else math.inf
    return _on(pose, rates, past), rates, t + load_float64(at, PIECE) - now


@inlined
def _outside(moving, j, pose, place):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance of a place [m] from obstacle j at a pose, however it is turned [m]."""
    return _apart(pose[0], place) - disc_of(moving, j)


@kernel
def _nearest(moving, j, pose, place):  # type: ignore[no-untyped-def]
    """Return the clearance of a place [m] from obstacle j at a pose [m], and its nearest solid; -radius inside."""
    seen = _turned(-pose[1], pose[2], _both(1.0, place, -1.0, pose[0]))
    best, which = math.inf, np.int64(0)
    for k in solids_of(moving, j):
        size = _three(moving.solid + 8 * SOLID * k, 0)
        d = max(outside(load_int64(moving.form, k), *size, *in_solid(moving, k, *seen)), 0.0)
        if d < best:
            best, which = d, k
    return best - moving.robot, which


@kernel
def _wall(moving, j, pose, rates, place):  # type: ignore[no-untyped-def]
    """Return a row of walls for a place [m]: clearance [m], direction away and velocity [m/s] of obstacle j there."""
    c, k = _nearest(moving, j, pose, place)
    at = moving.solid + 8 * SOLID * k
    away = (0.0, 0.0, 0.0)
    if c + moving.robot > 0.0:
        seen = _turned(-pose[1], pose[2], _both(1.0, place, -1.0, pose[0]))
        off = offset_of(load_int64(moving.form, k), *_three(at, 0), *in_solid(moving, k, *seen))
        away = _turned(
            pose[1], pose[2], (_dot(_three(at, 6), off), _dot(_three(at, 9), off), _dot(_three(at, 12), off))
        )
    arm = _both(1.0, _both(1.0, place, -1.0, away), -1.0, pose[0])
    away = _both(1.0 / max(c + moving.robot, 1e-300), away, 0.0, away)
    return (c, *away, *_both(1.0, rates[0], 1.0, _cross(rates[1], arm)))


@borrowing
def _march(moving, j, step, t, dt, stop, least):  # type: ignore[no-untyped-def]
    """Return the share of a straight step, up to `stop`, at which obstacle j touches it, or NEVER, and if that is sure.

    It is not where the clearance is below the first of `least` [m], and the march advances by the second.
    """
    (a, b), (certain, stride) = step, least
    share, sure = 0.0, True
    rate = max(_apart(a, b) + fastest_of(moving, j) * dt, MIN_VARIANCE)
    while True:
        now = t + share * dt
        place = _both(1.0 - share, a, share, b)
        pose, _, _ = piece_of(moving, j, now)
        c = _outside(moving, j, pose, place)
        if c <= rate * (stop - share) or c < certain:
            c, _ = _nearest(moving, j, pose, place)
        if c <= 0.0:
            return share, True
        if c < certain:
            sure, c = False, stride
        if share >= stop:
            return NEVER, sure
        ahead = c / rate
        if dt > 0.0:
            ahead = min(ahead, max((restart_of(moving, j, now) - t) / dt - share, 0.0) + 1e-9)
        share = min(stop, share + ahead)


@kernel
def certify(moving, leg, heading):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a straight step (ax, ay, az, s, bx, by, bz, t), from a at s [s] to b at t."""
    ax, ay, az, s, bx, by, bz, t = leg
    verdict = FREE
    for j in range(moving.J):
        share, sure = _march(moving, j, ((ax, ay, az), (bx, by, bz)), s, t - s, 1.0, (TUNING.certain, TUNING.stride))
        if share <= 1.0:
            return BLOCKED
        verdict = verdict if sure else UNSURE
    return verdict


@part
def sweep(moving, notes, step, t, dt, stop):  # type: ignore[no-untyped-def]
    """Find the share at which a step without position noise meets an obstacle: `MovingKernels`."""
    first, least = NEVER, TUNING.sweep_step * moving.robot
    for j in range(moving.J):
        share, _ = _march(moving, j, (step[0], step[1]), t, dt, min(stop, first), (least, least))
        first = min(first, share)
    return first


@kernel
def clearance(moving, place, t):  # type: ignore[no-untyped-def]
    """Return the clearance of a place from all obstacles at t [s], [m]."""
    best = math.inf
    for j in range(moving.J):
        pose, _, _ = piece_of(moving, j, t)
        if _outside(moving, j, pose, place) < best:
            c, _ = _nearest(moving, j, pose, place)
            best = min(best, c)
    return best


@borrowing
def walls(moving, notes, place, t, within, out):  # type: ignore[no-untyped-def]
    """Write walls nearer than `within` [m] to a place at t [s] to rows of `out` (J, WALL); `MovingKernels.walls`."""
    count, until = 0, math.inf
    for j in range(moving.J):
        pose, rates, held = piece_of(moving, j, t)
        until = min(until, restart_of(moving, j, t))
        if _outside(moving, j, pose, place) >= within:
            continue
        until = min(until, held)
        wall = _wall(moving, j, pose, rates, place)
        if wall[0] < within:
            out[count, :] = wall
            count += 1
    return count, until


@part
def _behind(moving, j, piece, way, dt, c, d, length):  # type: ignore[no-untyped-def]
    """Return clearance d of a step's end; negative if its chord meets the obstacle, as if it ended inside of that."""
    share = c / length
    while share < 1.0 - d / length:
        pose = _on(piece[0], piece[1], share * dt)
        e, _ = _nearest(moving, j, pose, _both(1.0 - share, way[0], share, way[1]))
        if e <= 0.0:
            return c * (1.0 - 1.0 / share)
        share += max(e, TUNING.sweep_step * moving.robot) / length
    return d


@borrowing
def bridge(moving, notes, step, t, dt, cov, rule, state, out):  # type: ignore[no-untyped-def]
    """Find which obstacle a noisy step meets and when: `MovingKernels.bridge`."""
    (here, there), (most, weighed) = step, rule
    length = _apart(here, there)
    alive, worst, nearest = 1.0, 2.0, (0.0, 0.0, 0.0)
    for j in range(moving.J):
        pose, rates, _ = piece_of(moving, j, t)
        c = _outside(moving, j, pose, here)
        d = c - length - fastest_of(moving, j) * dt
        if d > 0.0 and 2.0 * c * d >= FAR * most:
            continue
        wall = _wall(moving, j, pose, rates, here)
        c = wall[0]
        d, _ = _nearest(moving, j, _on(pose, rates, dt), there)
        seen = _apart(_both(1.0, here, dt, rates[0]), there) + dt * math.sqrt(_dot(rates[1], rates[1])) * disc_of(
            moving, j
        )
        if c > 0.0 and d > 0.0 and c + d <= seen:
            d = _behind(moving, j, (pose, rates), (here, there), dt, c, d, seen)
        variance = variance_along(wall[1:4], cov)
        survives = survival(c, d, variance) if c > 0.0 else 0.0
        alive *= survives
        if survives < worst:
            worst, nearest = survives, (c, d, variance)
            out[0, :] = wall
    return met(alive, nearest, weighed, state)


@kernel
def walls_at(moving, place, t, within, out):  # type: ignore[no-untyped-def]
    """Write walls nearer than `within` [m] to a place at t [s] to rows of `out` (J, WALL); return how many."""
    return walls(moving, 0, place, t, within, out)[0]


KERNELS = MovingKernels(
    unwatched, inlined(lambda notes: None), walls, bridge, sweep, clearance, certify, certify_turn=None
)


class SolidNumbers(NamedTuple):
    """J moving obstacles in space, as numbers and addresses that kernels can take cheaply."""

    J: int  # number of bodies
    body: int  # address of float64 (J, BODY), as in the plane
    parts: int  # address of int64 (J, PARTS)
    rows: int  # address of float64 (k, PIECE), of all bodies
    solid: int  # address of float64 (K, SOLID)
    form: int  # address of int64 (K,): index in `shapes.FORMS`
    robot: float  # its radius [m]
    speed: float  # the greatest of any point of any body, jumps aside [m/s]


class MovingSolids(Held, SolidNumbers):
    """J moving obstacles in space together with the arrays that the addresses point to: `geometry.world.Moving`."""

    collision: MovingObstacles  # the same obstacles as FCL has them
    kernels = KERNELS

    @classmethod
    def of(cls, scene: Scene) -> "MovingSolids":
        """Gather the moving obstacles of a scene; SceneError: one of them has no closed form."""
        for mover in scene.movers:
            for solid in mover.solids:
                if solid.kind is Kind.MESH:
                    raise SceneError(
                        f'{scene.name}: "{solid.name}" of "{mover.name}" is a mesh, and it moves in space; make it of '
                        "boxes, spheres, capsules, cylinders or ellipsoids"
                    )
        return cls._around(scene.movers, MovingObstacles(scene.movers, scene.footprint), scene.footprint)

    @classmethod
    def _around(cls, movers: Sequence[Mover], collision: MovingObstacles, robot: Footprint) -> "MovingSolids":
        body = np.zeros((len(movers), BODY))
        parts = np.zeros((len(movers), PARTS), dtype=np.int64)
        row = solid = 0
        for j, mover in enumerate(movers):
            motion, far = mover.motion, radius_of(mover.solids, 3)
            lap = motion.rows[-1, 0] if motion.repeat else 0.0
            body[j] = motion.offset, lap, jumps(motion), far + robot.radius, speed_bound(motion, far)
            parts[j] = row, row + len(motion.rows), solid, solid + len(mover.solids)
            row, solid = parts[j, [1, 3]]
        solids = Solids.of([solid for mover in movers for solid in mover.solids])
        rows = np.vstack([np.hstack([mover.motion.rows, mover.motion.rates]) for mover in movers])
        numbers = np.hstack([solids.size, solids.position, solids.rotation.reshape(-1, 9)])
        made = cls.holding(len(movers), body, parts, rows, numbers, solids.form, robot.radius, float(body[:, -1].max()))
        made.collision = collision
        return made

    def with_motions(self, movers: Sequence[Mover]) -> "MovingSolids":
        """Return these obstacles on other motions; FCL's shapes are shared: one thread at a time asks."""
        return self._around(movers, self.collision.with_motions(movers), self.collision.footprint)

    def clearance(self, pose: Pose, t: float) -> float:
        """Return the clearance of a place from the nearest at t [s], [m]."""
        return float(clearance(self, pose, t))

    def walls(self, pose: Pose, t: float, within: float) -> Array:
        """Return clearance [m], direction away and velocity [m/s] of those `within` [m] of a place, (k, WALL)."""
        out = np.empty((self.J, WALL))
        return out[: walls_at(self, pose, t, within, out)]

    def distance(self, pose: Array, t: float) -> float:
        """Return the exact clearance of a place (3,) at t [s], [m]."""
        return self.collision.clearance(pose, t)

    def meets(self, a: Array, s: float, b: Array, t: float) -> bool:
        """Return whether a straight step between places, a at s [s] and b at t, meets one, exactly where in doubt."""
        sure = certify(self, (*a.tolist(), s, *b.tolist(), t), 0.0) == FREE
        return not sure and self.collision.meets(a, s, b, t, undecided=True)
