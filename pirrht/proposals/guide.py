"""Guides of any system: records, courses that their optimisation starts from, and the feedback that samples follow."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import Curves
from pirrht.geometry.pieces import Pieces, setting_out
from pirrht.proposals.proposal import ProposalControl
from pirrht.proposals.tuning import ProposalTuning
from pirrht.rollouts.tables import FINER, LawRows, ProposalTables, Setup
from pirrht.steering.motion import Trajectory
from pirrht.systems.dynamics import Dynamics
from pirrht.topology.signature import Classes


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
    aims: Array  # (T+1, d) where to be at which time, if that is held to [m]


COURSE: Any = Course


def empty_course(T: int, n: int, modes: int, d: int = 2) -> Course:
    """Return a course of T steps from zeros, states (T+1, n), aims (T+1, d); its noise is the passive one."""
    unit = np.tile(np.eye(modes), (T, 1, 1))
    return Course(
        np.zeros((T + 1, n)), np.zeros((T, modes)), np.zeros((T, modes, n)), unit, unit.copy(), np.zeros(T),
        np.zeros((T, modes)), np.zeros((T + 1, d)),
    )  # fmt: skip


def straight(states: Array, places: Array, cost: Array) -> Curves | Pieces:
    """Return straight lines between states (k+1, n) at places (k+1, d) of costs (k,)."""
    if places.shape[1] == 3:
        return Pieces(np.hstack([places[:-1], places[1:]]), cost, states[:-1], states[1:])
    dx, dy = np.diff(places, axis=0).T
    start = np.column_stack([places[:-1], np.arctan2(dy, dx)])
    return Curves(start, np.zeros((len(dx), 1)), np.hypot(dx, dy)[:, None], cost, states[:-1], states[1:])


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
    drift: Array | None = None  # (T FINER, d) slope of log psi by near walls that push on top of its law [1/m]
    bend: Array | None = None  # (T FINER, d, d) its derivatives [1/m^2]

    def log_ratio_to(self, other: DDPGuide) -> float:
        """Return by how much another guide's path is less likely than its own under its own law [nats].

        That is half the integral of |a - b|^2, a being the law at the other's states, b the other's controls.
        """
        most, m = min(other.length, len(other.modes)), self.dynamics.m
        y = other.states[:most]
        own = self.states[: max(self.length, 1)]
        near = np.argmin((self.metric * (y[:, None] - own) ** 2).sum(axis=2), axis=1)
        asked = self.modes[near] + np.einsum("ijk,ik->ij", self.gains[near], y - own[near])
        off = np.clip(asked, -self.steep, self.steep)[:, :m] - other.modes[:most, :m]
        return float(0.5 * (off**2).sum(axis=1) @ np.diff(other.times)[:most])

    @property
    def tape(self) -> Array:
        """Its controls u (T, m), over the steps."""
        return self.dynamics.inputs_of(self.states[:-1], self.modes[:, : self.dynamics.m])

    def rest(self, elapsed: float, goal: Array) -> Trajectory | None:
        """Return the trajectory left after some time [s], to the goal's centre (d,) [m]; None if nothing."""
        passed = int(np.searchsorted(self.times, elapsed + 1e-9, side="right")) - 1
        if passed >= self.length:
            return None
        states = self.states[[*range(passed, self.length + 1), self.length]]
        states[-1, list(self.dynamics.position)] = goal
        places = self.dynamics.place(states)
        travel = np.hypot.reduce(np.diff(places, axis=0), axis=1)
        steps = np.diff(self.times)[passed : self.length]
        durations = np.append(steps, travel[-1] * steps.sum() / max(travel[:-1].sum(), 1e-9))
        return Trajectory(
            controls=np.vstack([self.tape[passed : self.length], np.zeros(self.dynamics.m)]), durations=durations,
            path=straight(states, places, durations), cost=float(durations.sum()), length=float(travel.sum()),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class LinearFeedback(ProposalControl):
    """Feedback around the guide of any system."""

    guide: DDPGuide

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) of the guide at s [s] plus its gains times the deviation of the state x (n,)."""
        guide, d = self.guide, self.guide.dynamics
        i = min(int(np.searchsorted(guide.times, s + 1e-9, side="right")) - 1, len(guide.modes) - 1)
        share = min(1.0, (s - guide.times[i]) / (guide.times[i + 1] - guide.times[i]))
        off = d.difference(x, guide.states[i] + share * d.difference(guide.states[i + 1], guide.states[i]))
        a = self._law(x, i, min(i * FINER + round(share * FINER), len(guide.modes) * FINER - 1), off)
        mean = a[: d.m]
        sway = a[d.m :]

        return d.input_of(x, mean + 2.0 * math.sqrt(3.0) * (share - 0.5) * sway if len(sway) else mean)

    def held(self, x: Array) -> Array:
        """Return the mean control (m,) of the guide over its first step from x (n,)."""
        d = self.guide.dynamics
        return d.input_of(x, self._law(x, 0, 0, d.difference(x, self.guide.states[0]))[: d.m])

    def _law(self, x: Array, i: int, row: int, off: Array) -> Array:
        """Evaluate the law of step i (modes,), less the drift of its row, `off` (n,) from the guide."""
        guide = self.guide
        modes = guide.modes[i] + guide.gains[i] @ off
        if guide.drift is not None and guide.bend is not None:  # wall drift comes on top
            modes = modes - guide.dynamics.B_c(x).T @ (guide.drift[row] + guide.bend[row] @ off)
        return np.asarray(np.clip(modes, -guide.steep, guide.steep))

    def pack(self, leads: ProposalTables, h: int) -> None:
        """Write `LawRows` of `ProposalTables.law` (H, T FINER, law_width), and the number of its rows."""
        guide = self.guide
        leads.law_length[h] = guide.length * FINER
        (T, modes), n = guide.modes.shape, guide.states.shape[1]
        row = np.arange(T * FINER)
        law = LawRows.of(leads, h, n, modes)
        i = row // FINER
        share = (row % FINER / FINER)[:, None]
        then = np.maximum(np.minimum(i + 1, guide.length - 1), i)
        mean = (1.0 - share) * guide.modes[i] + share * guide.modes[then]
        gains = (1.0 - share[:, :, None]) * guide.gains[i] + share[:, :, None] * guide.gains[then]
        if guide.drift is not None and guide.bend is not None:
            B = guide.dynamics.B_c(guide.states[0])
            mean = mean - guide.drift @ B
            gains = gains - B.T @ guide.bend
        # States are linear within a step, but for positions, whose velocity is.
        states = (1.0 - share) * guide.states[i] + share * guide.states[i + 1]
        at = list(guide.dynamics.position)
        pace = np.gradient(guide.states[: guide.length + 1, at], guide.times[: guide.length + 1], axis=0)
        pace = np.vstack([pace, np.repeat(pace[-1:], len(guide.states) - len(pace), axis=0)])
        states[:, at] += 0.5 * share * (1.0 - share) * np.diff(guide.times)[i][:, None] * (pace[i] - pace[i + 1])
        law.mean[:], law.gains[:], law.state[:] = mean, np.swapaxes(gains, 1, 2), states
        law.deviation[:] = np.swapaxes(guide.share, 1, 2)[i]
        law.inverse[:] = np.swapaxes(guide.inverse, 1, 2)[i]
        law.log_det[:], law.steepest[:], law.metric[:] = guide.volume[i], guide.steep, guide.metric


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Initialisation:
    """Initial courses of one system, each with its number of prescribed steps."""

    dynamics: Dynamics
    setup: Setup
    classes: Classes  # of guides, which are not asked for theirs here
    width: int  # modes of a step
    optimise: Any  # kernel (`ddp`)
    tracking: Task  # under which aims are held to
    window: int | None  # last steps that are improved when more of a reference is tracked; None: all
    tuning: ProposalTuning

    def along(self, x: Array, trajectory: Trajectory, times: Array) -> tuple[Course, int]:
        """Start from the controls of a reference from x (n,)."""
        d, state = self.dynamics, x
        course = empty_course(len(times) - 1, d.n, self.width)
        length = min(int(np.searchsorted(times, trajectory.durations.sum())), len(times) - 1)
        for i, u in enumerate(trajectory.tape(times[: length + 1])):
            course.control[i, : d.m] = d.to_noise(state, u)
            state = d.step(state, u, np.zeros(d.m), float(times[i + 1] - times[i]))
        return course, length

    def perturbed(self, control: Array, length: int, times: Array) -> Iterator[tuple[Course, int]]:
        """Start from controls (T, modes), the first of them perturbed: to turn the other way, to brake, to reverse."""
        m, steps = self.dynamics.m, int(np.searchsorted(times, self.tuning.perturbed_time))
        few = m <= self.tuning.perturbed_inputs
        signs = product((-1.0, 0.0, 1.0), repeat=m) if few else np.vstack([np.eye(m), -np.eye(m)])
        for strength, direction in product(self.tuning.perturbed_strengths, map(np.asarray, signs)):
            if np.any(direction):
                course = empty_course(len(control), self.dynamics.n, self.width)
                course.control[:] = control
                course.control[:steps, :m] += strength * self.tracking.steep / self.tuning.steepest * direction
                yield course, max(length, min(steps, len(control)))

    def tracked(self, x: Array, trajectory: Trajectory, times: Array) -> tuple[Course, int]:
        """Start gently by tracking places and times of a reference from x (n,), more and more of it from its start."""
        (places, ways), ahead = setting_out(trajectory.path), self.tuning.ahead
        seconds = float(trajectory.durations.sum())
        pace = trajectory.length / seconds  # through the goal, no halt
        onward = trajectory.durations[-1] + times[-1]
        end = places[-1] + pace * onward * ways[-1]
        passed = np.cumsum([0.0, *trajectory.durations[:-1], onward])
        ramp, late, then = self.tuning.ramp * (trajectory.slack or 0.0), 0.0, times
        if ramp:
            along = self.dynamics.place(self.dynamics.f(x)) @ ways[0]
            late = ramp * (1.0 - min(max(along / pace, 0.0), 1.0))  # by as much as it is slow at the start
            then = times + late * np.expm1(-times / ramp)
        course, length = empty_course(len(times) - 1, self.dynamics.n, self.width, len(end)), 0
        course.aims[:] = np.column_stack([np.interp(then, passed, column) for column in np.vstack([places, end]).T])
        course.states[0] = x
        whole = int(np.searchsorted(times, seconds + self.setup.world.radius / pace + late))
        whole = min(len(times) - 1, whole)
        while length < whole:
            length = min(whole, length + ahead)
            first = 0 if self.window is None else max(0, length - self.window)
            part, passes = Course(*(array[first:] for array in course)), self.tuning.ahead_passes
            self.optimise(self.setup, self.classes, self.tracking, times[first:], 0, passes, part, length - first)
        return course, length

    def shifted(self, last: DDPGuide, times: Array, elapsed: float) -> tuple[Course, int]:
        """Start from a guide after some time [s], on a new grid (T+1,) [s]."""
        nominal = empty_course(len(last.modes), self.dynamics.n, self.width)._replace(
            states=last.states, control=last.modes, gains=last.gains
        )
        return self.retimed(nominal, last.length, last.times, times, elapsed=elapsed)

    def retimed(
        self,
        last: Course,
        length: int,
        before: Array,
        times: Array,
        *,
        pace: float = 1.0,
        elapsed: float = 0.0,
    ) -> tuple[Course, int]:
        """Start from a nominal path of some steps on a grid `before` (T+1,) [s], on another grid (T+1,) [s].

        It begins after some time [s], and is followed by its feedback `pace` times as fast.
        """
        then = pace * times + elapsed
        states = np.column_stack([np.interp(then, before, column) for column in last.states.T])
        at = np.clip(np.searchsorted(before, then[:-1] + 1e-9, side="right") - 1, 0, len(before) - 2)
        steps = int(np.sum(at < length)) if before[-1] > then[0] else 0
        control = pace * last.control[at]
        control[:, self.dynamics.m :] *= (np.diff(times) / np.diff(before)[at])[:, None]
        return empty_course(len(at), self.dynamics.n, self.width)._replace(
            states=states, control=control, gains=last.gains[at]
        ), min(steps, len(at))
