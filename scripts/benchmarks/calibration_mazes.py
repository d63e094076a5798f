"""Estimates in mazes against the exact grid: rings with doors, spirals, combs and corridors of 1.1 diameters.

A maze is a kind and a seed. Six kinds of three seeds make 18; five random states in each are asked at three noise
levels. An estimate counts as flagged if its plan says that it is in doubt: few
effective samples, a heavy tail, or a class that matters and hardly has a sample. The trees are those of `pirrht
estimate --at`, with a limit that is wide enough for the state.
"""

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np
from benchmarks.first_plan import controller_of
from benchmarks.moving_text import prepared
from benchmarks.scenes import SIDE, places_of
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.exact.desirability import Desirability
from sim.cli.tables import doubts
from sim.scenario import Scenario

RADIUS, THICK = 0.1, 0.08  # of the robot, and of walls [m]
NOISES = (0.1, 0.2, 0.3)
MAZES, STATES, FAR = 18, 5, 5.0  # an estimate is off if it is beyond FAR standard errors
HEADER = ["maze", "x", "b", "v", "v estimated", "s.e.", "in errors", "u in errors", "ESS", "flagged", "limit"]

Wall = tuple[float, float, float, float]  # from x, y to x, y [m]


def rings(rng: np.random.Generator) -> list[Wall]:
    """Two square rings around the goal, a door in each, at another place."""
    walls: list[Wall] = []
    for half in (0.8, 1.6):
        corners = 2.5 + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
        door = int(rng.integers(4))
        for side, (a, b) in enumerate(zip(corners[:-1], corners[1:], strict=True)):
            middle, gap = 0.5 * (a + b) + rng.uniform(-0.3, 0.3) * (b - a), rng.uniform(0.28, 0.5)
            along = (b - a) / np.hypot(*(b - a))
            if side == door:
                walls += [(*a, *(middle - 0.5 * gap * along)), (*(middle + 0.5 * gap * along), *b)]
            else:
                walls.append((*a, *b))
    return walls


def spiral(rng: np.random.Generator) -> list[Wall]:
    """A square spiral around the goal, of lanes 0.5 to 0.6 m wide, in one of four directions."""
    lane, a = rng.uniform(0.5, 0.6), 0.45
    b, c = a + lane, a + 2.0 * lane
    corners = np.array([[a, a], [-a, a], [-a, -a], [b, -a], [b, b], [-b, b], [-b, -b], [c, -b], [c, c]])
    turn = 0.5 * np.pi * rng.integers(4)
    points = 2.5 + corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return [(*p, *q) for p, q in zip(points[:-1], points[1:], strict=True)]


def comb(rng: np.random.Generator) -> list[Wall]:
    """Teeth from below and above in turn: a way to and fro."""
    walls: list[Wall] = []
    for k, x in enumerate(np.linspace(0.9, 4.1, 5)):
        end = rng.uniform(3.4, 4.4)
        walls.append((x, 0.0, x, end) if k % 2 else (x, SIDE, x, SIDE - end))
    return walls


def corridor(rng: np.random.Generator) -> list[Wall]:
    """A wall across with a corridor of 1.1 diameters through it and a wide gap elsewhere."""
    x, y, width, length = rng.uniform(1.8, 2.4), rng.uniform(1.5, 3.0), 2.2 * RADIUS + THICK, rng.uniform(0.4, 1.2)
    low, high = y - 0.5 * width, y + 0.5 * width
    return [
        (x, 0.5, x, low), (x, high, x, SIDE), (x, low, x + length, low), (x, high, x + length, high),
    ]  # fmt: skip


def blocks(rng: np.random.Generator) -> list[Wall]:
    """Corridors between walls that stand across and along on a lattice."""
    walls: list[Wall] = []
    for x in (1.2, 2.3, 3.4):
        for y in (1.0, 2.1, 3.2, 4.3):
            dx, dy = (0.8, 0.0) if rng.random() < 0.5 else (0.0, 0.8)
            walls.append((x - 0.5 * dx, y - 0.5 * dy, x + 0.5 * dx, y + 0.5 * dy))
    return walls


def hooks(rng: np.random.Generator) -> list[Wall]:
    """Three pockets that open away from the goal."""
    walls: list[Wall] = []
    for k in range(3):
        x, y, deep, wide = 1.3 + 1.0 * k, rng.uniform(1.2, 3.8), rng.uniform(0.5, 0.8), rng.uniform(0.4, 0.7)
        walls += [(x, y - wide, x, y + wide), (x, y - wide, x - deep, y - wide), (x, y + wide, x - deep, y + wide)]
    return walls


