"""Solve for log psi, v = -lambda log psi and u* = lambda R^-1 G' grad log psi as functions of x, on a grid.

Three problems can be solved:

* in continuous time, `q psi/lambda = f.grad psi + tr(BB' Hess psi)/2` with psi = 1 on the goal's disc and
  exp(-phi/lambda) at obstacles and border: the limit of runs and of the exit rule "bridge";
* among moving obstacles, as a function of x and t;
* with a step dt, `psi(x) = exp(-q dt/lambda) E[psi(x + f dt + B dw)]`, where a path ends only where a step ends: the
  paper's sampling procedure ("endpoint").
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, Protocol, cast

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.errors import OptionError
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.exact.grid import TUNING, Progress, ignore_progress
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.steering.in_time import homology_of
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from pirrht.topology.signature import class_id


class Solver(Protocol):
    """A module that solves for psi of one kind of problem."""

    evaluate: Any  # compiled: (grid, x (n,), slope (n,)) -> log psi at x [nats]; its gradient goes to slope
    # among moving bodies x is (n + 1,), the last of them the time [s]

    def spacing_for(self, problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
        """Return the requested spacing [m], or a default; refuses a grid that is too fine or too coarse."""

    def grid_of(
        self, problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress = ignore_progress
    ) -> Any:
        """Solve for a spacing [m] and a step dt [s] or none; `progress` gets the share done if it takes long."""


# By dynamics: the modules of this package that solve in continuous time, and with a step. They are imported when asked.
Modules = Mapping[type[Dynamics], tuple[str, str]]
SOLVERS: Modules = {SingleIntegrator: ("point", "discrete_point"), Unicycle: ("car", "car")}
AMONG_MOVERS: Modules = {SingleIntegrator: ("moving_point", "moving_point")}  # where bodies move


def solver_for(problem: Problem, space: FreeSpace, dt: float | None) -> Solver:
    """Choose the module that solves a problem in continuous time or with a step dt [s]; OptionError if none does."""
    d = problem.dynamics
    # A subclass with a drift of its own is another system: what solves its parent knows nothing of it.
    solvers, where = (AMONG_MOVERS, " among moving obstacles") if space.scene.movers else (SOLVERS, "")
    found = next((both for kind, both in solvers.items() if isinstance(d, kind) and d.drift is kind.drift), None)
    if found is None or callable(problem.q) or not d.constant or d.input_form:
        known = " or ".join(kind.__name__ for kind in solvers)
        raise OptionError(f"no grid solves the dynamics {type(d).__name__}{where}; it takes {known} with constant q")
    return cast(Solver, import_module(f"{__package__}.{found[0 if dt is None else 1]}"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Desirability:
    """log psi of one problem as a function of the state, and among moving obstacles of the time [s]."""

    problem: Problem
    space: FreeSpace
    spacing: float  # of the grid [m]
    dt: float | None  # step of the problem in discrete time [s]; None: continuous time
    grid: Any  # what `evaluate` reads
    evaluate: Any  # of the solver
    gain: Array  # lambda R^-1 G_c', (m, m) [control per nats/state]

    @classmethod
    def of(
        cls, problem: Problem, space: FreeSpace, *, spacing: float | None = None, dt: float | None = None,
        progress: Progress = ignore_progress,
    ) -> Desirability:  # fmt: skip
        """Solve for psi (paper, section III-A, or III-B with a step).

        Args:
            problem: of constant q, with dynamics that `SOLVERS` know.
            space: of the same scene.
            spacing: of the grid [m]; None: fine enough for v to 0.5 % and u to 2 %.
            dt: step of the discrete-time problem [s]; None: continuous time.
            progress: called with the share that is done among moving obstacles, anew for every period that is tried.

        Raises:
            OptionError: no grid of this package solves the problem, or it needs too fine a grid.
        """
        d, x = problem.dynamics, np.zeros(problem.dynamics.n)
        spacing = cls.spacing_for(problem, space, spacing=spacing, dt=dt)
        solver = solver_for(problem, space, dt)
        gain: Array = problem.temperature * np.linalg.solve(problem.control_cost(x), d.G_c(x).T).astype(float)
        grid = solver.grid_of(problem, space, spacing, dt, progress)
        return cls(problem=problem, space=space, spacing=spacing, dt=dt, grid=grid, evaluate=solver.evaluate, gain=gain)

    @staticmethod
    def spacing_for(
        problem: Problem, space: FreeSpace, *, spacing: float | None = None, dt: float | None = None
    ) -> float:
        """Return the spacing [m] of the grid that `of` solves on, quickly; refuses what `of` does."""
        solver = solver_for(problem, space, dt)
        for name, value, unit in (("spacing", spacing, "meters"), ("dt", dt, "seconds")):
            if value is not None and not 0.0 < value < math.inf:
                raise OptionError(f"{name} is {value:g}; it must be a positive number of {unit}")
        return solver.spacing_for(problem, space, spacing, dt)

    def __repr__(self) -> str:
        time = "continuous time" if self.dt is None else f"steps of {self.dt:g} s"
        of, scene = type(self.problem.dynamics).__name__, formatting.name(self.space.scene.name)
        return f"Desirability(of a {of} in {scene}, {time}, grid of {self.spacing:.3g} m)"

    @property
    def moves(self) -> bool:
        """Tell whether log psi depends on the time."""
        return bool(self.space.scene.movers)

    def log_psi(self, x: Array, t: Array | float = 0.0) -> Array | float:
        """log psi at one state (n,) or many (k, n), (k,) [nats], at a time t [s], one or (k,); 0 in the goal.

        At walls it is -phi/lambda. The time counts among moving obstacles.
        """
        states = np.atleast_2d(np.asarray(x, dtype=float))
        value, _ = self._at(states, t)
        if not self.moves:
            places = states[:, :2]
            blocked = (self.space.collision.clearance(places) <= 0.0) & ~self.space.scene.goal.contains(places)
            value[blocked] = -self.problem.phi / self.problem.temperature
        return value if np.ndim(x) == 2 else float(value[0])

    def value(self, x: Array, t: Array | float = 0.0) -> Array | float:
        """v = -lambda log psi at one state (n,) or many (k, n), (k,) [cost], at a time t [s], one or (k,)."""
        return -self.problem.temperature * self.log_psi(x, t)

    def control(self, x: Array, t: Array | float = 0.0) -> Array:
        """u* = lambda R^-1 G' grad log psi at one state (n,) or many (k, n), (m,) or (k, m); 0 in the goal.

        The time t [s], one or (k,), counts where bodies move.
        """
        controls: Array = self._at(np.atleast_2d(x), t)[1][:, -len(self.gain) :] @ self.gain.T
        return controls if np.ndim(x) == 2 else controls[0]

    def _at(self, states: Array, t: Array | float) -> tuple[Array, Array]:
        """log psi (k,) [nats] at states (k, n) and a time [s], one or (k,), and its gradient (k, n)."""
        value, slope = np.empty(len(states)), np.zeros(states.shape)
        if self.moves:
            states = np.column_stack([states, np.broadcast_to(np.asarray(t, dtype=float), len(states))])
        states = np.ascontiguousarray(states, dtype=float)
        for k in range(len(states)):
            value[k] = self.evaluate(self.grid, states[k], slope[k])
        return value, slope

    def shares(self, x: Array, samples: int = 2000, seed: int = 0, *, t: float = 0.0) -> dict[str, float]:
        """Draw optimally controlled paths from x (n,): the share that takes each class, most frequent first.

        Names are those of the straight line from x. Standard errors are sqrt(share (1 - share) / samples). Among moving
        obstacles paths leave at t [s], and integers for each of these follow those for static ones.
        """
        from pirrht.exact.paths import arrived

        homology = homology_of(self.problem, self.space)
        turns, ends = arrived(self, homology, np.append(np.asarray(x, dtype=float), t), samples, seed)
        first = homology.at(x, t)
        closed = [homology.closed(h, first, homology.at(end, end[-1])) for h, end in zip(turns, ends, strict=True)]
        names, counts = np.unique(np.rint(np.reshape(closed, (-1, homology.M))).astype(int), axis=0, return_counts=True)
        return {class_id(names[k]): float(counts[k] / len(turns)) for k in np.argsort(-counts, kind="stable")}


class Optimal(Policy):
    """Feedback control by a solved grid.

    Args:
        desirability: of the problem in continuous time.
        sampling: of the sampler that a recording draws with; drives do not use it.
    """

    def __init__(self, desirability: Desirability, sampling: Sampling) -> None:
        self.desirability, self._sampling = desirability, sampling
        self.homology = homology_of(self.problem, self.space)
        start = self.problem.dynamics.state_of(self.problem.scene.start)
        desirability.control(start)  # compiles, so that the first plan takes no longer than the others
        self.begin(start)

    def __repr__(self) -> str:
        return f"Optimal({self.desirability!r})"

    @property
    def problem(self) -> Problem:
        """Problem that the grid solves."""
        return self.desirability.problem

    @property
    def space(self) -> FreeSpace:
        """Free space of its scene."""
        return self.desirability.space

    @cached_property
    def path_integral(self) -> PathIntegral:  # type: ignore[override]
        """Sampler that a recording reads problem and temperature from."""
        return path_integral(self.problem, self.space, self._sampling)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Return the law from state x (n,) on, and v there [cost]; static scenes have one law for all times."""
        now = self.run.time

        def law(state: Array, since: float = 0.0) -> Array:
            return self.desirability.control(state, now + since)

        value = self.desirability.value(x, now)
        return Plan(
            state=x, times=np.array([0.0, TUNING.drawn]), references=(), ids=(), estimate=None, fallback=None,
            instead=law(x)[None, :], law=law, time=now, exact=float(value), space=self.space, movers=self.run.movers,
        )  # fmt: skip
