"""The rollouts of the paper's kernel in JAX and in pytorch_mppi: same scene, tapes, noise, step and exit rule.

Both look clearances up in the arrays of our own field, use float32 and their own random numbers, and have all cores.
"""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import Field
from pirrht.geometry.scene import Goal

HINT = "not installed: pip install 'pirrht[bench]'"
COLLISION_COST = 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """dx = u dt + b dw from one state, held open-loop tapes, first exit at the ends of the steps."""

    start: Array  # (2,)
    tapes: Array  # (H, T, 2)
    dt: float
    noise: float  # b
    temperature: float  # lambda
    rate: float  # q
    field: Field
    goal: Goal


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a peer found, to compare with ours."""

    goal_share: float  # of the samples that reach the goal
    ess: float  # effective samples
    log_psi: float | None = None


Peer = Callable[[int], Answer]  # seed -> answer


def missing(module: str) -> bool:
    """Whether a peer is not installed."""
    return importlib.util.find_spec(module) is None


def jax_rollouts(task: Task, samples: int) -> Peer:
    """jit(vmap(scan)) with the likelihood ratio under every tape, the balance heuristic and the control now."""
    import jax
    import jax.numpy as jnp

    f, goal, reach = task.field, jnp.asarray(task.goal.center, jnp.float32), float(task.goal.radius)
    grid, root = jnp.asarray(f.held["nearest"]), float(np.sqrt(task.dt))
    a = jnp.asarray(task.tapes / task.noise, jnp.float32)  # (H, T, 2)
    H, T = a.shape[:2]
    around = jnp.repeat(jnp.arange(H), samples // H)

    def clearance(p: Any) -> Any:
        fx, fy = (p[0] - f.x0) / f.spacing, (p[1] - f.y0) / f.spacing
        i, j = jnp.clip(fx.astype(jnp.int32), 0, f.nx - 2), jnp.clip(fy.astype(jnp.int32), 0, f.ny - 2)
        u, v = fx - i, fy - j
        low = grid[i, j] * (1.0 - v) + grid[i, j + 1] * v
        high = grid[i + 1, j] * (1.0 - v) + grid[i + 1, j + 1] * v
        edge = jnp.minimum(jnp.minimum(p[0] - f.left, f.right - p[0]), jnp.minimum(p[1] - f.low, f.high - p[1]))
        return jnp.minimum(edge, low * (1.0 - u) + high * u)

    def step(carried: Any, given: Any) -> Any:
        x, outcome, work, ratio = carried
        z, own, each = given
        alive = outcome == 0
        y = own * task.dt + z * root
        moved = x + task.noise * y
        arrived = jnp.sum((moved - goal) ** 2) <= reach**2
        judged = jnp.where(clearance(moved) <= 0.0, 2, jnp.where(arrived, 1, 0))
        grown = ratio + jnp.sum(each * (y - 0.5 * each * task.dt), axis=-1)
        return (
            jnp.where(alive, moved, x),
            jnp.where(alive, judged, outcome),
            jnp.where(alive, work + task.rate * task.dt, work),
            jnp.where(alive, grown, ratio),
        ), None

    def path(z: Any, h: Any) -> Any:
        begin = (jnp.asarray(task.start, jnp.float32), jnp.int32(0), jnp.float32(0.0), jnp.zeros(H, jnp.float32))
        end, _ = jax.lax.scan(step, begin, (z, a[h], jnp.swapaxes(a, 0, 1)))
        return end[1], end[2], end[3], task.noise * (a[h, 0] + z[0] / root)

    def estimate(key: Any) -> Any:
        z = jax.random.normal(key, (T, 2, samples))
        outcome, work, ratio, control = jax.vmap(path, in_axes=(2, 0))(z, around)
        mixture = jax.nn.logsumexp(ratio, axis=1) - np.log(H)
        log_weight = jnp.where(outcome == 1, -work / task.temperature - mixture, -jnp.inf)
        top = log_weight.max()
        weight = jnp.exp(log_weight - top)
        ess = weight.sum() ** 2 / jnp.sum(weight**2)
        return jnp.mean(outcome == 1), ess, top + jnp.log(weight.mean()), weight @ control / weight.sum()

    compiled = jax.jit(estimate)

    def run(seed: int) -> Answer:
        share, ess, log_psi, _ = jax.block_until_ready(compiled(jax.random.key(seed)))
        return Answer(goal_share=float(share), ess=float(ess), log_psi=float(log_psi))

    return run


def torch_rollouts(task: Task, samples: int) -> Peer:
    """One `pytorch_mppi.MPPI` per tape, with its share of the samples and weights of its own; state (x, y, outcome)."""
    import torch
    from pytorch_mppi import MPPI

    f, reach = task.field, float(task.goal.radius)
    grid, goal = torch.from_numpy(f.held["nearest"]), torch.tensor(task.goal.center, dtype=torch.float32)
    last: dict[str, Any] = {}

    def clearance(x: Any, y: Any) -> Any:
        fx, fy = (x - f.x0) / f.spacing, (y - f.y0) / f.spacing
        i, j = fx.long().clamp(0, f.nx - 2), fy.long().clamp(0, f.ny - 2)
        u, v = fx - i, fy - j
        low = grid[i, j] * (1.0 - v) + grid[i, j + 1] * v
        high = grid[i + 1, j] * (1.0 - v) + grid[i + 1, j + 1] * v
        edge = torch.minimum(torch.minimum(x - f.left, f.right - x), torch.minimum(y - f.low, f.high - y))
        return torch.minimum(edge, low * (1.0 - u) + high * u)

    def dynamics(state: Any, action: Any) -> Any:
        outcome = state[:, 2]
        moved = state[:, :2] + torch.where(outcome[:, None] == 0.0, action * task.dt, 0.0)
        arrived = ((moved - goal) ** 2).sum(1) <= reach**2
        judged = torch.where(clearance(moved[:, 0], moved[:, 1]) <= 0.0, 2.0, arrived.float())
        last["state"] = torch.cat([moved, torch.where(outcome == 0.0, judged, outcome)[:, None]], 1)
        return last["state"]

    def running_cost(state: Any, action: Any) -> Any:
        outcome = state[:, 2]
        return task.rate * task.dt * (outcome == 0.0) + COLLISION_COST * (outcome == 2.0)

    tapes = torch.tensor(task.tapes, dtype=torch.float32)
    H, T = tapes.shape[:2]
    sigma = torch.eye(2) * (task.noise**2 / task.dt)
    around = {"num_samples": samples // H, "horizon": T, "lambda_": task.temperature}
    planners = [MPPI(dynamics, running_cost, 3, sigma, U_init=tape, **around) for tape in tapes]
    start = torch.tensor([*task.start, 0.0], dtype=torch.float32)

    def run(seed: int) -> Answer:
        torch.manual_seed(seed)
        arrived = ess = 0.0
        for planner, tape in zip(planners, tapes, strict=True):
            planner.U = tape
            planner.command(start, shift_nominal_trajectory=False)
            arrived += float((last["state"][:, 2] == 1.0).float().mean()) / H
            ess += 1.0 / float((planner.omega**2).sum())
        return Answer(goal_share=arrived, ess=ess)

    return run