KINDS = (rings, spiral, comb, corridor, blocks, hooks)


def text(kind: Any, seed: int) -> str:
    """MJCF of a maze; the goal lies in its middle, or right where the maze leads there."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    goal = (2.5, 2.5) if kind in (rings, spiral) else (4.6, 2.5)
    geoms = []
    for k, (ax, ay, bx, by) in enumerate(kind(rng)):
        length, angle = np.hypot(bx - ax, by - ay), np.degrees(np.arctan2(by - ay, bx - ax))
        geoms.append(
            f'<geom name="wall {k}" type="box" pos="{(ax + bx) / 2:.4f} {(ay + by) / 2:.4f} 0.3" '
            f'size="{0.5 * (length + THICK):.4f} {0.5 * THICK} 0.3" euler="0 0 {angle:.3f}"/>'
        )
    return f"""<mujoco model="maze"><compiler angle="degree"/>
    <custom><numeric name="pirrht_radius" data="{RADIUS}"/><numeric name="pirrht_margin" data="0"/></custom>
    <worldbody>{"".join(geoms)}
    <site name="workspace" type="box" pos="2.5 2.5 0.5" size="2.5 2.5 0.5"/><site name="start" pos="0.25 2.5 0"/>
    <site name="goal" type="cylinder" pos="{goal[0]} {goal[1]} 0" size="0.25 0.01"/></worldbody></mujoco>"""


def mazes(count: int, first_seed: int) -> Iterator[tuple[str, str]]:
    """Names and texts."""
    for k in range(count):
        kind, seed = KINDS[k % len(KINDS)], first_seed + k // len(KINDS)
        yield f"{kind.__name__}{seed}", text(kind, seed)


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    found = list(records(options))
    bad = [one for one in found if one["off"] > FAR]
    silent = [one for one in bad if not one["flagged"]]
    shown = [_text(one) for one in bad]
    flagged = sum(one["flagged"] for one in found)
    last = (
        f"{len(found)} estimates, {flagged} flagged, {len(bad)} beyond {FAR:g} s.e., {len(silent)} of them not flagged"
    )
    return HEADER, [*shown, [last, *[""] * (len(HEADER) - 1)]], {"estimates": found, "silent": len(silent)}


def records(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """One record per maze, state and noise."""
    count, noises = options.scenes or MAZES, options.noises or NOISES
    for name, content in tqdm(list(mazes(count, options.first_seed)), "mazes", leave=False, disable=None):
        quiet = prepared(name, content, given={"seed": options.first_seed})
        truths = {b: Desirability.of(quiet.with_settings(noise=b).problem, quiet.space) for b in noises}
        for x in places_of(quiet.space, options.states or STATES, options.first_seed, None):
            tree = quiet.grown_tree(at=x)
            for b in noises:
                scenario = quiet.with_settings(noise=b)
                yield {"maze": name, "limit": tree.limit, **record(scenario, truths[b], tree, x)}


def record(scenario: Scenario, truth: Desirability, tree: Any, x: Array) -> dict[str, Any]:
    """What one plan says at x (2,), and what is true there."""
    controller = controller_of(scenario, tree)
    controller.begin(x)
    plan = controller.plan(x)
    e: Estimate | None = plan.estimate
    value, u = float(truth.value(x)), truth.control(x)
    if e is None:
        return {
            "x": x.tolist(), "noise": scenario.settings.noise, "v": value, "said": None, "error": None, "off": 0.0,
            "u_off": 0.0, "ess": 0.0, "flagged": True,
        }  # fmt: skip
    off = abs(e.value - value) / max(e.value_error, 1e-9)
    u_off = float(np.max(np.abs(e.control - u) / np.maximum(e.control_error, 1e-9)))
    said = doubts([e], plan.references, scenario.problem.temperature, None)
    return {
        "x": x.tolist(), "noise": scenario.settings.noise, "v": value, "said": e.value, "error": e.value_error,
        "off": max(off, u_off), "v_off": off, "u_off": u_off, "ess": e.ess, "flagged": bool(said),
    }  # fmt: skip


def _text(one: dict[str, Any]) -> list[str]:
    return [
        one["maze"], f"{one['x'][0]:.3f} {one['x'][1]:.3f}", f"{one['noise']:g}", f"{one['v']:.4f}",
        f"{one['said']:.4f}", f"{one['error']:.4f}", f"{one['v_off']:.1f}", f"{one['u_off']:.1f}", f"{one['ess']:.0f}",
        "yes" if one["flagged"] else "no", f"{one['limit']:g}",
    ]  # fmt: skip
