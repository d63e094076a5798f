"""Shares and means of a sweep's runs with intervals, and methods compared on equal seeds."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.settings import METHODS
from pirrht.errors import OptionError
from sim.report.statistics import Interval, holm, mcnemar, mean, paired_shares, sign_flips, wilson
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
    least_p: float  # the adjusted p-value if all pairs of the comparison that has most differed, all of them one way
    findings: list[str]

    def json(self) -> dict[str, Any]:
        """The report as plain values."""
        values = asdict(self)
        return values | {"sweep": values.pop("manifest")}


def report(dataset: Dataset) -> Report:
    """Sum up what a sweep has finished so far.

    Raises:
        OptionError: the folder holds no sweep, or rows that no sweep wrote: figures of them would mean nothing.
    """
    manifest, records = dataset.manifest(), dataset.records()
    for r in (r for r in records if r["outcome"] is not None):
        wrong = [] if r["outcome"] in OUTCOMES else ["outcome"]
        wrong += [name for name in ("cost", "path_length", "time") if r[name] is None or not isfinite(r[name])]
        if wrong:
            run = f"{r['scene']}, b = {r['noise']}, {r['method']}, seed {r['seed']}"
            remedy = "remove its part-*.parquet, and its runs are made again"
            raise OptionError(f"{dataset.runs}: the run {run} has no usable {wrong[0]}; {remedy}")
    points, comparisons = summed(records)
    questions = sum(len(_questions(c)) for c in comparisons)
    most = max((c.pairs for c in comparisons), default=0)
    return Report(
        name=dataset.folder.resolve().name,
        manifest=manifest,
        asked=wished(manifest["asked"]),
        found=len(records),
        errors=dict(Counter(r["error"] for r in records if r["outcome"] is None).most_common()),
        points=points,
        comparisons=comparisons,
        questions=questions,
        least_p=min(1.0, max(1, questions) * mcnemar(most, 0)),
        findings=_findings(comparisons),
    )


def summed(records: Iterable[Record]) -> tuple[list[Point], list[Comparison]]:
    """Return figures of every scene, noise level and method, and methods compared on equal seeds."""
    groups: dict[Key, list[Record]] = {}
    apart = sorted(records, key=_order)
    for r in apart:
        groups.setdefault((r["scene"], r["noise"], r["method"]), []).append(r)
    if len({scene for scene, _, _ in groups}) > 1:
        for r in sorted(apart, key=lambda r: _order(r)[1:]):
            groups.setdefault((ALL, r["noise"], r["method"]), []).append(r)
    compared = [_comparison(key, groups) for key in groups if key[2] != BASE and (*key[:2], BASE) in groups]
    asked = [(i, name, getattr(c, f"{name}_p")) for i, c in enumerate(compared) for name in _questions(c)]
    for (i, name, _), p in zip(asked, holm([p for _, _, p in asked]), strict=True):
        change: dict[str, Any] = {f"{name}_adjusted": p}
        compared[i] = replace(compared[i], **change)
    return [_point(key, groups) for key in groups], compared


def _order(record: Record) -> tuple[Any, ...]:
    rank = [*METHODS, record["method"]].index(record["method"])
    return record["scene"], record["noise"], rank, record["method"], record["seed"]


def _questions(c: Comparison) -> list[str]:
    """List the questions that its pairs could answer."""
    return [name for name, pairs in (("success", c.pairs), ("cost", c.arrived)) if pairs]


def _point(key: Key, groups: Mapping[Key, Sequence[Record]]) -> Point:
    scene, noise, method = key
    runs = [r for r in groups[key] if r["outcome"] is not None]
    arrived = [r for r in runs if r["outcome"] == "goal"]
    classes = Counter(r["executed_class"] for r in arrived) if scene != ALL else Counter[str]()

    def share(outcome: str) -> Interval:
        return wilson(sum(r["outcome"] == outcome for r in runs), len(runs))

    def average(among: Iterable[Record], of: Callable[[Record], float | None]) -> Interval:
        return mean([value for value in map(of, among) if value is not None and isfinite(value)])

    return Point(
        scene=scene,
        noise=noise,
        method=method,
        runs=len(runs),
        arrived=len(arrived),
        errors=len(groups[key]) - len(runs),
        success=share("goal"),
        collision=share("collision"),
        timeout=share("timeout"),
        cost=average(arrived, lambda r: r["cost"]),
        cost_over_optimal=mean(*_costs(_pairs(runs, groups.get((scene, noise, BEST), ())))),
        path_length=average(arrived, lambda r: r["path_length"]),
        time=average(arrived, lambda r: r["time"]),
        classes={str(name): wilson(count, len(arrived)) for name, count in classes.most_common()},
        class_switches=average(runs, lambda r: r["class_switches"]),
        class_reversals=average(runs, lambda r: r["class_reversals"]),
        step_ms=average(runs, lambda r: r["step_ms"]["median"]),
        step_p95_ms=average(runs, lambda r: r["step_ms"]["p95"]),
    )


def _comparison(key: Key, groups: Mapping[Key, Sequence[Record]]) -> Comparison:
    scene, noise, method = key
    pairs = _pairs(groups[key], groups[scene, noise, BASE])
    ends = Counter((a["outcome"] == "goal", b["outcome"] == "goal") for a, b in pairs)
    gained, lost = ends[True, False], ends[False, True]
    costs, base_costs = _costs(pairs)
    return Comparison(
        scene=scene,
        noise=noise,
        method=method,
        pairs=len(pairs),
        gained=gained,
        lost=lost,
        success=paired_shares(gained, lost, len(pairs)),
        success_p=mcnemar(gained, lost),
        arrived=len(costs),
        cost=mean(costs - base_costs),
        cost_p=sign_flips(costs - base_costs),
    )


def _pairs(runs: Iterable[Record], others: Iterable[Record]) -> list[tuple[Record, Record]]:
    """Runs of equal scene and seed that came to an end."""
    known = {(r["scene"], r["seed"]): r for r in others if r["outcome"] is not None}
    ended = [r for r in runs if r["outcome"] is not None]
    return [(r, known[r["scene"], r["seed"]]) for r in ended if (r["scene"], r["seed"]) in known]


def _costs(pairs: Iterable[tuple[Record, Record]]) -> Array:
    """Costs (2, k) of the pairs of which both reached the goal."""
    return (
        np.array([(a["cost"], b["cost"]) for a, b in pairs if a["outcome"] == b["outcome"] == "goal"]).reshape(-1, 2).T
    )


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
