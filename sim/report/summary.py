"""Shares and means of a sweep's runs with intervals, and methods compared on equal seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from pirrht.control.settings import METHODS
from pirrht.errors import OptionError
from sim.report.statistics import Interval, holm, mcnemar, mean, paired_shares, ratio, sign_flips, wilson
from sim.sweeps.dataset import Dataset, wished
from sim.text import counted

BASE = "pi-rrht"  # what other methods are compared with
LEVEL = 0.05
BEST = "optimal"  # what costs are held against
ALL = "all scenes"
OUTCOMES = ("goal", "collision", "timeout")

Record = Mapping[str, Any]
Key = tuple[str, float, str]  # scene, noise, method


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """The runs of one scene, noise level and method."""

    scene: str  # `ALL` for those of all scenes together
    noise: float
    method: str
    runs: int  # those that came to an end
    arrived: int  # those that reached the goal
    errors: int  # those that did not; they count nowhere else
    success: Interval
    collision: Interval
    timeout: Interval
    cost: Interval  # of those that arrived, like the next three
    cost_over_optimal: Interval  # ratio of means over seeds that reached the goal by both
    path_length: Interval  # [m]
    time: Interval  # [s]
    classes: dict[str, Interval]  # shares of the driven classes among runs that reached the goal, largest first
    class_switches: Interval  # per run
    class_reversals: Interval  # per run
    step_ms: Interval  # mean over runs of the median
    step_p95_ms: Interval  # mean over runs of the 95th percentile


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A method against `BASE` on the seeds that both have come to an end with."""

    scene: str
    noise: float
    method: str
    pairs: int
    gained: int  # pairs of which only the method's reached the goal
    lost: int  # only that of `BASE`
    success: Interval  # difference of the shares
    success_p: float  # McNemar, exact
    arrived: int  # pairs of which both reached the goal
    cost: Interval  # mean difference of their costs
    cost_p: float  # by flipping signs
    success_adjusted: float = 1.0  # for all findings of the report
    cost_adjusted: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """All figures of a sweep, and the runs behind them."""

    name: str
    manifest: Mapping[str, Any]
    asked: int  # runs
    found: int
    errors: dict[str, int]  # how many runs ended with each
    points: list[Point]
    comparisons: list[Comparison]
    questions: int  # that the comparisons could answer
    least_p: float  # the smallest adjusted p-value that so many pairs and questions allow
    findings: list[str]

    @property
    def scenes(self) -> list[str]:
        """Names, all of them together last if there are several."""
        return list(dict.fromkeys(point.scene for point in self.points))

    def json(self) -> dict[str, Any]:
        """The report as plain values."""
        values = asdict(self)
        return values | {"sweep": values.pop("manifest")}


def report(dataset: Dataset) -> Report:
    """Sum up what a sweep has finished so far.

    Raises:
        OptionError: the folder holds no sweep, or rows that no sweep wrote.
    """
    manifest = dataset.manifest()
    records = dataset.records()
    _check(records, dataset)
    points, comparisons = summed(records)
    return Report(
        name=dataset.folder.resolve().name,
        manifest=manifest,
        asked=wished(manifest["asked"]),
        found=len(records),
        errors=dict(Counter(r["error"] for r in records if r["outcome"] is None).most_common()),
        points=points,
        comparisons=comparisons,
        questions=sum(len(questions(c)) for c in comparisons),
        least_p=least(comparisons),
        findings=_findings(comparisons),
    )


def summed(records: Sequence[Record]) -> tuple[list[Point], list[Comparison]]:
    """Return figures of every scene, noise level and method, and methods compared on equal seeds."""
    wanted = [(key, by) for by in _groupings(sorted(records, key=_order)) for key in by]
    comparisons = [c for c in (comparison(key, by) for key, by in wanted) if c is not None]
    return [_point(key, by[key], by) for key, by in wanted], adjusted(comparisons)


def _order(record: Record) -> tuple[Any, ...]:
    rank = [*METHODS, record["method"]].index(record["method"])
    return record["scene"], record["noise"], rank, record["method"], record["seed"]


def _check(records: Sequence[Record], dataset: Dataset) -> None:
    """Refuse rows that no sweep wrote: figures of them would mean nothing.

    Raises:
        OptionError: names the folder, the run and what is wrong with it.
    """
    for r in records:
        if r["outcome"] is None:
            continue
        wrong = ["outcome"] if r["outcome"] not in OUTCOMES else []
        wrong += [name for name in ("cost", "path_length", "time") if r[name] is None or not isfinite(r[name])]
        if wrong:
            run = f"{r['scene']}, b = {r['noise']}, {r['method']}, seed {r['seed']}"
            raise OptionError(
                f"{dataset.runs}: the run {run} has no usable {wrong[0]}; remove its part-*.parquet, and its runs are "
                "made again"
            )


def _groupings(records: Sequence[Record]) -> list[dict[Key, list[Record]]]:
    """Runs by point; and if there are several scenes, by noise and method alone."""
    apart: dict[Key, list[Record]] = {}
    together: dict[Key, list[Record]] = {}
    for r in records:
        apart.setdefault((r["scene"], r["noise"], r["method"]), []).append(r)
    for r in sorted(records, key=lambda r: _order({**r, "scene": ALL})):
        together.setdefault((ALL, r["noise"], r["method"]), []).append(r)
    return [apart, together] if len({scene for scene, _, _ in apart}) > 1 else [apart]


