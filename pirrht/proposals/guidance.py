"""Guides of a problem: per class a trajectory of least cost near the reference, with feedback that holds samples near.

References know neither noise nor the rollouts' steps: they graze obstacles, and a Dubins curve turns at full lock. A
guide starts from one, or from the last guide of its class, and is improved on the steps of rollouts (`ddp`). The width
of the boundary layer at walls follows from the time in which noise carries the position over it.

With little noise the clearance cost is a wall of its own, a few millimetres thin, along which descent creeps. As in
interior point methods (Fiacco and McCormick 1968) a cold start is therefore optimised for more noise first, and from
there on for less.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.problem import Problem
from pirrht.proposals.ddp import optimiser
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.guide import Course, DDPGuide, Initialisation, Task, empty_course
from pirrht.proposals.tuning import TUNING, ProposalTuning, Stage
from pirrht.proposals.wall_drift import Scales
from pirrht.proposals.walls import drift_along
from pirrht.rollouts.cpu import kind_of
from pirrht.rollouts.tables import FINER, PredictedWorld, Setup, law_columns
from pirrht.steering.motion import Trajectory
from pirrht.systems.dynamics import no_homing
from pirrht.topology.signature import Classes
from pirrht.traits import Traits

Short = Callable[[], bool] | None  # tells whether time is short; None: it is unlimited


def late(short: Short) -> bool:
    """Check whether time is short."""
    return short is not None and short()


class Query(NamedTuple):
    """A class, by its additive key, at one state (n,) and time."""

    setup: Setup
    classes: Classes  # of paths from there
    clock: Array  # (T+1,) ends of the steps, on the clock of moving obstacles [s]
    x: Array
    times: Array  # (T+1,) ends of the steps, from 0 [s]
    key: int


class DDPGuidance:
    """Makes guides for references of one problem in the sampler's world; if it `sways`, controls vary in a step."""

    def __init__(
        self, problem: Problem, world: PredictedWorld, *, sways: bool, tuning: ProposalTuning = TUNING
    ) -> None:
        if not self.suits(problem):
            raise OptionError(
                "a point without drift among static obstacles takes StraightLine.of(problem) as its steering"
            )
        d, (setup, homology) = problem.dynamics, world.snapshot
        kind = kind_of(problem, setup.world.static.kernels, setup.world.moving.kernels, homology.table.kernels)

        self.problem = problem
        self.world = world
        self.tuning = tuning
        self.gated = kind.gated

        self.width = 2 * d.m if sways and not d.noisy_position else d.m  # modes of a step
        self.wall_radius = max(tuning.wall_radii * problem.scene.robot_radius, tuning.wall_radius)
        self.optimise = optimiser(kind)
        strength, position, curved, active, self.metric = _noise_of(problem, setup, self.width, tuning)
        self.tasks = {warmth: self._task(warmth, strength, position, curved, active) for warmth, _ in tuning.cold}
        # Walls are met so soon under strong noise that the first stages would price all of the free space.
        fitting = [stage for stage in tuning.cold if self._layer(stage) <= tuning.widest_layer * self.wall_radius]
        self.cold = tuple(fitting) or tuning.cold[-1:]
        hold = tuning.hold * problem.least_rate / self.wall_radius**2
        tracking, window = self.tasks[self.cold[0][0]]._replace(hold=hold), None
        if setup.world.moving.J > 0:
            # A reference passes obstacles in time; tracking it late and avoiding them ends on another side of some.
            tracking, window = tracking._replace(margin=-np.inf, spacing=np.inf), tuning.window
        self.onward = tuning.onward if kind.homing is no_homing else 0
        self.starts = Initialisation(
            dynamics=d, setup=setup, classes=homology.static.classes(np.zeros(d.n), np.zeros(1)), width=self.width,
            optimise=self.optimise, tracking=tracking, window=window, tuning=tuning,
        )  # fmt: skip

    @property
    def law_width(self) -> int:
        """Numbers of the law of a step."""
        return int(law_columns(self.problem.dynamics.n, self.width).width)

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Check for any system but points among static obstacles, which climb psi."""
        return not Traits.of(problem).climbs(bool(problem.scene.movers))

    def _task(self, warmth: float, strength: float, position: float, curved: bool, active: int) -> Task:
        """Return the numbers of the optimisation for `warmth` times lambda at walls, by `_noise_of`.

        A wall of curvature 1/r holds a system that saves cost q per second with the force q / (V r). Over a distance c
        that is worth lambda in the time in which noise carries the position so far. The layer is that c.
        """
        t, temperature, rate = self.tuning, self.problem.temperature, self.problem.least_rate
        force = rate / self.wall_radius
        push = warmth * temperature * strength ** (2.0 / 3.0)
        price = t.barrier_noisy if self.problem.dynamics.noisy_position else t.barrier

        layer = (push / force) ** 0.6
        margin = t.margin
        exponent = -2.0 / 3.0

        if self.gated:
            # psi, which vanishes like the distance c, has the price lambda b^2 / (2 c^2) at a flat wall.
            push, price, margin = warmth * temperature * position**2, t.barrier_point, t.margin_point
            layer, exponent = (push / force) ** (1.0 / 3.0), -2.0
        sag = t.sag_point if self.gated else t.sag
        return Task(
            temperature=temperature, margin=margin * layer, least=t.parabola * layer, price=price * push,
            exponent=exponent, spacing=math.sqrt(8.0 * self.wall_radius * sag * layer),
            tolerance=t.tolerance * warmth * temperature, steep=t.steepest * math.sqrt(2.0 * rate / temperature),
            far=math.sqrt(2.0 * rate * temperature) / position, active=active, curved=curved,
        )  # fmt: skip

    def _layer(self, stage: Stage) -> float:
        """Return the boundary layer of a stage [m]."""
        return self.tasks[stage[0]].least / self.tuning.parabola

    def warm_up(self, x: Array) -> None:
        """Compile the optimisation, by a guide of two steps of 1 s from x (n,)."""
        course = empty_course(2, self.problem.dynamics.n, self.width)
        self._from(self.query(x, np.arange(3.0), 0), (course, 1), self.tuning.warm)

    def optima(
        self, query: Query, reference: Trajectory, last: Sequence[DDPGuide] = (), elapsed: float = 0.0, *,
        alternatives: Sequence[Trajectory] = (), thorough: bool = False, paces: Sequence[float] = (),
        short: Short = None,
    ) -> list[DDPGuide]:  # fmt: skip
        """Return the local optima of a class that have some weight, best first; none if none arrives within the time.

        Improved are what is left of the `last` optima, found `elapsed` [s] ago, and if the first of them leaves the
        class or touches something, the initialisations of the class, all of them or (unless `thorough`) up to the first
        valid guide; but where noise has carried the robot into a wall's zone the first leads out of it. If nothing
        valid is found, samples follow what the reference led to. By a clock, which tells when time is `short`, guides
        are improved in parts, and what is valid after one is left to the next plan.
        """
        starts = [self.starts.shifted(one, query.times, elapsed) for one in last]
        found = [self._from(query, start, self.tuning.warm, short, paces) for start in starts]
        first = found[0] if found else None

        if first is None or not (first.valid or self._in_margin(query)):
            fresh = self._fresh(query, (reference, *alternatives), thorough, short)
            first = fresh[0] if fresh else None
            found = [*fresh, *found[1:]]
        return self._ranked(first, [one for one in found if one is not None and one.valid])

    def _in_margin(self, query: Query) -> bool:
        """Return whether noise has carried the robot into a wall's zone."""
        world = query.setup.world
        reads = list(self.problem.dynamics.reads(world.static.kernels.turns))
        return bool(world.clearance(tuple(query.x[reads].tolist()), float(query.clock[0])) <= 0.0)

    def _ranked(self, first: DDPGuide | None, valid: Sequence[DDPGuide]) -> list[DDPGuide]:
        """Return the best of some valid guides, and the cheapest others with weight that its samples miss.

        There is one other in the plane, and there are two in space: to either side of an obstacle, and over it.
        """
        if not valid:
            return [] if first is None else [first]
        best, t = min(valid, key=lambda one: one.penalised), self.tuning
        if first is not None and first.valid and first.penalised <= best.penalised + self.problem.temperature:
            best = first  # prices are off the value of a class by about lambda
        most = best.penalised + t.alternative * self.problem.temperature
        chosen = [best]
        for one in sorted(valid, key=lambda one: one.penalised):
            apart = all(kept is not one and kept.log_ratio_to(one) > t.apart for kept in chosen)
            if apart and one.penalised < most and len(chosen) < len(self.problem.dynamics.position):
                chosen.append(one)
        return chosen

    def _fresh(self, query: Query, paths: Sequence[Trajectory], thorough: bool, short: Short) -> list[DDPGuide]:
        """Return valid guides from the initialisations of a class; without any, that from the first path."""
        found: list[DDPGuide | None] = []
        for start, stages in self._initialisations(query, paths, thorough):
            if found and late(short):
                break
            found.append(self._from(query, start, stages, short, self.tuning.paces))
            if not thorough and (found[0] is None or (found[-1] is not None and found[-1].valid)):
                break
        first = [one for one in found[:1] if one is not None]
        return [one for one in found if one is not None and one.valid] or first

    def _initialisations(
        self, query: Query, paths: Sequence[Trajectory], thorough: bool
    ) -> Iterator[tuple[tuple[Course, int], tuple[Stage, ...]]]:
        """Yield the initialisations of a class and the stages of their improvement, its paths first.

        Optimisation is local. Among moving obstacles a class has several optima: to pass a closing gap at the last
        moment, in good time as is better under much noise, or to let it open again. So other speeds are tried; where
        steps curve, turning about has several optima: paths that turn tighter find them, or else the first controls are
        perturbed.
        """
        # Where noise acts on the position, walls are met so soon that 100 lambda would price all of the free space.
        t, noisy = self.tuning, self.problem.dynamics.noisy_position
        reference, *alternatives = paths
        for path in paths:
            yield self._begun(query, path), t.cold[1:] if noisy else self.cold
        if query.setup.world.moving.J > 0:
            yield from ((self._begun(query, reference.faster(scale)), t.perturbed) for scale in t.time_scales)
        if thorough and self.tasks[1.0].curved and not alternatives:
            # Of a tracked path no controls are known: perturbed from rest, homing finds optima that tracking does not.
            course, length = self.starts.along(query.x, reference, query.times)
            yield from ((start, t.perturbed) for start in self.starts.perturbed(course.control, length, query.times))

    def _begun(self, query: Query, trajectory: Trajectory) -> tuple[Course, int]:
        """Start from x (n,) by the controls of a reference, or by tracking its positions if these are unknown."""
        known = trajectory.slack is None or trajectory.controls.any()
        begun = self.starts.along if known else self.starts.tracked
        return begun(query.x, trajectory, query.times)

    def query(self, x: Array, times: Array, key: int, time: float = 0.0) -> Query:
        """Prepare for guides of a class from x (n,) at a time [s]."""
        (setup, homology), clock = self.world.snapshot, times
        if setup.world.moving.J > 0:
            clock = np.ascontiguousarray(times + time)
        return Query(setup, homology.classes(x, clock), clock, x, times, key)

    def counts(self, guides: Sequence[DDPGuide | None], samples: int) -> list[int]:
        """Return the samples around each reference, (H,): N, or few for one of negligible weight or without a guide."""
        penalised = [np.inf if guide is None else guide.penalised for guide in guides]
        bound = self.hopeless(min(penalised))
        few = min(self.tuning.few, samples)

        return [samples if bound == np.inf or one <= bound else few for one in penalised]

    def hopeless(self, least: float) -> float:
        """Return the cost from which on a class weighs nothing next to one of the least cost."""
        return least * (1.0 + self.tuning.hopeless_share) + self.tuning.hopeless * self.problem.temperature

    def _from(
        self, query: Query, start: tuple[Course, int], stages: Sequence[Stage],
        short: Short = None, paces: Sequence[float] = (),
    ) -> DDPGuide | None:  # fmt: skip
        """Improve a course stage by stage, as long as there is time, and make a guide of it."""
        course, length = start
        d = self.problem.dynamics
        times = query.times
        setup, classes, clock, *_ = query

        course.states[0] = query.x

        def improved(course: Course, length: int, stages: Sequence[Stage]) -> tuple[int, float, float, bool]:
            found = (length, np.inf, np.inf, False)
            for warmth, rounds in self._parts(stages, short):
                if found[0] > 0:
                    task = self.tasks[warmth]
                    found = self.optimise(setup, classes, task, clock, query.key, rounds, course, found[0])
                if found[-1] and short is not None:
                    break  # the next plan goes on from here
            return found

        begun = course.control[0].copy()
        again = (Course(*map(np.copy, course)), length) if len(stages) > 1 else None
        length, cost, penalised, sound = improved(course, length, stages)
        if again is not None and length != 0 and not (sound or late(short)):  # high prices of walls led it astray
            course, length = again
            length, cost, penalised, sound = improved(course, length, stages[-1:])
        if sound and query.setup.world.moving.J == 0:
            course, (length, cost, penalised, sound) = self._paced(
                query, course, (length, cost, penalised, sound), paces, short
            )
        if length == 0 and np.isfinite(cost) and not self.gated:  # its first step enters the goal
            self._entering(setup, course, begun, float(times[1]))
            length = 1
        if length < 1:
            return None
        end = min(length + self.onward, len(course.control))
        for i in range(length, end):  # on into the goal, if nothing homes in on it
            for part in course[1:6]:
                part[i] = part[length - 1]
            u = d.input_of(course.states[i], course.control[i, : d.m])
            course.states[i + 1] = d.step(course.states[i], u, np.zeros(d.m), float(times[i + 1] - times[i]))
        course.control[end:], course.gains[end:], course.volume[end:] = 0.0, 0.0, 0.0
        course.share[end:] = course.inverse[end:] = np.eye(self.width)
        steep = self.tasks[1.0].steep
        if not self.tuning.steepest / steep * np.abs(course.gains).max() < self.tuning.wildest:
            return None
        drift, bend = self._drift(query, course.states, end) if self.gated else (None, None)
        return DDPGuide(
            dynamics=d, times=times, states=course.states, modes=course.control, gains=course.gains,
            share=course.share, inverse=course.inverse, volume=course.volume, metric=self.metric, steep=steep,
            length=end, cost=cost, penalised=penalised, valid=bool(sound), drift=drift, bend=bend,
        )  # fmt: skip

    def _parts(self, stages: Sequence[Stage], short: Short) -> Iterator[Stage]:
        """Yield stages; by a clock in parts, so that no optimisation takes long, and one of each once time is short."""
        for warmth, rounds in stages:
            if short is None:
                yield warmth, rounds
                continue
            for _ in range(0, rounds, self.tuning.part):
                hasty = short()
                yield warmth, self.tuning.part_short if hasty else self.tuning.part
                if hasty:
                    break

    def _paced(
        self, query: Query, course: Course, found: tuple[int, float, float, bool], paces: Sequence[float],
        short: Short,
    ) -> tuple[Course, tuple[int, float, float, bool]]:  # fmt: skip
        """Improve a course from itself at other paces, each as often as it gains.

        Where steps touch corners has many local optima: passing a corner with the next step instead of this one.
        """
        task, rounds = self.tasks[1.0], self.tuning.paced
        for pace in paces:
            while found[0] > 0 and not late(short):
                other, length = self.starts.retimed(course, found[0], query.times, query.times, pace=pace)
                other.states[0] = query.x
                better = self.optimise(query.setup, query.classes, task, query.clock, query.key, rounds, other, length)
                if not better[3] or not better[2] < found[2] - task.tolerance:
                    break
                course, found = other, better
        return course, found

    def _entering(self, setup: Setup, course: Course, begun: Array, dt: float) -> None:
        """Write a first step of dt [s] that enters the goal: by homing, or a control (modes,) that it began with."""
        d, x, world = self.problem.dynamics, course.states[0], setup.world
        course.control[0], course.gains[0], course.volume[0] = begun, 0.0, 0.0
        course.share[0] = course.inverse[0] = np.eye(self.width)
        if d.homing is not no_homing:
            course.control[0] = 0.0
            aim, rate = (world.goal, world.radius), setup.least_rate
            d.homing(x, setup.parameters, d.B_c(x), *aim, rate, course.control[0, : d.m])
        u = d.input_of(x, course.control[0, : d.m])
        course.states[1] = d.step(x, u, np.zeros(d.m), dt)

    def _drift(self, query: Query, states: Array, length: int) -> tuple[Array, Array]:
        """Evaluate slope and bend of log psi by near walls along a guide (T+1, n); none past its length."""
        count = length * FINER
        total = (len(query.times) - 1) * FINER
        at = np.arange(count) / FINER
        ends = np.arange(len(query.times))
        places = np.column_stack([np.interp(at, ends, column) for column in self.problem.dynamics.place(states).T])
        times, offset = np.interp(at, ends, query.clock), Scales.of(self.problem, states[0]).wall_offset
        d = places.shape[1]
        slopes = np.zeros((total, d))
        bends = np.zeros((total, d, d))
        world = query.setup.world
        along = drift_along(world.static.kernels, world.moving.kernels)
        slopes[:count], bends[:count] = along(query.setup, places, times, offset)
        return slopes, bends


