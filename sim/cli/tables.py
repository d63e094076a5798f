"""Tables and lines that a person reads on the terminal of plans, estimates, runs and sweeps."""

from __future__ import annotations

import textwrap
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
from sim.drive import clock
from sim.drive.result import DriveResult
from sim.drive.truth import Truth
from sim.report.comparisons import BASE, Key, Record, extra_costs, pairs_of
from sim.scenario import Scenario
from sim.text import LEAST, counted, say, table

FEW_CLASSES = 4
LONE = 1.5  # effective samples of a class of which no more than one has any weight
WORTH = 0.01  # weight of a class that any repeat finds, for others to be in doubt about it
NEAR = 5.0  # a class so many lambda above the value, without noise, may have weight all the same
SPOT = "rover"  # the robot that turns almost on the spot
_FIRST = ("scene", "b", "method", "runs", "goal", "collision", "timeout")
_LAST = ("time [s]", "path/shortest", "switches", "reversals", "ms/step", "plan [s]", "classes")
_OVER = f"over {BASE}"  # of seeds that reach the goal by both: means of different seeds do not compare


def scene_table(rows: Sequence[tuple[str, str, float, int, str]], room: int | None = None) -> str:
    """One row per scene: its name, robot, noise, number of bodies that move, and a sentence on it."""
    known = [[name, robot, f"{noise:g}", str(moving)] for name, robot, noise, moving, _ in rows]
    lines = table(["scene", "robot", "noise", "moving"], known).splitlines()
    indent = " " * (max(map(len, lines)) + 2)
    told = [lines[0] + "  about", lines[1] + "-" * 7]
    for line, (*_, about) in zip(lines[2:], rows, strict=True):
        text = line.ljust(len(indent)) + about
        broken = room is not None and room >= len(indent) + LEAST
        told.append(textwrap.fill(text, room or 0, subsequent_indent=indent) if broken else text.rstrip())
    return "\n".join(told)


def class_table(references: Sequence[Reference], room: int | None = None, homology: Homology | None = None) -> str:
    """One row per homology class, cheapest first; with a homology in time also how each passes the bodies."""
    if homology is not None and homology.J:
        return table(
            ["class", "cost", "length [m]", "bodies"],
            [
                [title(r.id), f"{r.cost:.4f}", f"{r.length:.3f}", ", ".join(passing(r, homology)) or "-"]
                for r in references
            ],
            room,
        )
    if references and len(references[0].winding) > 4:  # too wide for a terminal; JSON has it all
        rows = [[title(r.id), f"{r.cost:.4f}", f"{r.length:.3f}"] for r in references]
        return table(["class", "cost", "length [m]"], rows, room)
    rows = [[r.id, f"{r.cost:.4f}", f"{r.length:.3f}", " ".join(f"{h:+.2f}" for h in r.signature)] for r in references]
    return table(["class", "cost", "length [m]", "H"], rows, room)


def estimate_table(
    estimates: Sequence[Estimate | None], ids: Sequence[str], truth: Truth | None = None, room: int | None = None
) -> str:
    """One row per repeat: value, control, their standard errors, effective sample size and class weights.

    With a truth also the errors.
    """
    off = [] if truth is None else ["v error", "u error"]
    if len(ids) > FEW_CLASSES:  # too wide for a terminal; JSON has them all
        ids = [name for name in ids if any(e and e.class_weights.get(name, 0.0) >= 5e-4 for e in estimates)]
    header = ["repeat", "value", "v stderr", "control", "u stderr", *off, "ESS", *map(title, ids), "other"]
    rows = []
    for i, e in enumerate(estimates):
        if e is None:
            rows.append([str(i), "none", "-", "none", "-", *["-"] * len(off), "0", *["-"] * (len(ids) + 1)])
            continue
        known = [e.class_weights.get(name, 0.0) for name in ids]
        weights = [f"{weight:.3f}" for weight in [*known, max(0.0, 1.0 - sum(known))]]
        errors = [] if truth is None else [f"{error:+.4f}" for error in truth.errors(e)]
        value = [f"{e.value:.4f}", f"{e.value_error:.4f}"]
        control = [_vector(e.control), "(" + ", ".join(f"{error:.3f}" for error in e.control_error) + ")"]
        rows.append([str(i), *value, *control, *errors, f"{e.ess:.1f}", *weights])
    if truth is not None:
        exact = [f"{truth.value:.4f}", "-", _vector(truth.control), "-"]
        rows.append(["truth", *exact, *["-"] * (len(ids) + 4)])
    return table(header, rows, room)


def doubts(
    estimates: Sequence[Estimate | None], references: Sequence[Reference], temperature: float, target: float | None
) -> list[str]:
    """List doubts that standard errors hide: few samples, heavy tails, classes not sampled, targets missed."""
    known = [e for e in estimates if e is not None]
    of = f"of {len(known)} repeats"
    lines = []
    poor = sum(e.doubtful for e in known)
    if poor:
        lines.append(
            f"effective sample size (ESS) below {TUNING.few:g} in {poor} {of}; standard errors say nothing there, "
            "try more --samples"
        )
    heavy = sum(e.heavy_tailed and not e.doubtful for e in known)
    if heavy:
        lines.append(
            f"weights of a heavy tail in {heavy} {of}: a path that was not drawn may outweigh all that were, and "
            "standard errors are too small; try more --samples"
        )
    for reference in references:
        thin = sum(e.class_ess.get(reference.id, 0.0) < LONE for e in known)
        if thin and _matters(reference, known, thin, temperature):
            lines.append(
                f"class {title(reference.id)}: hardly a sample in {thin} {of}; standard errors do not know what it is "
                "worth, try more --samples"
            )
    if target is not None:
        missed = sum(float(e.control_error.max()) > target for e in known)
        drawn = [sum(part.size for part in e.parts) for e in known]
        lines.append(
            f"--target-error {target:g}: not reached in {missed} of {len(known)} repeats, "
            f"at most {max(drawn, default=0)} samples drawn"
        )
    return lines


