"""What guides of any system are optimised for, and the trajectory with its feedback that kernels write into."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array


class Task(NamedTuple):
    """The numbers of a problem that guides are optimised for."""

    temperature: float  # lambda [cost]
    margin: float  # clearance below which a point costs something [m]
    least: float  # clearance below which the barrier goes on as a parabola [m]
    price: float  # cost rate of the barrier at a clearance of 1 m [cost/s]
    spacing: float  # at most, of the points of a step whose clearance is priced [m]
    tolerance: float  # an expected gain below this ends the iterations [cost]
    steep: float  # |a| stays below this [1/sqrt(s)]
    far: float  # cost per meter that is left to the goal where noise acts on the position [cost/m]
    active: int  # bit k tells whether drift or q depends on the k-th state
    curved: bool  # whether steps have second derivatives
    hold: float = 0.0  # cost rate of being 1 m off the course's aims, over a fixed time [cost/s]; 0: to the goal


class Course(NamedTuple):
    """A trajectory of T steps and the feedback around it, in noise units; kernels write into it."""

    states: Array  # (T+1, n); its first row is the start
    control: Array  # (T, modes) a [1/sqrt(s)]
    gains: Array  # (T, modes, n) K of a = control + K (x - states)
    share: Array  # (T, modes, modes) L, symmetric; the noise of a step has the covariance L L' dt
    inverse: Array  # (T, modes, modes) of L
    volume: Array  # (T,) log det L
    change: Array  # (T, modes) the best change of each control
    aims: Array  # (T+1, 2) where to be at which time, if that is held to [m]


def empty_course(T: int, n: int, modes: int) -> Course:
    """A course of T steps from zeros, states (T+1, n); its noise is the passive one."""
    unit = np.tile(np.eye(modes), (T, 1, 1))
    return Course(
        states=np.zeros((T + 1, n)), control=np.zeros((T, modes)), gains=np.zeros((T, modes, n)), share=unit,
        inverse=unit.copy(), volume=np.zeros(T), change=np.zeros((T, modes)),
        aims=np.zeros((T + 1, 2)),
    )  # fmt: skip


COURSE: Any = Course
