"""Where the weakest plans of the drives of `effective` lose their effective samples, and what is to blame.

Every proposal with weight is sampled anew, MANY times on its own. The log weight of a path up to a time, plus what is
still to be expected of it, is a martingale, so the variances of its increments add up to that of the log weight. What
is to be expected is a quadratic function of the state, fitted to other paths. The variance of an increment is the
covariance of two that rest on fits to separate paths, so that no error of a fit counts as variance.

Log-normal weights of variance V, of which a share P arrives, leave exp(-V) P of the samples: each part of the path
costs nats of V and of -log P. Parts are after the end of the proposal, within the layer at walls in which clearance
has a price, and between walls. What costs most is to blame, unless a controller that starts anew finds more psi, with
all initialisations and up to 64 times the samples ("optimum"), or the class had enough effective samples, were all
samples drawn around that proposal ("mixture").
"""

import argparse
from heapq import nsmallest
from typing import Any, NamedTuple

import numpy as np
from benchmarks.effective import Drive, drives
from benchmarks.first_plan import controller_of
from tqdm import tqdm

from pirrht.arrays import Array, IntArray
from pirrht.control.plan import Plan
from pirrht.errors import NoReference
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampling import TUNING
from pirrht.estimation.weights import normalised
from pirrht.outcome import Outcome
from pirrht.rollouts.tables import FINER, Origin, Paths
from sim.scenario import Scenario

WORST, MANY, KNOTS, FOLDS = 30, 6000, 40, 3
HEAVY = 0.05  # share of the weight from which on a proposal is looked at
MORE, ERRORS = 0.5, 3.0  # log psi by which another controller must find more [nats], and in standard errors
FAR = 100.0  # nats below the heaviest weight from which on paths do not count
FAR_OFF = 3.0  # deviations beyond which a fit is not extrapolated
FEWEST = 60  # paths to which a quadratic function is fitted
PARTS = ("between", "walls", "end")
HEADER = ["robot", "scene", "seed", "plan", "at", "ESS", "class", "weight", "of ESS", "arrive %", "own ESS %", *PARTS]


