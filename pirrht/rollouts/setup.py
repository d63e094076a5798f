"""What kernels need to know of a problem and its scene."""

from __future__ import annotations

import numpy as np

from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.rollouts.records import MovingSetup, Setup


def setup_of(problem: Problem, space: FreeSpace, *, bridge: bool) -> Setup | MovingSetup:
    """What rollouts of a problem meet in its scene, exits judged along the step (`bridge`) or at its end."""
    d = problem.dynamics
    x = np.zeros(d.n)
    constant, told = d.constant, d.constant or d.input_form
    setup = Setup(
        arena=space.arena,
        cuts=space.homology.cuts,
        parameters=np.asarray(d.parameters, dtype=float),
        inverse=d.control_gain(x) if told else np.zeros((d.m, d.m)),
        gain=d.noise_gain(x) if told else np.zeros((d.m, d.m)),
        diffusion=np.asarray(d.B_c(x)) if constant else np.zeros((d.rows, d.m)),
        rate=0.0 if callable(problem.q) else float(problem.q),
        bridge=bridge,
        pace=problem.least_rate / problem.temperature,
    )
    return MovingSetup.of(setup, space.traffic) if problem.scene.movers else setup
