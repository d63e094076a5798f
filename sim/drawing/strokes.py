"""Lines to be drawn: samples by class and their averages, references, the tree lifted by the paper's H.

And of moving obstacles their outlines at some moments, and the tubes that they sweep in space and time.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array, IntArray
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.polyline import interpolated, lengths
from pirrht.outcome import Outcome
from pirrht.planner.graph import ROOT
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.plotting.strokes import fading, outline, rings
from pirrht.topology.signature import OTHER, Signature
from sim.states import adapter_of

Floats = NDArray[np.float32]
DEAD = "dead"
MOST, POINTS = 24, 32  # samples of a mean path, the heaviest of a class, and its points
CORNERS, ROUGH = 32, 20  # of what is round, of a tube and of an outline
TURN = 0.15  # of an obstacle from one ring of its tube to the next at most [rad]
ENDS = 8  # samples of a class whose robots are outlined where they end, the heaviest
JUMP = 1e-6  # time over which an obstacle that starts over jumps [s]


def at_most(points: Array, count: int) -> Array:
    """A polyline (k, d) thinned out to at most `count` points, ends included."""
    return points[np.rint(np.linspace(0, len(points) - 1, min(count, len(points)))).astype(np.int64)]


def knots_of(reference: Reference) -> Array | None:
    """The path of a reference with times of its own, (k, d + 1) [m, s]; None of one without."""
    knots = getattr(reference.trajectory.path, "knots", None)
    return None if knots is None else np.asarray(knots)


def timed(reference: Reference, now: float) -> Array:
    """The path of a reference of a plan made at a time [s], (k, d + 1) [m, s]; without own times at even pace."""
    if (knots := knots_of(reference)) is not None:
        return np.column_stack([knots[:, :-1], knots[:, -1] - knots[0, -1] + now])
    line, along = reference.trajectory.points, lengths(reference.trajectory.points)
    whole = float(reference.trajectory.durations.sum())
    return np.column_stack([line, now + whole * along / max(float(along[-1]), 1e-9)])


def apart(lines: Sequence[NDArray[Any]]) -> list[int]:
    """For each of several lines (k, d) the index of a point far from the others and from earlier such points."""
    found: list[int] = []
    for i, line in enumerate(lines):
        others = np.vstack([other for j, other in enumerate(lines) if j != i] or [line[[0, -1]]])
        gap = np.linalg.norm(line[:, None] - others, axis=-1).min(axis=1)
        for other, k in zip(lines, found, strict=False):
            gap += 0.5 * np.minimum(np.linalg.norm(line - other[k], axis=-1), 0.3 * np.ptp(others[:, :2]))
        found.append(int(np.argmax(gap)))
    return found


def lift(points: Array, z: float | Array) -> Floats:
    """Planar points (..., 2) at height z, (..., 3), single precision."""
    out = np.empty((*points.shape[:-1], 3), np.float32)
    # Whole 1/256 m leave zero bytes behind, which the file's compression turns into half the size.
    out[..., :2] = np.rint(points[..., :2] * 256.0) / 256.0
    out[..., 2] = z
    return out


def single(points: Array) -> Floats:
    """Points (..., 3) in single precision, rounded as those of `lift` along x and y."""
    return lift(points, points[..., 2])


def placed(points: Array, z: float | Array) -> Floats:
    """Points in space (..., 3) as they are, or planar points (..., 2) at height z, single precision."""
    return single(points) if points.shape[-1] == 3 else lift(points, z)


class Fan(NamedTuple):
    """Sampled paths of one class, or of those that died."""

    strips: Floats  # (k, l, 3)
    moments: Array  # (k, l) when each point is reached, from the plan on [s]
    opacity: Array  # (k,) grows with the weight
    ends: Array  # (k, 3) pose where each ends


def fans(
    path_integral: PathIntegral, estimate: Estimate, names: Mapping[int, str], *, points: int, everything: bool
) -> dict[str, Fan]:
    """Samples by the class of their own path, of references by additive key: all, or chosen ones of so many points."""
    paths = estimate.rollouts.paths
    alive = paths.outcome == Outcome.GOAL
    groups = {name: alive & (paths.key == k) for k, name in names.items()}
    groups |= {OTHER: alive & ~np.isin(paths.key, list(names)), DEAD: ~alive}
    heaviest = np.argsort(-estimate.weight, kind="stable")
    chosen = {name: heaviest[mask[heaviest]] for name, mask in groups.items() if mask.any()}
    length = 2 + int(paths.steps.max(initial=0)) // 2
    if not everything:  # of each class, the more the heavier
        count = min(50, max(4, points // (length * max(1, len(chosen)))))
        rank = np.linspace(0.0, 1.0, count) ** 2
        chosen = {name: m[np.unique((rank * (len(m) - 1)).astype(np.int64))] for name, m in chosen.items()}
        length = max(2, min(length, points // max(1, sum(map(len, chosen.values())))))
    top = max(float(estimate.weight.max()), np.finfo(float).tiny)  # earlier samples may have all the weight
    drawn, times = {}, estimate.rollouts.tables.times
    adapter = adapter_of(path_integral.problem.dynamics.states)
    for name, group in chosen.items():
        states, steps = path_integral.replay.trace(estimate.rollouts, group[::-1])  # the heavy ones last, on top
        opacity = np.sqrt(estimate.weight[group[::-1]] / top)
        # Steps may be unequal; points are even in time.
        at = np.searchsorted(times, np.linspace(0.0, 1.0, length) * times[steps, None] - 1e-9)
        ends = adapter.poses(states[np.arange(len(steps)), steps])
        places = adapter.drawn(np.take_along_axis(states, at[:, :, None], axis=1), 0.02 * (1.0 + opacity[:, None]))
        drawn[name] = Fan(strips=single(places), moments=times[at], opacity=opacity, ends=ends)
    return drawn


def heavy_ends(footprint: Footprint, fan: Fan) -> Array:
    """Return the outlines of a robot with corners where the heaviest samples of a class end, (k, c + 1, 2) [m]."""
    return rings(footprint, fan.ends[-ENDS:] if not footprint.is_disc else fan.ends[:0])


def tree_edges(tree: HomologyTree, obstacle: int, most: int) -> Array:
    """Edges from nodes to their parents, (k, 2, 3) [m, m, turns] with the paper's H of one obstacle; at most `most`."""
    graph, size = tree.graph, tree.size
    live = np.arange(graph.parent.shape[1]) < graph.nodes[:size, None]
    vertex, slot = np.nonzero(live & (graph.parent[:size] != ROOT))
    vertex, slot = at_most(np.column_stack([vertex, slot]), most).T
    edge = graph.parent[vertex, slot]
    head = graph.head[edge]
    ends = np.empty((len(vertex), 2, 3))
    ends[:, 0, :2] = tree.states[vertex, :2]
    ends[:, 1, :2] = tree.states[head, :2]
    used = np.arange(graph.marker.shape[2]) < graph.pairs[vertex, slot][:, None]
    turns = np.sum(graph.turn[vertex, slot] * (used & (graph.marker[vertex, slot] == obstacle)), axis=1, dtype=float)
    added = np.zeros(len(graph.tail))  # by prepending each edge [turns]
    around = np.flatnonzero(graph.edge_marker[: int(graph.size[4])] == obstacle)
    added[np.searchsorted(graph.edge_first[: graph.size[1] + 1], around, side="right") - 1] = graph.edge_turn[around]
    ends[:, 0, 2] = 1.0 + graph.straight[vertex, obstacle] + turns
    ends[:, 1, 2] = 1.0 + graph.straight[head, obstacle] + turns - added[edge]
    return ends