def _point(key: Key, everyone: Sequence[Record], groups: Mapping[Key, Sequence[Record]]) -> Point:
    scene, noise, method = key
    runs = [r for r in everyone if r["outcome"] is not None]
    arrived = [r for r in runs if r["outcome"] == "goal"]
    classes = Counter(r["executed_class"] for r in arrived) if scene != ALL else Counter[str]()
    best = costs_of(pairs_of(runs, groups.get((scene, noise, BEST), ())))

    def share(outcome: str) -> Interval:
        return wilson(sum(r["outcome"] == outcome for r in runs), len(runs))

    return Point(
        scene=scene,
        noise=noise,
        method=method,
        runs=len(runs),
        arrived=len(arrived),
        errors=len(everyone) - len(runs),
        success=share("goal"),
        collision=share("collision"),
        timeout=share("timeout"),
        cost=mean([r["cost"] for r in arrived]),
        cost_over_optimal=ratio(*best.T),
        path_length=mean([r["path_length"] for r in arrived]),
        time=mean([r["time"] for r in arrived]),
        classes={str(name): wilson(count, len(arrived)) for name, count in classes.most_common()},
        class_switches=mean(_known(r["class_switches"] for r in runs)),
        class_reversals=mean(_known(r["class_reversals"] for r in runs)),
        step_ms=mean(_known(r["step_ms"]["median"] for r in runs)),
        step_p95_ms=mean(_known(r["step_ms"]["p95"] for r in runs)),
    )


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None and isfinite(value)]


def comparison(key: Key, groups: Mapping[Key, Sequence[Record]]) -> Comparison | None:
    """A method's runs against those of `BASE`; None if that is the method, or has no runs there."""
    scene, noise, method = key
    base = groups.get((scene, noise, BASE))
    if method == BASE or base is None:
        return None
    pairs = pairs_of(groups[key], base)
    ends = Counter((a["outcome"] == "goal", b["outcome"] == "goal") for a, b in pairs)
    gained, lost = ends[True, False], ends[False, True]
    costs = costs_of(pairs)
    off = costs[:, 0] - costs[:, 1]
    return Comparison(
        scene=scene,
        noise=noise,
        method=method,
        pairs=len(pairs),
        gained=gained,
        lost=lost,
        success=paired_shares(gained, lost, len(pairs)),
        success_p=mcnemar(gained, lost),
        arrived=len(off),
        cost=mean(off),
        cost_p=sign_flips(off),
    )


def pairs_of(runs: Iterable[Record], others: Iterable[Record]) -> list[tuple[Record, Record]]:
    """Runs of equal scene and seed that came to an end."""
    known = {(r["scene"], r["seed"]): r for r in others if r["outcome"] is not None}
    ended = [r for r in runs if r["outcome"] is not None]
    return [(r, known[r["scene"], r["seed"]]) for r in ended if (r["scene"], r["seed"]) in known]


def costs_of(pairs: Iterable[tuple[Record, Record]]) -> np.ndarray[Any, Any]:
    """Costs (k, 2) of the pairs of which both reached the goal."""
    return np.array([(a["cost"], b["cost"]) for a, b in pairs if a["outcome"] == b["outcome"] == "goal"]).reshape(-1, 2)


def adjusted(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """p-values adjusted for the number of questions that there are pairs for."""
    asked = [(i, name) for i, c in enumerate(comparisons) for name in questions(c)]
    values = holm([getattr(comparisons[i], f"{name}_p") for i, name in asked])
    changes: list[dict[str, Any]] = [{} for _ in comparisons]
    for (i, name), value in zip(asked, values, strict=True):
        changes[i][f"{name}_adjusted"] = value
    return [replace(c, **change) for c, change in zip(comparisons, changes, strict=True)]


def questions(c: Comparison) -> list[str]:
    """List the questions that its pairs could answer: success, cost."""
    return [name for name, pairs in (("success", c.pairs), ("cost", c.arrived)) if pairs]


def least(comparisons: Sequence[Comparison]) -> float:
    """The adjusted p-value if all pairs of the comparison that has most differed, all of them one way.

    Flips of signs, of which there are no more pairs, reach no smaller one.
    """
    number = sum(len(questions(c)) for c in comparisons)
    return min(1.0, max(1, number) * mcnemar(max((c.pairs for c in comparisons), default=0), 0))


def pairs_needed(asked: int) -> int:
    """The fewest pairs with which one of so many questions can come out significant."""
    pairs = 1
    while asked * mcnemar(pairs, 0) >= LEVEL:
        pairs += 1
    return pairs


def _findings(comparisons: Sequence[Comparison]) -> list[str]:
    """Put significant differences into words; empty if there are none."""
    lines = []
    for c in comparisons:
        where = f"{c.scene}, b = {c.noise:g}: {c.method}"
        often, costs = ("more" if value.value > 0 else "less" for value in (c.success, c.cost))
        if c.success_adjusted < LEVEL:
            lines.append(
                f"{where} reaches the goal {often} often than {BASE}, by {100 * abs(c.success.value):.1f} points "
                f"({counted(c.gained, 'seed')} gained, {c.lost} lost; adjusted p = {p_value(c.success_adjusted)})"
            )
        if c.cost_adjusted < LEVEL:
            lines.append(
                f"{where} costs {costs} than {BASE} where both arrive, by {abs(c.cost.value):.3f} "
                f"({counted(c.arrived, 'seed')}; adjusted p = {p_value(c.cost_adjusted)})"
            )
    return lines


def p_value(p: float) -> str:
    """A p-value for people."""
    return f"{p:.3f}" if p >= 0.001 else f"{p:.1e}" if p >= 1e-12 else "< 1e-12"
