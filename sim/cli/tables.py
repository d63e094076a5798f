"""Tables and lines that a person reads on the terminal of plans, estimates, runs and sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampling import TUNING
from pirrht.planner.references import Reference
from pirrht.topology.homology import Homology
from sim.drawing.colors import title
from sim.drawing.sides import passing
from sim.drive import realtime
from sim.drive.metrics import EpisodeMetrics
from sim.drive.truth import Truth
from sim.report.comparisons import BASE, Key, Record, extra_costs, pairs_of
from sim.scenario import Scenario
from sim.text import counted, say, table

FEW_CLASSES = 4
FEW_OBSTACLES = 4
LONE_ESS = 1.5  # effective samples of a class of which no more than one has any weight
MIN_WEIGHT = 0.01  # of a class in any repeat, for others to be in doubt about it
DOUBT_RANGE = 5.0  # a class so many lambda above the value, without noise, may have weight all the same


def scene_table(rows: Sequence[tuple[str, str, float, int, str]]) -> str:
    """One row per scene: its name, robot, noise, number of moving obstacles, and a sentence on it."""
    known = [[name, robot, f"{noise:g}", str(moving)] for name, robot, noise, moving, _ in rows]
    lines = table(["scene", "robot", "noise", "moving"], known).splitlines()
    about = ["about", "-" * 7, *(row[-1] for row in rows)]
    return "\n".join(f"{line.ljust(max(map(len, lines)))}  {more}" for line, more in zip(lines, about, strict=True))


def class_table(references: Sequence[Reference], columns: int | None = None, homology: Homology | None = None) -> str:
    """One row per homology class, cheapest first; with a homology in time also how each passes moving obstacles."""
    header = ["class", "cost", "length [m]"]
    more: list[list[str]] = [[] for _ in references]
    if homology is not None and homology.J:
        header, more = [*header, "bodies"], [[", ".join(passing(r, homology)) or "-"] for r in references]
    elif not references or len(references[0].winding) <= FEW_OBSTACLES:  # else too wide; JSON has it all
        header, more = [*header, "H"], [[" ".join(f"{h:+.2f}" for h in r.signature)] for r in references]
    known = [[title(r.id), f"{r.cost:.4f}", f"{r.length:.3f}", *last] for r, last in zip(references, more, strict=True)]
    return table(header, known, columns)


def estimate_table(
    estimates: Sequence[Estimate | None], ids: Sequence[str], truth: Truth | None = None, columns: int | None = None
) -> str:
    """One row per repeat: value, control, standard errors, effective samples, class weights, errors."""
    off = [] if truth is None else ["v error", "u error"]
    if len(ids) > FEW_CLASSES:  # too wide for a terminal; JSON has them all
        ids = [name for name in ids if any(e and e.class_weights.get(name, 0.0) >= 5e-4 for e in estimates)]
    header = ["repeat", "value", "v stderr", "control", "u stderr", *off, "ESS", *map(title, ids), "other"]
    rows = []
    for i, e in enumerate(estimates):
        row = dict.fromkeys(header, "-") | {"repeat": str(i), "value": "none", "control": "none", "ESS": "0"}
        if e is not None:
            shares = {title(name): e.class_weights.get(name, 0.0) for name in ids}
            shares["other"] = max(0.0, 1.0 - sum(shares.values()))
            row |= {"value": f"{e.value:.4f}", "v stderr": f"{e.value_error:.4f}", "ESS": f"{e.ess:.1f}"}
            row |= {"control": _vector(e.control, "+.3f"), "u stderr": _vector(e.control_error, ".3f")}
            row |= {name: f"{share:.3f}" for name, share in shares.items()}
            if truth is not None:
                row |= {name: f"{error:+.4f}" for name, error in zip(off, truth.errors(e), strict=True)}
        rows.append(list(row.values()))
    if truth is not None:
        exact = {"repeat": "truth", "value": f"{truth.value:.4f}", "control": _vector(truth.control, "+.3f")}
        rows.append([exact.get(name, "-") for name in header])
    return table(header, rows, columns)


def _vector(values: Array, form: str) -> str:
    return "(" + ", ".join(f"{v:{form}}" for v in values) + ")"


def doubts(
    estimates: Sequence[Estimate | None], references: Sequence[Reference], temperature: float, target: float | None
) -> list[str]:
    """List doubts that standard errors hide: few samples, heavy tails, classes not sampled, targets missed."""
    known = [e for e in estimates if e is not None]
    of, lines = f"of {len(known)} repeats", []
    if poor := sum(e.doubtful for e in known):
        lines.append(
            f"effective sample size (ESS) below {TUNING.few:g} in {poor} {of}; standard errors say nothing there, "
            "try more --samples"
        )
    if heavy := sum(e.heavy_tailed and not e.doubtful for e in known):
        lines.append(
            f"weights of a heavy tail in {heavy} {of}: a path that was not drawn may outweigh all that were, and "
            "standard errors are too small; try more --samples"
        )
    for r in references:
        thin = sum(e.class_ess.get(r.id, 0.0) < LONE_ESS for e in known)
        cheap = thin and r.cost < min(e.value for e in known) + DOUBT_RANGE * temperature
        weighty = max((e.class_weights.get(r.id, 0.0) for e in known), default=0.0) >= MIN_WEIGHT
        if thin and (weighty or (cheap and 2 * thin > len(known))):
            lines.append(
                f"class {title(r.id)}: hardly a sample in {thin} {of}; standard errors do not know what it is worth, "
                "try more --samples"
            )
    if target is not None:
        missed = sum(float(e.control_error.max()) > target for e in known)
        drawn = max((sum(part.size for part in e.parts) for e in known), default=0)
        lines.append(f"--target-error {target:g}: not reached in {missed} {of}, at most {drawn} samples drawn")
    return lines


def passages_line(found: dict[str, Any]) -> str:
    """Report open passages (`passages_json`) that are on no path; empty without any."""
    if not (unused := found["unused"]):
        return ""
    (x, y), width, between = unused[0]["at"], unused[0]["width"], " and ".join(unused[0]["between"])
    return (
        f"{len(unused)} of {counted(found['open'], 'open passage')} on no path, the narrowest {width:.2f} m wide at "
        f"({x:.2f}, {y:.2f}) between {between}: more --vertices or --classes or a higher --limit may lead there"
    )


def fitting_lines(scenario: Scenario) -> str:
    """Report where less than the margin counts, and which part of a covered goal plans lead to; empty if neither."""
    given, planned = scenario.loaded.scene, scenario.space.scene
    lines = [
        f"less than the margin of {given.margin:.3g} m is free at ({w.x:.4g}, {w.y:.4g}): {given.margin - w.less:.3g} "
        f"m counts within {w.radius:.3g} m of it"
        for w in planned.waivers
        if given.margin > 0.0
    ]
    if planned.goal is not given.goal:
        (x, y), radius = planned.goal.center, planned.goal.radius
        lines.append(
            f"the centre of the goal is covered: plans lead to its free part, {radius:.3g} m around ({x:.4g}, {y:.4g})"
        )
    return "\n".join(lines)


def odds(scenario: Scenario) -> str:
    """State in a line what is uncertain: noise, where the system uses it, and lambda."""
    unit = scenario.system.noise_in.removeprefix("in ")
    own = "noise" in scenario.system.heeds
    noise = f"noise {scenario.settings.noise:g} {unit}".rstrip() if own else "noise of its own"
    margin = f", margin {scenario.margin:.3g} m" if scenario.margin > 0.0 else ""
    moved, radius = scenario.settings.noise * scenario.settings.period**0.5, scenario.loaded.scene.robot_radius
    doubt = f"; that is {moved:.2g} m between two controls, more than the radius of {radius:.2g} m: is the unit right?"
    doubt = doubt if own and scenario.problem.dynamics.noisy_position and moved > radius else ""
    return f"{scenario.system.called}: {noise}, lambda {scenario.problem.temperature:.3g}{margin}{doubt}"


def summary(run: EpisodeMetrics) -> None:
    """Print the results of a run; with a truth also how far from the optimal control it was."""
    executed = "no class" if run.executed_class is None else f"class {title(run.executed_class)}"
    so_far = " so far" if run.outcome == "timeout" else ""
    blocked = f", blocked for {run.blocked_time:.2f} s" if run.fallbacks else ""
    ms, late = run.step_ms, "longer than the period (the simulation waited)" if run.real_time is None else "late"
    lines = [
        f"{run.outcome} after {run.time:.2f} s: cost {run.cost:.3f}{so_far}, path of {run.path_length:.2f} m smoothed "
        "over its jitter",
        f"{executed}, {counted(run.class_switches, 'class switch', 'class switches')} "
        f"({counted(run.class_reversals, 'reversal')} of a decision), {counted(run.fallbacks, 'fallback')} (plans "
        f"without reference or surviving sample{blocked}), least clearance {run.min_clearance:.3f} m (free distance "
        "around the footprint)",
    ]
    if run.outcome == "timeout" and run.fallbacks > run.steps // 2:
        lines.append("no path for most of the time: more --samples or --vertices, or less --margin, may find one")
    if run.outcome == "collision":
        lines.append("noise moves the robot between two controls: --margin M makes plans leave more clearance [m]")
    if run.doubtful_plans:
        lines.append(
            f"{run.doubtful_plans} of {counted(run.steps, 'plan')} on fewer than {TUNING.few:g} effective samples, "
            f"the weakest on {run.least_ess:.1f} at {run.least_ess_time:.2f} s: a guess; try more --samples"
        )
    if run.real_time is not None:
        lines.append(realtime.summary(run.real_time))
    times = f"median {ms['median']:.1f} ms, p95 {ms['p95']:.1f}, max {ms['max']:.1f}, {run.deadline_misses} {late}"
    lines.append(f"{counted(run.steps, 'control step')}: {times}")
    if (truth := run.truth) is not None:
        lines.append(
            f"compared with the optimal control: |u - u*| {truth['mean_control_error']:.3f} on average, "
            f"{truth['max_control_error']:.3f} at most; exact value at the start {truth['value']:.4f}"
        )
    say("\n".join(lines))


def sweep_table(records: Sequence[Record], columns: int | None = None) -> str:
    """One row per scene, noise and method; a path is compared with the shortest reference."""
    points: dict[Key, list[Record]] = {}
    for record in records:
        points.setdefault((record["scene"], record["noise"], record["method"]), []).append(record)
    rows = [_sweep_row(point, points) for point in points]
    empty = {name for name, nothing in (("error", "0"), (f"over {BASE}", "-")) if all(r[name] == nothing for r in rows)}
    header = [name for name in rows[0] if name not in empty]
    return table(header, [[row[name] for name in header] for row in rows], columns, keep=3)


def _sweep_row(point: Key, points: Mapping[Key, Sequence[Record]]) -> dict[str, str]:
    """Cells by header; costs over those of `BASE` are of seeds that reach the goal by both."""
    scene, noise, method = point
    ended = [r for r in points[point] if r["outcome"] is not None]
    goals = [r for r in ended if r["outcome"] == "goal"]
    base = [] if method == BASE else points.get((scene, noise, BASE), ())
    names, counts = np.unique([r["executed_class"] for r in goals], return_counts=True)
    shares = [f"{title(str(names[i]))}: {counts[i] / len(goals):.0%}" for i in np.argsort(-counts, kind="stable")[:4]]
    return {
        "scene": scene,
        "b": f"{noise:g}",
        "method": method,
        "runs": str(len(points[point])),
        **{name: str(sum(r["outcome"] == name for r in ended)) for name in ("goal", "collision", "timeout")},
        "error": str(len(points[point]) - len(ended)),
        "cost": _mean([r["cost"] for r in goals]),
        f"over {BASE}": _mean(extra_costs(pairs_of(points[point], base)), "+.3f"),
        "time [s]": _mean([r["time"] for r in goals]),
        "path/shortest": _mean([r["path_length"] / r["shortest_length"] for r in goals if r["shortest_length"]]),
        "switches": _mean([r["class_switches"] for r in ended], ".2f"),
        "reversals": _mean([r["class_reversals"] for r in ended], ".2f"),
        "ms/step": _mean([np.median([r["step_ms"]["median"] for r in ended])] if ended else [], ".1f"),
        "plan [s]": _mean([r["plan_seconds"] for r in ended if r["plan_seconds"] is not None]),
        "classes": ", ".join(shares) or "-",
    }


def _mean(values: Sequence[float], form: str = ".3f") -> str:
    return f"{np.mean(values):{form}}" if len(values) else "-"
