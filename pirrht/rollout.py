"""Compiled rollouts: noisy paths around references, their cost, and how likely each reference makes them.

Everything is expressed in noise units: with a = B_c^-1 G_c u and the path's own increments y = a dt + dw, a step is
x + f dt + B y, and log dQ_g/dP grows by a_g'y - a_g'a_g dt / 2 for every reference g (paper, Girsanov's theorem).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.clearance import Field
from pirrht.cuts import Cuts
from pirrht.gates import Gates
from pirrht.jit import as_jitable
from pirrht.problem import Problem, unit_rate
from pirrht.rollout_again import added, control, trace
from pirrht.rollout_any import any_path
from pirrht.rollout_block import is_point, sample
from pirrht.rollout_loops import Kernels, loops
from pirrht.scene import Array

__all__ = ["Guides", "Kernels", "Paths", "World", "empty_paths", "kernels_for"]


class World(NamedTuple):
    """What a rollout needs to know of scene and problem."""

    field: Field
    goal: tuple[float, float]  # centre [m]
    goal_radius: float
    cuts: Cuts
    parameters: Array  # p of the dynamics
    gain: Array  # (m, m) B_c^-1 G_c, if constant
    inverse: Array  # (m, m) G_c^-1 B_c, if constant
    diffusion: Array  # (m, m) B_c, if constant
    rate: float  # q, if constant [cost/s]
    bridge: bool  # exit rule: along the step, or at its end


class Guides(NamedTuple):
    """H references that samples are drawn around: control guides of T steps, or corners to head for."""

    control: Array  # (H, T, m) tapes; for references with gates or a law what is added to these
    drift: Array  # (H, T, m) a = B_c^-1 G_c u, the same in noise units, where the gain is constant
    times: Array  # (T+1,) ends of the steps, from 0 [s]
    active: NDArray[np.int64]  # (H,) number of steps before a row of `control` is zero for good
    first: NDArray[np.int64]  # (H+1,) first sample drawn around each reference; the last entry is S
    gates: Gates  # what to head for, one after the other, instead of the tape
    speed: float  # towards a gate [m/s]
    reach: float  # walls push within about this distance [m]; 0: they do not
    window: int  # leading steps over which the control now is averaged
    mirrored: bool  # the noise of every second sample is minus that of the one before it
    law: Array  # (H, T, 9) of a car: a, its slopes in x, y, theta, the state they are for, spread and its log
    led: NDArray[np.int64]  # (H,) number of steps that the law covers, then towards the goal; 0: follow the tape


class Paths(NamedTuple):
    """What is kept of S sampled paths; kernels write into it."""

    work: Array  # (S,) integral of q up to the exit [cost]
    log_ratio: Array  # (S, H) log dQ_g/dP of each path under each reference
    key: NDArray[np.int64]  # (S,) class of the path itself, as an additive key
    outcome: NDArray[np.int8]  # (S,) Outcome
    steps: NDArray[np.int32]  # (S,) steps taken, the exit's included
    now: Array  # (S, m) control now, integrated over the first `window` steps: noise, and the guide at the start
    span: Array  # (S,) time of these steps until the exit [s]


def empty_paths(S: int, H: int, m: int) -> Paths:
    """Room for S paths under H references."""
    return Paths(
        work=np.zeros(S),
        log_ratio=np.zeros((S, H)),
        key=np.zeros(S, np.int64),
        outcome=np.zeros(S, np.int8),
        steps=np.zeros(S, np.int32),
        now=np.zeros((S, m)),
        span=np.zeros(S),
    )


def kernels_for(problem: Problem) -> Kernels:
    """The compiled rollouts of a problem; built once per kind of dynamics and cost rate."""
    d = problem.dynamics
    constant = d.constant
    gain = None if constant else as_jitable(_function(d.control_block))
    noise = None if constant else as_jitable(_function(d.diffusion_block))
    q = as_jitable(problem.q) if callable(problem.q) else unit_rate
    if is_point(d) and not callable(problem.q):
        return Kernels(sample, control, trace, added)
    one_path, room = any_path(as_jitable(d.drift), gain, noise, q, d.n, d.m, callable(problem.q), d.noisy_position)
    return loops(one_path, room, d.m)


def _function(block: Array | Callable[..., None]) -> Callable[..., None]:
    return _filling(block.tobytes(), len(block)) if isinstance(block, np.ndarray) else block


@cache  # kernels are built once per matrix
def _filling(data: bytes, m: int) -> Callable[..., None]:
    matrix = np.frombuffer(data).reshape(m, m)

    def fill(x, p, out):  # type: ignore[no-untyped-def]
        out[:, :] = matrix

    return fill
