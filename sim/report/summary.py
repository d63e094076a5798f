"""Shares and means of a sweep's runs with intervals, and methods compared on equal seeds, as values of JSON.

SciPy does the work and is imported late, since a report is one command of many.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pirrht.arrays import Array
from pirrht.control.settings import METHODS
from pirrht.errors import OptionError
from sim.sweeps.dataset import Dataset, wished
from sim.text import counted

BASE = "pi-rrht"  # what other methods are compared with
LEVEL = 0.05
BEST = "optimal"  # what costs are held against
ALL = "all scenes"
Z = 1.959963984540054  # of a two-sided 95 % interval
REPEATS = 10_000  # of a bootstrap
DRAWS = 5_000_000  # of all bootstraps of a field, from which on each has fewer repeats
LEAST_REPEATS = 1_000
MOST_POINTS = 5_000  # combinations of scene, noise and method of a report
BLOCK = 4_000_000  # numbers that are drawn at a time
QUESTIONS = {"success": "pairs", "cost": "arrived"}  # of a comparison, and the count of pairs that could answer
MORE = ("less", "more")
KEY = ("scene", "noise", "method")  # of a row
OUTCOMES = {"success": "goal", "collision": "collision", "timeout": "timeout"}

Record = Mapping[str, Any]
Key = tuple[str, float, str]
Row = dict[str, Any]
Interval = dict[str, float]


def _interval(value: float = nan, low: float = nan, high: float = nan) -> Interval:
    """Return an estimate with its 95 % interval; NaN where there is nothing to estimate from."""
    return {"value": float(value), "low": float(low), "high": float(high)}


def report(dataset: Dataset) -> dict[str, Any]:
    """Sum up what a sweep has finished so far; OptionError for a folder without one, or rows that none wrote."""
    manifest = dataset.manifest()
    records = dataset.records()

    for r in (r for r in records if r["outcome"] is not None):
        wrong = [] if r["outcome"] in OUTCOMES.values() else ["outcome"]
        wrong += [name for name in ("cost", "path_length", "time") if r[name] is None or not isfinite(r[name])]
        if wrong:
            run = f"{r['scene']}, b = {r['noise']}, {r['method']}, seed {r['seed']}"
            remedy = "remove its part-*.parquet, and its runs are made again"
            raise OptionError(f"{dataset.runs}: the run {run} has no usable {wrong[0]}; {remedy}")
    combinations = len({tuple(r[name] for name in KEY) for r in records})
    if combinations > MOST_POINTS:
        remedy = f"read the rows themselves, pandas.read_parquet({str(dataset.runs)!r})"
        raise OptionError(
            f"{dataset.folder} has {combinations} combinations of scene, noise and method, and a report at most "
            f"{MOST_POINTS}: {remedy}"
        )
    points, comparisons = summed(records)
    questions = sum(c[pairs] > 0 for c in comparisons for pairs in QUESTIONS.values())
    most = max((c["pairs"] for c in comparisons), default=0)
    return {
        "name": dataset.folder.resolve().name,
        "asked": wished(manifest["asked"]),  # runs
        "found": len(records),
        "errors": dict(Counter(r["error"] for r in records if r["outcome"] is None).most_common()),  # runs by error
        "points": points,
        "comparisons": comparisons,
        "questions": questions,  # that the comparisons could answer
        "least_p": min(1.0, max(1, questions) * mcnemar(most, 0)),  # adjusted, if as many pairs as can be all differed
        "findings": _findings(comparisons),
        "sweep": manifest,
    }


def summed(records: Iterable[Record]) -> tuple[list[Row], list[Row]]:
    """Return figures of every scene, noise level and method, and methods compared with `BASE` on equal seeds."""
    groups = dict[Key, list[Record]]()
    apart = sorted(records, key=_order)
    many = len({r["scene"] for r in apart}) > 1
    together = sorted(apart, key=lambda r: _order(r)[1:]) if many else []
    for scene, r in [*((r["scene"], r) for r in apart), *((ALL, r) for r in together)]:
        groups.setdefault((scene, r["noise"], r["method"]), []).append(r)
    compared = [_comparison(key, groups) for key in groups if key[2] != BASE and (*key[:2], BASE) in groups]
    asked = [(c, name) for c in compared for name, pairs in QUESTIONS.items() if c[pairs]]
    for (c, name), p in zip(asked, holm([c[f"{name}_p"] for c, name in asked]), strict=True):
        c[f"{name}_adjusted"] = p
    repeats = max(LEAST_REPEATS, min(REPEATS, DRAWS // max(1, len(groups))))
    return [_point(key, groups, repeats) for key in groups], compared


def _order(record: Record) -> tuple[Any, ...]:
    rank = [*METHODS, record["method"]].index(record["method"])
    return record["scene"], record["noise"], rank, record["method"], record["seed"]


def _point(key: Key, groups: Mapping[Key, Sequence[Record]], repeats: int) -> Row:
    """Sum up the runs of one scene (or `ALL`), noise level and method."""
    runs = [r for r in groups[key] if r["outcome"] is not None]
    arrived = [r for r in runs if r["outcome"] == "goal"]
    ends = Counter(r["outcome"] for r in runs)
    classes = Counter(r["executed_class"] for r in arrived) if key[0] != ALL else Counter[str]()
    steps = [r["step_ms"] for r in runs]

    def averages(records: Sequence[Record], *names: str) -> dict[str, Interval]:
        """Return the means of fields over the records that have all of them, by one bootstrap."""
        values = np.array([[r[name] for r in records] for name in names], dtype=float)  # None becomes NaN
        return dict(zip(names, means(values[:, np.isfinite(values).all(axis=0)], repeats=repeats), strict=True))

    step = averages(steps, "median", "p95")

    return {
        **dict(zip(KEY, key, strict=True)),
        "runs": len(runs),  # that came to an end
        "arrived": len(arrived),
        "errors": len(groups[key]) - len(runs),  # runs that count nowhere else
        **{name: wilson(ends[end], len(runs)) for name, end in OUTCOMES.items()},
        **averages(arrived, "cost", "path_length", "time"),
        "cost_over_optimal": mean(*_costs(_pairs(runs, groups.get((*key[:2], BEST), ()))), repeats=repeats),
        "classes": {str(name): wilson(count, len(arrived)) for name, count in classes.most_common()},  # driven ones
        **averages(runs, "class_switches", "class_reversals"),
        "step_ms": step["median"],
        "step_p95_ms": step["p95"],
    }


def _comparison(key: Key, groups: Mapping[Key, Sequence[Record]]) -> Row:
    """Compare a method with `BASE` on the seeds that both have come to an end with."""
    pairs = _pairs(groups[key], groups[*key[:2], BASE])
    ends = Counter((a["outcome"] == "goal", b["outcome"] == "goal") for a, b in pairs)
    gained = ends[True, False]
    lost = ends[False, True]
    costs, base_costs = _costs(pairs)
    return {
        **dict(zip(KEY, key, strict=True)),
        "pairs": len(pairs),
        "gained": gained,  # pairs of which only the method's reached the goal
        "lost": lost,  # only that of `BASE`
        "success": paired_shares(gained, lost, len(pairs)),  # difference of the shares
        "success_p": mcnemar(gained, lost),
        "arrived": len(costs),  # pairs of which both reached the goal
        "cost": mean(costs - base_costs),
        "cost_p": sign_flips(costs - base_costs),
        "success_adjusted": 1.0,
        "cost_adjusted": 1.0,
    }


def _pairs(runs: Iterable[Record], others: Iterable[Record]) -> list[tuple[Record, Record]]:
    """Runs of equal scene and seed that came to an end."""
    known = {(r["scene"], r["seed"]): r for r in others if r["outcome"] is not None}
    ended = [r for r in runs if r["outcome"] is not None]
    return [(r, known[r["scene"], r["seed"]]) for r in ended if (r["scene"], r["seed"]) in known]


def _costs(pairs: Iterable[tuple[Record, Record]]) -> Array:
    """Costs (2, k) of the pairs of which both reached the goal."""
    costs = [(a["cost"], b["cost"]) for a, b in pairs if a["outcome"] == b["outcome"] == "goal"]
    return np.array(costs).reshape(-1, 2).T


def _findings(comparisons: Sequence[Row]) -> list[str]:
    """Put significant differences into words; empty if there are none."""
    lines = []
    for c in comparisons:
        where = f"{c['scene']}, b = {c['noise']:g}: {c['method']}"
        success = c["success"]["value"]
        cost = c["cost"]["value"]

        if c["success_adjusted"] < LEVEL:
            lines.append(
                f"{where} reaches the goal {MORE[success > 0]} often than {BASE}, by {100 * abs(success):.1f} points "
                f"({counted(c['gained'], 'seed')} gained, {c['lost']} lost; "
                f"adjusted p = {p_value(c['success_adjusted'])})"
            )
        if c["cost_adjusted"] < LEVEL:
            lines.append(
                f"{where} costs {MORE[cost > 0]} than {BASE} where both arrive, by {abs(cost):.3f} "
                f"({counted(c['arrived'], 'seed')}; adjusted p = {p_value(c['cost_adjusted'])})"
            )
    return lines


def p_value(p: float) -> str:
    """A p-value for people."""
    return f"{p:.3f}" if p >= 0.001 else f"{p:.1e}" if p >= 1e-12 else "< 1e-12"


def wilson(successes: int, runs: int) -> Interval:
    """A share with Wilson's score interval (Wilson 1927)."""
    from scipy.stats import binomtest

    if runs == 0:
        return _interval()
    known = binomtest(successes, runs).proportion_ci(method="wilson")
    return _interval(successes / runs, known.low, known.high)


