"""The exact answer on a grid: log psi, v = -lambda log psi and u* = lambda R^-1 G' grad log psi as functions of x.

Samples are judged against it. Two problems can be asked for:

* in continuous time, `q psi/lambda = f.grad psi + tr(BB' Hess psi)/2` with psi = 1 on the goal's disc and
  exp(-phi/lambda) at obstacles and border: what drives and the exit rule "bridge" tend to;
* with a step dt, `psi(x) = exp(-q dt/lambda) E[psi(x + f dt + B dw)]`, where a path ends only where a step ends: what
  the paper's procedure samples ("endpoint").
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.errors import OptionError
from pirrht.exact import discrete_time as steps
from pirrht.exact import heading_grid as car
from pirrht.exact import planar as planar
from pirrht.exact.domain import Domain
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import clearance
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from pirrht.topology.homology import class_id

FINEST = 1.0  # default spacing in decay lengths 1/k of psi ...
COARSEST = 0.2  # ... but at most this share of the robot's radius
PER_STEP = 3.0  # default points per standard deviation of a step
WALK = 0.01  # steps of paths that are drawn in continuous time [s]
ACROSS = 2.0  # points across the deviation of a car after a second, at least
COARSEST_OF_CAR = 1.0 / 6.0  # its default spacing is at most this share of its radius
FEWEST = 120  # headings
MOST_OF_CAR = 8_000_000  # grid points of positions and headings
MOST = 1_000_000  # grid points that are solved for in about half a minute
BAND = 0.03  # FCL itself is asked where the clearance field claims less room than this [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Desirability:
    """log psi of one problem as a function of the state."""

    problem: Problem
    space: FreeSpace
    spacing: float  # of the grid [m]
    dt: float | None  # step of the problem in discrete time [s]; None: continuous time
    grid: Any  # what `look` reads
    look: Any  # compiled: (grid, x, slope) -> log psi at x (n,); its gradient goes to slope (n,)
    gain: Array  # lambda R^-1 G_c', (m, m)

    @classmethod
    def of(
        cls, problem: Problem, space: FreeSpace, *, spacing: float | None = None, dt: float | None = None
    ) -> Desirability:
        """Solve for psi.

        Args:
            problem: of constant q, with the dynamics `SingleIntegrator` or `Unicycle`.
            space: of the same scene.
            spacing: of the grid [m]; None: fine enough for v to 0.5 % and u to 2 %.
            dt: step of the discrete-time problem [s]; None: continuous time.

        Raises:
            OptionError: a problem that no grid of this package solves, or one that needs too fine a grid.
        """
        d, x = problem.dynamics, np.zeros(problem.dynamics.n)
        spacing = cls.spacing_for(problem, space, spacing=spacing, dt=dt)
        gain: Array = problem.temperature * np.linalg.solve(problem.control_cost(x), d.G_c(x).T).astype(float)
        grid: Any
        if isinstance(d, Unicycle):
            grid, look = _headings(problem, space, d, spacing), car.look
        elif dt is None:
            grid, look = _planar(problem, space, spacing), planar.look
        else:
            grid, look = _stepwise(problem, space, spacing, dt), steps.look
        return cls(problem=problem, space=space, spacing=spacing, dt=dt, grid=grid, look=look, gain=gain)

    @staticmethod
    def spacing_for(
        problem: Problem, space: FreeSpace, *, spacing: float | None = None, dt: float | None = None
    ) -> float:
        """The spacing [m] of the grid that `of` solves on; quick, so that what it refuses can be refused early.

        Raises:
            OptionError: as `of`.
        """
        d = problem.dynamics
        if callable(problem.q) or not d.constant or not isinstance(d, (SingleIntegrator, Unicycle)):
            raise OptionError(
                f"no grid solves the dynamics {type(d).__name__}; it takes SingleIntegrator or Unicycle with constant q"
            )
        if spacing is not None and not (math.isfinite(spacing) and spacing > 0):
            raise OptionError(f"spacing is {spacing:g}; it must be a positive number of meters")
        if dt is not None and not (math.isfinite(dt) and dt > 0):
            raise OptionError(f"dt is {dt:g}; it must be a positive number of seconds")
        if isinstance(d, Unicycle):
            return _spacing_of_car(d, space, spacing, dt)
        length = 1.0 / _wavenumber(problem)
        default = min(FINEST * length, COARSEST * space.scene.robot_radius)
        reason = f"psi falls by a factor e in {length:.2g} m"
        if dt is not None:
            default = _deviation(problem, dt) / PER_STEP
            reason = f"noise carries a step {_deviation(problem, dt):.2g} m"
        h = default if spacing is None else spacing
        size = (space.scene.upper - space.scene.lower) / h
        if np.prod(size) > MOST:
            raise OptionError(
                f"{reason}, so the grid needs {size[0]:.0f} x {size[1]:.0f} points and can have {MOST:,}; "
                f"choose more --noise{'' if dt is None else ', a longer --dt'} or a smaller workspace"
            )
        return h

    def log_psi(self, x: Array) -> Array | float:
        """log psi at one state (n,) or many (k, n), (k,) [nats]; 0 in the goal, -phi/lambda at walls."""
        states = np.atleast_2d(np.asarray(x, dtype=float))
        value, _ = self._at(states)
        center, radius = self.space.scene.goal.center, self.space.scene.goal.radius
        blocked = self.space.collision.clearance(states[:, :2]) <= 0.0
        blocked &= np.hypot(*(states[:, :2] - center).T) > radius
        value[blocked] = -self.problem.phi / self.problem.temperature
        return value if np.ndim(x) == 2 else float(value[0])

    def value(self, x: Array) -> Array | float:
        """v = -lambda log psi at one state (n,) or many (k, n), (k,) [cost]."""
        return -self.problem.temperature * self.log_psi(x)

    def control(self, x: Array) -> Array:
        """u* = lambda R^-1 G' grad log psi at one state (n,) or many (k, n), (k, m); 0 in the goal and in walls."""
        if np.ndim(x) == 2:
            states = np.ascontiguousarray(x, dtype=float)
            controls: Array = self._at(states)[1][:, -len(self.gain) :] @ self.gain.T
            return controls
        slope = np.zeros(len(x))
        self.look(self.grid, x, slope)
        control: Array = self.gain.dot(slope[-len(self.gain) :])
        return control

    def shares(self, x: Array, samples: int = 2000, seed: int = 0) -> dict[str, float]:
        """How often optimally controlled paths from x (n,) take each class, most frequent first; drawn, not solved for.

        The names are those of the straight line from x. Their standard error is sqrt(share (1 - share) / samples).
        """
        from pirrht.exact.optimal_paths import walker

        d, markers = self.problem.dynamics, self.space.homology.markers
        x = np.array(x, dtype=float)
        turns, outcome = np.zeros((samples, len(markers))), np.zeros(samples, dtype=np.int64)
        walker(self.look, d.drift, self.dt is not None)(
            self.grid, self.space.field, markers, np.asarray(d.parameters, dtype=float), self.gain, d.G_c(x), d.B_c(x),
            self.problem.phi / self.problem.temperature, x, self.dt or WALK, seed, turns, outcome,
        )  # fmt: skip
        whole = np.rint(turns - self.space.homology.straight(x[None, :2])[0]).astype(int)
        arrived = whole[outcome == Outcome.GOAL]
        classes, counts = np.unique(arrived, axis=0, return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {class_id(classes[k]): float(counts[k] / len(arrived)) for k in order}

    def _at(self, states: Array) -> tuple[Array, Array]:
        value, slope = np.empty(len(states)), np.zeros_like(states)
        for k in range(len(states)):
            value[k] = self.look(self.grid, states[k], slope[k])
        return value, slope


def _wavenumber(problem: Problem) -> float:
    """k of `Laplace psi = k^2 psi` for a point in the plane [1/m]."""
    assert not callable(problem.q)
    b = float(problem.dynamics.B_c(np.zeros(2))[0, 0])
    return math.sqrt(2.0 * problem.q / problem.temperature) / b


def _planar(problem: Problem, space: FreeSpace, spacing: float) -> planar.Expansion:
    return planar.solve(
        lambda points: room(space, points),
        Domain.of(space.scene),
        wavenumber=_wavenumber(problem),
        wall=problem.phi / problem.temperature,
        spacing=spacing,
    )


def _deviation(problem: Problem, dt: float) -> float:
    """Standard deviation of a step in the plane along each axis [m]."""
    return float(problem.dynamics.B_c(np.zeros(2))[0, 0]) * math.sqrt(dt)


def _stepwise(problem: Problem, space: FreeSpace, spacing: float, dt: float) -> steps.Lattice:
    assert not callable(problem.q)
    return steps.solve(
        lambda points: room(space, points),
        Domain.of(space.scene),
        deviation=_deviation(problem, dt),
        loss=problem.q * dt / problem.temperature,
        wall=problem.phi / problem.temperature,
        spacing=spacing,
    )


def _spacing_of_car(d: Unicycle, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
    """Spacing for a car; refuses where the grid would smear paths more than the noise does."""
    if dt is not None:
        raise OptionError("no grid solves the discrete-time problem of a car; use the exit rule bridge")
    sideways = d.b * d.V / math.sqrt(3.0)  # deviation from the straight line after a second
    needed = sideways / ACROSS
    h = min(needed, COARSEST_OF_CAR * space.scene.robot_radius) if spacing is None else spacing
    finest = min(h, needed)
    size = [*(math.ceil(s / finest) + 1 for s in space.scene.upper - space.scene.lower), _directions(d, finest)]
    if h > needed * (1.0 + 1e-9) or math.prod(size) > MOST_OF_CAR:
        raise OptionError(
            f"noise b = {d.b:g} carries the car only {sideways:.2g} m sideways in a second, so the grid needs "
            f"points {finest:.2g} m apart, {size[0]} x {size[1]} x {size[2]} points, and can have {MOST_OF_CAR:,}; "
            "choose more --noise or a smaller workspace"
        )
    return h


def _directions(d: Unicycle, spacing: float) -> int:
    """Headings so close together that the noise of one ray spans one of them."""
    return max(FEWEST, math.ceil(2.0 * math.pi / (d.b * math.sqrt(car.RAY * spacing / d.V))))


def _headings(problem: Problem, space: FreeSpace, d: Unicycle, spacing: float) -> car.Headings:
    assert not callable(problem.q)
    return car.solve(
        space.field,
        Domain.of(space.scene),
        speed=d.V,
        noise=d.b,
        rate=problem.q,
        temperature=problem.temperature,
        phi=problem.phi,
        spacing=spacing,
        headings=_directions(d, spacing),
    )


def room(space: FreeSpace, points: Array) -> Array:
    """Clearance at positions (k, 2), border included, (k,) [m]: the field's, and FCL's close to obstacles."""
    out = np.empty(len(points))
    _sample(space.field, np.ascontiguousarray(points), out)
    close = np.flatnonzero(out < BAND)
    out[close] = space.collision.clearance(points[close])
    return out


@kernel
def _sample(field, points, out):  # type: ignore[no-untyped-def]
    for k in range(len(points)):
        out[k] = clearance(field, points[k, 0], points[k, 1])
