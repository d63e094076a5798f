"""The records of a car's guide, a problem and a course, and whether a course is of its class and touches nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.rollouts.first_exit import COLLISION
from pirrht.rollouts.sweep import sweep_exit
from pirrht.topology.cuts import key_of_segment


class Car(NamedTuple):
    """The numbers of a problem with unicycle dynamics that guides are optimised for."""

    speed: float  # V [m/s]
    gain: float  # g = 1/rho, turn rate per control [rad/s]
    effort: float  # R [cost/s]
    rate: float  # q [cost/s]
    margin: float  # clearance below which a point costs something [m]
    least: float  # clearance below which the barrier goes on as a parabola [m]
    price: float  # cost rate of the barrier at a clearance of 1 m [cost/s]
    spacing: float  # at most, of the points of a step whose clearance is priced [m]
    tolerance: float  # an expected gain below this ends the iterations [cost]
    sways: bool  # whether the control may rise or fall within a step


class Course(NamedTuple):
    """A trajectory of T steps and the feedback around it; kernels write into it."""

    states: Array  # (T+1, 3) x, y [m] and theta [rad]; its first row is the start
    control: Array  # (T,) u, a turn rate in units of the car's gain
    gains: Array  # (T, 3) K of u = control + K (x - states) [1/m], [1/m], [1/rad]
    spread: Array  # (T,) standard deviation left to the noise by what comes later, as a share of the passive one
    change: Array  # (T,) the best change of each control
    sway: Array  # (T,) r, by which the control rises over each step, over sqrt(12)
    sway_gains: Array  # (T, 4) of r = sway + sway_gains (x - states, u - control) [1/m], [1/m], [1/rad], [1]
    sway_spread: Array  # (T,) what `spread` is, for the noise of r
    sway_change: Array  # (T,) the best change of each sway


def empty_course(T: int) -> Course:
    """A course of T steps from zeros, states (T+1, 3) [m], [rad] included; its noise is the passive one."""
    none = np.zeros(T)
    return Course(
        states=np.zeros((T + 1, 3)), control=none.copy(), gains=np.zeros((T, 3)), spread=np.ones(T), change=none.copy(),
        sway=none.copy(), sway_gains=np.zeros((T, 4)), sway_spread=np.ones(T), sway_change=none.copy(),
    )  # fmt: skip


@kernel
def class_of(setup, states, length):  # type: ignore[no-untyped-def]
    """Additive class key of the first `length` steps of states (T+1, 3) [m], counted at the cuts as the rollouts do."""
    key = np.int64(0)
    for i in range(length):
        key += key_of_segment(setup.cuts, states[i, 0], states[i, 1], states[i + 1, 0], states[i + 1, 1])
    return key


@kernel
def is_free(setup, car, states, length):  # type: ignore[no-untyped-def]
    """Whether the first `length` steps of states (T+1, 3) [m], [rad], lines or arcs, touch nothing."""
    for i in range(length):
        turn = states[i + 1, 2] - states[i, 2] if car.sways else 0.0
        outcome, _ = sweep_exit(setup.arena, states[i, 0], states[i, 1], states[i + 1, 0], states[i + 1, 1], turn)
        if outcome == COLLISION:
            return False
    return True
