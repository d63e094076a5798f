"""Tables and lines that a person reads on the terminal of plans, estimates, runs and sweeps."""

from collections.abc import Mapping, Sequence
from typing import Any

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.risk import CollisionProbability
from pirrht.estimation.sampling import TUNING
from pirrht.formatting import percent
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.topology.signature import OTHER, Signature
from sim.drawing.colors import passing, title
from sim.drawing.ways import ways_in
from sim.drive import episode
from sim.drive.metrics import REASONS, EpisodeMetrics, Truth
from sim.scenario import Scenario
from sim.settings import Settings
from sim.text import counted, say, table

LEAST_SHARE = 1e-4  # probability of a collision below which it is not stated [%]
HINTED = 0.01  # bound of that probability above which --risk is mentioned
FEW_CLASSES = 4
FEW_OBSTACLES = 4
MIN_WEIGHT = 0.01  # of a class in any repeat, for others to be in doubt about it
REMEDIES = {  # of `Plan.fallback`
    "no reference": "more --vertices or a smaller margin may find one",
    "no survivor": "try more --samples or less --noise",
}
DOUBT_RANGE = 5.0  # a class so many lambda above the value, without noise, may have weight all the same


def class_table(
    references: Sequence[Reference], homology: Signature | None = None, names: Sequence[str] = (),
    space: FreeSpace | None = None,
) -> str:  # fmt: skip
    """One row per homology class, cheapest first; with a homology in time also how each passes obstacles.

    `names` are those of static obstacles; of paths through a `space` of three dimensions their ways are named.
    """
    rows = [{"class": title(r.id), "cost": f"{r.cost:.4f}", "length [m]": f"{r.length:.3f}"} for r in references]
    bodies = passing(references, homology, names) if homology is not None and homology.J else [[]] * len(rows)
    ways = ways_in(space, references, names)
    ways = [way.ljust(max(map(len, ways))) for way in ways]
    for k, (row, r, words) in enumerate(zip(rows, references, bodies, strict=True)):
        if homology is not None and homology.J:
            row["bodies"] = ", ".join(words) or "-"
        elif len(r.winding) <= FEW_OBSTACLES:  # else too wide; JSON has it all
            row["H"] = " ".join(f"{h:+.2f}" for h in r.signature)
        row |= {"way": ways[k]} if ways else {}
    return table([*rows[0]], [[*row.values()] for row in rows]) if rows else "no class"


def estimate_table(estimates: Sequence[Estimate | None], ids: Sequence[str], truth: Truth | None = None) -> str:
    """One row per repeat: value, control, standard errors, effective samples, class weights, errors."""
    off = [] if truth is None else ["v error", "u error"]
    if len(ids) > FEW_CLASSES:  # too wide for a terminal; JSON has them all
        ids = [name for name in ids if any(e and e.class_weights.get(name, 0.0) >= 5e-4 for e in estimates)]
    header = ["repeat", "value", "v stderr", "control", "u stderr", *off, "ESS", *map(title, ids), OTHER]
    rows = []
    for i, e in enumerate(estimates):
        row = {"repeat": str(i), "value": "none", "control": "none", "ESS": "0"}
        if e is not None:
            row |= {"value": f"{e.value:.4f}", "v stderr": f"{e.value_error:.4f}", "ESS": f"{e.ess:.1f}"}
            row |= {"control": _vector(e.control, "+.3f"), "u stderr": _vector(e.control_error, ".3f")}
            row |= zip(off, map("{:+.4f}".format, () if truth is None else truth.errors(e)), strict=True)
            row |= _shares(ids, e.class_weights, e.class_weight_errors)
        rows.append(row)
    if truth is not None:
        row = {"repeat": "truth", "value": f"{truth.value:.4f}", "control": _vector(truth.control, "+.3f")}
        rows.append(row | _shares(ids, truth.shares, truth.share_errors))
    return table(header, [[row.get(name, "-") for name in header] for row in rows])


def _shares(ids: Sequence[str], weights: Mapping[str, float], errors: Mapping[str, float | None]) -> dict[str, str]:
    """Return cells of the weights of classes and of all others, with their standard errors where they are known."""
    if not weights:
        return {}
    weights = {name: weights.get(name, 0.0) for name in ids}
    weights[OTHER] = max(0.0, 1.0 - sum(weights.values()))
    cells = {name: f"{weight:.3f}" for name, weight in weights.items()}
    cells |= {name: f"{cells[name]} +- {error:.3f}" for name in cells if (error := errors.get(name)) is not None}
    return {title(name): cell for name, cell in cells.items()}