def _noise_of(
    problem: Problem, setup: Setup, width: int, tuning: ProposalTuning
) -> tuple[float, float, bool, int, Array]:
    """Measure the noise of a problem by the derivatives of its steps at some states, with `width` modes.

    Where inputs carry the noise, each in turn is at the strength that costs as much as time. An OptionError is raised
    if no noise reaches the position.
    Returns: b of a position's variance b^2 t^3 / 3, where noise acts on the velocity [m/s^1.5], and of b^2 t, where it
        acts on the position [m/sqrt(s)]; whether steps have second derivatives; bit k tells whether drift or q depends
        on the k-th state; weights (n,) of squared differences between states, inverse to their noise, the first's 1.
    """
    d, h = problem.dynamics, tuning.spreading / tuning.spreading_steps
    lower, upper = d.box(problem.scene)
    fractions = np.arange(1, d.n + 1) * 0.7548776662 + np.arange(1, tuning.probes + 1)[:, None] * 0.5698402910
    states, active = lower + fractions % 1.0 * (upper - lower), 0
    for i, off in enumerate(tuning.spreading * np.eye(d.n)):
        rates = [np.append(d.f(x + off) - d.f(x), problem.rate(x + off) - problem.rate(x)) for x in states]
        active |= int(np.any(rates)) << i
    asked, at_once = math.sqrt(2.0 * problem.least_rate / problem.temperature), 0.0
    spread, bend, expand = np.zeros((d.n, d.n)), 0.0, forward_pass(kind_of(problem, setup.world.static.kernels)).expand
    for k, x in enumerate(states):
        J = np.zeros((d.n + 1, d.n + width))
        S = np.zeros((d.n + width,) * 2)
        control = np.full(width, 0.5)
        if d.input_form:
            control = asked * np.eye(width)[k % d.m]
            B = d.position_noise(x)
            at_once = max(at_once, float(np.linalg.eigvalsh(B @ B.T)[-1]))
        expand(setup, (x, control, h, np.ones(d.n)), active, True, J, S)
        A = J[:-1, : d.n]
        C = J[:-1, d.n :]
        bend = max(bend, float(np.abs(S).max()))
        P = np.zeros((d.n, d.n))

        for _ in range(tuning.spreading_steps):
            P = A @ P @ A.T + C @ C.T / h
        spread += P / len(states)
    position = np.ix_(d.position, d.position)
    if not spread[position].any():
        raise OptionError(
            f"{type(d).__name__}: its noise never reaches x, y; its drift must say how they move, as in out[0] = x[2]"
        )

    most = float(np.linalg.eigvalsh(spread[position])[-1])
    squares = np.diag(spread)
    metric = np.zeros(d.n)

    np.divide(squares[d.position[0]], squares, out=metric, where=squares > 1e-9 * squares.max())
    noise = math.sqrt(at_once if at_once else most / tuning.spreading)
    strength = math.sqrt(3.0 * most / tuning.spreading**3)
    return strength, noise, bend > tuning.straight, active, metric