def mean(values: ArrayLike, over: ArrayLike | None = None, *, repeats: int = REPEATS) -> Interval:
    """A mean over independent runs (k,), with a percentile bootstrap interval if there are two or more.

    With `over` (k,), the other's values of pairs of runs, the ratio of both means, by a bootstrap that draws pairs.
    """
    rows = [np.asarray(one, dtype=float)[None] for one in (values, over) if one is not None]
    (known,) = means(*rows, repeats=repeats)
    return known


def means(values: ArrayLike, over: ArrayLike | None = None, *, repeats: int = REPEATS) -> list[Interval]:
    """Means of f fields over k runs (f, k) as of `mean`; one bootstrap draws runs for all of them."""
    from scipy.stats import bootstrap

    def statistic(*drawn: Array, axis: int = -1) -> Any:
        first, *rest = (np.mean(x, axis=axis) for x in drawn)
        return first / rest[0] if rest else first

    samples = [np.asarray(x, dtype=float) for x in (values, over) if x is not None]
    fields, count = samples[0].shape
    if count == 0:
        return [_interval() for _ in range(fields)]
    value = statistic(*samples)
    if count == 1:
        return [_interval(one) for one in value]
    found = bootstrap(
        samples, statistic, paired=over is not None, vectorized=True, n_resamples=repeats,
        batch=max(1, BLOCK // (fields * count)), method="percentile", rng=np.random.default_rng(0), axis=-1,
    ).confidence_interval  # fmt: skip
    return [_interval(*one) for one in zip(value, found.low, found.high, strict=True)]


def paired_shares(gained: int, lost: int, pairs: int) -> Interval:
    """The difference of two shares over pairs, with the adjusted Wald interval of Bonett and Price (2012).

    Of `gained` pairs only the first succeeded, of `lost` only the second. SciPy has no interval for pairs.
    """
    if pairs == 0:
        return _interval()
    up = (gained + 1) / (pairs + 2)
    down = (lost + 1) / (pairs + 2)
    half = Z * sqrt((up + down - (up - down) ** 2) / (pairs + 2))
    return _interval((gained - lost) / pairs, max(-1.0, up - down - half), min(1.0, up - down + half))


def mcnemar(gained: int, lost: int) -> float:
    """Exact two-sided p-value that pairs of unequal outcome are as often one way as the other (McNemar 1947)."""
    from scipy.stats import binomtest

    return float(binomtest(gained, gained + lost).pvalue) if gained + lost else 1.0


def sign_flips(differences: ArrayLike, seed: int = 0) -> float:
    """Two-sided p-value that differences (k,) of pairs are symmetric about zero, by flipping signs (Fisher 1935).

    All flips up to 13 pairs, beyond that 10 000 random ones, with the one at hand counted among them.
    """
    from scipy.stats import permutation_test

    d = np.asarray(differences, dtype=float)
    if len(d) < 2 or not d.any():  # one pair is as probable either way
        return 1.0

    found = permutation_test(  # of the distance from zero: both sides at once, whatever their shape
        (d,), lambda x, axis: np.abs(np.sum(x, axis=axis)), permutation_type="samples", alternative="greater",
        vectorized=True, n_resamples=REPEATS, batch=max(1, BLOCK // len(d)), rng=np.random.default_rng(seed),
    )  # fmt: skip
    return float(found.pvalue)


def holm(p: Sequence[float]) -> list[float]:
    """p-values adjusted for their number, so that the chance of any false finding stays below 5 % (Holm 1979).

    SciPy adjusts for the false discovery rate only.
    """
    adjusted, worst = [0.0] * len(p), 0.0
    for rank, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        worst = max(worst, min(1.0, (len(p) - rank) * p[i]))
        adjusted[i] = worst
    return adjusted