def _vector(values: Array, form: str) -> str:
    return "(" + ", ".join(f"{v:{form}}" for v in values) + ")"


def doubts(
    estimates: Sequence[Estimate | None], references: Sequence[Reference], temperature: float, target: float | None
) -> list[str]:
    """List doubts that standard errors hide: few samples, heavy tails, classes not sampled, targets missed."""
    known = [e for e in estimates if e is not None]
    of = f"of {len(known)} repeats"
    least = min((e.value for e in known), default=0.0)
    poor = sum(e.doubtful for e in known)
    heavy = sum(e.heavy_tailed and not e.doubtful for e in known)
    lines = [
        (poor, f"the effective sample size (ESS) is below {TUNING.few:g} in {poor} {of}: do not trust standard errors "
         "there"),
        (heavy, f"the weights have a heavy tail in {heavy} {of}: a path that was not drawn may outweigh all others, "
         "and standard errors are too small"),
    ]  # fmt: skip
    for r in references:
        thin = sum(e.class_ess.get(r.id, 0.0) < TUNING.lone for e in known)
        cheap = 2 * thin > len(known) and r.cost < least + DOUBT_RANGE * temperature
        if cheap or any(e.class_weights.get(r.id, 0.0) >= MIN_WEIGHT for e in known):
            text = (
                f"class {title(r.id)}: hardly a sample arrived in {thin} {of}, so standard errors leave out its weight"
            )
            lines.append((thin, text))
    found = [f"{line}; try more --samples" for often, line in lines if often]
    if target is not None:
        missed = sum(float(e.control_error.max()) > target for e in known)
        drawn = max((sum(part.size for part in e.parts) for e in known), default=0)
        found.append(f"--target-error {target:g} was not reached in {missed} {of}, with at most {drawn} samples")
    return found


def passages_line(found: dict[str, Any]) -> str:
    """Report open passages (`passages_json`) that are on no path; empty without any."""
    if not (unused := found["unused"]):
        return ""

    x, y = unused[0]["at"]
    width = unused[0]["width"]
    between = " and ".join(unused[0]["between"])

    return (
        f"no path leads through {len(unused)} of {counted(found['open'], 'open passage')}; the narrowest of these is "
        f"{width:.2f} m wide at ({x:.2f}, {y:.2f}) between {between}; more --vertices or --classes or a higher --limit "
        "may lead through"
    )


def fitting_lines(scenario: Scenario) -> str:
    """Report where less than the margin counts, and which part of a covered goal plans lead to; empty if neither."""
    given, planned = scenario.loaded.scene, scenario.space.scene
    lines = [
        f"less than the margin of {given.margin:.3g} m is free at ({w.x:.4g}, {w.y:.4g}): {given.margin - w.less:.3g} "
        f"m counts within {w.radius:.3g} m of it"
        for w in planned.waivers
        if given.margin > 0.0 and w not in given.narrow
    ]
    if given.narrow:
        least = given.margin - max(disc.less for disc in given.narrow)
        passages = counted(len(given.narrow), "narrow passage")
        lines.append(f"margin {given.margin:.3g} m, and in {passages} less, {least:.2g} m at least")
    if planned.goal is not given.goal:
        free = f"{planned.goal.radius:.3g} m around {scenario.system.adapter.text(planned.goal.center, 4)}"
        lines.append(f"the centre of the goal is covered: plans lead to its free part, {free}")
    return "\n".join(lines)


def odds(scenario: Scenario) -> str:
    """State in a line what is uncertain: noise, where the system uses it, and lambda."""
    unit = scenario.system.noise_in.removeprefix("in ")
    own = "noise" in scenario.system.heeds
    noise = f"noise {scenario.settings.noise:g} {unit}".rstrip() if own else "noise of its own"
    margin = f", margin {scenario.margin:.3g} m" if scenario.margin > 0.0 else ""
    note = f" {scenario.risk_note}" if scenario.risk_note else ""
    risk = "" if scenario.settings.risk is None else f", risk {scenario.settings.risk:g}{note}"
    robot = scenario.loaded.robot if scenario.system.robots else scenario.system.name
    return f"{robot}: {noise}, lambda {scenario.problem.temperature:.3g}{margin}{risk}"


