"""The value of a mass at random states of `slit` and of random scenes: a million samples of three kinds, and plans.

Or of a rover or a car that accelerates, with --robot.

psi does not depend on what samples follow. So a million are drawn three times: led by the feedback of every class's
guide, as plans are; holding every reference's tape; and nine of ten led by the guide of another class than the
cheapest, the rest on tapes, without which paths of the cheapest class would hardly ever come up. All are weighed by the
mixture that they are drawn from. Where there is one class only, its guide is put aside instead, with weaker gains.
Truth is the first kind, and plans of default size are held against it. A state's speed is one that BRAKE can stop
within its clearance. With --part line truth is an exact grid, see `mass_line`.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from benchmarks.first_plan import controller_of, first_plan
from benchmarks.scenes import random_states, scenario_of, with_references
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.estimation.sampler import PathIntegral
from pirrht.proposals.guide import LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, Tape
from sim.scenario import Scenario, prepare

STATES, SAMPLES, PLANS = 20, 1_000_000, 10
EACH = 5  # states of a scene at most
PART = 50_000  # samples that are drawn at once
FASTEST, BRAKE = 1.0, 2.0  # [m/s], [m/s^2]
TAPES = 0.1  # share of the third kind that holds tapes
ASIDE, WEAKER = 0.02, 0.7  # [m], [m/s]; share of the gains
LOST = -600.0  # a sample that weighs less than exp of this beside the heaviest counts nothing [nats]
CLOSE = 0.01  # "within 1 %"
KINDS = ("guided", "tapes", "crossed")
HEADER = ["scene", "clearance", "speed", "classes", "v", "s.e.", "tapes off %", "s.e. %", "crossed off %", "s.e. %"]
HEADER += ["ESS guided", "tapes", "crossed", "plans off %", "rms %", "claimed %"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Psi:
    """What samples of one kind say."""

    log_psi: float  # [nats]
    error: float  # standard error of psi over psi
    ess: float
    samples: int


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    if options.part == "line":
        from benchmarks import mass_line

        return mass_line.rows(options)
    found = list(records(options))
    clear = [one for one in found if one["claims_enough"]]
    within = {kind: sum(abs(one[kind]["share"]) <= CLOSE for one in clear) for kind in KINDS[1:]}
    told = [f"{within[kind]} of {len(clear)} within 1 %" for kind in KINDS[1:]]
    last = [f"all {len(found)}", *[""] * 5, told[0], "", told[1], *[""] * (len(HEADER) - 9)]
    return HEADER, [*(_text(one) for one in found), last], {"states": found, "within": within}


def records(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """One record per state."""
    left, seed = options.states or STATES, options.first_seed
    with tqdm(total=left, desc="states", leave=False, disable=None) as bar:
        for scenario in scenarios(seed, options.noises, options.robot or "hover"):
            controller = controller_of(scenario, scenario.grown_tree())
            for x in states_in(scenario, controller, min(EACH, left), seed):
                yield record(scenario, controller, x, options.samples or SAMPLES, options.plans or PLANS)
                bar.update()
                left -= 1
            if left <= 0:
                return


def scenarios(seed: int, noises: list[float] | None = None, robot: str = "hover") -> Iterator[Scenario]:
    """`slit` and then random scenes, for a robot under default settings or with the noises [m/s/sqrt(s)] in turn."""
    for k in count():
        number = seed + k - 1
        scenario = (
            prepare("slit", robot=robot, given={"seed": seed})
            if k == 0
            else scenario_of(number, {"seed": number}, robot=robot)
        )
        yield scenario if not noises else scenario.with_settings(noise=noises[k % len(noises)])


def states_in(scenario: Scenario, controller: Controller, count: int, seed: int) -> list[Array]:
    """Random positions, headings and velocities, (n,), from which there is a way, `count` at most."""
    assert controller.tree is not None
    return with_references(controller.tree, _drawn(scenario, 4 * count, seed), count)


def _drawn(scenario: Scenario, count: int, seed: int) -> Iterator[Array]:
    rng, names = np.random.default_rng([seed, 62]), scenario.problem.dynamics.states
    for place in random_states(scenario.space, count, seed):
        speed = rng.random() * min(FASTEST, np.sqrt(2.0 * BRAKE * scenario.space.clearance(place)))
        angle = rng.uniform(-np.pi, np.pi)
        parts = {"vx": speed * np.cos(angle), "vy": speed * np.sin(angle), "heading": angle, "speed": speed}
        yield np.array([*place, *(parts[name] for name in names[2:])])


def record(scenario: Scenario, controller: Controller, x: Array, samples: int, plans: int) -> dict[str, Any]:
    """What samples of three kinds and plans say at x (n,)."""
    lam = scenario.problem.temperature
    batches = batches_at(controller, x)
    said = {kind: psi_of(controller.path_integral, batches[kind], samples, 1 + k) for k, kind in enumerate(KINDS)}
    truth = said["guided"]
    v = -lam * truth.log_psi
    out: dict[str, Any] = {
        "scene": scenario.loaded.scene.name, "x": x.tolist(), "noise": scenario.settings.noise,
        "clearance": scenario.space.clearance(x), "speed": float(np.hypot(*scenario.problem.dynamics.f(x)[:2])),
        "classes": len(batches["tapes"].proposals), "v": v, "v_error": lam * truth.error,
        "claims_enough": all(said[kind].ess >= 100.0 for kind in KINDS),
    }  # fmt: skip
    for kind, one in said.items():
        out[kind] = {
            "share": lam * (truth.log_psi - one.log_psi) / v, "error": lam * one.error / v, "ess": one.ess,
            "log_psi": one.log_psi, "log_error": one.error, "samples": one.samples,
        }  # fmt: skip
    made = [plan for plan in (first_plan(controller, x) for _ in range(plans)) if plan is not None]
    off = np.array([plan["v"] - v for plan in made] or [np.nan]) / v
    claimed = np.array([plan["v_error"] for plan in made] or [np.nan]) / v
    rms, claim = (float(np.sqrt(np.mean(np.square(some)))) for some in (off, claimed))
    return out | {"plans": {"bias": float(np.mean(off)), "rms": rms, "claimed": claim, "without": plans - len(made)}}


def batches_at(controller: Controller, x: Array) -> dict[str, Batch]:
    """What samples of each of KINDS from x (n,) follow; their numbers are shares only."""
    assert controller.tree is not None
    controller.begin(x)
    references = controller.tree.references(x)
    guided = controller.batch(x, references)
    tapes = [Tape(guided.times, reference.trajectory.tape(guided.times)) for reference in references]
    first = guided.proposals[: len(tapes)]  # what is sampled beside a reference's guide comes after them
    held = [replace(one, lead=tape, count=1) for one, tape in zip(first, tapes, strict=True)]
    out = {"guided": guided, "tapes": replace(guided, proposals=tuple(held))}
    led = sorted(
        (one for one in guided.proposals if isinstance(one.lead, LinearFeedback)),
        key=lambda one: one.lead.guide.penalised,  # type: ignore[attr-defined]
    )
    if not led:
        return out | {"crossed": out["tapes"]}
    other = led[1] if len(led) > 1 else _aside(led[0])
    shares = round(len(held) * (1.0 - TAPES) / TAPES)
    return out | {"crossed": replace(guided, proposals=(replace(other, count=shares), *held))}


def _aside(proposal: Proposal) -> Proposal:
    """The same around a guide beside its own."""
    assert isinstance(proposal.lead, LinearFeedback)
    guide = proposal.lead.guide
    return replace(
        proposal, lead=LinearFeedback(replace(guide, states=guide.states + ASIDE, gains=WEAKER * guide.gains))
    )


def psi_of(integral: PathIntegral, batch: Batch, samples: int, seed: int) -> Psi:
    """psi by so many samples of a batch, whose own numbers tell how they are shared out; equal seeds, equal answers."""
    shares = np.array(batch.counts) / sum(batch.counts)
    parts = max(1, round(samples / PART))
    counts = np.maximum(2, 2 * np.rint(0.5 * shares * samples / parts)).astype(int)
    sums, top, n = np.zeros(2), -np.inf, int(parts * counts.sum())
    for part in range(parts):
        weights = integral.rollout(batch.counting(list(counts)), 1000 * seed + part).log_weight
        most = max(top, float(weights.max()))
        if not np.isfinite(most):
            continue
        sums *= np.exp(max(top - most, LOST) * np.array([1.0, 2.0])) if np.isfinite(top) else 0.0
        w, top = np.exp(np.maximum(weights - most, LOST)), most
        sums += w.sum(), np.square(w).sum()
    if not np.isfinite(top):
        return Psi(log_psi=-np.inf, error=np.inf, ess=0.0, samples=n)
    mean = sums[0] / n
    error = np.sqrt(max(sums[1] / n - mean**2, 0.0) / n) / mean
    return Psi(log_psi=top + float(np.log(mean)), error=float(error), ess=float(sums[0] ** 2 / sums[1]), samples=n)


def _text(one: dict[str, Any]) -> list[str]:
    tapes, crossed, plans = (one[key] for key in (*KINDS[1:], "plans"))
    return [
        one["scene"], f"{one['clearance']:.3f}", f"{one['speed']:.2f}", str(one["classes"]),
        f"{one['v']:.4f}", f"{one['v_error']:.4f}",
        f"{100 * tapes['share']:+.3f}", f"{100 * tapes['error']:.3f}",
        f"{100 * crossed['share']:+.3f}", f"{100 * crossed['error']:.3f}",
        *(f"{one[kind]['ess']:.0f}" for kind in KINDS),
        f"{100 * plans['bias']:+.2f}", f"{100 * plans['rms']:.2f}", f"{100 * plans['claimed']:.2f}",
    ]  # fmt: skip
