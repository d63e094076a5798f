"""Solve for log psi, v = -lambda log psi and u* = lambda R^-1 G' grad log psi as functions of x, on a grid.

In continuous time `q psi/lambda = f.grad psi + tr(BB' Hess psi)/2` with psi = 1 on the goal's disc and exp(-phi/lambda)
at obstacles and border: the limit of runs and of the exit rule "bridge"; among moving obstacles psi depends on x and t.
With a step dt `psi(x) = exp(-q dt/lambda) E[psi(x + f dt + B dw)]`, where a path ends only where a step ends: the
paper's sampling procedure ("endpoint").
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol, cast

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array, IntArray
from pirrht.control.held import HeldLaw
from pirrht.control.plan import Law, Plan
from pirrht.control.policy import Policy
from pirrht.control.settings import TUNING as CONTROL
from pirrht.errors import OptionError
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling
from pirrht.exact.grid import TUNING, Progress, ignore_progress
from pirrht.exact.paths import Process, walker
from pirrht.freespace import FreeSpace
from pirrht.geometry.space import COLLISION, GOAL, at_states
from pirrht.problem import Problem
from pirrht.steering.in_time import homology_of
from pirrht.systems.ball import Ball
from pirrht.systems.dynamics import Dynamics
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from pirrht.topology.signature import Signature, class_id
from pirrht.traits import Traits


class Solver(Protocol):
    """A module that solves for psi of one kind of problem."""

    # Compiled: (grid, x (n,), slope (n,)) -> log psi at x [nats]; its gradient goes to slope. Among moving bodies x is
    evaluate: Any  # (n + 1,), the last of them the time [s].

    def spacing_for(self, problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
        """Return the requested spacing [m], or a default; refuses a grid that is too fine or too coarse."""

    def grid_of(self, problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress) -> Any:
        """Solve for a spacing [m] and a step dt [s] or none; `progress` gets the share done if it takes long."""


# By dynamics: the modules that solve in continuous time, with a step, and among moving obstacles (None: none does).
SOLVERS: dict[type[Dynamics], tuple[str | None, ...]] = {
    Ball: ("ball", None, None),
    SingleIntegrator: ("point", "discrete_point", "moving_point"),
    Unicycle: ("car", "car", None),
}


def solver_for(problem: Problem, space: FreeSpace, dt: float | None) -> Solver:
    """Choose the module that solves a problem in continuous time or with a step dt [s]; OptionError if none does."""
    d, moves = problem.dynamics, bool(space.scene.movers)
    which = 2 if moves else int(dt is not None)
    solvers = {kind: modules[which] for kind, modules in SOLVERS.items() if modules[which]}
    # A subclass with a drift or a position of its own is another system: what solves its parent knows nothing of it.
    alike = (one for one in solvers if isinstance(d, one) and (d.drift, d.position) == (one.drift, one.position))
    found = solvers.get(next(alike, None))  # type: ignore[arg-type]
    traits = Traits.of(problem)
    if found is None or traits.input_form or not (traits.constant_blocks and traits.constant_rate):
        known = " or ".join(kind.__name__ for kind in solvers)
        where = " among moving obstacles" if moves else ""
        raise OptionError(f"no grid solves the dynamics {type(d).__name__}{where}; it takes {known} with constant q")
    return cast(Solver, import_module(f"{__package__}.{found}"))


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
    ) -> "Desirability":  # fmt: skip
        """Solve for psi (paper, section III-A, or III-B with a step).

        Args:
            problem: of constant q, with dynamics that `SOLVERS` know.
            space: of the same scene.
            spacing: of the grid [m]; None: fine enough for v to 0.5 % and u to 2 %.
            dt: step of the discrete-time problem [s]; None: continuous time.
            progress: called with the share that is done, anew for every period of repeated motions.

        Raises:
            OptionError: no grid of this package solves the problem, or it needs too fine a grid.
        """
        d, x = problem.dynamics, np.zeros(problem.dynamics.n)
        spacing = cls.spacing_for(problem, space, spacing=spacing, dt=dt)
        solver = solver_for(problem, space, dt)
        gain: Array = problem.temperature * np.linalg.solve(problem.control_cost(x), d.G_c(x).T).astype(float)
        return cls(
            problem=problem, space=space, spacing=spacing, dt=dt, evaluate=solver.evaluate, gain=gain,
            grid=solver.grid_of(problem, space, spacing, dt, progress),
        )  # fmt: skip

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

    @property
    def gap(self) -> float:
        """Distance from walls at which the law is evaluated where the robot is within the safety margin [m]."""
        return CONTROL.off_walls * self.space.scene.robot_radius

    def log_psi(self, x: Array, t: Array | float = 0.0) -> Array | float:
        """log psi at one state (n,) or many (k, n), (k,) [nats], at a time t [s], one or (k,), if obstacles move."""
        states = np.atleast_2d(self.problem.dynamics.checked(x, many=True))
        value, _ = self._at(states, t)
        if not self.moves:
            d = self.problem.dynamics
            blocked = (
                self.space.collision.clearance(states[:, d.reads(self.space.static.kernels.turns)]) <= 0.0
            ) & ~self.space.scene.goal.contains(d.place(states))
            value[blocked] = -self.problem.phi / self.problem.temperature
        return value if np.ndim(x) == 2 else float(value[0])

    def value(self, x: Array, t: Array | float = 0.0) -> Array | float:
        """v = -lambda log psi at one state (n,) or many (k, n), (k,) [cost], at a time t [s], one or (k,)."""
        return -self.problem.temperature * self.log_psi(x, t)

    def control(self, x: Array, t: Array | float = 0.0) -> Array:
        """u* = lambda R^-1 G' grad log psi at one state (n,) or many (k, n), (m,) or (k, m), at a time t [s]."""
        controls: Array = (
            self._at(np.atleast_2d(self.problem.dynamics.checked(x, many=True)), t)[1][:, -len(self.gain) :]
            @ self.gain.T
        )
        return controls if np.ndim(x) == 2 else controls[0]

    def _at(self, states: Array, t: Array | float) -> tuple[Array, Array]:
        """log psi (k,) [nats] at states (k, n) and a time [s], one or (k,), and its gradient (k, n)."""
        value = np.empty(len(states))
        slope = np.zeros(states.shape)

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
        x = self.problem.dynamics.checked(x)
        homology, turns, ends, outcome = self._walk(
            x, samples, seed, t, self.dt or (TUNING.moving_path_step if self.moves else TUNING.path_step)
        )

        turns = turns[outcome == GOAL]
        ends = ends[outcome == GOAL]
        first = homology.at(x, t)

        closed = [homology.closed(h, first, homology.at(end, end[-1])) for h, end in zip(turns, ends, strict=True)]
        names, counts = np.unique(np.rint(np.reshape(closed, (-1, homology.M))).astype(int), axis=0, return_counts=True)
        return {class_id(names[k]): float(counts[k] / len(turns)) for k in np.argsort(-counts, kind="stable")}

    def collision_probability(
        self, x: Array, samples: int = 10_000, seed: int = 0, *, step: float, margin: float = 0.0, t: float = 0.0
    ) -> tuple[float, float]:
        """Simulate the law, held for steps [s], from x (n,), t [s]: share of runs that collide, its standard error.

        A point's control is limited near walls, and within the margin it is that of the nearest free place, as in runs
        (`control.held`).

        Args:
            margin: by which walls that are hit are behind those of the problem [m].
        """
        share = float(np.mean(self._walk(x, samples, seed, t, step, margin=margin)[-1] == COLLISION))
        return share, math.sqrt(max(share * (1.0 - share), 1.0 / samples) / samples)

    def _walk(
        self, x: Array, samples: int, seed: int, t: float, step: float, *, margin: float | None = None
    ) -> tuple[Signature, Array, Array, IntArray]:
        """Draw paths by steps [s], with a margin [m] of held controls: turns, ends, outcomes."""
        d = self.problem.dynamics
        homology = homology_of(self.problem, self.space)
        x0 = np.append(d.checked(x), t).astype(float)

        process = Process(
            static=self.space.static, goal=self.space.world.goal, radius=self.space.world.radius,
            parameters=np.asarray(d.parameters, dtype=float), rate=d.G_c(x0[:-1]) @ self.gain, B=d.B_c(x0[:-1]),
            wall=self.problem.phi / self.problem.temperature, step=step,
            shortest=TUNING.shortest_path_step if margin is None else step, margin=margin or 0.0, gap=self.gap,
        )  # fmt: skip
        how = "stepwise" if self.dt else "continuous" if margin is None or d.n > d.m else "held"
        turns = np.zeros((samples, homology.M))
        ends = np.empty((samples, len(x0)))
        outcome = np.zeros(samples, dtype=np.int64)
        states = at_states(self.space.static.kernels, d.reads(self.space.static.kernels.turns))
        walk = walker(self.evaluate, d.drift, how, self.moves, states, homology.table.kernels, len(d.position))
        walk(self.grid, process, homology.table, x0, seed, turns, ends, outcome)
        return homology, turns, ends, outcome


