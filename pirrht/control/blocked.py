"""What a robot does while it has no way: it brakes within what is known to be free, and holds its position."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.guidance.leads import Along, Batch, Follow
from pirrht.problem import Problem
from pirrht.tree.reference import Reference

Law = Callable[[Array, float], Array]  # control (m,) at a state (n,), a time since it was chosen [s]
SOON, FINE = 1.0, 0.02  # [s], and the step in which room is compared [m]
NEARER = 0.01  # so much nearer something may come than when a place to wait was chosen, before others are tried [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class BrakeSettings:
    """How a robot brakes and waits.

    Attributes:
        within: time constant of braking and of holding a position [s].
        horizon: how long what it does must be free [s]; by then it is asked again many times.
        step: between two states that are checked [s].
        clearance: that is enough, from standing and moving obstacles [m].
        rings: how far it gives way to have that [m], nearest first.
        directions: to which it does.
    """

    within: float = 0.2
    horizon: float = 3.0
    step: float = 0.05
    clearance: float = 0.1
    rings: tuple[float, ...] = (0.0, 0.1, 0.2, 0.4, 0.8)
    directions: int = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Halt:
    """A law that brakes or, of a robot that cannot, leads along the longest free way; with what comes of it.

    Attributes:
        law: control (m,) at a state (n,), a time since it was chosen [s].
        times: ends of steps, (T+1,) [s].
        tape: the controls of those steps without noise, (T, m).
        room: clearance from what stands once it has settled, as much as counts [m].
        free: how long it touches nothing [s]; infinite if never within the horizon.
        clearance: the least within the horizon, once it has settled [m].
    """

    law: Law
    times: Array
    tape: Array
    room: float
    free: float
    clearance: float


class Brake:
    """Chooses where to wait, and keeps to it while that stays free.

    Args:
        settings: how.
    """

    def __init__(self, problem: Problem, settings: BrakeSettings | None = None) -> None:
        self.problem, self.settings = problem, settings or BrakeSettings()
        at_start = problem.dynamics.state_of(problem.scene.start)
        self.stops = problem.dynamics.brake(at_start, at_start[:2], self.settings.within) is not None
        self._last: Law | None = None
        self._enough = 0.0  # clearance at which it goes on waiting where it waits [m]

    def begin(self) -> None:
        """Forget where it waits: it goes on."""
        self._last = None

    def halt(self, x: Array, space: FreeSpace, now: float, known: Law | None = None) -> Halt:
        """What to do at x (n,) among the bodies of a space, at a time of its clock [s].

        The first that keeps enough clearance is taken: to go on waiting where it waits, to brake on the spot, to give
        way ever farther. If none does, what touches nothing for SOON counts first, then room to what stands, since
        noise uses it up, then how long it is free: what comes later may go elsewhere.

        Args:
            known: what else a robot that cannot stop may do, and does rather than turn.
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
        """What may be done at x (n,), in the order of preference."""
        yield from (law for law in (known, self._last) if law is not None)
        if not self.stops:
            yield from (held(np.array([0.0, np.inf]), u[None]) for u in self._turns(x))
            return
        d, s = self.problem.dynamics, self.settings
        spot = x[:2] + d.f(x)[:2] * s.within  # where it comes to rest if it brakes at once
        angles = 2.0 * np.pi * np.arange(s.directions) / s.directions
        for ring in s.rings:
            for angle in angles if ring > 0.0 else angles[:1]:
                place = spot + ring * np.array([np.cos(angle), np.sin(angle)])
                yield self._to(place)

    def _to(self, place: Array) -> Law:
        dynamics, within = self.problem.dynamics, self.settings.within

        def law(x: Array, _: float) -> Array:
            u = dynamics.brake(x, place, within)
            assert u is not None
            return u

        return law

    def _turns(self, x: Array) -> Iterator[Array]:
        """Steady controls (m,) of a robot that cannot stop: none, and up to four times what costs as much as time."""
        m = self.problem.dynamics.m
        usual = np.sqrt(2.0 * self.problem.least_rate / np.diag(self.problem.control_cost(x)))
        yield np.zeros(m)
        for times in (0.5, 1.0, 2.0, 4.0):
            for i in range(m):
                for sign in (1.0, -1.0):
                    yield sign * times * usual * (np.arange(m) == i)

    def _tried(self, law: Law, x: Array, space: FreeSpace, now: float) -> Halt:
        """What comes of a law without noise."""
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
            law=law,
            times=np.asarray(times),
            tape=np.array(controls),
            room=min(float(standing[settled].min()), s.clearance),
            free=float(times[met[0]]) if len(met) else inf,
            clearance=float(clearance[settled].min()),
        )


def held(times: Array, tape: Array) -> Law:
    """Controls (T, m) of steps that end at `times` (T+1,) [s], and the last one from then on, whatever the state."""
    return lambda _, s: tape[min(int(np.searchsorted(times, s + 1e-9, side="right")), len(tape)) - 1]


def known_law(batch: Batch, references: Sequence[Reference]) -> Law | None:
    """What a robot that cannot stop knows of a path: the cheapest guide or reference, without feedback."""
    led = [one.lead.guide for one in batch.proposals if isinstance(one.lead, Along | Follow)]
    if led:
        return held(batch.times, min(led, key=lambda guide: guide.priced).tape)
    return held(batch.times, references[0].trajectory.tape(batch.times)) if references else None
