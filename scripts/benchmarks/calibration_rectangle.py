"""A unicycle of 1 m x 0.4 m at random states of random rooms, whose wall has a gap that one direction fits.

Plans are compared with the exact solution on (x, y, heading): the share of v and of u within one and two of the
standard errors that the same plan claims, and beyond three. Biases are means over states, with the scatter of the
states as their standard errors; that of u is along u*.
"""

import argparse
import time
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

FOOTPRINT = Footprint.rectangle(1.0, 0.4)
WIDTH, HEIGHT, WALL = 4.5, 3.0, 2.2  # of a room, and place of its wall [m]
GAPS = (0.5, 0.7)  # widths of gaps [m]: less than the rectangle's length, or the diagonal of 1.08 m
NOISES = (0.6,)
RHO = 0.5  # turning radius at 1 m/s [m]
ROOMS, STATES, PLANS, SAMPLES, VERTICES = 6, 8, 10, 1000, 1500
MARGIN = 0.05  # clearance of a state at least [m]
HEADER = ["b, room", "states", "plans", "v in 1", "in 2", "over 3", "u in 1", "in 2", "over 3"]
HEADER += ["v bias", "its s.e.", "u bias", "its s.e.", "ESS", "none", "exact s"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    states = []
    for noise in options.noises or NOISES:
        for seed in range(options.first_seed, options.first_seed + (options.scenes or ROOMS)):
            states += _room(seed, noise, options.states or STATES, options.plans or PLANS)
    values = [{"noise": b, "room": name, **_summary(some)} for b, name, some in by_noise_and_scene(states)]
    return HEADER, [_text(row) for row in values], {"table": values, "states": states}


def room(seed: int) -> Scene:
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
    return Scene.from_boxes(boxes, lower=(0.0, 0.0), footprint=FOOTPRINT, **ends)


def _room(seed: int, noise: float, count: int, plans: int) -> list[dict[str, Any]]:
    """Records of states of a room; each plan begins a drive of its own."""
    problem = Problem(scene=room(seed), dynamics=Unicycle(V=1.0, rho=RHO, b=noise), R=np.eye(1), q=1.0)
    space = FreeSpace.of(problem.scene)
    began = time.perf_counter()
    truth = Desirability.of(problem, space)
    seconds = time.perf_counter() - began
    tree = grown_tree(space, Dubins.of(problem), problem.scene.start, vertices=VERTICES, limit=0.8, seed=seed)
    rng = np.random.default_rng([seed, 63])
    low, high = np.append(problem.scene.lower, -np.pi), np.append(problem.scene.upper, np.pi)
    drawn = (x for x in rng.uniform(low, high, (400 * count, 3)) if space.clearance(x) > MARGIN)
    states = with_references(tree, (x for x in drawn if not problem.scene.goal.contains(x[:2])), count)
    controller = Controller(problem, space, tree, Sampling(samples=SAMPLES), rng=np.random.default_rng(seed))
    return [{"scene": f"room{seed}", "noise": noise, "seconds": seconds, **_record(truth, controller, x, plans)}
            for x in states]  # fmt: skip


def _record(truth: Desirability, controller: Controller, x: Array, plans: int) -> dict[str, Any]:
    made = [plan for plan in (first_plan(controller, x) for _ in range(plans)) if plan is not None]
    u = truth.control(x)
    return {"x": x.tolist(), "v": float(truth.value(x)), "u": u.tolist(), "plans": made, "without": plans - len(made)}


def _summary(states: list[dict[str, Any]]) -> dict[str, Any]:
    some, found = [s for s in states if s["plans"]], dict[str, Any]()
    found |= {"states": len(states), "plans": sum(len(s["plans"]) for s in some), "exact_s": states[0]["seconds"]}
    for key in "vu":
        off = [np.array([np.ravel(p[key]) for p in s["plans"]]) - np.ravel(s[key]) for s in some]
        errors = [np.array([np.ravel(p[f"{key}_error"]) for p in s["plans"]]) for s in some]
        score = np.abs(np.concatenate(off)) / np.maximum(np.concatenate(errors), 1e-300)
        along = [o * (np.sign(s["u"]) if key == "u" else 1.0) for o, s in zip(off, some, strict=True)]
        bias = np.array([o.mean() for o in along])
        found |= {f"{key}1": np.mean(score <= 1), f"{key}2": np.mean(score <= 2), f"{key}3": np.mean(score > 3)}
        found |= {f"{key}_bias": bias.mean(), f"{key}_bias_error": bias.std() / np.sqrt(len(bias))}
    found["ess"] = np.median([p["ess"] for s in some for p in s["plans"]])
    return {name: float(value) for name, value in found.items()} | {"without": sum(s["without"] for s in states)}


def _text(row: dict[str, Any]) -> list[str]:
    shares = [f"{100 * row[f'{key}{k}']:.1f}" for key in "vu" for k in (1, 2, 3)]
    biases = [f"{row[f'{key}_bias{error}']:+.4f}" for key in "vu" for error in ("", "_error")]
    counts = [f"{row['states']:.0f}", f"{row['plans']:.0f}"]
    ends = [f"{row['ess']:.0f}", str(row["without"]), f"{row['exact_s']:.0f}"]
    return [f"{row['noise']:g}, {row['room']}", *counts, *shares, *biases, *ends]
