"""Prepare a scenario from a scene and options; without a margin, noise and clearance decide, or a risk."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import NoReference, OptionError, SceneError
from pirrht.estimation.risk import CollisionProbability
from pirrht.formatting import percent
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import find_passages
from pirrht.geometry.scene import Scene
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from sim.mjcf import load
from sim.scenario.scenario import Scenario
from sim.settings import BY_SCENE, BY_SETTING, SceneOptions, resolve
from sim.systems import chosen, named, refuse

AMONG = 0.8  # H_limit among moving obstacles, if not given: waiting for one winds about it meanwhile
REACTION = 0.01  # how long feedback takes to answer noise [s]
DEVIATIONS = 3.0  # of the robot's place after that time without control
LEAST = 0.01  # margin [m]: contacts and servos are not exact either
SHARE = 0.25  # of the clearance that the robot has in the narrowest passage, at the start and at the goal point
STEPS = 20  # of a time, by which noise adds up
WORTH = 2e-3  # a smaller margin is none [m]
PREDICTED = ("pi-rrht", "optimal")  # methods whose law is that of the prediction
ROUNDS = 8  # margins that are tried under --risk
FINEST = 1e-4  # margins are whole multiples of this [m]
WIDEST = 4.0  # of margins that are weighed at once, in deviations of a held step: it removes all but 1e-9 of the risk
RESERVE = 2.0  # by which predictions can be too low: 2.3 in the worst of 120 cells (`benchmark.py risk`)
ACCEPTED = 0.1  # of a risk: most that a finite final cost accepts
DRAWN, MOST_DRAWN = 4, 10_000  # times the samples of a plan, since it is made once per run; and at most


def prepare(
    scene: str | Path, *, given: Mapping[str, Any] | None = None, loose: bool = False, driven: bool = True,
    room: Callable[[Scene], Scene] | None = None, **options: Any,
) -> Scenario:  # fmt: skip
    """Load a scene and decide everything that a run needs.

    Args:
        given, options: fields of `SceneOptions` and `Settings`, None where the scene, the preset or the robot decides;
            `system` is MODULE:NAME or one that is registered.
        loose: whether static obstacles can be moved (`sim.mjcf.load`).
        driven: whether a robot that its plant cannot drive is refused.
        room: makes another scene of the one that is read, which the robot is put into without a margin.

    Raises:
        SceneError, OptionError, NotLinearlySolvable: with one line for a person.
    """
    given = {**(given or {}), **options}
    for name in given.keys() - {*BY_SCENE, *BY_SETTING}:
        like = get_close_matches(name, [*BY_SCENE, *BY_SETTING], n=1)
        fit = f"did you mean {like[0]}" if like else f"those are {', '.join(sorted([*BY_SCENE, *BY_SETTING]))}"
        raise OptionError(f"prepare: {name!r} is no option; {fit}")
    task = SceneOptions(**{name: given.get(name) for name in BY_SCENE})
    system = None if task.system is None else chosen(task.system)
    read = partial(load, scene, loose=loose, **{name: getattr(task, name) for name in BY_SCENE} | {"system": system})
    loaded = read()
    kind = named(loaded.dynamics_name)
    overlay = kind.preset(task.preset)
    refuse(kind, given)
    base = replace(kind.settings, limit=AMONG) if loaded.scene.movers else kind.settings
    settings = resolve(base, kind.heard(loaded.scene.defaults, loaded.meant), overlay, given)

    def at(margin: float | None, **changes: Any) -> Scenario:
        own, numbers = loaded if margin is None else read(margin=margin), replace(settings, **changes)
        if room is not None:
            own = replace(own, scene=room(own.scene))
        return Scenario(
            loaded=own, system=kind, settings=numbers, problem=kind.problem(own.scene, numbers),
            space=FreeSpace.of(own.scene), margin=own.margin if margin is None else margin,
            widens=given.get("limit") is None and "limit" not in overlay,
        )  # fmt: skip

    if room is not None:
        return at(None)
    if settings.risk is not None:
        if task.margin is not None:
            raise OptionError("--risk chooses the margin; leave out --margin")
        scenario = within_risk(at, settings.risk, stop=settings.risk_infeasible == "stop")
    else:
        scenario = at(None)
        if task.margin is None and "margin" not in loaded.scene.defaults and (own := default_margin(scenario)) > 0.0:
            scenario = at(own)
    if driven:
        scenario.plant()
    return scenario


def default_margin(scenario: Scenario) -> float:
    """Return the margin [m] for a scenario without one; 0 where there is no clearance for it.

    It is three standard deviations of the place that noise alone moves the robot to before it reacts, and takes no more
    than a quarter of the clearance anywhere, so that no class is lost.
    """
    s, problem, space, scene = scenario.settings, scenario.problem, scenario.space, scenario.space.scene
    ends = space.collision.clearance(np.array([scene.start[:2], scene.goal.center[:2]]))
    if scene.goal is not problem.scene.goal:  # its centre is covered, and plans lead to what is free with the margin
        ends = ends[:1]
    if scene.movers:
        ends = np.append(ends, space.moving.distance(scene.start[:2], 0.0))
    widths = find_passages(space.field, space.collision).width
    clearance = min(float(ends.min()), 0.5 * float(widths.min(initial=np.inf)) - scene.robot_radius)
    spread = deviation(problem, s.period if s.between == "hold" else REACTION)
    margin = min(max(LEAST, DEVIATIONS * spread), SHARE * clearance)
    return round(margin, 4) if margin > WORTH else 0.0


def deviation(problem: Problem, time: float) -> float:
    """Return the standard deviation of the place after a time [s] from the start, along its worst direction [m]."""
    d, h, shift = problem.dynamics, time / STEPS, 1e-4
    start, still = d.state_of(problem.scene.start), np.zeros(d.m)

    def slopes(step: Callable[[Array], Array], n: int) -> Array:
        return np.array([step(e) - step(-e) for e in shift * np.eye(n)]).T / (2.0 * shift)

    A, B = slopes(lambda e: d.step(start + e, still, still, h), d.n), slopes(lambda e: d.step(start, still, e, h), d.m)
    P = np.zeros((d.n, d.n))
    for _ in range(STEPS):
        P = A @ P @ A.T + h * B @ B.T
    return float(np.sqrt(np.linalg.eigvalsh(P[:2, :2])[-1]))


def predicted(
    scenario: Scenario, margins: Sequence[float] = (0.0,), tree: HomologyTree | None = None
) -> list[CollisionProbability]:
    """Predict the probability of a collision by one plan at the start, for margins besides the scenario's own [m].

    The tree is grown if it is not given. Empty: nothing is predicted (`Scenario.collisions`).
    """
    if not scenario.predicts_collisions:
        return []
    many = scenario.with_settings(samples=min(DRAWN * scenario.settings.samples, MOST_DRAWN), method="pi-rrht")
    driver = many.controller(tree or many.grown_tree())
    driver.begin(many.start)
    plan = driver.plan(many.start)
    return [one for more in margins if (one := many.collisions(plan, more)) is not None]


def within_risk(at: Callable[..., Scenario], risk: float, *, stop: bool) -> Scenario:
    """Return the scenario of the least margin whose upper bound of the probability of a collision is at most `risk`.

    Predictions count RESERVE times: they take walls as flat, and the law as the optimal one. The next margin is chosen
    by the samples of the plan with the last one: from their walls the true ones move away. A final cost with which the
    law accepts more than a share ACCEPTED of the risk is raised.

    Args:
        at: makes the scenario with a margin [m] and settings by name.
        stop: whether OptionError is raised if no margin keeps the risk; else the one that comes nearest is taken.
    """
    scenario, margin, wide, closed, phi, note = at(0.0), 0.0, 0.0, math.inf, dict[str, float](), ""
    if not scenario.predicts_collisions or scenario.settings.method not in PREDICTED:
        raise OptionError(f"--risk takes --exit bridge and a method of {', '.join(PREDICTED)}; others take --margin")
    spread = scenario.problem.dynamics.position_spread(scenario.start)
    more = np.arange(0.0, WIDEST * spread * math.sqrt(scenario.held) + FINEST, FINEST).tolist()
    tried: list[tuple[CollisionProbability, Scenario]] = []
    for _ in range(ROUNDS):
        try:
            scenario = at(margin, **phi) if margin or phi else scenario
            found = predicted(scenario, more)
        except (NoReference, SceneError):  # no way is as wide as that
            if not tried:
                raise
            found = []
        if not (found or tried) and not stop:
            return replace(scenario, risk_note="not predicted")
        if not (found or tried):
            raise OptionError("--risk: no sample of a plan at the start reaches the goal, so that no probability of a "
                              "collision is predicted: try more --samples, or --risk-infeasible best")  # fmt: skip
        if found and not phi and found[0].accepted_most > ACCEPTED * risk:
            phi["phi"] = found[0].goal_value - scenario.problem.temperature * math.log(ACCEPTED * risk / 2.0)
            note = f"with phi raised to {phi['phi']:.4g}"
            continue
        if not found:
            closed = margin
        elif RESERVE * found[0].most <= risk:
            return replace(scenario, risk_note=note)
        else:
            tried.append((found[0], scenario))
            keep = (m for m, one in zip(more, found, strict=True) if RESERVE * one.most <= risk)
            wide, enough = margin, next(keep, more[-1])
        margin = round(wide + enough if wide + enough < closed else 0.5 * (wide + closed), 4)
        if margin in (wide, closed):
            break
    one, nearest = min(tried, key=lambda found: found[0].most)
    least = f"{percent(min(1.0, RESERVE * one.most))} at most, by class {one.safest()}"
    if stop:
        raise OptionError(
            f"--risk is {risk:g}; no margin that leaves a way keeps it. Nearest comes one of "
            f"{1e3 * nearest.margin:.2g} mm with {least}: allow more, or --risk-infeasible best"
        )
    return replace(nearest, risk_note=f"not kept: {least}")