def remaining(homology: Signature, reference: Reference, line: Array, obstacle: int) -> Array:
    """The paper's H [turns] of what is left of a reference at each point of its line (k, 2), (k,)."""
    away = line - homology.markers[obstacle]
    cross = away[:-1, 0] * away[1:, 1] - away[:-1, 1] * away[1:, 0]
    swept = np.arctan2(cross, np.sum(away[:-1] * away[1:], axis=1)) / (2.0 * np.pi)
    left: Array = reference.signature[obstacle] - np.concatenate([[0.0], np.cumsum(swept)])
    return left


def mean_paths(path_integral: PathIntegral, estimate: Estimate, names: Mapping[int, str]) -> dict[str, Array]:
    """Per class, named by additive key, the weighted mean of its heaviest samples at equal shares of their time.

    Positions (POINTS, 2) [m]; if it touches something, the sample nearest to it.
    """
    paths, found = estimate.rollouts.paths, {}
    arrived = (paths.outcome == Outcome.GOAL) & (estimate.weight > 0.0)
    share = np.linspace(0.0, 1.0, POINTS)

    for key, name in names.items():
        group = np.flatnonzero(arrived & (paths.key == key))
        group = group[np.argsort(-estimate.weight[group], kind="stable")[:MOST]]
        if len(group):
            states, steps = path_integral.replay.trace(estimate.rollouts, group)
            times = estimate.rollouts.tables.times[: states.shape[1]]
            position = adapter_of(path_integral.problem.dynamics.states).position
            whole = zip(states[..., position], times[steps], strict=True)
            lines = np.array([interpolated(line, times, share * end) for line, end in whole])
            mean = np.average(lines, axis=0, weights=estimate.weight[group])
            free = path_integral.space.collision.segments_free(mean[:-1], mean[1:]).all()
            found[name] = mean if free else lines[int(np.argmin(np.abs(lines - mean).max(axis=(1, 2))))]
    return found


