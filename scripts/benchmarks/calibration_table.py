"""Sums of what plans claim and how far they are off, by room and in total."""

from collections.abc import Iterator
from typing import Any

import numpy as np

EDGES = (0.0, 0.25, 0.5, 1.0, 2.0, np.inf)  # of clearance / (b sqrt(1 s))
FEW = 0.05  # an effective sample size of less than this share of the samples is small
BAD = 0.1  # a state is bad if more than this share of its plans lies beyond 3 standard errors
HEADER = [
    *("b, room", "states", "plans", "v in 1", "in 2", "over 3", "ux in 1", "in 2", "uy in 1", "in 2"),
    *("both in 2", "u over 3", "v bias", "rms", "s.e.", "u bias", "rms", "s.e."),
    *("ESS", "5 %", "< 5 %", "v bad", "u bad", "none", "ms"),
]


def summaries(states: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row per noise and bin of room that has states, and one per noise."""
    out = []
    for noise in sorted({s["noise"] for s in states}):
        own = [s for s in states if s["noise"] == noise]
        for low, high in [*zip(EDGES[:-1], EDGES[1:], strict=True), (0.0, None)]:
            some = own if high is None else [s for s in own if low <= s["room"] < high]
            if some:
                out.append({"noise": noise, "from": low, "to": high, **summary(some)})
    return out


def by_noise_and_scene(states: list[dict[str, Any]]) -> Iterator[tuple[float, str, list[dict[str, Any]]]]:
    """Noise, scene and the states of both, and after the scenes of a noise "all" of its states."""
    for noise in sorted({s["noise"] for s in states}):
        own = [s for s in states if s["noise"] == noise]
        for name in dict.fromkeys(s["scene"] for s in own):
            yield noise, name, [s for s in own if s["scene"] == name]
        yield noise, "all", own


def summary(states: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage (shares), errors [cost, m/s] and effective samples (shares) of some states."""
    plans = [p for s in states for p in s["plans"]]
    counts = {"states": len(states), "plans": len(plans), "without": sum(s["without"] for s in states)}
    if not plans:
        return counts
    each = [scores(s) for s in states if s["plans"]]
    of = {name: np.concatenate([e[name] for e in each]) for name in each[0]}
    (ux, uy), worst = of["u"].T, of["u"].max(axis=1)
    return counts | {
        "v1": _within(of["v"], 1),
        "v2": _within(of["v"], 2),
        "v3": 1.0 - _within(of["v"], 3),
        "ux1": _within(ux, 1),
        "ux2": _within(ux, 2),
        "uy1": _within(uy, 1),
        "uy2": _within(uy, 2),
        "u2": _within(worst, 2),
        "u3": 1.0 - _within(worst, 3),
        "v_bias": float(of["off_v"].mean()),
        "v_rms": _rms(of["off_v"]),
        "v_error": _rms(of["claim_v"]),
        "u_bias": float(of["along"].mean()),
        "u_rms": _rms(np.hypot(*of["off_u"].T)),
        "u_error": _rms(np.hypot(*of["claim_u"].T)),
        "ess": float(np.median(of["share"])),
        "ess_low": float(np.quantile(of["share"], 0.05)),
        "ess_few": float(np.mean([np.median(e["share"]) < FEW for e in each])),
        "v_bad": sum(_bad(e["v"]) for e in each),
        "u_bad": sum(_bad(np.max(e["u"], axis=1)) for e in each),
        "ms": float(np.median([p["ms"] for p in plans])),
    }


def scores(state: dict[str, Any]) -> dict[str, Any]:
    """Errors of a state's plans, and these over what the plans claim; (k,) for v and (k, 2) for u."""
    plans = state["plans"]
    off_v, off_u = np.array([p["v"] for p in plans]) - state["v"], np.array([p["u"] for p in plans]) - state["u"]
    claim_v, claim_u = np.array([p["v_error"] for p in plans]), np.array([p["u_error"] for p in plans])
    true = np.array(state["u"])
    return {
        "v": np.abs(off_v) / np.maximum(claim_v, 1e-12),
        "u": np.abs(off_u) / np.maximum(claim_u, 1e-12),
        "off_v": off_v,
        "off_u": off_u,
        "claim_v": claim_v,
        "claim_u": claim_u,
        "along": off_u @ true / max(float(np.hypot(*true)), 1e-12),
        "share": np.array([p["ess"] / p["samples"] for p in plans]),
    }


def text_of(row: dict[str, Any]) -> list[str]:
    """A row of the table; coverage in per cent."""
    to = row["to"]
    bin_ = "all" if to is None else f">= {row['from']:g}" if to == np.inf else f"{row['from']:g} - {to:g}"
    cells = [f"{row['noise']:g}, {bin_}", str(row["states"]), str(row["plans"])]
    if "v1" not in row:
        return [*cells, *[""] * (len(HEADER) - 5), str(row["without"]), ""]
    errors = [[f"{row[f'{x}_bias']:+.4f}", f"{row[f'{x}_rms']:.4f}", f"{row[f'{x}_error']:.4f}"] for x in "vu"]
    return [
        *cells,
        *(f"{100 * row[key]:.1f}" for key in ("v1", "v2", "v3", "ux1", "ux2", "uy1", "uy2", "u2", "u3")),
        *errors[0],
        *errors[1],
        *(f"{100 * row[key]:.1f}" for key in ("ess", "ess_low", "ess_few")),
        *(str(row[key]) for key in ("v_bad", "u_bad", "without")),
        f"{row['ms']:.1f}",
    ]


def truth_errors(states: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The greatest differences between truth and a finer grid by noise, [cost, m/s] and in standard errors."""
    out = []
    for noise in sorted({s["noise"] for s in states}):
        own = [s for s in states if s["noise"] == noise and s["finer"] is not None and s["plans"]]
        if not own:
            continue
        row = {"noise": noise, "states": len(own)}
        for name in ("v", "u"):
            off = [np.max(np.abs(np.subtract(s["finer"][name], s[name]))) for s in own]
            claims = [_rms(scores(s)[f"claim_{name}"]) for s in own]
            row |= {name: float(max(off)), f"{name}_over_error": float(np.max(np.divide(off, claims)))}
        out.append(row)
    return out


def truth_text(row: dict[str, Any]) -> list[str]:
    """The table's line for that."""
    cells = {0: f"{row['noise']:g}, truth", 1: str(row["states"])}
    for name, score, rms in (("v", "over 3", 13), ("u", "u over 3", 16)):
        cells |= {HEADER.index(score): f"{row[f'{name}_over_error']:.2f}", rms: f"{row[name]:.4f}"}
    return [cells.get(k, "") for k in range(len(HEADER))]


def _within(score: Any, most: float) -> float:
    return float(np.mean(score <= most))


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _bad(score: Any) -> bool:
    return bool(np.mean(score > 3.0) > BAD)
