"""Records of guides of any system: the task, the course that kernels write into, and the guide made of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.steering.motion import Trajectory
from pirrht.systems.dynamics import Dynamics


class Task(NamedTuple):
    """Numbers of a problem that guides are optimised for."""

    temperature: float  # lambda [cost]
    margin: float  # clearance below which a point costs something [m]
    least: float  # clearance below which the barrier goes on as a parabola [m]
    price: float  # cost rate of the barrier at a clearance of 1 m [cost/s]
    exponent: float  # p of the barrier c^p: -2/3, or -2 for a point, which feels walls as a Brownian motion does
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


class Track(NamedTuple):
    """Straight lines between the states of a guide."""

    tails: Array  # (k, n)
    heads: Array  # (k, n)
    cost: Array  # (k,) [cost]

    def points(self, spacing: float) -> list[Array]:
        """Return every piece as a line of two points (2, 2) [m], at any `spacing` [m]."""
        return list(np.stack([self.tails[:, :2], self.heads[:, :2]], axis=1))


class WallsAhead(NamedTuple):
    """Walls along a guide, at its T FINER rows."""

    half_spaces: Array  # (T FINER, GATES, GATE) constraints of walls yet to be passed
    drift: Array  # (T FINER, 2) slope of log psi by near walls [1/m]
    bend: Array  # (T FINER, 2, 2) its derivatives [1/m^2]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DDPGuide:
    """A trajectory of one class and the feedback around it, on the grid of the rollouts, in noise units."""

    dynamics: Dynamics
    times: Array  # (T+1,) ends of the steps [s]
    states: Array  # (T+1, n)
    modes: Array  # (T, M) a = B_c^-1 G_c u, or s^-1 u [1/sqrt(s)]; of M = 2 m, the last half rises over each step
    gains: Array  # (T, M, n) K of a = modes + K (x - states)
    share: Array  # (T, M, M) L, symmetric: the samples' noise of a step has the covariance L L' dt
    inverse: Array  # (T, M, M) of L
    volume: Array  # (T,) log det L
    metric: Array  # (n,) weights of squared differences between states: one over what noise does to them
    steep: float  # |a| stays below this [1/sqrt(s)]
    length: int  # steps until the one that enters the goal
    cost: float  # integral of q + u'Ru/2 up to the goal [cost]
    penalised: float  # cost with that of the clearance [cost]
    valid: bool  # whether it touches nothing and is of its class
    walls_ahead: WallsAhead | None = None  # of a point among moving obstacles

    def log_ratio_to(self, other: DDPGuide) -> float:
        """Return by how much another guide's path is less likely than its own under its own law [nats].

        That is half the integral of |a - b|^2, a being the law at the other's states, b the other's controls.
        """
        most = min(other.length, len(other.modes))
        y, own = other.states[:most], self.states[: max(self.length, 1)]
        near = np.argmin((self.metric * (y[:, None] - own) ** 2).sum(axis=2), axis=1)
        asked = self.modes[near] + np.einsum("ijk,ik->ij", self.gains[near], y - own[near])
        m = self.dynamics.m
        off = np.clip(asked, -self.steep, self.steep)[:, :m] - other.modes[:most, :m]
        return float(0.5 * (off**2).sum(axis=1) @ np.diff(other.times)[:most])

    @property
    def tape(self) -> Array:
        """Its controls u (T, m), over the steps."""
        return self.dynamics.inputs_of(self.states[:-1], self.modes[:, : self.dynamics.m])

    def rest(self, elapsed: float, goal: Array) -> Trajectory | None:
        """Return the trajectory left after some time [s], to the goal's centre (2,) [m]; None if nothing."""
        passed = int(np.searchsorted(self.times, elapsed + 1e-9, side="right")) - 1
        if passed >= self.length:
            return None
        part = slice(passed, self.length)
        end = self.states[self.length].copy()
        end[:2] = goal
        states = np.vstack([self.states[passed : self.length + 1], end])
        travel = np.hypot(*np.diff(states[:, :2], axis=0).T)
        steps = np.diff(self.times)[part]
        left = travel[-1] * steps.sum() / max(travel[:-1].sum(), 1e-9)
        durations = np.append(steps, left)
        return Trajectory(
            controls=np.vstack([self.tape[part], np.zeros(self.dynamics.m)]), durations=durations,
            path=Track(states[:-1], states[1:], durations), cost=float(durations.sum()), length=float(travel.sum()),
        )  # fmt: skip