class Weak(NamedTuple):
    """A plan of a drive."""

    step: int
    drive: Drive
    scenario: Scenario
    plan: Plan
    estimate: Estimate


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the weakest plans, one for each second of a drive at most."""
    weak, table, values = list[Weak](), list[list[str]](), list[dict[str, Any]]()
    for drive in tqdm(list(drives(options)), "drives", disable=None):
        scenario, of_second = drive.scenario(), dict[int, Weak]()
        try:
            tree = scenario.grown_tree()
        except NoReference:
            continue
        for frame in scenario.drive(scenario.plant(), scenario.driver(tree)):
            if frame.plan.estimate is not None:
                one = Weak(frame.step, drive, scenario, frame.plan, frame.plan.estimate)
                before = of_second.get(int(frame.time), one)
                of_second[int(frame.time)] = min(before, one, key=lambda weak: weak.estimate.ess)
        weak = nsmallest(options.plans or WORST, [*weak, *of_second.values()], key=lambda one: one.estimate.ess)
    for one in tqdm(weak, "plans", disable=None):
        more, robot, e = anew(one), one.drive, one.estimate
        start = " ".join(f"{v:.2f}" for v in e.rollouts.origin.x)
        for h in np.flatnonzero(np.array(e.proposal_weights) >= HEAVY):
            found = losses(one, int(h))
            blame = max(PARTS, key=lambda part: found["nats"][part])
            if found["own_ess"] * sum(part.size for part in e.parts) >= TUNING.few:
                blame = "mixture"
            blame = "optimum" if more > MORE else blame
            table.append([
                robot.robot, robot.scene, str(robot.seed), str(one.step), start, f"{e.ess:.1f}", found["class"],
                f"{e.proposal_weights[h]:.2f}", f"{e.class_ess.get(found['class'], 0.0) / e.ess:.2f}",
                *(f"{100.0 * found[name]:.2g}" for name in ("arrive", "own_ess")),
                *(f"{found['nats'][part]:.1f}" for part in PARTS), f"{more:+.1f}", blame,
                ", ".join(f"{nats:.1f} ({died}) at {t:.1f} s, {c:.2f} m" for t, nats, died, c in found["heaviest"]),
            ])  # fmt: skip
            values.append({**robot._asdict(), "plan": one.step, "at": start, "ess": e.ess, "more": more, "blame": blame,
                           "weight": e.proposal_weights[h], **found})  # fmt: skip
    return [*HEADER, "anew", "to blame", "nats (deaths) at time, clearance"], table, values


def anew(weak: Weak) -> float:
    """Return the log psi [nats] that a controller whose run begins there finds more; 0: within the errors."""
    x, scenario = weak.estimate.rollouts.origin.x, weak.scenario
    controller = controller_of(scenario, scenario.grown_tree())
    controller.begin(x, weak.plan.time)
    other = controller.plan(x).estimate
    if other is None:
        return 0.0
    error = np.hypot(other.value_error, weak.estimate.value_error) / scenario.problem.temperature
    more = other.log_psi - weak.estimate.log_psi
    return float(more if abs(more) > ERRORS * error else 0.0)


def losses(weak: Weak, h: int) -> dict[str, Any]:
    """Return what MANY samples around one reference lose [nats], by part of the path."""
    rollouts, problem, backend = weak.estimate.rollouts, weak.scenario.problem, weak.plan.replay.backend  # type: ignore[union-attr]
    count = np.where(np.arange(len(rollouts.rise)) == h, MANY, 0)
    tables = rollouts.tables._replace(first=np.concatenate([[0], np.cumsum(count)]).astype(np.int64))
    origin = Origin(rollouts.origin.x, np.uint64(weak.step), rollouts.origin.time)

    def sampled(k: int) -> tuple[Paths, Array]:
        """Sample the first k steps; return log weights (S,) of what has been passed, too."""
        control, drift = np.ascontiguousarray(tables.control[:, :k]), np.ascontiguousarray(tables.drift[:, :k])
        cut = {"control": control, "drift": drift, "times": tables.times[: k + 1].copy()}
        part = tables._replace(**cut, active=np.minimum(tables.active, k))
        paths = backend.sample(rollouts.setup, part, origin)
        return paths, paths.log_survival - paths.work / problem.temperature - paths.log_ratio[:, h]

    paths, log_weight = sampled(len(tables.times) - 1)
    arrived = paths.outcome == Outcome.GOAL
    arrived &= log_weight > np.max(log_weight[arrived], initial=-np.inf) - FAR
    last = min(int(paths.steps[arrived].max(initial=KNOTS)), len(tables.times) - 1)
    knots = np.unique(np.linspace(0, last, KNOTS + 1).astype(int))
    states = backend.replay(rollouts.setup, tables, origin, np.arange(MANY))[0][:, : last + 1]
    under_way = paths.steps[:, None] >= np.arange(last + 1)
    total = np.einsum("st,std->td", under_way, problem.dynamics.place(states))
    mean = total / np.maximum(under_way.sum(axis=0), 1)[:, None]
    clear = np.minimum.reduceat(weak.scenario.space.collision.clearance(mean), knots[:-1])
    passed = np.array([0.0 * log_weight, *(sampled(k)[1] for k in knots[1:])])[:, arrived]
    variance = increments(passed, states[arrived], paths.steps[arrived], knots)
    died = np.histogram(paths.steps[paths.outcome == Outcome.COLLISION], knots)[0]
    nats = variance - np.diff(np.log(np.maximum(MANY - np.cumsum([0, *died]), 0.5)))
    end = int(tables.law_length[h]) // FINER or last
    guidance = controller_of(weak.scenario, weak.scenario.grown_tree()).path_integral.guidance
    layer = 0.0 if guidance is None else guidance.tasks[1.0].margin
    part = np.where(knots[:-1] >= end, "end", np.where(clear < layer, "walls", "between"))
    weight, own = normalised(np.where(arrived, log_weight, -np.inf))
    key = int(paths.key[np.argmax(weight)])
    heaviest = sorted(np.argsort(nats)[-4:].tolist())
    return {
        "class": weak.plan.classes.get(key, "other"), "arrive": float(arrived.mean()), "own_ess": own / MANY,
        "nats": {name: float(nats[part == name].sum()) for name in PARTS}, "layer": layer,
        "heaviest": [(float(tables.times[knots[i]]), float(nats[i]), int(died[i]), float(clear[i])) for i in heaviest],
        "variance": float(log_weight[arrived].var()) if arrived.any() else 0.0, "increments": variance.tolist(),
        "deaths": died.tolist(), "times": tables.times[knots].tolist(),
    }  # fmt: skip


def increments(passed: Array, states: Array, steps: IntArray, knots: IntArray) -> Array:
    """Return the variances (k-1,) of the martingale's increments between knots (k,).

    Args: log weight at each knot, (k, S); states (S, T+1, n), and steps (S,) until the goal.
    """
    fold = np.arange(passed.shape[1]) // 2 % FOLDS  # antithetic pairs stay together
    known = np.zeros((FOLDS, *passed.shape))  # log weight expected in the end, by the paths of each fold
    for i, k in enumerate(knots):
        under_way = steps > k
        rest, x = passed[-1] - passed[i], states[:, k]
        scaled = np.clip((x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-9), -FAR_OFF, FAR_OFF)
        upper = np.triu_indices(x.shape[1])
        square = np.column_stack([np.ones(len(x)), scaled, (scaled[:, :, None] * scaled[:, None])[:, *upper]])
        for f in range(FOLDS):
            mine = under_way & (fold == f)
            expected = np.full(len(x), rest[fold == f].mean() if k == 0 else 0.0)
            if k > 0 and mine.sum() >= FEWEST:
                expected[under_way] = square[under_way] @ np.linalg.lstsq(square[mine], rest[mine], rcond=None)[0]
            known[f, i] = passed[i] + expected
    known[:, -1] = passed[-1]
    change = np.diff(known, axis=1)  # (FOLDS, k-1, S)
    pairs = [change[f - 1][:, fold == f] * change[f - 2][:, fold == f] for f in range(FOLDS)]
    return np.mean([one.mean(axis=1) for one in pairs], axis=0)
