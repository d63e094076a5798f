"""Guides of a car: per class a trajectory of least cost near the reference, with feedback that holds samples near it.

Dubins curves are bad proposals: they minimise time, turn at full lock and graze obstacles, while the problem also
charges u'Ru/2 and noise requires clearance. In `clutter` their cost exceeds the value by hundreds of lambda, and open
loop the heading diffuses. A guide starts from the curve, or from the last guide of its class, and is improved on the
rollouts' own steps (`ddp`); samples then follow u_ref + K (x - x_ref).

With little noise the clearance cost is a wall of its own, a few millimetres thin, along which descent creeps: from a
curve in narrow passages hundreds of rounds end far above the optimum. As in interior point methods (Fiacco and
McCormick 1968) a cold start is therefore optimised for more noise first, and from there on for less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import Curves
from pirrht.geometry.field import clearance
from pirrht.problem import Problem
from pirrht.proposals.any_guide import remaining
from pirrht.proposals.ddp import Car, Course, empty_course, optimise
from pirrht.rollouts.tables import Setup
from pirrht.steering.trajectory import Trajectory
from pirrht.systems.unicycle import Unicycle

Stage = tuple[float, int]  # how many lambda, and backward passes at most

COLD: tuple[Stage, ...] = ((100.0, 60), (10.0, 30), (1.0, 150))  # from a curve
WARM = ((1.0, 8),)  # from the last guide
NONE = ((1.0, 0),)
TOLERANCE = 0.01  # lambda; a round that is expected to gain less is the last
BARRIER = 3.0  # price of lambda / (time in which noise carries a car over its clearance); tuned for even weights
MARGIN = 20.0  # boundary layers beyond which a wall costs nothing
PARABOLA = 0.2  # boundary layers below which the barrier rises no steeper than a parabola
SAG = 0.25  # boundary layers by which a wall may bulge towards a path between two points that are priced
WILD = 1e4  # largest gain: beyond it the cost-to-go has no minimum
FEW = 30  # samples around references of negligible weight,
HOPELESS, SHARE = 60.0, 0.01  # whose guide costs so many lambda, and this share of the least cost, above the cheapest


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Guide:
    """Trajectory of one class and the feedback around it, on the grid of the rollouts."""

    times: Array  # (T+1,) ends of the steps [s]
    states: Array  # (T+1, 3) x, y [m] and theta [rad]
    control: Array  # (T,) u, a turn rate in units of 1/rho
    gains: Array  # (T, 3) K of u = control + K (x - states) [1/m], [1/m], [1/rad]
    spread: Array  # (T,) standard deviation of the samples' noise as a share of the passive one
    sway: Array  # (T,) r, by which u rises over each step, over sqrt(12); zero where u is held
    sway_gains: Array  # (T, 4) of r = sway + sway_gains (x - states, u - control) [1/m], [1/m], [1/rad], [1]
    sway_spread: Array  # (T,) share left of the standard deviation of the noise of r
    length: int  # steps until the one that enters the goal
    cost: float  # integral of q + u'Ru/2 up to the goal [cost]
    priced: float  # cost with clearance priced, off the value by about as much in every class [cost]
    valid: bool  # whether it touches nothing and is of its class

    @property
    def tape(self) -> Array:
        """Its controls (T, 1), over the steps."""
        return self.control[:, None]

    def rest(self, elapsed: float, goal: Array) -> Trajectory | None:
        """Return the arcs left after some time [s], to the goal's centre (2,) [m]; None if nothing."""
        passed = int(np.searchsorted(self.times, elapsed + 1e-9, side="right")) - 1
        if passed >= self.length:
            return None
        part = slice(passed, self.length)
        steps = np.diff(self.times)[part]
        ahead = self.states[self.length]
        start = np.vstack([self.states[part], ahead])
        travel = np.hypot(*np.diff(start[:, :2], axis=0).T)
        turn = np.append(np.diff(start[:, 2]), 0.0)
        left = float(np.hypot(*(goal - ahead[:2])))
        length = np.append(travel, left)
        speed = float(travel.sum() / steps.sum())
        whole = float(length.sum())
        path = Curves(
            start=start, curvature=(turn / length)[:, None], length=length[:, None], cost=length, tails=start,
            heads=np.vstack([start[1:], ahead]),
        )  # fmt: skip
        controls, durations = np.append(self.control[part], 0.0)[:, None], np.append(steps, left / speed)
        return Trajectory(controls=controls, durations=durations, path=path, cost=whole / speed, length=whole)


