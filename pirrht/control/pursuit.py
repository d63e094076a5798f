"""Pure pursuit: steer along the circle to the point of a path that is a look-ahead distance away.

Coulter, "Implementation of the pure pursuit path tracking algorithm" (CMU-RI-TR-92-01, 1992). At the angle alpha
between the heading and that point, a distance L away, the circle has the curvature 2 sin(alpha) / L. Where the point
lies behind, the robot turns on the spot if it can; one without a heading moves straight to the point.
"""

from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.run_state import RunState, from_start
from pirrht.control.settings import ControlSettings
from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.geometry.polyline import interpolated, lengths
from pirrht.planner.references import Reference
from pirrht.problem import Problem
from pirrht.steering.motion import SPACING
from pirrht.systems.dynamics import wrapped


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PursuitLaw:
    """A law that follows a path of points (k, d), SPACING apart, at the system's best speed."""

    problem: Problem
    path: Array
    distance: float  # to look ahead [m]
    speed: float  # [m/s]

    @classmethod
    def of(cls, problem: Problem, line: Array, distance: float) -> "PursuitLaw":
        """The law along a polyline (l, d); OptionError: more than a pose is the state."""
        d = problem.dynamics
        if d.n > len(d.reads(True)):
            raise OptionError(
                f"pure pursuit steers robots whose state is a pose, and {type(d).__name__} has {d.states}"
            )
        along = lengths(line)
        at = np.arange(0.0, along[-1] + SPACING, SPACING)
        path = interpolated(line, along, at)
        x = d.state_of(problem.scene.start)
        gain = d.whole(d.G_c(x))[list(d.position)]
        pull = float(np.linalg.eigvalsh(gain @ np.linalg.solve(problem.control_cost(x), gain.T))[-1])
        drift = float(np.hypot.reduce(d.place(d.f(x))))
        speed = float(np.sqrt(drift**2 + 2.0 * problem.least_rate * pull))  # q + u'Ru/2 per metre is least
        return cls(problem=problem, path=path, distance=distance, speed=speed)

    def aim(self, place: Array) -> Array:
        """Return the first point of the path (d,) behind the nearest one to a place (d,) that is far enough from it."""
        away = np.hypot.reduce(self.path - place, axis=1)
        nearest = int(np.argmin(away))
        far = np.flatnonzero(away[nearest:] >= self.distance)
        return np.asarray(self.path[nearest + far[0]] if len(far) else self.path[-1])

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,)."""
        d = self.problem.dynamics
        off = self.aim(d.place(x)) - d.place(x)
        length = max(float(np.hypot.reduce(off)), SPACING)
        wanted = self.speed * off / length
        if d.heading is not None:
            heading = float(x[d.heading])
            angle = wrapped(np.arctan2(off[1], off[0]) - heading)
            ahead = self.speed if abs(angle) < 0.5 * np.pi else 0.0
            bend = np.sin(angle) if ahead else np.sign(angle)
            wanted = np.array([ahead * np.cos(heading), ahead * np.sin(heading), 2.0 * self.speed * bend / length])
        reads = list(d.reads(True))
        return np.asarray(np.linalg.pinv(d.whole(d.G_c(x))[reads]) @ (wanted - d.f(x)[reads]))


def pursuing(
    integral: PathIntegral, x: Array, reference: Reference, run: RunState, settings: ControlSettings
) -> Plan:  # fmt: skip
    """Return the plan at x (n,) that follows a reference without samples."""
    problem = integral.problem
    law = PursuitLaw.of(problem, problem.dynamics.place(reference.trajectory.points), settings.look_ahead)
    (own,) = from_start(run, [reference])
    plan = Plan(
        state=x, times=np.array([0.0, integral.sampling.dt]), references=(reference,),
        ids=(run.route.homology.name(own),), estimate=None, fallback=None, instead=law(x, 0.0)[None], law=law,
        time=run.clock.time, space=integral.space, dynamics=problem.dynamics, movers=run.route.movers,
    )  # fmt: skip
    run.plan()
    return plan
