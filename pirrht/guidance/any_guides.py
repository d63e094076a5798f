"""Guides of any system: per class a trajectory of least cost near the reference, with feedback that holds samples near.

What `tracking` is to a car. References know neither noise nor the rollouts' steps; a guide starts from one, or from
what was left of the last guide of its class, and is improved on the very steps of rollouts (`any_ddp`). How wide the
layer at walls is that noise uses up follows from how far noise carries the position in a given time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import clearance
from pirrht.geometry.traffic import traffic_clearance
from pirrht.guidance.any_ddp import Course, Task, empty_course, optimiser
from pirrht.guidance.gates import CARELESS, gates_of, pushes_of
from pirrht.guidance.tracking import MARGIN, PARABOLA, SAG, TOLERANCE, WILD, wall_radius, worth
from pirrht.guidance.walls import Scales
from pirrht.problem import Problem
from pirrht.rollouts.backend import kind_of
from pirrht.rollouts.gates import GATE, GATES
from pirrht.rollouts.general.kind import is_gated, takes_law
from pirrht.rollouts.records import FINER, MovingSetup, Setup, law_width
from pirrht.steering.trajectory import Trajectory
from pirrht.systems.dynamics import Dynamics, no_homing
from pirrht.topology.in_time import TimedHomology
from pirrht.topology.marks import NO_MARKS, Marks

COLD = ((100.0, 30), (10.0, 30), (1.0, 60))  # from a reference: so many lambda, and backward passes at most
WARM = ((1.0, 8),)  # from the last guide
NONE = ((1.0, 0),)
ON = 2  # steps for which what nothing homes in holds its last control, so that it does not halt on the goal's rim
HOLD = 10.0  # time spent as far off a reference without controls as walls are wide costs so many times its q
HEAD, ROUNDS = 10, 20  # steps by which more of it is tracked, and backward passes at most for each
RAMP = 0.5  # of the slack of such a reference it takes to get up to its pace
STEEP = 10.0  # |a| of a guide stays below so many times sqrt(2 q / lambda), under which control costs what time does
STEERED = 3.0  # lambda / (time in which noise carries the position over its clearance) costs so much
SHAKEN = 0.75  # likewise where noise acts on the position itself; both tuned for even weights
BESIDE = 0.5  # and where it does so among bodies that move, in lambda b^2 / c^2
FADED = 5.0  # layers beyond which a wall then costs nothing
SPREADING = 0.5  # time in which noise spreads the position to tell how strong it is [s]
PIECES = 5  # steps of it
PROBES = 8  # states at which this is asked
STRAIGHT = 1e-5  # second derivatives below this are the rounding of differences


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """States that a system passes, with straight lines in between; a path that is only looked at."""

    states: Array  # (k+1, n)
    cost: Array  # (k,) [cost]

    @property
    def tails(self) -> Array:
        """First states, (k, n)."""
        return np.asarray(self.states[:-1])

    @property
    def heads(self) -> Array:
        """Last states, (k, n)."""
        return np.asarray(self.states[1:])

    def points(self, spacing: float) -> list[Array]:
        """Every piece as a line of two points (2, 2) [m]; `spacing` [m] is of no use to straight ones."""
        return [np.vstack(pair) for pair in zip(self.states[:-1, :2], self.states[1:, :2], strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AnyGuide:
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
    priced: float  # the same with clearance priced [cost]
    valid: bool  # whether it touches nothing and is of its class
    pushes: tuple[Array, Array] | None = None  # of walls beside it, (T FINER, 2) [1/m] and how they change, (.., 2, 2)
    gates: Array | None = None  # (T FINER, GATES, GATE) of a point among what moves: walls it has yet to pass

    def input_of(self, x: Array, a: Array) -> Array:
        """The control u (m,) at x (n,) of one in noise units (m,)."""
        return self.dynamics.input_of(x, a)

    @property
    def tape(self) -> Array:
        """Its controls u (T, m), over the steps."""
        m = self.dynamics.m
        return np.array([self.input_of(x, a[:m]) for x, a in zip(self.states, self.modes, strict=False)])

    def rest(self, elapsed: float, goal: Array) -> Trajectory | None:
        """What is left of it after some time [s], into the goal around the centre (2,) [m]; None if nothing."""
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
            controls=np.vstack([self.tape[part], np.zeros(self.dynamics.m)]),
            durations=durations,
            path=Track(states, durations),
            cost=float(durations.sum()),
            length=float(travel.sum()),
        )


class AnyGuidance:
    """Makes guides for the references of one problem.

    Args:
        sways: whether controls may rise or fall within a step, as the noise of rollouts does.
        homology: of paths in space and time, where bodies move.
    """

    def __init__(
        self, problem: Problem, setup: Setup | MovingSetup, *, sways: bool, homology: TimedHomology | None = None
    ) -> None:
        assert self.suits(problem)
        d = problem.dynamics
        self.problem, self.setup, self.homology = problem, setup, homology
        self.width = 2 * d.m if sways and not d.noisy_position else d.m  # modes of a step
        kind = kind_of(problem)
        self.gated = is_gated(kind)
        self.passes, self.halts = optimiser(kind), kind.homing is no_homing
        self.active = self._asked()
        spread, curved, at_once = self._noise()
        most = float(np.linalg.eigvalsh(spread[:2, :2])[-1])
        strength, pace = math.sqrt(3.0 * most / SPREADING**3), math.sqrt(at_once if at_once else most / SPREADING)
        squares = np.diag(spread)
        self.metric = np.divide(squares[0], squares, out=np.zeros(d.n), where=squares > 1e-9 * squares.max())
        self.tasks = {warmth: self._task(warmth, strength, pace, curved) for warmth, _ in COLD}
        hold = HOLD * problem.least_rate / wall_radius(problem) ** 2
        self.tracking = self.tasks[COLD[0][0]]._replace(hold=hold)

    @property
    def law_width(self) -> int:
        """Numbers of the law of a step."""
        return law_width(self.problem.dynamics.n, self.width) + (GATES * GATE if self.gated else 0)

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Whether guides can be made: all but points, which climb, and cars, whose guides are `tracking`'s."""
        return takes_law(kind_of(problem))

    @property
    def _share(self) -> float:
        """Price at walls over what noise does there."""
        if self.gated:
            return BESIDE
        return SHAKEN if self.problem.dynamics.noisy_position else STEERED

    def _task(self, warmth: float, strength: float, pace: float, curved: bool) -> Task:
        """What is minimised if walls were met under `warmth` times lambda; see `tracking.boundary_layer`."""
        temperature, rate = self.problem.temperature, self.problem.least_rate
        force = rate / wall_radius(self.problem)
        push = warmth * temperature * strength ** (2.0 / 3.0)
        layer = (push / force) ** 0.6
        if self.gated:
            # psi, which vanishes like the distance c, has the price lambda b^2 / (2 c^2) beside a flat wall.
            push = warmth * temperature * pace * pace
            layer = (push / force) ** (1.0 / 3.0)
        return Task(
            temperature=temperature,
            margin=(FADED if self.gated else MARGIN) * layer,
            least=PARABOLA * layer,
            price=self._share * push,
            spacing=math.sqrt(8.0 * wall_radius(self.problem) * SAG * layer),
            tolerance=TOLERANCE * warmth * temperature,
            steep=STEEP * math.sqrt(2.0 * rate / temperature),
            far=math.sqrt(2.0 * rate * temperature) / pace,
            active=self.active,
            curved=curved,
        )

    def _noise(self) -> tuple[Array, bool, float]:
        """Covariance (n, n) of the state after SPREADING under noise alone, and whether steps have second derivatives.

        The variance of a position is b^2 t^3 / 3 where noise b acts on the velocity, for a car with b V in its place.
        Where inputs carry the noise, one after the other is what the rate of cost asks for, and the third is the
        variance per second of a position in the noisiest direction, which each heading has elsewhere; else zero.
        """
        d, h = self.problem.dynamics, SPREADING / PIECES
        asked, at_once = math.sqrt(2.0 * self.problem.least_rate / self.problem.temperature), 0.0
        spread, bend = np.zeros((d.n, d.n)), 0.0
        for k, x in enumerate(self._probes()):
            J, S = np.zeros((d.n + 1, d.n + self.width)), np.zeros((d.n + self.width,) * 2)
            control = np.full(self.width, 0.5)
            if d.input_form:
                control = asked * np.eye(self.width)[k % d.m]
                B = d.B_c(x)[:2]
                at_once = max(at_once, float(np.linalg.eigvalsh(B @ B.T)[-1]))
            self.passes.expand(self.setup, x, control, h, np.ones(d.n), self.active, True, J, S)
            A, C = J[:-1, : d.n], J[:-1, d.n :]
            bend = max(bend, float(np.abs(S).max()))
            P = np.zeros((d.n, d.n))
            for _ in range(PIECES):
                P = A @ P @ A.T + C @ C.T / h
            spread += P / PROBES
        return spread, bend > STRAIGHT, at_once

    def _probes(self) -> list[Array]:
        d = self.problem.dynamics
        lower, upper = d.box(self.problem.scene)
        fractions = np.arange(1, d.n + 1) * 0.7548776662 + np.arange(1, PROBES + 1)[:, None] * 0.5698402910
        return list(lower + fractions % 1.0 * (upper - lower))

    def _asked(self) -> int:
        """Bits of the states that drift or q depend on anywhere."""
        problem, found = self.problem, 0
        for x in self._probes():
            here, rate = problem.dynamics.f(x), problem.rate(x)
            for i, off in enumerate(np.eye(problem.dynamics.n)):
                other = x + off * SPREADING
                if np.any(problem.dynamics.f(other) != here) or problem.rate(other) != rate:
                    found |= 1 << i
        return found

    def warm_up(self, x: Array) -> None:
        """Compile the optimisation, by a guide of two steps of 1 [s] from x (n,)."""
        self._from(self._clock(x, np.arange(3.0), 0.0), x, np.arange(3.0), 0, (self._empty(2), 1), WARM)

    def improve(
        self,
        x: Array,
        times: Array,
        key: int,
        trajectory: Trajectory,
        last: AnyGuide | None = None,
        elapsed: float = 0.0,
        time: float = 0.0,
    ) -> AnyGuide | None:
        """A guide from x (n,) in the class with this additive key; None if it does not arrive within `times`.

        Args:
            times: ends of the rollout steps, (T+1,) from 0 [s].
            trajectory: the reference.
            last: the guide of the same class made `elapsed` [s] ago.
            time: now, on the clock of what moves [s].

        If the improvement leaves the class or touches something, samples follow the reference itself, with feedback;
        but where noise has carried the robot into a wall's zone the last guide is the way out of it.
        """
        guide, clock = None, self._clock(x, times, time)
        if last is not None:
            guide = self._from(clock, x, times, key, self._shifted(last, times, elapsed), WARM)
            if guide is not None and guide.valid:
                return guide
        if guide is not None and not self._clearance(x, time) > 0.0:
            return guide
        begun = self._along if trajectory.slack is None else self._tracked
        # Where noise acts on the position, walls are met so soon that 100 lambda would price all of a room.
        stages = COLD[1:] if self.problem.dynamics.noisy_position else COLD
        guide = self._from(clock, x, times, key, begun(x, trajectory, times), stages)
        if guide is None or guide.valid:
            return guide
        return self._from(clock, x, times, key, begun(x, trajectory, times), NONE)

    def _clock(self, x: Array, times: Array, time: float) -> tuple[Setup | MovingSetup, Array]:
        """What paths from x (n,) meet, and ends of their steps (T+1,) [s] on the clock of what moves."""
        if not isinstance(self.setup, MovingSetup):
            return self.setup, times
        then = np.ascontiguousarray(times + time)
        marks = NO_MARKS if self.homology is None else Marks.of(self.homology, x, then)
        return self.setup._replace(marks=marks), then

    def _clearance(self, x: Array, time: float) -> float:
        """Of the robot's centre at x (n,) [m], from what moves at a time [s]."""
        free = float(clearance(self.setup.arena.field, x[0], x[1]))
        if isinstance(self.setup, MovingSetup):
            free = min(free, float(traffic_clearance(self.setup.traffic, x[0], x[1], time)))
        return free

    def counts(self, guides: Sequence[AnyGuide | None], samples: int) -> list[int]:
        """Samples around each reference, (H,): N, or few where a class can hardly carry any weight (`worth`)."""
        return worth([None if guide is None else guide.priced for guide in guides], samples, self.problem.temperature)

    def _empty(self, T: int) -> Course:
        return empty_course(T, self.problem.dynamics.n, self.width)

    def _from(
        self,
        clock: tuple[Setup | MovingSetup, Array],
        x: Array,
        times: Array,
        key: int,
        start: tuple[Course, int],
        stages: Sequence[tuple[float, int]],
    ) -> AnyGuide | None:
        (setup, then), (course, length) = clock, start
        course.states[0] = x
        cost = priced = np.inf
        sound = False
        for warmth, rounds in stages:
            if length < 1:
                return None
            length = self._held_on(course, times, length)
            task = self.tasks[warmth]
            length, cost, priced, _, sound = self.passes.optimise(setup, task, then, key, rounds, course, length)
        if length < 1:
            return None
        length = self._held_on(course, times, length)
        course.control[length:], course.gains[length:], course.volume[length:] = 0.0, 0.0, 0.0
        course.share[length:] = course.inverse[length:] = np.eye(self.width)
        if not STEEP / self.tasks[1.0].steep * np.abs(course.gains).max() < WILD:
            return None
        return AnyGuide(
            dynamics=self.problem.dynamics, times=times, states=course.states, modes=course.control,
            gains=course.gains, share=course.share, inverse=course.inverse, volume=course.volume,
            metric=self.metric, steep=self.tasks[1.0].steep, length=length, cost=cost, priced=priced, valid=bool(sound),
            **(self._beside_walls(setup, then, course.states, length) if self.gated else {}),
        )  # fmt: skip

    def _beside_walls(self, setup: Setup | MovingSetup, times: Array, states: Array, length: int) -> dict[str, Any]:
        """Gates and pushes of a guide (T+1, 2) at times (T+1,) [s]; none past its length."""
        rows = length * FINER + 1
        i, share = np.divmod(np.arange(rows) / FINER, 1.0)
        i = np.minimum(i.astype(np.int64), len(times) - 2)
        share = np.where(np.arange(rows) == (len(times) - 1) * FINER, 1.0, share)[:, None]
        places = np.ascontiguousarray((1.0 - share) * states[i] + share * states[i + 1])
        when = (1.0 - share[:, 0]) * times[i] + share[:, 0] * times[i + 1]
        d = self.problem.dynamics
        noise = math.sqrt(float(np.trace(d.B_c(states[0]) @ d.B_c(states[0]).T)) / 2.0)
        out = np.zeros(((len(times) - 1) * FINER, GATES, GATE))
        found = gates_of(setup, places, when, noise, CARELESS * noise * math.sqrt(float(when[-1] - when[0])))
        out[: rows - 1] = found[: rows - 1]
        slopes, bends = np.zeros((len(out), 2)), np.zeros((len(out), 2, 2))
        reach = Scales.of(self.problem, states[0]).reach
        one, other = pushes_of(setup, places[: rows - 1], when[: rows - 1], reach)
        slopes[: rows - 1], bends[: rows - 1] = one, other
        return {"gates": out, "pushes": (slopes, bends)}

    def _held_on(self, course: Course, times: Array, length: int) -> int:
        """Hold the last law for ON steps more, in which what nothing homes in enters the goal; how many steps it has.

        The optimiser's trajectories end with the last step outside.
        """
        d, end = self.problem.dynamics, min(length + ON, len(course.control)) if self.halts else length
        for i in range(length, end):
            for part in (course.control, course.gains, course.share, course.inverse, course.volume):
                part[i] = part[length - 1]
            u = d.input_of(course.states[i], course.control[i, : d.m])
            course.states[i + 1] = d.step(course.states[i], u, np.zeros(d.m), float(times[i + 1] - times[i]))
        return end

    def _along(self, x: Array, trajectory: Trajectory, times: Array) -> tuple[Course, int]:
        """A tape that drives along a reference from x (n,)."""
        d, course = self.problem.dynamics, self._empty(len(times) - 1)
        tape, state = trajectory.tape(times), x
        ends = int(np.searchsorted(times, trajectory.durations.sum()))
        if self.halts:
            tape[max(ends - 1, 0) : ends + ON] = trajectory.controls[-1]
        for i, u in enumerate(tape):
            course.control[i, : d.m] = d.to_noise(state, u)
            if not (d.constant or d.input_form):
                state = d.step(state, u, np.zeros(d.m), float(times[i + 1] - times[i]))
        return course, min(ends, len(tape))

    def _tracked(self, x: Array, trajectory: Trajectory, times: Array) -> tuple[Course, int]:
        """What stays near where a reference is when, from x (n,); more and more of it is tracked from its start on.

        What is tracked sets off gently, since the system may have to turn about or to get up to speed.
        """
        arena, start = self.setup.arena, trajectory.path.start
        pace = trajectory.length / float(trajectory.durations.sum())
        ahead = np.array([math.cos(start[-1, 2]), math.sin(start[-1, 2])])  # on through the goal, without a halt
        corners = np.vstack([start[:, :2], start[-1, :2] + ahead * pace * (trajectory.durations[-1] + times[-1])])
        passed = np.cumsum([0.0, *trajectory.durations[:-1], trajectory.durations[-1] + times[-1]])
        course = self._empty(len(times) - 1)
        ramp = RAMP * trajectory.slack if trajectory.slack else 0.0
        along = self.problem.dynamics.f(x)[:2] @ np.array([math.cos(start[0, 2]), math.sin(start[0, 2])])
        short = 1.0 - min(max(along / pace, 0.0), 1.0)  # of its pace at the start
        then = times + short * ramp * np.expm1(-times / ramp) if ramp else times
        course.aims[:] = np.column_stack([np.interp(then, passed, column) for column in corners.T])
        course.states[0] = x
        end = float(trajectory.durations.sum()) + arena.radius / pace + short * ramp
        whole = min(len(times) - 1, int(np.searchsorted(times, end)))
        length = 0
        while length < whole:
            length = min(whole, length + HEAD)
            self.passes.optimise(self.setup, self.tracking, times, 0, ROUNDS, course, length)
        return course, length

    def _shifted(self, last: AnyGuide, times: Array, elapsed: float) -> tuple[Course, int]:
        """What is left of a guide after some time, on a new grid."""
        T, m = len(times) - 1, self.problem.dynamics.m
        then = times + elapsed
        states = np.column_stack([np.interp(then, last.times, column) for column in last.states.T])
        at = np.clip(np.searchsorted(last.times, then[:-1] + 1e-9, side="right") - 1, 0, len(last.modes) - 1)
        length = int(np.sum(at < last.length)) if last.times[-1] > then[0] else 0
        modes = last.modes[at].copy()
        modes[:, m:] *= (np.diff(times) / np.diff(last.times)[at])[:, None]
        return self._empty(T)._replace(states=states, control=modes, gains=last.gains[at]), min(length, T)