class Guidance:
    """Makes guides for the references of one problem.

    Args:
        sways: whether u may rise or fall within a step, which then is an arc, or is held.
    """

    def __init__(self, problem: Problem, setup: Setup, *, sways: bool) -> None:
        assert self.suits(problem)
        self.problem, self.setup, self.sways = problem, setup, sways
        self.cars = {warmth: self._car(warmth) for warmth, _ in COLD}
        self.car = self.cars[1.0]

    def _car(self, warmth: float) -> Car:
        """Return the numbers of the optimisation for `warmth` times lambda."""
        d = self.problem.dynamics
        assert isinstance(d, Unicycle)
        temperature = warmth * self.problem.temperature
        layer = boundary_layer(self.problem) * warmth**0.6
        return Car(
            speed=d.V, gain=1.0 / d.rho, effort=float(self.problem.control_cost(np.zeros(3))[0, 0]),
            rate=self.problem.least_rate, margin=MARGIN * layer, least=PARABOLA * layer,
            price=BARRIER * temperature * (d.b * d.V) ** (2.0 / 3.0),
            spacing=math.sqrt(8.0 * wall_radius(self.problem) * SAG * layer), tolerance=TOLERANCE * temperature,
            sways=self.sways,
        )  # fmt: skip

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Check for the car's dynamics and constant costs."""
        d = problem.dynamics
        car = isinstance(d, Unicycle) and d.drift is Unicycle.drift
        return car and not callable(problem.q) and not callable(problem.R)

    def warm_up(self, x: Array) -> None:
        """Compile the optimisation, by a guide of two steps of 1 [s] from x (3,)."""
        self._from(x, np.arange(3.0), 0, (empty_course(2), 1), WARM)

    def improve(
        self, x: Array, times: Array, key: int, trajectory: Trajectory, last: Guide | None = None,
        elapsed: float = 0.0, *, pressed: Callable[[], bool] | None = None,
    ) -> Guide | None:  # fmt: skip
        """Make a guide from x (3,) in the class with this additive key; None if it does not arrive within `times`.

        Args:
            times: ends of the rollout steps, (T+1,) from 0 [s].
            trajectory: the reference.
            last: the guide of the class made `elapsed` [s] ago.
            pressed: whether time is short, so that a curve is improved no further; None: it never is.

        If the improvement leaves the class or touches something, samples follow the curve itself, with feedback; but
        where noise has carried the robot into a wall's zone the last guide leads out of it.
        """
        guide = None if last is None else self._from(x, times, key, _shifted(last, times, elapsed), WARM)
        if guide is not None and (guide.valid or not clearance(self.setup.arena.field, x[0], x[1]) > 0.0):
            return guide
        guide = self._from(x, times, key, _along(trajectory, times), in_time(COLD, pressed))
        if guide is None or guide.valid:
            return guide
        return self._from(x, times, key, _along(trajectory, times), NONE)

    def counts(self, guides: Sequence[Guide | None], samples: int) -> list[int]:
        """Return the samples around each reference, (H,): N, or FEW for a class of negligible weight (`worth`)."""
        return worth([None if guide is None else guide.priced for guide in guides], samples, self.problem.temperature)

    def _from(
        self, x: Array, times: Array, key: int, start: tuple[Course, int], stages: Iterable[Stage]
    ) -> Guide | None:
        course, length = start
        course.states[0] = x
        cost, priced, sound = np.inf, np.inf, False
        for warmth, rounds in stages:
            if length < 1:
                return None
            car = self.cars[warmth]
            length, cost, priced, _, sound = optimise(self.setup, car, times, key, rounds, course, length)
        for part in (course.gains, course.sway, course.sway_gains):
            part[max(length, 0) :] = 0.0
        if length < 0 or not np.abs(course.gains).max() < WILD:
            return None
        return Guide(
            times=times, states=course.states, control=course.control, gains=course.gains, spread=course.spread,
            sway=course.sway, sway_gains=course.sway_gains, sway_spread=course.sway_spread,
            length=length, cost=cost, priced=priced, valid=bool(sound),
        )  # fmt: skip


def in_time(stages: Sequence[Stage], pressed: Callable[[], bool] | None) -> Iterator[Stage]:
    """Yield the stages until time is short, and then one that makes a guide without improving it."""
    for stage in stages:
        if pressed is not None and pressed():
            yield from NONE
            return
        yield stage


def worth(prices: Sequence[float | None], samples: int, temperature: float) -> list[int]:
    """Return samples around guides of these prices (H,) [cost], None being no guide: N, or FEW of negligible weight.

    Classes whose guide costs HOPELESS lambda more than the cheapest weigh about exp(-HOPELESS); a reference without
    a guide takes longer than any path of some weight.
    """
    least = min((price for price in prices if price is not None), default=np.inf)
    bound, few = least * (1.0 + SHARE) + HOPELESS * temperature, min(FEW, samples)
    return [samples if least == np.inf or (price is not None and price <= bound) else few for price in prices]


def boundary_layer(problem: Problem) -> float:
    """Return the width [m] over which noise keeps paths off a wall that they would otherwise follow.

    A wall of curvature 1/r holds a car that saves cost q per second with the force q / (V r); over a distance c
    that is worth lambda in the time (c / bV)^(2/3) in which noise carries the car so far.
    """
    d = problem.dynamics
    assert isinstance(d, Unicycle)
    force = problem.least_rate / wall_radius(problem)
    return float((problem.temperature * (d.b * d.V) ** (2.0 / 3.0) / force) ** 0.6)


def wall_radius(problem: Problem) -> float:
    """Return the assumed radius of curvature of walls [m]."""
    return max(2.0 * problem.scene.robot_radius, 0.2)


def _along(trajectory: Trajectory, times: Array) -> tuple[Course, int]:
    """Start from the tape of a curve."""
    control = trajectory.tape(times)[:, 0]
    length = int(np.searchsorted(times, trajectory.durations.sum()))
    return empty_course(len(control))._replace(control=control), min(length, len(control))


def _shifted(last: Guide, times: Array, elapsed: float) -> tuple[Course, int]:
    """Start from a guide after some time [s], on a new grid (T+1,) [s]."""
    states, at, length = remaining(last, times, elapsed)
    sway = last.sway[at] * np.diff(times) / np.diff(last.times)[at]
    course = empty_course(len(at))._replace(
        states=states, control=last.control[at], gains=last.gains[at], sway=sway, sway_gains=last.sway_gains[at]
    )
    return course, length
