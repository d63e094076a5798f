"""Prepare a scenario from a scene and options; without a margin, noise and clearance decide, or a risk."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene, Waiver
from pirrht.problem import Problem
from sim.mjcf import load
from sim.mjcf.footprint import collision_of
from sim.scenario.risk import RiskSearch
from sim.scenario.scenario import Scenario, unseen
from sim.settings import BY_SCENE, BY_SETTING, SceneOptions, resolve
from sim.states import adapter_of
from sim.systems import chosen, named, refuse
from sim.text import suggestion

AMONG = 0.8  # H_limit among moving obstacles, if not given: waiting for one winds about it meanwhile
REACTION = 0.01  # how long feedback takes to answer noise [s]
DEVIATIONS = 3.0  # of the robot's place after that time without control
LEAST = 0.01  # margin [m]: contacts and servos are not exact either
SHARE = 0.25  # of the clearance that the robot has in the narrowest passage, at the start and at the goal point
OPEN = 2.0  # times the margin is the clearance at both ends of a passage with a disc of its own
DISC = 1.25  # radius of this disc, in distances of the farther end from the middle
STEPS = 20  # of a time, by which noise adds up
MAPPED = 1000  # vertices of the tree of a map at most, if not given: every new map grows another one
UNMAPPED = 1.5  # H_limit at least without a map, if not given: where a way is shut, back is around what is known
GRAIN = 1.0  # of a cell, by which clearances in a map may be too low: less takes longer
WORTH = 2e-3  # a smaller margin is none [m]


def prepare(
    scene: str | Path, *, given: Mapping[str, Any] | None = None, loose: bool = False, driven: bool = True,
    room: Callable[[Scene], Scene] | None = None, pause: Callable[[], None] = lambda: None, **options: Any,
) -> Scenario:  # fmt: skip
    """Load a scene and decide everything that a run needs.

    Args:
        given, options: fields of `SceneOptions` and `Settings`, None where the scene, the preset or the robot decides;
            `system` is MODULE:NAME or one that is registered.
        loose: whether static obstacles can be moved (`sim.mjcf.load`).
        driven: whether a robot that its plant cannot drive is refused.
        room: makes another scene of the one that is read, which the robot is put into without a margin.
        pause: called before each margin of a search; what it raises ends that.

    Raises:
        SceneError, OptionError, NotLinearlySolvable: with one line for a person.
    """
    given = {**(given or {}), **options}
    for name in given.keys() - {*BY_SCENE, *BY_SETTING}:
        known = sorted([*BY_SCENE, *BY_SETTING])
        fit = suggestion(name, known) or f"; those are {', '.join(known)}"
        raise OptionError(f"prepare: {name!r} is no option{fit}")
    task = SceneOptions(**{name: given.get(name) for name in BY_SCENE})
    system = None if task.system is None else chosen(task.system)
    read = partial(load, scene, loose=loose, **{name: getattr(task, name) for name in BY_SCENE} | {"system": system})
    loaded = read()
    kind = named(loaded.dynamics_name)
    overlay = kind.preset(task.preset)
    refuse(kind, given)
    base = replace(kind.settings, limit=AMONG) if loaded.scene.movers and loaded.scene.dimension == 2 else kind.settings
    settings = resolve(base, kind.heard(loaded.scene.defaults, loaded.meant), overlay, given)
    if settings.sense == "lidar":
        limit = settings.limit if given.get("limit") is not None else max(settings.limit, UNMAPPED)
        vertices = settings.vertices if given.get("vertices") is not None else min(settings.vertices, MAPPED)
        settings = replace(settings, limit=limit, vertices=vertices)

    def at(margin: float | None, narrow: tuple[Waiver, ...] = (), **changes: Any) -> Scenario:
        pause()
        own = loaded if margin is None else read(margin=margin)
        numbers = replace(settings, **changes)
        scene = own.scene if room is None else room(own.scene)
        own = replace(own, scene=replace(scene, narrow=narrow))
        problem = kind.problem(own.scene, numbers)
        known = own.scene
        grain = None
        if numbers.sense == "lidar":
            known = unseen(known)
            grain = GRAIN * numbers.cell
        return Scenario(
            loaded=own, system=kind, settings=numbers,
            problem=problem if grain is None else kind.problem(known, numbers), real=None if grain is None else problem,
            space=FreeSpace.of(known, grain), margin=own.margin if margin is None else margin,
            widens=given.get("limit") is None and "limit" not in overlay,
        )  # fmt: skip

    if room is not None:
        return at(None)
    start = loaded.scene.start
    if driven and loaded.scene.goal.contains(start[loaded.adapter.position]):
        raise SceneError(f"the start {loaded.adapter.text(start, 4)} is already in the goal; move one of them")
    if settings.risk is not None:
        if task.margin is not None:
            raise OptionError("--risk chooses the margin; leave out --margin")
        search = RiskSearch(at, settings.risk)
        scenario = search.result(stop=settings.risk_infeasible == "stop")
    else:
        scenario = at(None)
        if task.margin is None and "margin" not in loaded.scene.defaults:
            own, narrow = default_margin(scenario)
            scenario = at(own, narrow) if own > 0.0 else scenario
    if driven:
        scenario.plant()
    return scenario


def default_margin(scenario: Scenario) -> tuple[float, tuple[Waiver, ...]]:
    """Return the margin [m] for a scenario without one, and discs around narrow passages in which less counts.

    It is three standard deviations of the place that noise alone moves the robot to before it reacts. It takes no more
    than a quarter of the clearance at the start and goal and, in its disc, of a narrow passage: so no class is lost.
    Where such a passage does not open within its axis, or obstacles move, it counts everywhere. A margin of 0: there
    is no clearance for one.
    """
    s = scenario.settings
    problem = scenario.problem
    space = scenario.space
    scene = scenario.space.scene

    states = scenario.system.adapter
    start = scene.start[states.position]
    ends = space.collision.clearance(np.array([start, scene.goal.center]))
    if not scene.footprint.is_disc:
        ends[0] = collision_of(scene.world, scene.footprint).clearance(scene.start[None])[0]
    if scene.goal is not problem.scene.goal:  # its centre is covered, and plans lead to what is free with the margin
        ends = ends[:1]
    if scene.movers:
        ends = np.append(ends, space.moving.distance(start if scene.footprint.is_disc else scene.start, 0.0))
    passages = space.passages()
    kept = SHARE * np.maximum(0.5 * passages.width - scene.robot_radius, 0.0)  # in each of them
    spread = deviation(problem, s.period if s.between == "hold" else REACTION)
    margin = min(max(LEAST, DEVIATIONS * spread), SHARE * float(ends.min()))
    opens = (passages.opening > OPEN * margin) & (not scene.movers)
    margin = round(min(margin, float(kept[~opens].min(initial=np.inf))), 4)
    if margin <= WORTH:
        return 0.0, ()
    narrow = np.flatnonzero(opens & (kept < margin))
    discs = np.column_stack([passages.place, DISC * passages.extent, margin - kept])[narrow]
    return margin, tuple(Waiver(*disc) for disc in discs.tolist())


def deviation(problem: Problem, time: float) -> float:
    """Return the standard deviation of the place after a time [s] from the start, along its worst direction [m]."""
    d, h, shift = problem.dynamics, time / STEPS, 1e-4
    start = d.state_of(problem.scene.start)
    still = np.zeros(d.m)

    def slopes(step: Callable[[Array], Array], n: int) -> Array:
        return np.array([step(e) - step(-e) for e in shift * np.eye(n)]).T / (2.0 * shift)

    A = slopes(lambda e: d.step(start + e, still, still, h), d.n)
    B = slopes(lambda e: d.step(start, still, e, h), d.m)
    P = np.zeros((d.n, d.n))
    for _ in range(STEPS):
        P = A @ P @ A.T + h * B @ B.T
    position = adapter_of(d.states).position
    return float(np.sqrt(np.linalg.eigvalsh(P[position, position])[-1]))
