"""Braking and waiting while the robot has no path, within what is known to be free."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Law, Plan
from pirrht.control.run_state import Halt, RunState
from pirrht.freespace import FreeSpace
from pirrht.planner.references import Reference
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch
from pirrht.traits import Traits


@dataclass(frozen=True, slots=True, kw_only=True)
class BrakeSettings:
    """Settings of braking and waiting."""

    within: float = 0.2  # time constant of braking and of holding a position [s]
    horizon: float = 3.0  # how long a law must be free [s]; many plans come before that
    step: float = 0.05  # between two states that are checked [s]
    clearance: float = 0.1  # sufficient, from static and moving obstacles [m]
    rings: tuple[float, ...] = (0.0, 0.1, 0.2, 0.4, 0.8)  # how far to give way for it [m], nearest first
    directions: int = 12  # in which to give way
    urgent: float = 1.0  # being free for so long takes precedence over clearance [s]
    resolution: float = 0.02  # differences of clearance below this do not count [m]
    efforts: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0)  # of steady turns without a brake, in usual controls


@dataclass(frozen=True, slots=True, kw_only=True)
class Brake:
    """Chooses where to wait."""

    problem: Problem
    settings: BrakeSettings = BrakeSettings()

    @property
    def stops(self) -> bool:
        """Check whether the robot can stop."""
        return Traits.of(self.problem).can_brake

    def halt(self, x: Array, space: FreeSpace, now: float, known: Law | None = None, last: Halt | None = None) -> Halt:
        """Choose a law at x (n,) among the obstacles of a space, at a time of its clock [s].

        The first with sufficient clearance is taken: to go on by the `last` one, for which half of that is sufficient,
        to brake on the spot, to give way ever farther; a robot that cannot stop prefers a `known` law to turning. If
        none has, being free for the urgent time counts first, then clearance from static obstacles, since noise uses it
        up, then how long it is free: what comes later may go elsewhere.
        """
        s, tried = self.settings, list[Halt]()
        for law in self._laws(x, known, last):
            tried.append(self._tried(law, x, space, now))
            enough = s.clearance if last is None or law is not last.law else 0.5 * s.clearance
            if tried[-1].free == inf and tried[-1].clearance >= enough:
                break

        def worth(one: Halt) -> tuple[float, ...]:
            return min(one.free, s.urgent), one.static_clearance // s.resolution, one.free, one.clearance

        return max(tried, key=worth)

    def _laws(self, x: Array, known: Law | None, last: Halt | None) -> Iterator[Law]:
        """Yield candidate laws at x (n,), in the order of preference."""
        d, s = self.problem.dynamics, self.settings
        yield from (law for law in (known, None if last is None else last.law) if law is not None)
        if not self.stops:  # steady controls: zero, and multiples of the usual effort
            usual = np.diag(np.sqrt(2.0 * self.problem.least_rate / np.diag(self.problem.control_cost(x))))
            turns = [sign * times * u for times in s.efforts for u in usual for sign in (1.0, -1.0)]
            yield from (held(np.array([0.0, np.inf]), u[None]) for u in [np.zeros(d.m), *turns])
            return
        spot = d.place(x) + d.place(d.f(x)) * s.within  # where it comes to rest if it brakes at once
        angles = 2.0 * np.pi * np.arange(s.directions) / s.directions
        ways = np.column_stack([np.cos(angles), np.sin(angles)])
        if len(spot) == 3:  # and up and down
            ways = np.vstack([np.column_stack([ways, np.zeros(len(ways))]), np.eye(3)[-1:], -np.eye(3)[-1:]])
        for ring in s.rings:
            for way in ways if ring > 0.0 else ways[:1]:
                yield partial(self._brake, spot + ring * way)

    def _brake(self, place: Array, x: Array, _: float) -> Array:
        return np.asarray(self.problem.dynamics.brake(x, place, self.settings.within))

    def _tried(self, law: Law, x: Array, space: FreeSpace, now: float) -> Halt:
        """Simulate a law without noise."""
        d, s = self.problem.dynamics, self.settings

        times = np.arange(round(s.horizon / s.step) + 1) * s.step
        still = np.zeros(d.m)
        controls = []
        states = [x]

        for time in times[:-1]:
            controls.append(law(states[-1], time))
            states.append(d.step(states[-1], controls[-1], still, s.step))
        path = np.array(states)
        poses = path[:, d.reads(space.static.kernels.turns)]
        static = clearance = space.collision.clearance(poses)
        if space.scene.movers:
            pairs = zip(poses, now + times, strict=True)
            clearance = np.minimum(clearance, [space.moving.distance(pose, time) for pose, time in pairs])
        met = np.flatnonzero(clearance <= 0.0 if clearance[0] > 0.0 else clearance < clearance[0])  # out of a margin
        settled = times >= 2.0 * s.within
        return Halt(
            law=law, times=np.asarray(times), tape=np.array(controls), free=float(times[met[0]]) if len(met) else inf,
            static_clearance=min(float(static[settled].min()), s.clearance), clearance=float(clearance[settled].min()),
        )  # fmt: skip


def held(times: Array, tape: Array) -> Law:
    """Return the law of controls (T, m) of steps that end at `times` (T+1,) [s], the last one from then on."""
    return lambda _, s: tape[min(int(np.searchsorted(times, s + 1e-9, side="right")), len(tape)) - 1]


def blocked_plan(
    brake: Brake, x: Array, run: RunState, space: FreeSpace, why: str, batch: Batch | None = None,
    references: Sequence[Reference] = (),
) -> Plan:  # fmt: skip
    """Brake at x (n,), and wait until there is a path; forget guides and samples of earlier plans.

    A robot that cannot stop prefers the cheapest guide or reference, without feedback.
    """
    known: Law | None = None
    if batch is not None and references and not brake.stops:
        guides = [one.lead.guide for one in batch.proposals if one.lead.guide is not None]
        best = min(guides, key=lambda guide: guide.penalised, default=None)
        known = held(batch.times, references[0].trajectory.tape(batch.times) if best is None else best.tape)
    halt = brake.halt(
        x, space if run.route.prediction is None else run.route.prediction.space, run.now, known, run.halt
    )
    run.wait(None if halt.law is known else halt)
    return Plan(
        state=x, times=halt.times, references=tuple(references),
        ids=() if batch is None else tuple(batch.classes.values()), estimate=None, fallback=why, stops=brake.stops,
        instead=halt.tape, law=halt.law, time=run.clock.time, space=space, dynamics=brake.problem.dynamics,
        movers=run.route.movers,
    )  # fmt: skip
