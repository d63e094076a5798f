"""A sweep in a few lines on a terminal, as it ends: one per scene, noise level and method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sim.drawing.colors import title
from sim.report.comparisons import BASE, Key, Record, extra_costs, pairs_of
from sim.text import table

_FIRST = ("scene", "b", "method", "runs", "goal", "collision", "timeout")
_LAST = ("time [s]", "path/shortest", "switches", "reversals", "ms/step", "plan [s]", "classes")
_OVER = f"over {BASE}"  # of seeds that reach the goal by both: means of different seeds do not compare


def summary(rows: Sequence[Record], room: int | None = None) -> str:
    """A table with one line per scene, noise and method; a path is held against the shortest reference."""
    points: dict[Key, list[Record]] = {}
    for row in rows:
        points.setdefault((row["scene"], row["noise"], row["method"]), []).append(row)
    failed = any(row["outcome"] is None for row in rows)
    over = {point: _over(point, points) for point in points}
    paired = any(over.values())
    header = [*_FIRST, *(["error"] if failed else []), "cost", *([_OVER] if paired else []), *_LAST]
    lines = [
        _line(point, everyone, failed, [over[point] or "-"] if paired else []) for point, everyone in points.items()
    ]
    return table(header, lines, room, keep=3)


def _over(point: Key, points: Mapping[Key, Sequence[Record]]) -> str:
    """What a method's drives cost more than those of `BASE` with the same noise; empty without such pairs."""
    scene, noise, method = point
    if method == BASE:
        return ""
    off = extra_costs(pairs_of(points[point], points.get((scene, noise, BASE), ())))
    return f"{np.mean(off):+.3f}" if off else ""


def _line(point: Key, everyone: Sequence[Record], failed: bool, over: Sequence[str]) -> list[str]:
    scene, noise, method = point
    group = [r for r in everyone if r["outcome"] is not None]
    arrived = [r for r in group if r["outcome"] == "goal"]
    ends = [sum(r["outcome"] == name for r in group) for name in ("goal", "collision", "timeout")]
    return [
        *(scene, f"{noise:g}", method, str(len(everyone))),
        *map(str, ends),
        *([str(len(everyone) - len(group))] if failed else []),
        _mean([r["cost"] for r in arrived]),
        *over,
        _mean([r["time"] for r in arrived]),
        _mean([r["path_length"] / r["shortest_length"] for r in arrived if r["shortest_length"]]),
        _mean([r["class_switches"] for r in group], 2),
        _mean([r["class_reversals"] for r in group], 2),
        _mean([np.median([r["step_ms"]["median"] for r in group])] if group else [], 1),
        _mean([r["plan_seconds"] for r in group if r["plan_seconds"] is not None]),
        _shares([r["executed_class"] for r in arrived]),
    ]


def _mean(values: Sequence[float], digits: int = 3) -> str:
    return f"{np.mean(values):.{digits}f}" if values else "-"


def _shares(ids: Sequence[str]) -> str:
    if not ids:
        return "-"
    names, counts = np.unique(ids, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return ", ".join(f"{title(str(names[i]))}: {counts[i] / len(ids):.0%}" for i in order[:4])
