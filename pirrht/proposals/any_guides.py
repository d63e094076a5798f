"""Guides of any system: per class a trajectory of least cost near the reference, with feedback that holds samples near.

References know neither noise nor the rollouts' steps; a guide starts from one, or from the last guide of its class, and
is improved on the steps of rollouts (`any_ddp`). The width of the boundary layer at walls follows from how far noise
carries the position in a given time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import clearance
from pirrht.moving.distances import traffic_clearance
from pirrht.problem import Problem
from pirrht.proposals.any_ddp import optimiser
from pirrht.proposals.any_guide import Course, DDPGuide, Task
from pirrht.proposals.gates import CARELESS, gates_of, pushes_of
from pirrht.proposals.probed import Noise, active_states, noise_of
from pirrht.proposals.starts import Initialisation
from pirrht.proposals.tracking import MARGIN, NONE, PARABOLA, SAG, TOLERANCE, WILD, Stage, in_time, wall_radius, worth
from pirrht.proposals.walls import Scales
from pirrht.rollouts.backend import kind_of
from pirrht.rollouts.general.kind import is_gated, takes_law
from pirrht.rollouts.general.law import GATE, GATES
from pirrht.rollouts.records import FINER, Setup, law_width
from pirrht.steering.trajectory import Trajectory
from pirrht.systems.dynamics import no_homing
from pirrht.topology.homology import Homology
from pirrht.topology.moving_crossings import NO_RAYS

COLD = ((100.0, 30), (10.0, 30), (1.0, 60))  # from a reference: so many lambda, and backward passes at most
WARM = ((1.0, 8),)  # from the last guide
PUSHED = ((1.0, 60),)  # from a perturbed reference
HURRIES = (1.25, 1.5)  # times the speed of a reference are other starts, where obstacles move
RIVAL = 3.0  # lambda by which an alternative optimum of a class may cost more and still be sampled
APART = 3.0  # nats from which on samples around a guide hardly reach another one
HOLD = 10.0  # cost rate, in q, as far off a reference without controls as walls are wide
STEEP = 10.0  # bound of |a| in sqrt(2 q / lambda), at which control costs as much as time
STEERED = 3.0  # price of lambda / (time in which noise carries the position over its clearance)
SHAKEN = 0.75  # the price where noise acts on the position itself; both tuned for even weights
BESIDE = 0.5  # the price of lambda b^2 / c^2 of a point among moving obstacles
WINDOW, ALL = 30, 1_000_000  # steps at the end of a course that are improved when more of it is tracked
FADED = 5.0  # layers beyond which a wall costs a point among moving obstacles nothing


class DDPGuidance:
    """Makes guides for the references of one problem.

    Args:
        sways: whether controls may rise or fall within a step, as the noise of rollouts does.
        homology: of paths in space and time, where obstacles move.
    """

    def __init__(self, problem: Problem, setup: Setup, *, sways: bool, homology: Homology | None = None) -> None:
        assert self.suits(problem)
        d = problem.dynamics
        self.problem, self.setup, self.homology = problem, setup, homology
        self.width = 2 * d.m if sways and not d.noisy_position else d.m  # modes of a step
        kind = kind_of(problem)
        self.gated = is_gated(kind)
        self.passes = optimiser(kind)
        self.active = active_states(problem)
        noise = noise_of(problem, setup, self.passes.expand, self.active, self.width)
        self.metric = noise.metric
        self.tasks = {warmth: self._task(warmth, noise) for warmth, _ in COLD}
        hold = HOLD * problem.least_rate / wall_radius(problem) ** 2
        tracking, window = self.tasks[COLD[0][0]]._replace(hold=hold), ALL
        if setup.traffic.J > 0:
            # A reference passes obstacles in time; tracking it late and avoiding them ends on another side of some.
            tracking, window = tracking._replace(margin=-np.inf, spacing=np.inf), WINDOW
        self.starts = Initialisation(
            dynamics=d, setup=setup, width=self.width, halts=kind.homing is no_homing, optimise=self.passes.optimise,
            tracking=tracking, window=window, asked=self.tasks[1.0].steep / STEEP,
        )  # fmt: skip

    @property
    def law_width(self) -> int:
        """Numbers of the law of a step."""
        return law_width(self.problem.dynamics.n, self.width) + (GATES * GATE if self.gated else 0)

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Check for any system but points, which climb, and cars (`tracking`)."""
        return takes_law(kind_of(problem))

    def _task(self, warmth: float, noise: Noise) -> Task:
        """Return the numbers of the optimisation for `warmth` times lambda at walls; see `tracking.boundary_layer`."""
        temperature, rate = self.problem.temperature, self.problem.least_rate
        force = rate / wall_radius(self.problem)
        push = warmth * temperature * noise.strength ** (2.0 / 3.0)
        layer, price = (push / force) ** 0.6, SHAKEN if self.problem.dynamics.noisy_position else STEERED
        if self.gated:
            # psi, which vanishes like the distance c, has the price lambda b^2 / (2 c^2) at a flat wall.
            push, price = warmth * temperature * noise.pace * noise.pace, BESIDE
            layer = (push / force) ** (1.0 / 3.0)
        return Task(
            temperature=temperature, margin=(FADED if self.gated else MARGIN) * layer, least=PARABOLA * layer,
            price=price * push, spacing=math.sqrt(8.0 * wall_radius(self.problem) * SAG * layer),
            tolerance=TOLERANCE * warmth * temperature, steep=STEEP * math.sqrt(2.0 * rate / temperature),
            far=math.sqrt(2.0 * rate * temperature) / noise.pace, active=self.active, curved=noise.curved,
        )  # fmt: skip

    def warm_up(self, x: Array) -> None:
        """Compile the optimisation, by a guide of two steps of 1 [s] from x (n,)."""
        self._from(self._clock(x, np.arange(3.0), 0.0), x, np.arange(3.0), 0, (self.starts.empty(2), 1), WARM)

    def improve(
        self, x: Array, times: Array, key: int, trajectory: Trajectory, last: DDPGuide | None = None,
        elapsed: float = 0.0, time: float = 0.0, pressed: Callable[[], bool] | None = None,
    ) -> DDPGuide | None:  # fmt: skip
        """Make a guide from x (n,) in the class with this additive key; None if it does not arrive within `times`.

        Args:
            times: ends of the rollout steps, (T+1,) from 0 [s].
            trajectory: the reference.
            last: the guide of the class made `elapsed` [s] ago.
            time: now, on the clock of moving obstacles [s].
            pressed: whether time is short, so that a reference is improved no further; None: it never is.

        If the improvement leaves the class or touches something, samples follow a faster start or the reference itself,
        with feedback; but where noise has carried the robot into a wall's zone the last guide leads out of it.
        """
        guide = None if last is None else self.onward(x, times, key, last, elapsed, time)
        if guide is not None and (guide.valid or not self._clearance(x, time) > 0.0):
            return guide
        return self._anew(self._clock(x, times, time), x, times, key, trajectory, pressed)[0]

    def _anew(
        self, clock: tuple[Setup, Array], x: Array, times: Array, key: int, trajectory: Trajectory,
        pressed: Callable[[], bool] | None,
    ) -> tuple[DDPGuide | None, list[DDPGuide | None]]:  # fmt: skip
        """Make a guide from a reference; return those of faster starts as well."""
        # Where noise acts on the position, walls are met so soon that 100 lambda would price all of the free space.
        stages = COLD[1:] if self.problem.dynamics.noisy_position else COLD
        guide = self._from(clock, x, times, key, self._begun(x, trajectory, times), in_time(stages, pressed))
        hurried: list[DDPGuide | None] = []
        if guide is None or guide.valid:
            return guide, hurried
        for start in self._hurried(x, trajectory, times):
            if pressed is not None and pressed():
                break
            guide = self._from(clock, x, times, key, start, PUSHED)
            hurried.append(guide)
            if guide is not None and guide.valid:
                return guide, hurried
        return self._from(clock, x, times, key, self._begun(x, trajectory, times), NONE), hurried

    def onward(
        self, x: Array, times: Array, key: int, last: DDPGuide, elapsed: float, time: float = 0.0
    ) -> DDPGuide | None:
        """Improve what is left of an earlier guide (arguments of `improve`)."""
        start = self.starts.shifted(last, times, elapsed)
        return self._from(self._clock(x, times, time), x, times, key, start, WARM)

    def first(
        self, x: Array, times: Array, key: int, trajectory: Trajectory, also: Sequence[Trajectory] = (),
        time: float = 0.0, pressed: Callable[[], bool] | None = None,
    ) -> tuple[DDPGuide | None, DDPGuide | None]:  # fmt: skip
        """Make a guide from the reference, or from another start if that costs less, and an alternative optimum.

        Args:
            also: other references of the class.
            pressed: whether time is short, so that no more starts are tried; None: it never is.
        """
        clock = self._clock(x, times, time)
        own, hurried = self._anew(clock, x, times, key, trajectory, pressed)
        found, rest = [own, *hurried], self._hurried(x, trajectory, times, len(hurried))
        pushed = self.starts.pushed(x, trajectory, times) if self.tasks[1.0].curved else ()
        for start in chain(pushed, (self._begun(x, one, times) for one in also), rest):
            if pressed is not None and pressed():
                break
            found.append(self._from(clock, x, times, key, start, PUSHED))
        valid = [one for one in found if one is not None and one.valid]
        best = min(valid, key=lambda one: one.priced, default=own)
        # Prices are off the value of a class by about lambda.
        if own is not None and own.valid and best is not None:
            best = best if best.priced < own.priced - self.problem.temperature else own
        return best, self.rival(best, valid)

    def rival(self, guide: DDPGuide | None, others: Sequence[DDPGuide | None]) -> DDPGuide | None:
        """Return the cheapest other guide of a class that has some weight and that samples of this one do not reach."""
        if guide is None or not guide.valid:
            return None
        most = guide.priced + RIVAL * self.problem.temperature
        dear = [one for one in others if one is not None and one.valid and one is not guide and one.priced < most]
        apart = [one for one in dear if guide.unlike(one) > APART]
        return min(apart, key=lambda one: one.priced, default=None)

    def _begun(self, x: Array, trajectory: Trajectory, times: Array) -> tuple[Course, int]:
        """Start from x (n,) along a reference, or by tracking one of positions alone."""
        begun = self.starts.along if trajectory.slack is None else self.starts.tracked
        return begun(x, trajectory, times)

    def _hurried(self, x: Array, trajectory: Trajectory, times: Array, made: int = 0) -> Iterator[tuple[Course, int]]:
        """Start faster than the reference where obstacles move; not the first that are made.

        Without noise it is best to pass a closing gap at the last moment. Under much noise no local improvement leads
        from there to passing in good time.
        """
        if self.setup.traffic.J > 0:
            yield from (self._begun(x, trajectory.faster(times_as_fast), times) for times_as_fast in HURRIES[made:])

    def _clock(self, x: Array, times: Array, time: float) -> tuple[Setup, Array]:
        """Return the setup of paths from x (n,), and ends of their steps (T+1,) [s] on its clock."""
        if self.setup.traffic.J == 0:
            return self.setup, times
        then = np.ascontiguousarray(times + time)
        marks = NO_RAYS if self.homology is None else self.homology.rays(x, then)
        return self.setup._replace(marks=marks), then

    def _clearance(self, x: Array, time: float) -> float:
        """Return the clearance of the robot's centre at x (n,) and a time [s], [m]."""
        free = float(clearance(self.setup.arena.field, x[0], x[1]))
        if self.setup.traffic.J > 0:
            free = min(free, float(traffic_clearance(self.setup.traffic, x[0], x[1], time)))
        return free

    def counts(self, guides: Sequence[DDPGuide | None], samples: int) -> list[int]:
        """Return the samples around each reference, (H,): N, or few for a class of negligible weight (`worth`)."""
        return worth([None if guide is None else guide.priced for guide in guides], samples, self.problem.temperature)

    def _from(
        self, clock: tuple[Setup, Array], x: Array, times: Array, key: int, start: tuple[Course, int],
        stages: Iterable[Stage],
    ) -> DDPGuide | None:  # fmt: skip
        (setup, then), (course, length) = clock, start
        course.states[0] = x
        cost, priced, sound = np.inf, np.inf, False
        for warmth, rounds in stages:
            if length < 1:
                return None
            length = self.starts.held_on(course, times, length)
            task = self.tasks[warmth]
            length, cost, priced, _, sound = self.passes.optimise(setup, task, then, key, rounds, course, length)
        if length < 1:
            return None
        length = self.starts.held_on(course, times, length)
        course.control[length:], course.gains[length:], course.volume[length:] = 0.0, 0.0, 0.0
        course.share[length:] = course.inverse[length:] = np.eye(self.width)
        if not STEEP / self.tasks[1.0].steep * np.abs(course.gains).max() < WILD:
            return None
        return DDPGuide(
            dynamics=self.problem.dynamics, times=times, states=course.states, modes=course.control,
            gains=course.gains, share=course.share, inverse=course.inverse, volume=course.volume,
            metric=self.metric, steep=self.tasks[1.0].steep, length=length, cost=cost, priced=priced, valid=bool(sound),
            **(self._beside_walls(setup, then, course.states, length) if self.gated else {}),
        )  # fmt: skip

    def _beside_walls(self, setup: Setup, times: Array, states: Array, length: int) -> dict[str, Any]:
        """Return gates and pushes of a guide (T+1, 2) at times (T+1,) [s]; none past its length."""
        count, rows = length * FINER, length * FINER + 1
        i, share = np.divmod(np.arange(rows) / FINER, 1.0)
        i = np.minimum(i.astype(np.int64), len(times) - 2)
        share = np.where(np.arange(rows) == (len(times) - 1) * FINER, 1.0, share)[:, None]
        places = np.ascontiguousarray((1.0 - share) * states[i] + share * states[i + 1])
        when = (1.0 - share[:, 0]) * times[i] + share[:, 0] * times[i + 1]
        d = self.problem.dynamics
        noise = math.sqrt(float(np.trace(d.B_c(states[0]) @ d.B_c(states[0]).T)) / 2.0)
        gates = np.zeros(((len(times) - 1) * FINER, GATES, GATE))
        within = CARELESS * noise * math.sqrt(float(when[-1] - when[0]))
        gates[:count] = gates_of(setup, places, when, noise, within)[:count]
        slopes, bends = np.zeros((len(gates), 2)), np.zeros((len(gates), 2, 2))
        reach = Scales.of(self.problem, states[0]).reach
        slopes[:count], bends[:count] = pushes_of(setup, places[:count], when[:count], reach)
        return {"gates": gates, "pushes": (slopes, bends)}