def _matters(reference: Reference, known: Sequence[Estimate], thin: int, temperature: float) -> bool:
    """Return whether a class of few samples has weight in some repeat, or is too cheap to have none in most."""
    cheap = reference.cost < min(e.value for e in known) + NEAR * temperature
    weight = max(e.class_weights.get(reference.id, 0.0) for e in known)
    return weight >= WORTH or (cheap and 2 * thin > len(known))


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{v:+.3f}" for v in values) + ")"


def passages_line(found: dict[str, Any], circle: float = 0.0) -> str:
    """Return what a person should know of open passages (`passages_json`) on no path; empty without any.

    Args:
        circle: how wide the robot's turning circle is, robot included [m]; 0 if it turns on the spot or has no heading.
    """
    unused = found["unused"]
    if not unused:
        return ""
    first = unused[0]
    tight = sum(passage["width"] < circle for passage in unused)
    turning = (
        f"; the turning circle, {circle:.2f} m wide, does not fit into {tight}: --robot {SPOT} turns almost on the spot"
    )
    return (
        f"{len(unused)} of {counted(found['open'], 'open passage')} on no path, the narrowest "
        f"{first['width']:.2f} m wide at ({first['at'][0]:.2f}, {first['at'][1]:.2f}) between "
        f"{' and '.join(first['between'])}: more --vertices or --classes or a higher --limit may lead there"
        + (turning if tight else "")
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
        x, y = planned.goal.center
        lines.append(f"the centre of the goal is covered: plans lead to its free part, {planned.goal.radius:.3g} m "
                     f"around ({x:.4g}, {y:.4g})")  # fmt: skip
    return "\n".join(lines)


def odds(scenario: Scenario) -> str:
    """State in a line what is uncertain: noise, where the system uses it, and lambda."""
    unit = scenario.system.noise_in.removeprefix("in ")
    heeds = "noise" in scenario.system.heeds
    noise = f"noise {scenario.settings.noise:g} {unit}".rstrip() if heeds else "noise of its own"
    margin = f", margin {scenario.margin:.3g} m" if scenario.margin > 0.0 else ""
    return f"{scenario.system.called}: {noise}, lambda {scenario.problem.temperature:.3g}{margin}"


def summary(drive: DriveResult, truth: dict[str, Any] | None = None) -> None:
    """Print what a drive came to; with a truth also how far from the optimal control it was."""
    executed = "no class" if drive.executed_class is None else f"class {title(drive.executed_class)}"
    so_far = " so far" if drive.outcome == "timeout" else ""
    ms, late = drive.step_ms, "longer than the period (the plant waits)" if drive.real_time is None else "late"
    say(
        f"{drive.outcome} after {drive.time:.2f} s: cost {drive.cost:.3f}{so_far}, path of {drive.path_length:.2f} m "
        "smoothed over its jitter"
    )
    say(
        f"{executed}, {counted(drive.class_switches, 'class switch', 'class switches')} "
        f"({counted(drive.class_reversals, 'reversal')} of a decision), "
        f"{counted(drive.fallbacks, 'fallback')} (plans without reference or surviving sample"
        f"{f', blocked for {drive.blocked_time:.2f} s' if drive.fallbacks else ''}), "
        f"least clearance {drive.min_clearance:.3f} m (free distance around the footprint)"
    )
    if drive.outcome == "timeout" and drive.fallbacks > drive.steps // 2:
        say("no way for most of the time: more --samples or --vertices, or less --margin, may find one")
    if drive.outcome == "collision":
        say("noise moves the robot between two controls: --margin M makes plans leave so much more room [m]")
    if drive.doubtful_plans:
        say(
            f"{drive.doubtful_plans} of {counted(drive.steps, 'plan')} on fewer than {TUNING.few:g} effective samples, "
            f"the weakest on {drive.least_ess:.1f} at {drive.least_ess_time:.2f} s: a guess; try more --samples"
        )
    if drive.real_time is not None:
        say(clock.summary(drive.real_time))
    say(
        f"{counted(drive.steps, 'control step')}: median {ms['median']:.1f} ms, p95 {ms['p95']:.1f}, "
        f"max {ms['max']:.1f}, {drive.deadline_misses} {late}"
    )
    if truth is not None:
        say(
            f"beside the optimal control: |u - u*| {truth['mean_control_error']:.3f} on average, "
            f"{truth['max_control_error']:.3f} at most; exact value at the start {truth['value']:.4f}"
        )


def sweep_table(rows: Sequence[Record], room: int | None = None) -> str:
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
    """Return the mean extra cost of a method over `BASE` with equal noise; empty without pairs."""
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
