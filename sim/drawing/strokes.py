"""Lines to be drawn: sampled paths by class and their averages, references, the tree lifted by the paper's H."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.estimation.estimate import OTHER, Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.outcome import Outcome
from pirrht.planner.graph import ROOT
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.topology.homology import Homology
from sim.drawing.colors import Color

Floats = NDArray[np.float32]
Indices = NDArray[np.int64]
DEAD = "dead"
MOST, POINTS = 24, 32  # samples of a mean path, the heaviest of a class, and its points


def at_most(points: Array, count: int) -> Array:
    """A polyline (k, d) thinned out to at most `count` points, ends included."""
    if len(points) <= count:
        return points
    return points[np.rint(np.linspace(0, len(points) - 1, count)).astype(np.int64)]


def timed(reference: Reference, now: float) -> Array:
    """The path of a reference of a plan made at a time [s], (k, 3) [m, m, s]; without times of its own at even pace."""
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
    alive = paths.outcome == Outcome.GOAL
    groups = {name: alive & (paths.key == k) for k, name in names.items()}
    groups |= {OTHER: alive & ~np.isin(paths.key, list(names)), DEAD: ~alive}
    members = {name: np.flatnonzero(mask) for name, mask in groups.items() if mask.any()}
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


def tree_edges(tree: HomologyTree, obstacle: int, most: int) -> Array:
    """Edges from nodes to their parents with the paper's H of one obstacle as third coordinate.

    Args:
        most: so many at most.

    Returns:
        ends (k, 2, 3) [m, m, turns] with k at most `most`.
    """
    graph, size = tree.graph, tree.size
    width = graph.parent.shape[1]
    live = np.arange(width) < graph.nodes[:size, None]
    vertex, slot = np.nonzero(live & (graph.parent[:size] != ROOT))
    if len(vertex) > most:
        keep = np.linspace(0, len(vertex) - 1, most).astype(np.int64)
        vertex, slot = vertex[keep], slot[keep]
    edge = graph.parent[vertex, slot]
    head = graph.head[edge]
    ends = np.empty((len(vertex), 2, 3))
    ends[:, 0, :2], ends[:, 1, :2] = tree.states[vertex, :2], tree.states[head, :2]
    used = np.arange(graph.marker.shape[2]) < graph.pairs[vertex, slot][:, None]
    turns = np.sum(graph.turn[vertex, slot] * (used & (graph.marker[vertex, slot] == obstacle)), axis=1, dtype=float)
    added = np.zeros(len(graph.tail))  # by prepending each edge [turns]
    around = np.flatnonzero(graph.edge_marker[: int(graph.size[4])] == obstacle)
    added[np.searchsorted(graph.edge_first[: graph.size[1] + 1], around, side="right") - 1] = graph.edge_turn[around]
    ends[:, 0, 2] = 1.0 + graph.straight[vertex, obstacle] + turns
    ends[:, 1, 2] = 1.0 + graph.straight[head, obstacle] + turns - added[edge]
    return ends


def remaining(homology: Homology, reference: Reference, line: Array, obstacle: int) -> Array:
    """The paper's H [turns] of what is left of a reference at each point of its line (k, 2), (k,)."""
    away = line - homology.markers[obstacle]
    cross = away[:-1, 0] * away[1:, 1] - away[:-1, 1] * away[1:, 0]
    swept = np.arctan2(cross, np.sum(away[:-1] * away[1:], axis=1)) / (2.0 * np.pi)
    left: Array = reference.signature[obstacle] - np.concatenate([[0.0], np.cumsum(swept)])
    return left


def packed(colors: NDArray[np.uint8] | Sequence[Color]) -> NDArray[np.uint32]:
    """Colours (k, 3) as 0xRRGGBBAA (k,), opaque; Rerun takes these without converting one by one."""
    rgb = np.asarray(colors, dtype=np.uint32).reshape(-1, 3)
    return rgb @ np.array([1 << 24, 1 << 16, 1 << 8], np.uint32) + np.uint32(255)


def mean_paths(path_integral: PathIntegral, estimate: Estimate, names: Mapping[int, str]) -> dict[str, Array]:
    """Per class the weighted mean of its heaviest samples at equal shares of their time, (POINTS, 2) [m].

    If it touches something, the sample nearest to it.

    Args:
        names: of the classes, by additive key.
    """
    paths, found = estimate.rollouts.paths, {}
    arrived, share = (paths.outcome == Outcome.GOAL) & (estimate.weight > 0.0), np.linspace(0.0, 1.0, POINTS)
    for key, name in names.items():
        group = np.flatnonzero(arrived & (paths.key == key))
        group = group[np.argsort(-estimate.weight[group], kind="stable")[:MOST]]
        if len(group):
            states, steps = path_integral.replay.trace(estimate.rollouts, group)
            times = estimate.rollouts.tables.times
            lines = np.array([
                [np.interp(share * times[k], times[: k + 1], line[: k + 1, i]) for i in (0, 1)]
                for line, k in zip(states, steps, strict=True)
            ]).transpose(0, 2, 1)  # fmt: skip
            mean = np.average(lines, axis=0, weights=estimate.weight[group])
            free = path_integral.space.collision.segments_free(mean[:-1], mean[1:]).all()
            found[name] = mean if free else lines[int(np.argmin(np.abs(lines - mean).max(axis=(1, 2))))]
    return found