class Optimal(Policy):
    """Feedback control by a solved grid in continuous time; only recordings draw by `sampling`.

    A point's control is held for `held` [s], as in `Controller`; None: it changes continuously.
    """

    def __init__(self, desirability: Desirability, sampling: Sampling, *, held: float | None = None) -> None:
        self.desirability, self.held = desirability, held
        self.path_integral = path_integral(desirability.problem, desirability.space, sampling)
        self.homology = self.path_integral.homology
        start = self.problem.dynamics.state_of(self.problem.scene.start)
        desirability.control(start)  # compiles, so that the first plan takes no longer than the others
        self.begin(start)

    def __repr__(self) -> str:
        return f"Optimal({self.desirability!r})"

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Return the law from state x (n,) on, and v there [cost]; static scenes have one law for all times."""
        now, world = self.run.clock.time, self.path_integral.setup.world
        gap = self.desirability.gap
        reads = self.path_integral.problem.dynamics.reads(world.static.kernels.turns)

        def optimal(state: Array, since: float = 0.0) -> Array:
            t = now + since
            return self.desirability.control(world.off_walls(state, reads, t, gap), t)

        law: Law = optimal
        proposals = self.path_integral.proposals
        if self.held is not None and proposals.traits.noisy_position:
            law = HeldLaw.of(
                law, proposals.wall_drift(proposals.scales(x).wall_offset, self.held, time=now), self.held, x
            )
        return Plan(
            state=x, times=np.array([0.0, TUNING.drawn]), references=(), ids=(), estimate=None, fallback=None,
            instead=law(x, 0.0)[None, :], law=law, time=now, exact=float(self.desirability.value(x, now)),
            space=self.space, dynamics=self.problem.dynamics, movers=self.run.route.movers,
        )  # fmt: skip
