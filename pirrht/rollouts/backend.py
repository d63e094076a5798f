"""Compiled rollouts: noisy paths around references, their cost, and how likely each reference makes them.

Everything is expressed in noise units: with a = B_c^-1 G_c u, or s^-1 u in input form, and the path's own increments
y = a dt + dw, a step is x + f dt + B y, and log dQ_g/dP grows by a_g'y - a_g'a_g dt / 2 for every reference g (paper,
Girsanov's theorem).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import as_jitable
from pirrht.problem import Problem, unit_rate
from pirrht.rollouts.general.kind import Kind
from pirrht.rollouts.general.loops import loops
from pirrht.rollouts.general.path import any_path
from pirrht.rollouts.homing import car_home, straight_home
from pirrht.rollouts.point.block import is_point, sample
from pirrht.rollouts.point.replay import control, trace
from pirrht.rollouts.records import Kernels
from pirrht.systems.dynamics import no_homing
from pirrht.systems.unicycle import unicycle_drift

ALONE = 2400  # samples of a point, many abreast


def kernels_for(problem: Problem) -> Kernels:
    """The compiled rollouts of a problem; built once per kind of dynamics and cost rate."""
    if is_point(problem.dynamics) and not callable(problem.q) and not problem.scene.movers:
        return Kernels(sample, control, trace, alone=ALONE)
    return loops(*any_path(kind_of(problem)), problem.dynamics.m)


def kind_of(problem: Problem) -> Kind:
    """What kernels of a problem are compiled for."""
    d = problem.dynamics
    noise = d.diffusion_block if d.input_matrix is None else d.input_matrix
    return Kind(
        drift=as_jitable(d.drift),
        control_block=None if d.constant or d.input_form else as_jitable(_function(d.control_block)),
        diffusion_block=None if d.constant else as_jitable(_function(noise)),
        q=as_jitable(problem.q) if callable(problem.q) else unit_rate,
        n=d.n,
        m=d.m,
        varying_rate=callable(problem.q),
        noisy_position=d.noisy_position,
        angles=sum(1 << i for i in d.angles),
        homing=as_jitable(_homing(problem)),
        input_form=d.input_form,
        midway=d.stratonovich,
        astray=d.n == d.m == 2 and not d.even,
        moving=bool(problem.scene.movers),
    )


def _homing(problem: Problem) -> Callable[..., None]:
    """What samples do that outlive their law; where bodies move also points and cars are led by one."""
    d = problem.dynamics
    if problem.scene.movers and d.homing is no_homing:
        if d.n == d.m == 2 and not d.input_form:
            return straight_home
        if d.drift is unicycle_drift and d.m == 1:
            return car_home
    return d.homing


def _function(block: Array | Callable[..., None]) -> Callable[..., None]:
    return _filling(block.astype(float).tobytes(), len(block)) if isinstance(block, np.ndarray) else block


@cache  # kernels are built once per matrix
def _filling(data: bytes, m: int) -> Callable[..., None]:
    matrix = np.frombuffer(data).reshape(m, m)

    def fill(x, p, out):  # type: ignore[no-untyped-def]
        out[:, :] = matrix

    return fill
