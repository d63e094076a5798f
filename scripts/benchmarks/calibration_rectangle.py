"""A unicycle of 1 m x 0.4 m at random states of random rooms, whose wall has a gap that one direction fits.

A disc as wide goes through the same rooms. Plans are compared with the exact solution on (x, y, heading): the share of
v and of u within one and two of the standard errors that the same plan claims, and beyond three. The grid's own error,
the difference between the default spacing and half of it, as if of first order, is added in quadrature.
Biases are means over states, with the scatter of the states as their standard errors; that of u is along u*.
"""

import argparse
import time
from itertools import product
from typing import Any

import numpy as np
from benchmarks.calibration_table import by_noise_and_scene
from benchmarks.first_plan import first_plan
from benchmarks.scenes import with_references

from pirrht import (
    Controller,
    Desirability,
    Dubins,
    Footprint,
    FreeSpace,
    Problem,
    Sampling,
    Scene,
    Unicycle,
    grown_tree,
)
from pirrht.arrays import Array
from pirrht.steering.steering import Steering

FOOTPRINTS = {"1 x 0.4": Footprint.rectangle(1.0, 0.4), "disc": Footprint.disc(0.2)}
SPACINGS = (1.0, 0.5)  # of the exact solution, as shares of the default
WIDTH, HEIGHT, WALL = 4.5, 3.0, 2.2  # of a room, and place of its wall [m]
GAPS = (0.5, 0.7)  # widths of gaps [m]: less than the rectangle's length, or the diagonal of 1.08 m
NOISES = (0.6,)
RHO = 0.5  # turning radius at 1 m/s [m]
ROOMS, STATES, PLANS, SAMPLES, VERTICES = 6, 8, 10, 1000, 1500
MARGIN = 0.05  # clearance of a state at least [m]
HEADER = ["b, room", "states", "plans", "v in 1", "in 2", "over 3", "u in 1", "in 2", "over 3"]
HEADER += ["v bias", "its s.e.", "u bias", "its s.e.", "ESS", "none", "grid", "exact s"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    states = []
    for noise, footprint in product(options.noises or NOISES, FOOTPRINTS):
        for seed in range(options.first_seed, options.first_seed + (options.scenes or ROOMS)):
            states += _room(seed, noise, footprint, options.states or STATES, options.plans or PLANS)
    return table(states)


def table(states: list[dict[str, Any]]) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of records."""
    values = [{"noise": b, "room": name, **_summary(some)} for b, name, some in by_noise_and_scene(states)]
    return HEADER, [_text(row) for row in values], {"table": values, "states": states}


def room(seed: int, footprint: Footprint) -> Scene:
    """A wall with a gap, and a box on either side."""
    rng = np.random.default_rng([seed, 62])
    width = rng.uniform(*GAPS)
    low = rng.uniform(0.6, HEIGHT - 0.6 - width)
    start, goal = (0.8, rng.uniform(1.0, 2.0), 0.0), (3.8, rng.uniform(0.8, 2.2), 0.35)
    boxes = [(WALL, -1.0, WALL + 0.15, low), (WALL, low + width, WALL + 0.15, HEIGHT + 1.0)]
    side = rng.uniform(0.1, 0.3)
    y = rng.choice([0.2, HEIGHT - 0.2 - side])
    boxes.append((1.0, y, 1.0 + side, y + side))
    ends = {"start": start, "goal": goal, "upper": (WIDTH, HEIGHT)}
    return Scene.from_boxes(boxes, lower=(0.0, 0.0), footprint=footprint, **ends)


def _room(seed: int, noise: float, name: str, count: int, plans: int) -> list[dict[str, Any]]:
    """Records of states of a room."""
    car = Unicycle(V=1.0, rho=RHO, b=noise)
    problem = Problem(scene=room(seed, FOOTPRINTS[name]), dynamics=car, R=np.eye(1), q=1.0)
    of = {"scene": f"{name}, room{seed}", "noise": noise}
    given = {"limit": 0.8, "spacings": SPACINGS, "sampling": Sampling(samples=SAMPLES)}
    return [of | one for one in records(problem, Dubins.of(problem), seed, count, plans, **given)]


def records(
    problem: Problem, steering: Steering, seed: int, count: int, plans: int, *, limit: float, sampling: Sampling,
    spacings: tuple[float, float],
) -> list[dict[str, Any]]:  # fmt: skip
    """Records of states; each plan begins a drive of its own, the truth is of two `spacings`, shares of the default."""
    space = FreeSpace.of(problem.scene)
    began = time.perf_counter()
    spacing = Desirability.spacing_for(problem, space)
    truths = [Desirability.of(problem, space, spacing=share * spacing) for share in spacings]
    seconds = time.perf_counter() - began
    tree = grown_tree(space, steering, problem.scene.start, vertices=VERTICES, limit=limit, seed=seed)
    rng = np.random.default_rng([seed, 63])
    low, high = problem.dynamics.box(problem.scene)
    drawn = (x for x in rng.uniform(low, high, (400 * count, problem.dynamics.n)) if space.clearance(x) > MARGIN)
    states = (x for x in drawn if not problem.scene.goal.contains(problem.dynamics.place(x)))
    controller = Controller(problem, space, tree, sampling, rng=np.random.default_rng(seed))
    return [{"seconds": seconds} | _record(truths, controller, x, plans) for x in with_references(tree, states, count)]


def _record(truths: list[Desirability], controller: Controller, x: Array, plans: int) -> dict[str, Any]:
    made = [plan for plan in (first_plan(controller, x) for _ in range(plans)) if plan is not None]
    coarse, fine = ({"v": float(truth.value(x)), "u": truth.control(x)} for truth in truths)
    grid = {f"{key}_grid": np.abs(coarse[key] - fine[key]) for key in "vu"}
    known = {key: np.asarray(one).tolist() for key, one in (fine | grid).items()}
    return {"x": x.tolist(), "plans": made, "without": plans - len(made), **known}


def _summary(states: list[dict[str, Any]]) -> dict[str, Any]:
    some, found = [s for s in states if s["plans"]], dict[str, Any]()
    found |= {"states": len(states), "plans": sum(len(s["plans"]) for s in some), "exact_s": states[0]["seconds"]}
    for key in "vu":
        off = [np.array([np.ravel(p[key]) for p in s["plans"]]) - np.ravel(s[key]) for s in some]
        errors = [np.hypot([np.ravel(p[f"{key}_error"]) for p in s["plans"]], s[f"{key}_grid"]) for s in some]
        score = np.abs(np.concatenate(off)) / np.maximum(np.concatenate(errors), 1e-300)
        along = [o * (np.sign(s["u"]) if key == "u" else 1.0) for o, s in zip(off, some, strict=True)]
        bias = np.array([o.mean() for o in along])
        found |= {f"{key}1": np.mean(score <= 1), f"{key}2": np.mean(score <= 2), f"{key}3": np.mean(score > 3)}
        found |= {f"{key}_bias": bias.mean(), f"{key}_bias_error": bias.std() / np.sqrt(len(bias))}
    found["grid"] = np.median([s["v_grid"] for s in some])
    found["ess"] = np.median([p["ess"] for s in some for p in s["plans"]])
    return {name: float(value) for name, value in found.items()} | {"without": sum(s["without"] for s in states)}


def _text(row: dict[str, Any]) -> list[str]:
    shares = [f"{100 * row[f'{key}{k}']:.1f}" for key in "vu" for k in (1, 2, 3)]
    biases = [f"{row[f'{key}_bias{error}']:+.4f}" for key in "vu" for error in ("", "_error")]
    counts = [f"{row['states']:.0f}", f"{row['plans']:.0f}"]
    ends = [f"{row['ess']:.0f}", str(row["without"]), f"{row['grid']:.4f}", f"{row['exact_s']:.0f}"]
    return [f"{row['noise']:g}, {row['room']}", *counts, *shares, *biases, *ends]
