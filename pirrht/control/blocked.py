"""Braking and waiting while the robot has no path, within what is known to be free."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.problem import Problem
from pirrht.proposals.leads import Along, LinearFeedback
from pirrht.proposals.proposal import Batch

Law = Callable[[Array, float], Array]  # control (m,) at a state (n,), a time since it was chosen [s]
SOON, FINE = 1.0, 0.02  # [s], and the step in which clearance is compared [m]
NEARER = 0.01  # loss of clearance at a place to wait before others are tried [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class BrakeSettings:
    """Settings of braking and waiting."""

    within: float = 0.2  # time constant of braking and of holding a position [s]
    horizon: float = 3.0  # how long a law must be free [s]; many plans come before that
    step: float = 0.05  # between two states that are checked [s]
    clearance: float = 0.1  # sufficient, from static and moving obstacles [m]
    rings: tuple[float, ...] = (0.0, 0.1, 0.2, 0.4, 0.8)  # how far to give way for it [m], nearest first
    directions: int = 12  # in which to give way


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Halt:
    """A law that brakes or, of a robot that cannot, follows the longest free path; with its outcome."""

    law: Law
    times: Array  # ends of steps, (T+1,) [s]
    tape: Array  # controls of those steps without noise, (T, m)
    room: float  # clearance from static obstacles once it has settled, at most the sufficient one [m]
    free: float  # how long it touches nothing [s]; infinite if that is beyond the horizon
    clearance: float  # the least within the horizon, once it has settled [m]


class Brake:
    """Chooses where to wait, and keeps to it while that stays free."""

    def __init__(self, problem: Problem, settings: BrakeSettings | None = None) -> None:
        self.problem, self.settings = problem, settings or BrakeSettings()
        at_start = problem.dynamics.state_of(problem.scene.start)
        self.stops = problem.dynamics.brake(at_start, at_start[:2], self.settings.within) is not None
        self._last: Law | None = None
        self._enough = 0.0  # clearance that is sufficient where it waits [m]

    def begin(self) -> None:
        """Forget where it waits."""
        self._last = None

    def halt(self, x: Array, space: FreeSpace, now: float, known: Law | None = None) -> Halt:
        """Choose a law at x (n,) among the obstacles of a space, at a time of its clock [s].

        The first with sufficient clearance is taken: to go on waiting, to brake on the spot, to give way ever farther.
        If none has, being free for SOON counts first, then clearance from static obstacles, since noise uses it up,
        then how long it is free: what comes later may go elsewhere.

        Args:
            known: law that a robot which cannot stop prefers to turning.
        """
        chosen: Halt | None = None
        best: tuple[float, ...] = ()
        for law in self._laws(x, known):
            found = self._tried(law, x, space, now)
            worth = min(found.free, SOON), found.room // FINE, found.free, found.clearance
            if chosen is None or worth > best:
                best, chosen = worth, found
            enough = self._enough if law is self._last else self.settings.clearance
            if found.free == inf and found.clearance >= enough:
                break
        assert chosen is not None  # there are always laws
        if chosen.law is not self._last:
            half = 0.5 * self.settings.clearance
            self._enough = max(half, min(2.0 * half, chosen.clearance - NEARER))
        self._last = None if chosen.law is known else chosen.law
        return chosen

    def _laws(self, x: Array, known: Law | None) -> Iterator[Law]:
        """Yield candidate laws at x (n,), in the order of preference."""
        yield from (law for law in (known, self._last) if law is not None)
        if not self.stops:
            yield from (held(np.array([0.0, np.inf]), u[None]) for u in self._turns(x))
            return
        d, s = self.problem.dynamics, self.settings
        spot = x[:2] + d.f(x)[:2] * s.within  # where it comes to rest if it brakes at once
        angles = 2.0 * np.pi * np.arange(s.directions) / s.directions
        for ring in s.rings:
            for angle in angles if ring > 0.0 else angles[:1]:
                yield self._to(spot + ring * np.array([np.cos(angle), np.sin(angle)]))

    def _to(self, place: Array) -> Law:
        dynamics, within = self.problem.dynamics, self.settings.within

        def law(x: Array, _: float) -> Array:
            u = dynamics.brake(x, place, within)
            assert u is not None
            return u

        return law

    def _turns(self, x: Array) -> Iterator[Array]:
        """Yield steady controls (m,) of a robot that cannot stop: zero, and up to four times the usual effort."""
        m = self.problem.dynamics.m
        usual = np.sqrt(2.0 * self.problem.least_rate / np.diag(self.problem.control_cost(x)))
        yield np.zeros(m)
        for times in (0.5, 1.0, 2.0, 4.0):
            for i in range(m):
                for sign in (1.0, -1.0):
                    yield sign * times * usual * (np.arange(m) == i)

    def _tried(self, law: Law, x: Array, space: FreeSpace, now: float) -> Halt:
        """Simulate a law without noise."""
        d, s = self.problem.dynamics, self.settings
        count = round(s.horizon / s.step)
        still, controls, states = np.zeros(d.m), [], [x]
        for i in range(count):
            controls.append(law(states[-1], i * s.step))
            states.append(d.step(states[-1], controls[-1], still, s.step))
        places, times = np.array(states)[:, :2], np.arange(count + 1) * s.step
        standing = clearance = space.collision.clearance(places)
        if space.scene.movers:
            pairs = zip(places, now + times, strict=True)
            clearance = np.minimum(clearance, [space.crowd.clearance(place, time) for place, time in pairs])
        met = np.flatnonzero(clearance <= 0.0 if clearance[0] > 0.0 else clearance < clearance[0])  # out of a margin
        settled = times >= 2.0 * s.within
        return Halt(
            law=law, times=np.asarray(times), tape=np.array(controls),
            room=min(float(standing[settled].min()), s.clearance), free=float(times[met[0]]) if len(met) else inf,
            clearance=float(clearance[settled].min()),
        )  # fmt: skip


def held(times: Array, tape: Array) -> Law:
    """Return the law of controls (T, m) of steps that end at `times` (T+1,) [s], the last one from then on."""
    return lambda _, s: tape[min(int(np.searchsorted(times, s + 1e-9, side="right")), len(tape)) - 1]


def known_law(batch: Batch, references: Sequence[Reference]) -> Law | None:
    """Return the law of the cheapest guide or reference, without feedback; None if there is none."""
    led = [one.lead.guide for one in batch.proposals if isinstance(one.lead, Along | LinearFeedback)]
    if led:
        return held(batch.times, min(led, key=lambda guide: guide.priced).tape)
    return held(batch.times, references[0].trajectory.tape(batch.times)) if references else None
