"""Initial courses of a guide's optimisation: a reference's controls, a path to track, or the last guide."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.proposals.guide import Course, DDPGuide, Task, empty_course
from pirrht.proposals.tuning import ProposalTuning
from pirrht.rollouts.tables import Setup
from pirrht.steering.motion import Trajectory
from pirrht.systems.dynamics import Dynamics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Initialisation:
    """Initial courses of one system, each with its number of prescribed steps."""

    dynamics: Dynamics
    setup: Setup
    width: int  # modes of a step
    halts: bool  # whether the system has no homing
    optimise: Any  # kernel (`ddp`)
    tracking: Task  # under which aims are held to
    window: int | None  # last steps that are improved when more of a reference is tracked; None: all
    asked: float  # |a| under which control costs as much as time [1/sqrt(s)]
    tuning: ProposalTuning

    def continued(self, course: Course, times: Array, length: int) -> int:
        """Hold the last law of a system without homing for some steps more, into the goal; return its steps then."""
        d, end = self.dynamics, min(length + self.tuning.onward, len(course.control)) if self.halts else length
        for i in range(length, end):
            for part in (course.control, course.gains, course.share, course.inverse, course.volume):
                part[i] = part[length - 1]
            u = d.input_of(course.states[i], course.control[i, : d.m])
            course.states[i + 1] = d.step(course.states[i], u, np.zeros(d.m), float(times[i + 1] - times[i]))
        return end

    def along(self, x: Array, trajectory: Trajectory, times: Array) -> tuple[Course, int]:
        """Start from the controls of a reference from x (n,)."""
        d = self.dynamics
        course = empty_course(len(times) - 1, d.n, self.width)
        tape, state = trajectory.tape(times), x
        ends = int(np.searchsorted(times, trajectory.durations.sum()))
        if self.halts:
            tape[max(ends - 1, 0) : ends + self.tuning.onward] = trajectory.controls[-1]
        if d.constant or d.input_form:
            course.control[:, : d.m] = d.to_noise(x, tape)
            return course, min(ends, len(tape))
        for i, u in enumerate(tape):
            course.control[i, : d.m] = d.to_noise(state, u)
            state = d.step(state, u, np.zeros(d.m), float(times[i + 1] - times[i]))
        return course, min(ends, len(tape))

    def perturbed(self, control: Array, length: int, times: Array) -> Iterator[tuple[Course, int]]:
        """Start from controls (T, modes) with the first ones perturbed: to turn the other way, to brake, to reverse.

        Optimisation is local, and turning about has several local optima.
        """
        m, steps = self.dynamics.m, int(np.searchsorted(times, self.tuning.perturbed_time))
        few = m <= self.tuning.perturbed_inputs
        signs = product((-1.0, 0.0, 1.0), repeat=m) if few else np.vstack([np.eye(m), -np.eye(m)])
        directions = [np.asarray(sign) for sign in signs if np.any(sign)]
        for strength, direction in product(self.tuning.perturbed_strengths, directions):
            course = empty_course(len(control), self.dynamics.n, self.width)
            course.control[:] = control
            course.control[:steps, :m] += strength * self.asked * direction
            yield course, max(length, min(steps, len(control)))

    def tracked(self, x: Array, trajectory: Trajectory, times: Array) -> tuple[Course, int]:
        """Start by tracking the places and times of a reference from x (n,), more and more of it from its start on.

        It sets off gently, since the system may have to turn about or to accelerate.
        """
        arena, start = self.setup.world, trajectory.path.start
        pace = trajectory.length / float(trajectory.durations.sum())
        ahead = np.array([math.cos(start[-1, 2]), math.sin(start[-1, 2])])  # on through the goal, without a halt
        corners = np.vstack([start[:, :2], start[-1, :2] + ahead * pace * (trajectory.durations[-1] + times[-1])])
        passed = np.cumsum([0.0, *trajectory.durations[:-1], trajectory.durations[-1] + times[-1]])
        course = empty_course(len(times) - 1, self.dynamics.n, self.width)
        ramp = self.tuning.ramp * trajectory.slack if trajectory.slack else 0.0
        along = self.dynamics.f(x)[:2] @ np.array([math.cos(start[0, 2]), math.sin(start[0, 2])])
        short = 1.0 - min(max(along / pace, 0.0), 1.0)  # of its pace at the start
        then = times + short * ramp * np.expm1(-times / ramp) if ramp else times
        course.aims[:] = np.column_stack([np.interp(then, passed, column) for column in corners.T])
        course.states[0] = x
        end = float(trajectory.durations.sum()) + arena.radius / pace + short * ramp
        whole = min(len(times) - 1, int(np.searchsorted(times, end)))
        length = 0
        while length < whole:
            length = min(whole, length + self.tuning.ahead)
            first = 0 if self.window is None else max(0, length - self.window)
            part = Course(*(array[first:] for array in course))
            passes = self.tuning.ahead_passes
            self.optimise(self.setup, self.tracking, times[first:], 0, passes, part, length - first)
        return course, length

    def shifted(self, last: DDPGuide, times: Array, elapsed: float) -> tuple[Course, int]:
        """Start from a guide after some time [s], on a new grid (T+1,) [s]."""
        then = times + elapsed
        states = np.column_stack([np.interp(then, last.times, column) for column in last.states.T])
        at = np.clip(np.searchsorted(last.times, then[:-1] + 1e-9, side="right") - 1, 0, len(last.times) - 2)
        length = int(np.sum(at < last.length)) if last.times[-1] > then[0] else 0
        modes = last.modes[at].copy()
        modes[:, self.dynamics.m :] *= (np.diff(times) / np.diff(last.times)[at])[:, None]
        course = empty_course(len(at), self.dynamics.n, self.width)
        return course._replace(states=states, control=modes, gains=last.gains[at]), min(length, len(at))