class Tube(NamedTuple):
    """Tube that one solid of a moving obstacle sweeps while it moves without a jump."""

    times: Array  # (k,) at which the obstacle is where its outline is [s]; in between corners go straight
    rings: Array  # (k, c, 2) corners of the outline at each, counterclockwise [m]

    @property
    def faces(self) -> IntArray:
        """Triangles between the corners of all rings, row by row, (2 (k - 1) c, 3)."""
        k, c = self.rings.shape[:2]
        here = np.arange((k - 1) * c)
        after = here - here % c + (here + 1) % c
        return np.vstack([np.column_stack([here, after, here + c]), np.column_stack([after, after + c, here + c])])

    def at(self, time: float) -> Array:
        """Corners of the outline at a time [s], (c, 2) [m]."""
        return interpolated(self.rings.reshape(len(self.times), -1), self.times, np.array([time])).reshape(-1, 2)


class Outline(NamedTuple):
    """Predicted outline of a solid of a moving obstacle."""

    after: float  # a moment [s]
    strength: float  # from 1 for now to 0
    ring: Array  # (c + 1, 2) its corners, the first one twice [m]; in space (c + 1, 3), level through its centre


def foreseen(movers: Sequence[Mover], now: float) -> list[Outline]:
    """Outline moving obstacles as they are now [s] and as predicted soon, the weaker the later."""
    found = []
    for mover in movers:
        moments = [(0.0, 1.0), *fading(mover, now)]
        if mover.motion.in_space:
            posed = [(a, s, outline(solid), solid.position[2]) for a, s in moments for solid in mover.at(now + a)]
            found += [
                Outline(a, s, np.column_stack([np.vstack([r, r[:1]]), np.full(len(r) + 1, z)])) for a, s, r, z in posed
            ]
            continue
        for drawn in outlines(mover, now + np.array([after for after, _ in moments]), ROUGH):
            found += [Outline(a, s, np.vstack([one, one[:1]])) for (a, s), one in zip(moments, drawn, strict=True)]
    return found


def outlines(mover: Mover, times: Array, corners: int = CORNERS) -> list[Array]:
    """Outlines of each of an obstacle's solids seen from above at times (k,) [s], (k, c, 2) [m]."""
    poses = mover.motion.pose(times)
    turns = Rotation.from_euler("z", poses[:, 2:]).as_matrix()[:, :2, :2]
    rings = [outline(solid) for solid in mover.solids]
    flat = [at_most(np.vstack([ring, ring[:1]]), corners + 1)[:-1] for ring in rings]
    return [ring @ turns.transpose(0, 2, 1) + poses[:, None, :2] for ring in flat]


def tubes(mover: Mover, begin: float, end: float, corners: int = CORNERS) -> list[Tube]:
    """Sweep a moving obstacle from one time to another [s], solid by solid, cut where it jumps; round ones coarsely."""
    rows, shift = mover.motion.rows, mover.motion.offset
    period = float(rows[-1, 0]) if mover.motion.repeat else np.inf
    laps = np.arange(np.floor((begin + shift) / period) + 1, np.ceil((end + shift) / period)) * period - shift
    cuts = [begin, *laps[(laps > begin) & (laps < end)], end]
    found = []
    for low, high in zip(cuts[:-1], cuts[1:], strict=True):
        lap = np.floor((0.5 * (low + high) + shift) / period) * period if mover.motion.repeat else 0.0
        knots = rows[:, 0] + lap - shift
        times = np.concatenate([[low], knots[(knots > low) & (knots < high)], [high]])
        yaw = np.interp(times - lap + shift, rows[:, 0], rows[:, 3])
        parts = np.maximum(1, np.ceil(np.abs(np.diff(yaw)) / TURN)).astype(int)
        at = np.interp(np.arange(parts.sum() + 1), np.append(0, np.cumsum(parts)), np.arange(len(times)))
        times = np.interp(at, np.arange(len(times)), times)
        seen = np.minimum(times, max(low, high - JUMP))  # at the end of a lap it is where the next one begins
        found += [Tube(times=times, rings=rings) for rings in outlines(mover, seen, corners)]
    return found
