"""What a sweep's runs say: shares and means with intervals, and methods compared on equal seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pirrht.control.methods import METHODS
from sim.report.statistics import Interval, holm, mcnemar, mean, paired_shares, ratio, sign_flips, wilson
from sim.sweeps.dataset import Dataset, wished
from sim.text import counted

BASE = "pi-rrht"  # what other methods are compared with
BEST = "optimal"  # what costs are held against
ALL = "all scenes"
LEVEL = 0.05

Record = Mapping[str, Any]


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
    success_adjusted: float  # for all findings of the report
    arrived: int  # pairs of which both reached the goal
    cost: Interval  # mean difference of their costs
    cost_p: float  # by flipping signs
    cost_adjusted: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Everything that is told of a sweep."""

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
        told = asdict(self)
        return {name: told[name] for name in told if name != "manifest"} | {"sweep": dict(self.manifest)}


def report(dataset: Dataset) -> Report:
    """Sum up what a sweep has finished so far.

    Raises:
        OptionError: the folder holds no sweep.
    """
    manifest = dataset.manifest()
    records = sorted(dataset.records(), key=_order)
    points = [_point(key, runs, by) for by in _groupings(records) for key, runs in by.items()]
    comparisons = _adjusted([c for by in _groupings(records) for c in _comparisons(by)])
    return Report(
        name=dataset.folder.resolve().name,
        manifest=manifest,
        asked=wished(manifest["asked"]),
        found=len(records),
        errors=dict(Counter(r["error"] for r in records if r["outcome"] is None).most_common()),
        points=points,
        comparisons=comparisons,
        questions=sum(len(_questions(c)) for c in comparisons),
        least_p=_least(comparisons),
        findings=_findings(comparisons),
    )


Key = tuple[str, float, str]


def _order(record: Record) -> tuple[Any, ...]:
    known = list(METHODS)
    rank = known.index(record["method"]) if record["method"] in known else len(known)
    return record["scene"], record["noise"], rank, record["method"], record["seed"]


def _groupings(records: Sequence[Record]) -> list[dict[Key, list[Record]]]:
    """Runs by point; and if there are several scenes, by noise and method alone."""
    apart: dict[Key, list[Record]] = {}
    together: dict[Key, list[Record]] = {}
    for r in records:
        apart.setdefault((r["scene"], r["noise"], r["method"]), []).append(r)
    for r in sorted(records, key=lambda r: _order({**r, "scene": ALL})):
        together.setdefault((ALL, r["noise"], r["method"]), []).append(r)
    return [apart, together] if len({r["scene"] for r in records}) > 1 else [apart]


def _point(key: Key, everyone: Sequence[Record], groups: Mapping[Key, Sequence[Record]]) -> Point:
    scene, noise, method = key
    runs = [r for r in everyone if r["outcome"] is not None]
    arrived = [r for r in runs if r["outcome"] == "goal"]
    classes = Counter(r["executed_class"] for r in arrived) if scene != ALL else Counter[str]()
    best = [(r["cost"], b["cost"]) for r, b in _pairs(runs, groups.get((scene, noise, BEST), ())) if _both(r, b)]

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
        cost_over_optimal=ratio(*np.array(best).reshape(-1, 2).T),
        path_length=mean([r["path_length"] for r in arrived]),
        time=mean([r["time"] for r in arrived]),
        classes={str(name): wilson(count, len(arrived)) for name, count in classes.most_common()},
        class_switches=mean([r["class_switches"] for r in runs]),
        step_ms=mean([r["step_ms"]["median"] for r in runs]),
        step_p95_ms=mean([r["step_ms"]["p95"] for r in runs]),
    )


def _comparisons(groups: Mapping[Key, Sequence[Record]]) -> Iterable[Comparison]:
    for (scene, noise, method), runs in groups.items():
        base = groups.get((scene, noise, BASE))
        if method == BASE or base is None:
            continue
        pairs = _pairs(runs, base)
        ends = Counter((a["outcome"] == "goal", b["outcome"] == "goal") for a, b in pairs)
        gained, lost = ends[True, False], ends[False, True]
        off = [a["cost"] - b["cost"] for a, b in pairs if _both(a, b)]
        yield Comparison(
            scene=scene,
            noise=noise,
            method=method,
            pairs=len(pairs),
            gained=gained,
            lost=lost,
            success=paired_shares(gained, lost, len(pairs)),
            success_p=mcnemar(gained, lost),
            success_adjusted=1.0,
            arrived=len(off),
            cost=mean(off),
            cost_p=sign_flips(off),
            cost_adjusted=1.0,
        )


def _pairs(runs: Iterable[Record], others: Iterable[Record]) -> list[tuple[Record, Record]]:
    """Runs of equal scene and seed that came to an end."""
    known = {(r["scene"], r["seed"]): r for r in others if r["outcome"] is not None}
    ended = [r for r in runs if r["outcome"] is not None]
    return [(r, known[r["scene"], r["seed"]]) for r in ended if (r["scene"], r["seed"]) in known]


def _both(a: Record, b: Record) -> bool:
    return bool(a["outcome"] == b["outcome"] == "goal")


def _adjusted(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """p-values adjusted for the number of questions that there are pairs for."""
    asked = [(i, name) for i, c in enumerate(comparisons) for name in _questions(c)]
    p = holm([getattr(comparisons[i], f"{name}_p") for i, name in asked])
    changes: list[dict[str, Any]] = [{} for _ in comparisons]
    for (i, name), adjusted in zip(asked, p, strict=True):
        changes[i][f"{name}_adjusted"] = adjusted
    return [replace(c, **change) for c, change in zip(comparisons, changes, strict=True)]


def _questions(c: Comparison) -> list[str]:
    return [name for name, pairs in (("success", c.pairs), ("cost", c.arrived)) if pairs]


def _least(comparisons: Sequence[Comparison]) -> float:
    """The adjusted p-value if all pairs of the comparison that has most differed, all of them one way.

    Flips of signs, of which there are no more pairs, reach no smaller one.
    """
    questions = sum(len(_questions(c)) for c in comparisons)
    return min(1.0, max(1, questions) * mcnemar(max((c.pairs for c in comparisons), default=0), 0))


def pairs_needed(questions: int) -> int:
    """The fewest pairs with which one of so many questions can come out significant."""
    pairs = 1
    while questions * mcnemar(pairs, 0) >= LEVEL:
        pairs += 1
    return pairs


def _findings(comparisons: Sequence[Comparison]) -> list[str]:
    """What is significant, in words; and if nothing is, that."""
    told = []
    for c in comparisons:
        where = f"{c.scene}, b = {c.noise:g}: {c.method}"
        if c.success_adjusted < LEVEL:
            word = "more" if c.success.value > 0 else "less"
            told.append(
                f"{where} reaches the goal {word} often than {BASE}, by {100 * abs(c.success.value):.1f} points "
                f"({counted(c.gained, 'seed')} gained, {c.lost} lost; adjusted p = {p_value(c.success_adjusted)})"
            )
        if c.cost_adjusted < LEVEL:
            word = "more" if c.cost.value > 0 else "less"
            told.append(
                f"{where} costs {word} than {BASE} where both arrive, by {abs(c.cost.value):.3f} "
                f"({counted(c.arrived, 'seed')}; adjusted p = {p_value(c.cost_adjusted)})"
            )
    return told


def p_value(p: float) -> str:
    """A p-value for people."""
    return f"{p:.3f}" if p >= 0.001 else f"{p:.1e}" if p >= 1e-12 else "< 1e-12"