def chance(collision: CollisionProbability, settings: Settings) -> str:
    """State the predicted probability of a collision, and if a risk could be asked for that it can."""
    least = f"below {LEAST_SHARE:g} %"
    known = least if 100.0 * collision.probability <= LEAST_SHARE else (
        f"{percent(collision.probability)} +- {percent(collision.error)}")  # fmt: skip
    hinted = settings.risk is None and settings.sense == "map" and collision.most > HINTED
    more = "; --risk 0.01 looks for a margin that keeps 1 %" if hinted else ""
    return f"probability of a collision {known}{more}"


def chance_at_start(collision: CollisionProbability, settings: Settings) -> str:
    """State what is predicted at the start, by a robot with a lidar among what its first scan shows."""
    among = "" if settings.sense == "map" else ", among what the first scan shows"
    return f"predicted at the start{among}: {chance(collision, settings)}"


def summary(run: EpisodeMetrics, scenario: Scenario) -> None:
    """Print the results of a run; with a truth also how far from the optimal control it was."""
    executed = "no class" if run.executed_class is None else f"class {title(run.executed_class)}"
    so_far = " so far" if run.outcome == "timeout" else ""
    blocked = f", blocked for {run.blocked_time:.2f} s" if run.fallbacks else ""
    late = "took longer than the period, and the simulation waited" if run.real_time is None else "were late"
    first, *later = (1e3 * seconds for seconds in run.plan_seconds)
    say(f"{run.outcome} after {run.time:.2f} s: cost {run.cost:.3f}{so_far}, path length {run.path_length:.2f} m "
        "without the jitter of the noise")  # fmt: skip
    say(f"{executed}, {counted(run.class_switches, 'class switch', 'class switches')} "
        f"({counted(run.class_reversals, 'reversal')} of a decision), {counted(run.fallbacks, 'fallback')} (plans "
        f"without reference or surviving sample{blocked}), least clearance {run.min_clearance:.3f} m "
        "(free distance around the robot)")  # fmt: skip
    if so_far and run.fallbacks > run.steps // 2:
        (why, _), *_ = run.reasons.most_common()
        say(f"{REASONS[why]} for most of the time: {REMEDIES[why]}")
    if run.outcome == "collision" and scenario.settings.risk is None:
        risk = "" if scenario.settings.sense == "lidar" else "--risk 0.01 or "
        say(f"noise moves the robot between two controls: {risk}--margin M [m] makes plans leave more clearance")
    if run.doubtful_plans:
        say(f"{run.doubtful_plans} of {counted(run.steps, 'plan')} had fewer than {TUNING.few:g} effective samples, "
            f"the weakest {run.least_ess:.1f} at {run.least_ess_time:.2f} s: their controls are guesses; try more "
            "--samples")  # fmt: skip
    if (off := run.plant_mismatch) is not None:
        say("wheels or rotors follow the equation about; after a period they are off it by (rms) "
            + ", ".join(f"{name} {v:.2g}" for name, v in off.items()))  # fmt: skip
    if run.real_time is not None:
        say(episode.summary(run.real_time))
    longest = f", the longest later one {max(later):.1f} ms" if later else ""
    say(f"{counted(run.steps, 'control step')}: median {run.step_ms['median']:.1f} ms, 95th percentile "
        f"{run.step_ms['p95']:.1f} ms; the first took {first:.1f} ms{longest}; "
        f"{run.deadline_misses} {late}")  # fmt: skip
    if (map_ms := run.map_ms) is not None:
        say(f"{counted(len(run.map_seconds), 'new map')}: median {map_ms['median']:.1f} ms, 99th percentile "
            f"{map_ms['p99']:.1f} ms, the longest {map_ms['max']:.1f} ms of a plan")  # fmt: skip
    if (truth := run.truth) is not None:
        say(f"compared with the optimal control: |u - u*| {truth['mean_control_error']:.3f} on average, "
            f"{truth['max_control_error']:.3f} at most; exact value at the start {truth['value']:.4f}")  # fmt: skip
