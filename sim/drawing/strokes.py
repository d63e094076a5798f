"""Lines to be drawn: sampled paths by class and their averages, references, the tree lifted by the paper's H."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.estimation.estimate import OTHER, Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.outcome import Outcome
from pirrht.planner.graph import ROOT, Graph
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.topology.homology import Homology
from sim.drawing.colors import Color

Floats = NDArray[np.float32]
Indices = NDArray[np.int64]
DEAD = "dead"
FINE = 0.02  # distance of points on arcs that are then thinned out [m]
TAPE_SAMPLES = 2000  # of a round, for the line where the tape leads
MOST, POINTS = 24, 32  # samples that a way is the mean of, the heaviest of a class, and its points
TRIED = 5  # samples that may stand for a mean that touches something


def at_most(points: Array, count: int) -> Array:
    """A polyline (k, d) thinned out to at most `count` points, ends included."""
    if len(points) <= count:
        return points
    return points[np.rint(np.linspace(0, len(points) - 1, count)).astype(np.int64)]


def rounded(points: Array, most: int, turn: float = np.deg2rad(12.0)) -> Array:
    """A polyline (k, 2) thinned out where it turns by little: its corners stay corners, and its loops round.

    Args:
        most: so many points at most, if need be by coarser turns.
        turn: left out between two points [rad].
    """
    if len(points) <= 3:
        return points
    steps = np.diff(points, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    bend = np.abs((np.diff(heading) + np.pi) % (2.0 * np.pi) - np.pi)
    turned = np.concatenate([[0.0], np.cumsum(bend)])
    while True:
        new = np.floor(turned[1:] / turn) > np.floor(turned[:-1] / turn)
        keep = np.concatenate([[True], new, [True]])
        if keep.sum() <= most:
            kept: Array = points[keep]
            return kept
        turn *= 1.3


def fine(reference: Reference) -> Array:
    """The path of a reference as a polyline (k, 2) [m] whose loops are round."""
    lines = reference.path.points(FINE)
    return np.vstack([lines[0], *(line[1:] for line in lines[1:])])


def timed(reference: Reference, now: float) -> Array:
    """The path of a reference of a plan made at a time [s] in space and time, (k, 3) [m, m, s].

    One that has no times of its own goes at an even pace.
    """
    knots = getattr(reference.trajectory.path, "knots", None)
    if knots is not None and knots.shape[1] == 3:
        return np.column_stack([knots[:, :2], knots[:, 2] - knots[0, 2] + now])
    line = reference.trajectory.points
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    whole = float(reference.trajectory.durations.sum())
    return np.column_stack([line, now + whole * along / max(float(along[-1]), 1e-9)])


def even(points: Array, count: int) -> Array:
    """A polyline (k, 2) cut anew into `count` points at equal distances, (count, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, points[:, i]) for i in (0, 1)])


def ahead(plan: Plan, problem: Problem) -> Array:
    """Follow a plan's control sequence alone, (k, 2), as far as a tenth of the weight is still under way."""
    x, still, path = plan.state, np.zeros(problem.dynamics.m), [plan.state[:2]]
    tape, alive = _tape_of(plan)
    for u, dt, share in zip(tape, np.diff(plan.times), alive, strict=True):
        if share < 0.1 or problem.scene.goal.contains(x[:2]):
            break
        x = problem.dynamics.step(x, u, still, dt)
        path.append(x[:2])
    return np.array(path)


def _tape_of(plan: Plan) -> tuple[Array, Array]:
    """A plan's tape (T, m) and the weight under way (T,), by as many samples as a picture needs.

    All noise must be drawn again for it. Of several batches the smallest serves that is large enough.
    """
    estimate = plan.estimate
    if estimate is None or plan.replay is None or len(estimate.parts) == 1:
        return plan.tape, plan.alive
    met = [part for part in estimate.parts if np.isfinite(part.log_weight.max())]
    enough = [part for part in met if part.size >= TAPE_SAMPLES]
    return plan.replay.tape(
        [min(enough, key=lambda part: part.size) if enough else max(met, key=lambda part: part.size)]
    )


def apart(lines: Sequence[NDArray[Any]]) -> list[int]:
    """For each of several lines (k, d) the index of its point farthest from the others: room for a name."""
    found = []
    for i, line in enumerate(lines):
        others = np.vstack([other for j, other in enumerate(lines) if j != i] or [line[[0, -1]]])
        gap = np.linalg.norm(line[:, None] - others, axis=-1).min(axis=1)
        found.append(int(np.argmax(gap)))
    return found


def lift(points: Array, z: float | Array) -> Floats:
    """Planar points (..., 2) at height z, (..., 3), single precision."""
    out = np.empty((*points.shape[:-1], 3), np.float32)
    # Whole 1/256 m leave zero bytes behind, which the file's compression turns into half the size.
    out[..., :2] = np.rint(points[..., :2] * 256.0) / 256.0
    out[..., 2] = z
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fan:
    """Sampled paths of one class, or of those that died."""

    strips: Floats  # (k, l, 3)
    moments: Array  # (k, l) when each point is reached, from the plan on [s]
    opacity: Array  # (k,) grows with the weight


