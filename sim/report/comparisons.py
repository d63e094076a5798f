"""Methods compared on the seeds that both have come to an end with, and what that says given how often one asks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sim.report.statistics import Interval, holm, mcnemar, mean, paired_shares, sign_flips

BASE = "pi-rrht"  # what other methods are compared with
LEVEL = 0.05

Record = Mapping[str, Any]
Key = tuple[str, float, str]  # scene, noise, method


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


def comparison(key: Key, groups: Mapping[Key, Sequence[Record]]) -> Comparison | None:
    """A method's runs against those of `BASE`; None if that is the method, or has no runs there."""
    scene, noise, method = key
    base = groups.get((scene, noise, BASE))
    if method == BASE or base is None:
        return None
    pairs = pairs_of(groups[key], base)
    ends = Counter((a["outcome"] == "goal", b["outcome"] == "goal") for a, b in pairs)
    gained, lost = ends[True, False], ends[False, True]
    off = extra_costs(pairs)
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


def extra_costs(pairs: Iterable[tuple[Record, Record]]) -> list[float]:
    """Subtract the second run's cost from the first's, for pairs of which both reached the goal."""
    return [a["cost"] - b["cost"] for a, b in pairs if both_arrive(a, b)]


def both_arrive(a: Record, b: Record) -> bool:
    """Return whether two runs reached the goal."""
    return bool(a["outcome"] == b["outcome"] == "goal")


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
