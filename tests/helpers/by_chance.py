"""References in space and time of a point, one per class: the cheapest of many straight pieces drawn at random."""

from __future__ import annotations

import math

import numpy as np
from guides import best

from pirrht.arrays import Array
from pirrht.estimation.sampler import PathIntegral
from pirrht.jit.jit import kernel
from pirrht.jit.streams import stream, uniform
from pirrht.moving.exits import begin, sweep, watch
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide, LinearFeedback, straight
from pirrht.proposals.proposal import Batch, Proposal, Tape
from pirrht.rollouts.first_exit import COLLISION, sweep_exit
from pirrht.steering.motion import Trajectory
from pirrht.topology.signature import class_id

DRAWN = 40_000
ASIDE = 12.0  # classes whose cheapest costs so many lambda more than the cheapest count for nothing


@kernel
def _draw(setup, x, t, q, r, low, high, seed, paths, cost):  # type: ignore[no-untyped-def]
    """Fill paths (S, 4, 3) [m, m, s] from (x, t) over two places to the goal point, and their costs (S,)."""
    notes, best = watch(setup.world.moving), math.sqrt(2.0 * q / r)
    for s in range(cost.shape[0]):
        begin(notes)
        draws, path = stream(seed, s), paths[s]
        path[0, 0], path[0, 1], path[0, 2] = x[0], x[1], t
        path[3, 0], path[3, 1] = setup.world.goal
        draws, some = uniform(draws)
        draws, u = uniform(draws)
        draws, v = uniform(draws)
        path[1, 0], path[1, 1] = low[0] + u * (high[0] - low[0]), low[1] + v * (high[1] - low[1])
        draws, u = uniform(draws)
        draws, v = uniform(draws)
        path[2, 0], path[2, 1] = low[0] + u * (high[0] - low[0]), low[1] + v * (high[1] - low[1])
        if some < 0.3:
            path[2, :2] = path[1, :2]
        if some < 0.1:
            path[1, :2] = path[0, :2]
        total = 0.0
        for k in range(3):
            dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
            draws, u = uniform(draws)
            dt = math.sqrt(dx * dx + dy * dy) / best
            if s > 0:
                dt *= 0.4 + 1.2 * u
            draws, u = uniform(draws)
            draws, v = uniform(draws)
            if v < 0.1 or dt == 0.0:
                dt += u
            path[k + 1, 2] = path[k, 2] + dt
            total += q * dt + 0.5 * r * (dx * dx + dy * dy) / max(dt, 1e-9)
        cost[s] = total
        for k in range(3):
            ax, ay, bx, by = path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1]
            outcome, _, _ = sweep_exit(setup.world, ax, ay, bx, by)
            step, begun, dt = (ax, ay, bx, by, 0.0), path[k, 2], path[k + 1, 2] - path[k, 2]
            if outcome == COLLISION or sweep(setup.world.moving, notes, step, begun, dt, 1.0) <= 1.0:
                cost[s] = math.inf
                break


def trajectory_of(path: Array, cost: float) -> Trajectory:
    """A path (k, 3) [m, m, s] as a reference of a point."""
    steps = np.diff(path, axis=0)
    steps = steps[steps[:, 2] > 0.0]
    places = np.vstack([path[:1], path[0] + np.cumsum(steps, axis=0)])
    return Trajectory(
        controls=steps[:, :2] / steps[:, 2:], durations=steps[:, 2], cost=cost,
        path=straight(places, steps[:, 2]), length=float(np.hypot(*steps[:, :2].T).sum()),
    )  # fmt: skip


def references(integral: PathIntegral, x: Array, t: float, drawn: int = DRAWN) -> dict[tuple[int, ...], Trajectory]:
    """The cheapest found of every class from x (2,) [m] at t [s], cheapest first."""
    problem, homology = integral.problem, integral.homology
    assert homology is not None
    paths, cost = np.zeros((drawn, 4, 3)), np.zeros(drawn)
    scene, r = problem.scene, float(problem.control_cost(x)[0, 0])
    _draw(integral.setup, x, t, problem.least_rate, r, scene.lower, scene.upper, 1, paths, cost)
    found: dict[tuple[int, ...], Trajectory] = {}
    for k in np.argsort(cost)[:3000]:
        if not cost[k] < cost.min() * 1.3 + ASIDE * problem.temperature:
            break
        found.setdefault(homology.winding(paths[k]), trajectory_of(paths[k], float(cost[k])))
    return found


def guided(
    integral: PathIntegral, x: Array, t: float, samples: int, drawn: int = DRAWN
) -> tuple[Batch, list[DDPGuide], list[str]]:
    """Samples, so many in all, from x (n,) at t [s] around guides of all classes that count, and these guides."""
    assert integral.homology is not None
    guidance = integral.guidance
    assert isinstance(guidance, DDPGuidance)
    known = references(integral, x, t, drawn)
    assert known, "no way is free"
    times = integral.grid(max(one.cost for one in known.values()))
    keys = {integral.homology.key(winding): winding for winding in known}
    made = [(key, best(guidance, x, times, key, known[winding], time=t)) for key, winding in keys.items()]
    kept = [(key, guide) for key, guide in made if guide is not None]
    if not kept:
        key, winding = next(iter(keys.items()))
        tape = Tape(times, known[winding].tape(times))
        return Batch(state=x, times=times, proposals=(Proposal(lead=tape, count=samples, key=key),), time=t), [], []
    least = min(guide.penalised for _, guide in kept)
    kept = [(key, guide) for key, guide in kept if guide.penalised < least + ASIDE * integral.temperature]
    counts = guidance.counts([guide for _, guide in kept], samples)
    counts = [max(1, round(count * samples / sum(counts))) for count in counts]
    names = [class_id(keys[key]) for key, _ in kept]
    proposals = tuple(
        Proposal(lead=LinearFeedback(guide), count=count, name=name, key=key)
        for (key, guide), count, name in zip(kept, counts, names, strict=True)
    )
    return Batch(state=x, times=times, proposals=proposals, time=t), [guide for _, guide in kept], names