def fans(
    path_integral: PathIntegral, estimate: Estimate, names: Mapping[int, str], *, points: int, everything: bool
) -> dict[str, Fan]:
    """Chosen samples by the class of their own path.

    Args:
        names: additive class keys of the references.
        points: how many points may be drawn altogether.
        everything: draw all samples instead, however many.
    """
    paths = estimate.rollouts.paths
    members = _members(paths.outcome, paths.key, names)
    length = 2 + int(paths.steps.max(initial=0)) // 2
    share = max(4, points // (length * max(1, len(members))))
    chosen = {name: m if everything else _pick(m, estimate.weight, min(share, 50)) for name, m in members.items()}
    length = length if everything else max(2, min(length, points // max(1, sum(map(len, chosen.values())))))
    top = max(float(estimate.weight.max()), np.finfo(float).tiny)  # earlier samples may have all the weight
    drawn = {}
    for name, group in chosen.items():
        opacity = np.sqrt(estimate.weight[group] / top)
        order = np.argsort(opacity, kind="stable")  # the heavy ones are drawn last, on top
        strips, moments = _strips(path_integral, estimate, group[order], length)
        strips[..., 2] += 0.02 * opacity[order, None].astype(np.float32)
        drawn[name] = Fan(strips=strips, moments=moments, opacity=opacity[order])
    return drawn


def _members(outcome: NDArray[np.int8], key: Indices, names: Mapping[int, str]) -> dict[str, Indices]:
    alive = outcome == Outcome.GOAL
    members = {name: np.flatnonzero(alive & (key == k)) for k, name in names.items()}
    members[OTHER] = np.flatnonzero(alive & ~np.isin(key, list(names)))
    members[DEAD] = np.flatnonzero(~alive)
    return {name: group for name, group in members.items() if len(group)}


def _pick(group: Indices, weight: Array, count: int) -> Indices:
    """The heaviest third of `count`, and an even choice among the others."""
    if len(group) <= count:
        return group
    by_weight = group[np.argsort(-weight[group], kind="stable")]
    heavy, rest = by_weight[: count // 3], np.sort(by_weight[count // 3 :])
    even = rest[np.linspace(0, len(rest) - 1, count - len(heavy)).astype(np.int64)]
    return np.sort(np.concatenate([heavy, even]))


def _strips(path_integral: PathIntegral, estimate: Estimate, chosen: Indices, length: int) -> tuple[Floats, Array]:
    """Paths of chosen samples with `length` points each, (k, length, 3), and when they are there [s], (k, length)."""
    states, steps = path_integral.replay.trace(estimate.rollouts, chosen)
    times = estimate.rollouts.tables.times  # steps may be unequal; points are even in time
    at = np.searchsorted(times, np.linspace(0.0, 1.0, length) * times[steps, None] - 1e-9)
    return lift(np.take_along_axis(states[:, :, :2], at[:, :, None], axis=1), 0.02), times[at]


def tree_edges(tree: HomologyTree, obstacle: int, most: int, *, since: int = 0) -> tuple[Array, Array]:
    """Edges from nodes to their parents with the paper's H of one obstacle as third coordinate.

    Args:
        most: so many at most.
        since: only those of vertices from this number on.

    Returns:
        (k, 2, 3) ends [m, m, turns] with k at most `most`, and (k,) height of the middle [turns].
    """
    graph, size = tree.graph, tree.size
    width = graph.parent.shape[1]
    live = np.arange(width) < graph.nodes[since:size, None]
    vertex, slot = np.nonzero(live & (graph.parent[since:size] != ROOT))
    vertex += since
    if len(vertex) > most:
        keep = np.linspace(0, len(vertex) - 1, most).astype(np.int64)
        vertex, slot = vertex[keep], slot[keep]
    edge = graph.parent[vertex, slot]
    head = graph.head[edge]
    ends = np.empty((len(vertex), 2, 3))
    ends[:, 0, :2], ends[:, 1, :2] = tree.states[vertex, :2], tree.states[head, :2]
    turns = _node_turns_around(graph, vertex, slot, obstacle).astype(float)
    ends[:, 0, 2] = 1.0 + graph.straight[vertex, obstacle] + turns
    ends[:, 1, 2] = 1.0 + graph.straight[head, obstacle] + turns - _edge_turns_around(graph, obstacle)[edge]
    return ends, ends[:, :, 2].mean(axis=1)


def remaining(homology: Homology, reference: Reference, line: Array, obstacle: int) -> Array:
    """The paper's H [turns] of what is left of a reference at each point of its line (k, 2), (k,)."""
    away = line - homology.markers[obstacle]
    cross = away[:-1, 0] * away[1:, 1] - away[:-1, 1] * away[1:, 0]
    swept = np.arctan2(cross, np.sum(away[:-1] * away[1:], axis=1)) / (2.0 * np.pi)
    left: Array = reference.signature[obstacle] - np.concatenate([[0.0], np.cumsum(swept)])
    return left


def heights(values: Array, low: float, high: float) -> NDArray[np.uint8]:
    """Colours (k, 3) for heights (k,), from dim blue to pale sand."""
    anchors = np.array([(44, 62, 110), (92, 105, 138), (150, 150, 140), (226, 208, 150)], dtype=float)
    place = np.clip((values - low) / max(high - low, 1e-9), 0.0, 1.0) * (len(anchors) - 1)
    grid = np.arange(len(anchors))
    mixed = np.stack([np.interp(place, grid, anchors[:, c]) for c in range(3)], axis=1)
    colors: NDArray[np.uint8] = np.rint(mixed).astype(np.uint8)
    return colors


def packed(colors: NDArray[np.uint8] | Sequence[Color]) -> NDArray[np.uint32]:
    """Colours (k, 3) as 0xRRGGBBAA (k,), opaque; Rerun takes these without converting one by one."""
    rgb = np.asarray(colors, dtype=np.uint32).reshape(-1, 3)
    return rgb @ np.array([1 << 24, 1 << 16, 1 << 8], np.uint32) + np.uint32(255)


def ways(path_integral: PathIntegral, estimate: Estimate, names: Mapping[int, str]) -> dict[str, Array]:
    """Per class the mean of its samples that arrived, by weight, at equal shares of their time, (POINTS, 2) [m].

    Where that mean touches something or passes it on another side than its samples do, it is the sample nearest to it.

    Args:
        names: classes to look at, by additive key.
    """
    paths = estimate.rollouts.paths
    arrived = (paths.outcome == Outcome.GOAL) & (estimate.weight > 0.0)
    groups = {key: _heaviest(np.flatnonzero(arrived & (paths.key == key)), estimate.weight) for key in names}
    groups = {key: group for key, group in groups.items() if len(group)}
    if not groups:
        return {}
    lines = _lines(path_integral, estimate, np.concatenate([*groups.values()]))
    found, first = {}, 0
    for key, group in groups.items():
        mine = lines[first : first + len(group)]
        first += len(group)
        mean = np.average(mine, axis=0, weights=estimate.weight[group])
        order = np.argsort(np.abs(mine - mean).max(axis=(1, 2)), kind="stable")
        candidates = [mean, *mine[order[:TRIED]]]
        fit = (line for line in candidates if _belongs(path_integral.space, line, key))
        found[names[key]] = next(fit, mine[order[0]])
    return found


def _heaviest(group: Indices, weight: Array) -> Indices:
    return group[np.argsort(-weight[group], kind="stable")[:MOST]]


def _lines(path_integral: PathIntegral, estimate: Estimate, chosen: Indices) -> Array:
    """Paths of chosen samples (c,) at equal shares of their time, (c, POINTS, 2) [m]."""
    states, steps = path_integral.replay.trace(estimate.rollouts, chosen)
    times = estimate.rollouts.tables.times
    share = np.linspace(0.0, 1.0, POINTS)
    return np.stack(
        [
            np.column_stack([np.interp(share * times[k], times[: k + 1], line[: k + 1, i]) for i in (0, 1)])
            for line, k in zip(states, steps, strict=True)
        ]
    )


def _belongs(space: FreeSpace, line: Array, key: int) -> bool:
    """Return whether a line (k, 2) [m] is free and of the class with that key, as far as that is about what stands."""
    if not space.collision.segments_free(line[:-1], line[1:]).all():
        return False
    homology = space.homology
    return bool(space.scene.movers) or homology.key(homology.winding(line)) == key


def _edge_turns_around(graph: Graph, obstacle: int) -> NDArray[np.int64]:
    """Whole turns (E,) [turns] that prepending each edge adds around one obstacle (an index); 0 in spare room."""
    used = int(graph.size[4])
    found = np.flatnonzero(graph.edge_marker[:used] == obstacle)
    turns = np.zeros(len(graph.tail), dtype=np.int64)
    turns[np.searchsorted(graph.edge_first[: graph.size[1] + 1], found, side="right") - 1] = graph.edge_turn[found]
    return turns


def _node_turns_around(
    graph: Graph, vertex: NDArray[np.int64], slot: NDArray[np.int64], obstacle: int
) -> NDArray[np.int64]:
    """The integers (k,) [turns] that the classes of nodes, vertex (k,) and slot (k,), have around one obstacle."""
    known = np.arange(graph.marker.shape[2]) < graph.pairs[vertex, slot][:, None]
    match = known & (graph.marker[vertex, slot] == obstacle)
    turns: NDArray[np.int64] = np.sum(graph.turn[vertex, slot] * match, axis=1, dtype=np.int64)
    return turns
