"""Classes of planar paths about static and moving obstacles: rays that they cross, and angles (paper, section IV-A)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Mover
from pirrht.jit.jit import inlined, kernel, load_int32, part
from pirrht.topology.crossings import Cuts, key_of_step, keys_of_steps, marker_at, pairs_of_curve, straight_turns
from pirrht.topology.moving_crossings import NO_RAYS, MarkerTable, RayTable, begin, crossings_of_leg, follow, watch
from pirrht.topology.signature import Signature, SignatureKernels, hash_weights
from pirrht.topology.tracks import NO_TRACKS, MarkerTrajectories, places_at, trajectories_of, turns_of_step


@kernel
def base(table, x, out):  # type: ignore[no-untyped-def]
    """Write H of the base from x, 2 or 3 [m, m, s], to `out` (M,) [turns]: about static markers, then moving ones."""
    cuts = table.cuts
    gx, gy = cuts.goal_x, cuts.goal_y

    for k in range(cuts.M):
        mx, my = marker_at(cuts, k)
        out[load_int32(cuts.marker, k)] = straight_turns(x[0], x[1], mx, my, gx, gy)
    for j in range(table.tracks.J):
        out[cuts.M + j] = 0.0
        if x[2] < math.inf:
            out[cuts.M + j] = turns_of_step(
                table.tracks, j, (x[0], x[1], x[2]), (gx, gy, x[2] + math.hypot(gx - x[0], gy - x[1]) / table.speed)
            )


@kernel
def turns(table, a, b, out):  # type: ignore[no-untyped-def]
    """Add H of a straight step from a to b, (3) each [m, m, s], to `out` (M,) [turns]."""
    cuts = table.cuts
    for k in range(cuts.M):
        x, y = marker_at(cuts, k)
        out[load_int32(cuts.marker, k)] += turns_of_chord(a[0] - x, a[1] - y, b[0] - x, b[1] - y)
    for j in range(table.tracks.J):
        out[cuts.M + j] += turns_of_step(table.tracks, j, a, b)


@inlined
def arcs(table, curve, to_goal, head, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs of a curve of arcs."""
    return pairs_of_curve(table.cuts, curve, to_goal, head, marker, turn, count)


@part
def key(table, a, b):  # type: ignore[no-untyped-def]
    """Additive key of the segment from a to b, positions [m]."""
    return key_of_step(table.cuts, a[0], a[1], b[0], b[1])


@inlined
def keys(table, f, rows, n, out, at):  # type: ignore[no-untyped-def]
    """Add the keys of n steps."""
    keys_of_steps(table.cuts, f, rows, n, out, at)


class PlanarTable(MarkerTable):
    """Static and moving markers in the plane."""

    @property
    def kernels(self) -> SignatureKernels:
        """Return the kernels of rays in the plane."""
        return RAYS


RAYS = SignatureKernels(base, crossings_of_leg, turns, arcs, key, keys, watch, begin, follow)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Homology(Signature):
    """Signature of paths about S static and J moving markers, M = S + J in this order; often J = 0.

    About a static marker, the base of a point is the straight line to the goal point. Its integer counts how often a
    path crosses the ray that leaves the marker away from the goal point.

    About a moving marker, H is the turn of x(t) - o(t). The base goes straight to the goal point at the best speed, as
    if nothing was in the way. Paths are closed by waiting there until the later of two arrivals.

    Points are (n,), x and y first [m]. Where J > 0 they are x, y [m] and t [s].
    """

    markers: Array  # (S, 2) one point inside each static topological obstacle [m]
    goal: Array  # (2,) goal representative point [m]
    named: int | None = None  # names of classes give so many turns at least: they last while obstacles are added
    moved: tuple[int, ...] = ()  # static markers that lie elsewhere in their obstacle than in the signature before
    names: tuple[str, ...] = ()  # (J,) of the moving obstacles that moving markers belong to
    tracks: MarkerTrajectories = NO_TRACKS  # of the moving markers
    speed: float = 1.0  # of bases about moving markers, sqrt(2 q / r) [m/s]
    cuts: Cuts = field(init=False)  # the static markers sorted, for kernels that must not query all of them

    def __post_init__(self) -> None:
        object.__setattr__(self, "cuts", Cuts.of(self.markers, self.goal, hash_weights(len(self.markers))))

    def __repr__(self) -> str:
        return f"Homology({self.M} markers, goal {formatting.vector(self.goal)})"

    @property
    def table(self) -> PlanarTable:
        """Numbers that its kernels take."""
        return PlanarTable(self.cuts, self.tracks, self.speed)

    @property
    def static(self) -> "Homology":
        """Signature about the static markers only (J = 0)."""
        return replace(self, names=(), tracks=NO_TRACKS) if self.J else self

    def with_goal(self, goal: Array) -> "Homology":
        """Signature about the same markers for another goal point (2,) [m]."""
        return replace(self, goal=goal)

    def with_moving(self, movers: Sequence[Mover], footprint: Footprint) -> "Homology":
        """Signature about the same static markers and other moving obstacles."""
        names, tracks = trajectories_of(movers, footprint, self.goal)
        return replace(self, names=names, tracks=tracks)

    def with_speed(self, speed: float) -> "Homology":
        """Signature about the same markers with bases at another speed [m/s]."""
        return replace(self, speed=speed)

    def rays(self, x: Array, times: Array) -> RayTable:
        """Moving markers' rays for paths from x (n,) over steps that end at times (T + 1,) [s]."""
        if not self.J:
            return NO_RAYS
        weight = self.hash_weights[len(self.markers) :]
        return RayTable.of(self.tracks, weight, self.goal, x, times, self.arrival(self.at(x, float(times[0]))))

    def places(self, times: Array) -> Array:
        """Places of moving markers at times (T,) [s], (J, T, 2) [m]."""
        places = np.empty((self.J, len(times), 2))
        places_at(self.tracks, times, places)
        return places

    def closed(self, turns: Array, first: Array, last: Array) -> Array:
        """H of a path from `first` to `last` (n,), completed to the goal point, over the base's, (M,) [turns]."""
        S = len(self.markers)
        whole = turns.copy()
        whole[:S] += self.base(last)[:S] - self.base(first)[:S]
        if self.J:
            arrival = self.arrival(first)
            waits = np.array([[*self.goal, min(last[2], arrival)], [*self.goal, max(last[2], arrival)]])
            to_goal = self.turns(np.array([last, [*self.goal, last[2]]]))
            wait = math.copysign(1.0, arrival - last[2]) * self.turns(waits)
            whole[S:] += (to_goal + wait - self.base(first))[S:]
        return whole

    def arrival(self, x: Array) -> float:
        """Time at which the base that leaves x (3,) [m, m, s] arrives [s]."""
        return float(x[2] + math.dist(self.goal, x[:2]) / self.speed)
