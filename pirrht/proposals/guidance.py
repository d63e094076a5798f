"""Guides of a problem: per class a trajectory of least cost near the reference, with feedback that holds samples near.

References know neither noise nor the rollouts' steps: they graze obstacles, and a Dubins curve turns at full lock. A
guide starts from one, or from the last guide of its class, and is improved on the steps of rollouts (`ddp`). The width
of the boundary layer at walls follows from the time in which noise carries the position over it.

With little noise the clearance cost is a wall of its own, a few millimetres thin, along which descent creeps. As in
interior point methods (Fiacco and McCormick 1968) a cold start is therefore optimised for more noise first, and from
there on for less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import clearance
from pirrht.problem import Problem
from pirrht.proposals.ddp import optimiser
from pirrht.proposals.guide import Course, DDPGuide, Task, WallsAhead, empty_course
from pirrht.proposals.half_spaces import constraints_of, drifts_of
from pirrht.proposals.initialisation import Initialisation
from pirrht.proposals.noise_scales import Noise, noise_of
from pirrht.proposals.tuning import TUNING, ProposalTuning, Stage
from pirrht.proposals.wall_drift import Scales
from pirrht.rollouts.cpu import kind_of
from pirrht.rollouts.general.law import GATE, GATES
from pirrht.rollouts.tables import FINER, PredictedWorld, Setup, law_width
from pirrht.steering.motion import Trajectory
from pirrht.systems.dynamics import no_homing

UNIMPROVED: tuple[Stage, ...] = ((1.0, 0),)


class Query(NamedTuple):
    """A class at one state and time."""

    setup: Setup  # of paths from there
    clock: Array  # (T+1,) ends of the steps, on the clock of moving obstacles [s]
    x: Array  # (n,)
    times: Array  # (T+1,) ends of the steps, from 0 [s]
    key: int  # additive


class DDPGuidance:
    """Makes guides for the references of one problem.

    Args:
        world: the predicted world, shared with the sampler.
        sways: whether controls may rise or fall within a step, as the noise of rollouts does.
    """

    def __init__(
        self, problem: Problem, world: PredictedWorld, *, sways: bool, tuning: ProposalTuning = TUNING
    ) -> None:
        assert self.suits(problem)
        d = problem.dynamics
        self.problem, self.world, self.tuning, setup = problem, world, tuning, world.setup
        self.width = 2 * d.m if sways and not d.noisy_position else d.m  # modes of a step
        kind = kind_of(problem, setup.world.moving.kernels)
        self.gated = kind.gated
        self.wall_radius = max(tuning.wall_radii * problem.scene.robot_radius, tuning.wall_radius)
        self.optimise = optimiser(kind)
        noise = noise_of(problem, setup, self.width, tuning)
        self.metric = noise.metric
        self.tasks = {warmth: self._task(warmth, noise) for warmth, _ in tuning.cold}
        hold = tuning.hold * problem.least_rate / self.wall_radius**2
        tracking, window = self.tasks[tuning.cold[0][0]]._replace(hold=hold), None
        if setup.world.moving.J > 0:
            # A reference passes obstacles in time; tracking it late and avoiding them ends on another side of some.
            tracking, window = tracking._replace(margin=-np.inf, spacing=np.inf), tuning.window
        self.starts = Initialisation(
            dynamics=d, setup=setup, width=self.width, halts=kind.homing is no_homing, optimise=self.optimise,
            tracking=tracking, window=window, asked=self.tasks[1.0].steep / tuning.steepest, tuning=tuning,
        )  # fmt: skip

    @property
    def setup(self) -> Setup:
        """Scene and problem under the current prediction."""
        return self.world.setup

    @property
    def law_width(self) -> int:
        """Numbers of the law of a step."""
        return law_width(self.problem.dynamics.n, self.width) + (GATES * GATE if self.gated else 0)

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Check for any system but points among static obstacles, which climb psi."""
        return bool(problem.scene.movers) or kind_of(problem).takes_law

    def _task(self, warmth: float, noise: Noise) -> Task:
        """Return the numbers of the optimisation for `warmth` times lambda at walls.

        A wall of curvature 1/r holds a system that saves cost q per second with the force q / (V r). Over a distance c
        that is worth lambda in the time in which noise carries the position so far. The layer is that c.
        """
        t, temperature, rate = self.tuning, self.problem.temperature, self.problem.least_rate
        force = rate / self.wall_radius
        push = warmth * temperature * noise.strength ** (2.0 / 3.0)
        price = t.barrier_noisy if self.problem.dynamics.noisy_position else t.barrier
        layer, margin, exponent = (push / force) ** 0.6, t.margin, -2.0 / 3.0
        if self.gated:
            # psi, which vanishes like the distance c, has the price lambda b^2 / (2 c^2) at a flat wall.
            push, price, margin = warmth * temperature * noise.position**2, t.barrier_point, t.margin_point
            layer, exponent = (push / force) ** (1.0 / 3.0), -2.0
        return Task(
            temperature=temperature, margin=margin * layer, least=t.parabola * layer, price=price * push,
            exponent=exponent, spacing=math.sqrt(8.0 * self.wall_radius * t.sag * layer),
            tolerance=t.tolerance * warmth * temperature, steep=t.steepest * math.sqrt(2.0 * rate / temperature),
            far=math.sqrt(2.0 * rate * temperature) / noise.position, active=noise.active, curved=noise.curved,
        )  # fmt: skip

    def warm_up(self, x: Array) -> None:
        """Compile the optimisation, by a guide of two steps of 1 [s] from x (n,)."""
        course = empty_course(2, self.problem.dynamics.n, self.width)
        self._from(self.query(x, np.arange(3.0), 0, 0.0), (course, 1), self.tuning.warm)

    def improve(
        self, x: Array, times: Array, key: int, trajectory: Trajectory, last: DDPGuide | None = None,
        elapsed: float = 0.0, time: float = 0.0,
    ) -> DDPGuide | None:  # fmt: skip
        """Return the best local optimum from x (n,) in a class; see `optima`."""
        query = self.query(x, times, key, time)
        return next(iter(self.optima(query, trajectory, [] if last is None else [last], elapsed)), None)

    def optima(
        self, query: Query, reference: Trajectory, last: Sequence[DDPGuide] = (), elapsed: float = 0.0, *,
        thorough: bool = False, short: Callable[[], bool] = lambda: False,
    ) -> list[DDPGuide]:  # fmt: skip
        """Return the local optima of a class that have some weight, best first; none if none arrives within the time.

        Improved is what is left of the last plan's optima, and if the first of them leaves the class or touches
        something, the initialisations of the class; but where noise has carried the robot into a wall's zone the first
        leads out of it. If nothing valid is found, samples follow the reference with feedback.

        Args:
            reference: path of the class.
            last: optima of the class found `elapsed` [s] ago.
            thorough: whether all initialisations are improved; else up to the first that gives a valid guide.
            short: whether time is short, so that nothing more is improved.
        """
        if not last and self._is_late(query, reference):
            return []
        starts = [self.starts.shifted(one, query.times, elapsed) for one in last]
        found = [self._from(query, start, self.tuning.warm) for start in starts]
        first = found[0] if found else None
        if first is None or not (first.valid or _clearance(query) <= 0.0):
            fresh = self._improved(query, reference, thorough, short)
            first, found = fresh[0] if fresh else None, [*fresh, *found[1:]]
        return self._ranked(first, [one for one in found if one is not None and one.valid])

    def _is_late(self, query: Query, reference: Trajectory) -> bool:
        """Check that controls of a reference enter the goal only after the horizon: optimisation could not start."""
        seconds = float(reference.durations.sum())
        rim = query.setup.world.radius * seconds / max(reference.length, 1e-9)
        return reference.slack is None and seconds - rim > query.times[-1]

    def _ranked(self, first: DDPGuide | None, valid: Sequence[DDPGuide]) -> list[DDPGuide]:
        """Return the best of some valid guides, and the cheapest other one that has weight and that its samples miss.

        The first is best unless another costs less by lambda; without a valid one it is the only one.
        """
        if not valid:
            return [] if first is None else [first]
        best, t = min(valid, key=lambda one: one.penalised), self.tuning
        if first is not None and first.valid and first.penalised <= best.penalised + self.problem.temperature:
            best = first  # prices are off the value of a class by about lambda
        most = best.penalised + t.alternative * self.problem.temperature
        others = [one for one in valid if one is not best and one.penalised < most and best.log_ratio_to(one) > t.apart]
        return [best, *sorted(others, key=lambda one: one.penalised)[:1]]

    def _improved(
        self, query: Query, reference: Trajectory, thorough: bool, short: Callable[[], bool]
    ) -> list[DDPGuide]:
        """Return valid guides from the initialisations of a class; without any, one along the reference."""
        found: list[DDPGuide | None] = []
        for start, stages in self._initialisations(query, reference, thorough, short):
            if found and short():
                break
            found.append(self._from(query, start, stages))
            if not thorough and (found[0] is None or (found[-1] is not None and found[-1].valid)):
                break
        valid = [one for one in found if one is not None and one.valid]
        if valid or found[0] is None:
            return valid
        unimproved = self._from(query, self._begun(query, reference), UNIMPROVED)
        return [] if unimproved is None else [unimproved]

    def _initialisations(
        self, query: Query, reference: Trajectory, thorough: bool, short: Callable[[], bool]
    ) -> Iterator[tuple[tuple[Course, int], Iterable[Stage]]]:
        """Yield the initialisations of a class and the stages of their improvement, the reference first.

        Optimisation is local. Among moving obstacles a class has several optima: to pass a closing gap at the last
        moment, in good time as is better under much noise, or to let it open again. So other speeds are tried; where
        steps curve, turning about has several optima, and the first controls are perturbed.
        """
        # Where noise acts on the position, walls are met so soon that 100 lambda would price all of the free space.
        t, noisy = self.tuning, self.problem.dynamics.noisy_position
        yield self._begun(query, reference), in_time(t.cold[1:] if noisy else t.cold, short)
        if query.setup.world.moving.J > 0:
            yield from ((self._begun(query, reference.faster(scale)), t.perturbed) for scale in t.time_scales)
        if thorough and self.tasks[1.0].curved:
            # Of a tracked path no controls are known: perturbed from rest, homing finds optima that tracking does not.
            course, length = self.starts.along(query.x, reference, query.times)
            yield from ((start, t.perturbed) for start in self.starts.perturbed(course.control, length, query.times))

    def _begun(self, query: Query, trajectory: Trajectory) -> tuple[Course, int]:
        """Start from x (n,) along a reference, or by tracking one of positions alone."""
        begun = self.starts.along if trajectory.slack is None else self.starts.tracked
        return begun(query.x, trajectory, query.times)

    def query(self, x: Array, times: Array, key: int, time: float) -> Query:
        """Prepare for guides of a class from x (n,) at a time [s]."""
        setup, clock = self.setup, times
        if setup.world.moving.J > 0:
            clock = np.ascontiguousarray(times + time)
            setup = setup._replace(marks=self.world.homology.rays(x, clock))
        return Query(setup, clock, x, times, key)

    def counts(self, guides: Sequence[DDPGuide | None], samples: int) -> list[int]:
        """Return the samples around each reference, (H,): N, or few for a class of negligible weight.

        Classes whose guide costs k lambda more than the cheapest weigh about exp(-k); a reference without a guide takes
        longer than any path of some weight.
        """
        penalised = [np.inf if guide is None else guide.penalised for guide in guides]
        bound, few = self.hopeless(min(penalised)), min(self.tuning.few, samples)
        return [samples if bound == np.inf or one <= bound else few for one in penalised]

    def hopeless(self, least: float) -> float:
        """Return the cost from which on a class weighs nothing next to one of the least cost."""
        return least * (1.0 + self.tuning.hopeless_share) + self.tuning.hopeless * self.problem.temperature

    def _from(self, query: Query, start: tuple[Course, int], stages: Iterable[Stage]) -> DDPGuide | None:
        course, length = start
        course.states[0] = query.x
        cost, penalised, sound = np.inf, np.inf, False
        for warmth, rounds in stages:
            if length < 1:
                return None
            length = self.starts.continued(course, query.times, length)
            length, cost, penalised, sound = self.optimise(
                query.setup, self.tasks[warmth], query.clock, query.key, rounds, course, length
            )
        if length < 1:
            return None
        length = self.starts.continued(course, query.times, length)
        course.control[length:], course.gains[length:], course.volume[length:] = 0.0, 0.0, 0.0
        course.share[length:] = course.inverse[length:] = np.eye(self.width)
        steep = self.tasks[1.0].steep
        if not self.tuning.steepest / steep * np.abs(course.gains).max() < self.tuning.wildest:
            return None
        return DDPGuide(
            dynamics=self.problem.dynamics, times=query.times, states=course.states, modes=course.control,
            gains=course.gains, share=course.share, inverse=course.inverse, volume=course.volume,
            metric=self.metric, steep=steep, length=length, cost=cost, penalised=penalised, valid=bool(sound),
            walls_ahead=self._walls_ahead(query, course.states, length) if self.gated else None,
        )  # fmt: skip

    def _walls_ahead(self, query: Query, states: Array, length: int) -> WallsAhead:
        """Evaluate half-space constraints and wall drift along a guide (T+1, 2); none past its length."""
        times, count, rows = query.clock, length * FINER, length * FINER + 1
        i, share = np.divmod(np.arange(rows) / FINER, 1.0)
        i = np.minimum(i.astype(np.int64), len(times) - 2)
        share = np.where(np.arange(rows) == (len(times) - 1) * FINER, 1.0, share)[:, None]
        places = np.ascontiguousarray((1.0 - share) * states[i] + share * states[i + 1])
        when = (1.0 - share[:, 0]) * times[i] + share[:, 0] * times[i + 1]
        d = self.problem.dynamics
        noise = math.sqrt(float(np.trace(d.B_c(states[0]) @ d.B_c(states[0]).T)) / 2.0)
        total, offset = (len(times) - 1) * FINER, Scales.of(self.problem, states[0]).wall_offset
        ahead = WallsAhead(np.zeros((total, GATES, GATE)), np.zeros((total, 2)), np.zeros((total, 2, 2)))
        within = self.tuning.careless * noise * math.sqrt(float(when[-1] - when[0]))
        ahead.half_spaces[:count] = constraints_of(query.setup, places, when, noise, within)[:count]
        ahead.drift[:count], ahead.bend[:count] = drifts_of(query.setup, places[:count], when[:count], offset)
        return ahead


def _clearance(query: Query) -> float:
    """Return the clearance of the robot's centre at the start, [m]."""
    (x, y), world = query.x[:2], query.setup.world
    if world.moving.J == 0:
        return float(clearance(world.field, x, y))
    return world.clearance(x, y, float(query.clock[0]))


def in_time(stages: Sequence[Stage], short: Callable[[], bool]) -> Iterator[Stage]:
    """Yield the stages until time is short, and then one that makes a guide without improving it."""
    for stage in stages:
        if short():
            yield from UNIMPROVED
            return
        yield stage
