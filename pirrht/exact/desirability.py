"""Solve for log psi, v = -lambda log psi and u* = lambda R^-1 G' grad log psi as functions of x, on a grid.

In continuous time `q psi/lambda = f.grad psi + tr(BB' Hess psi)/2` with psi = 1 on the goal's disc and exp(-phi/lambda)
at obstacles and border: the limit of runs and of the exit rule "bridge"; among moving obstacles psi depends on x and t.
With a step dt `psi(x) = exp(-q dt/lambda) E[psi(x + f dt + B dw)]`, where a path ends only where a step ends: the
paper's sampling procedure ("endpoint").

Paths under u* are Euler-Maruyama steps in continuous time, so short near a wall that the law, which grows as
1/distance, turns them around. In discrete time the optimal transition is the passive one times psi at its end; it is
drawn from many normal ends around the one that the law points to, by their weights (Rubin's sampling and resampling).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple, Protocol, cast

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
from pirrht.exact.boundaries import clearance_at, poses_at
from pirrht.exact.grid import TUNING, Frame, Progress, frame_at, ignore_progress, in_goal
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.field import clearance
from pirrht.jit.jit import as_jitable, kernel
from pirrht.jit.streams import normals, stream, uniform
from pirrht.problem import Problem
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE
from pirrht.steering.in_time import homology_of
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from pirrht.topology.homology import Homology
from pirrht.topology.signature import class_id
from pirrht.topology.tracks import turns_of_step


class Solver(Protocol):
    """A module that solves for psi of one kind of problem."""

    # Compiled: (grid, x (n,), slope (n,)) -> log psi at x [nats]; its gradient goes to slope. Among moving bodies x is
    evaluate: Any  # (n + 1,), the last of them the time [s].

    def spacing_for(self, problem: Problem, space: FreeSpace, spacing: float | None, dt: float | None) -> float:
        """Return the requested spacing [m], or a default; refuses a grid that is too fine or too coarse."""

    def grid_of(self, problem: Problem, space: FreeSpace, spacing: float, dt: float | None, progress: Progress) -> Any:
        """Solve for a spacing [m] and a step dt [s] or none; `progress` gets the share done if it takes long."""


# By dynamics: the modules that solve in continuous time, with a step, and among moving obstacles (None: none does).
SOLVERS = {SingleIntegrator: ("point", "discrete_point", "moving_point"), Unicycle: ("car", "car", None)}


def solver_for(problem: Problem, space: FreeSpace, dt: float | None) -> Solver:
    """Choose the module that solves a problem in continuous time or with a step dt [s]; OptionError if none does."""
    d, moves = problem.dynamics, bool(space.scene.movers)
    which = 2 if moves else int(dt is not None)
    solvers = {kind: modules[which] for kind, modules in SOLVERS.items() if modules[which]}
    # A subclass with a drift of its own is another system: what solves its parent knows nothing of it.
    found = next((one for kind, one in solvers.items() if isinstance(d, kind) and d.drift is kind.drift), None)
    if found is None or callable(problem.q) or not d.constant or d.input_form:
        known, where = " or ".join(kind.__name__ for kind in solvers), " among moving obstacles" if moves else ""
        raise OptionError(f"no grid solves the dynamics {type(d).__name__}{where}; it takes {known} with constant q")
    return cast(Solver, import_module(f"{__package__}.{found}"))


class Process(NamedTuple):
    """The controlled process, and steps of paths of it."""

    field: Any  # clearance `Field`, unused among moving obstacles
    frame: Frame  # of the goal's disc
    parameters: Array  # (k,) that the drift reads
    rate: Array  # lambda G_c R^-1 G_c', (m, m) [state/s per nats/state]
    B: Array  # B_c, (m, m) [state/sqrt(s)]
    wall: float  # phi/lambda [nats]
    step: float  # of a path [s]; in continuous time at most
    shortest: float  # in continuous time, near walls [s]


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
        """log psi at one state (n,) or many (k, n), (k,) [nats], at a time t [s], one or (k,), if obstacles move."""
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
        """u* = lambda R^-1 G' grad log psi at one state (n,) or many (k, n), (m,) or (k, m), at a time t [s]."""
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
        step = self.dt or (TUNING.moving_path_step if self.moves else TUNING.path_step)
        homology, turns, ends, outcome = self._walk(x, samples, seed, t, step, TUNING.shortest_path_step)
        turns, ends, first = turns[outcome == GOAL], ends[outcome == GOAL], homology.at(x, t)
        closed = [homology.closed(h, first, homology.at(end, end[-1])) for h, end in zip(turns, ends, strict=True)]
        names, counts = np.unique(np.rint(np.reshape(closed, (-1, homology.M))).astype(int), axis=0, return_counts=True)
        return {class_id(names[k]): float(counts[k] / len(turns)) for k in np.argsort(-counts, kind="stable")}

    def collision_probability(
        self, x: Array, samples: int = 10_000, seed: int = 0, *, step: float, t: float = 0.0
    ) -> tuple[float, float]:
        """Hold and judge the law from x (n,), t [s], step by step [s]: share of runs that collide, standard error."""
        outcome = self._walk(x, samples, seed, t, step, step)[-1]
        share = float(np.mean(outcome == COLLISION))
        return share, math.sqrt(max(share * (1.0 - share), 1.0 / samples) / samples)

    def _walk(
        self, x: Array, samples: int, seed: int, t: float, step: float, shortest: float
    ) -> tuple[Homology, Array, Array, IntArray]:
        """Draw optimally controlled paths by steps [s], at walls as short as the shortest: turns, ends, outcomes."""
        d, homology, x0 = self.problem.dynamics, homology_of(self.problem, self.space), np.append(x, t).astype(float)
        process = Process(
            self.space.field, frame_at(np.zeros(2), self.spacing, self.space.scene.goal),
            np.asarray(d.parameters, dtype=float), d.G_c(x0[:-1]) @ self.gain, d.B_c(x0[:-1]),
            self.problem.phi / self.problem.temperature, step, shortest,
        )  # fmt: skip
        turns, ends = np.zeros((samples, homology.M)), np.empty((samples, len(x0)))
        outcome = np.zeros(samples, dtype=np.int64)
        walk = _walker(self.evaluate, d.drift, self.dt is not None, self.moves)
        walk(self.grid, process, homology.markers, homology.tracks, x0, seed, turns, ends, outcome)
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
        now, world, d = self.run.time, self.path_integral.setup.world, self.problem.dynamics
        gap = CONTROL.off_walls * self.space.scene.robot_radius

        def optimal(state: Array, since: float = 0.0) -> Array:
            t = now + since
            return self.desirability.control(world.off_walls(state, t, gap), t)

        law: Law = optimal
        if self.held is not None and d.noisy_position:
            proposals = self.path_integral.proposals
            walls = proposals.wall_drift(proposals.scales(x).wall_offset, self.held, time=now)
            law = HeldLaw.of(law, walls, self.held, x)
        value = self.desirability.value(x, now)
        return Plan(
            state=x, times=np.array([0.0, TUNING.drawn]), references=(), ids=(), estimate=None, fallback=None,
            instead=law(x, 0.0)[None, :], law=law, time=now, exact=float(value), space=self.space,
            movers=self.run.movers,
        )  # fmt: skip


@cache
def _walker(evaluate: Any, drift: Callable[..., None], discrete: bool, moves: bool) -> Any:
    """Build the kernel (grid, `Process`, markers (M, 2) [m], J tracks, x0, seed, turns, x, outcome) that draws paths.

    Turns (S, M + J) [turns], zeros before, are about markers and tracks; x (S, n + 1) and outcomes (S,) are ends of
    paths. `evaluate` is that of a solver, `drift` f (x, p, out) [state/s]; `discrete` paths solve the problem in steps.
    """
    move = as_jitable(drift)

    @kernel
    def clear(grid, process, x):  # type: ignore[no-untyped-def]
        if moves:
            return clearance_at(grid.surroundings, poses_at(grid.surroundings.solids, x[-1]), x[0], x[1])
        return clearance(process.field, x[0], x[1])

    @kernel
    def end(grid, process, x):  # type: ignore[no-untyped-def]
        if clear(grid, process, x) <= 0.0:
            return COLLISION
        return GOAL if in_goal(process.frame, x) else INSIDE

    @kernel
    def continuous(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        B, step, n, m = process.B, process.step, f.shape[0], process.B.shape[0]
        evaluate(grid, x, slope)
        if n == m:
            root = TUNING.wall_steps * clear(grid, process, x) / B[0, 0]
            step = max(min(step, root * root), process.shortest)
        move(x[:n], process.parameters, f)
        z = np.empty(m)
        for j in range(m):
            state, z[j], _ = normals(state)
        x[:n] += f * step
        x[n - m : n] += (process.rate @ slope[n - m :]) * step + (B @ z) * math.sqrt(step)
        x[n] += step
        return state

    @kernel
    def stepwise(grid, process, x, slope, f, state):  # type: ignore[no-untyped-def]
        evaluate(grid, x, slope)
        ahead, deviation = process.rate @ slope * process.step, process.B[0, 0] * math.sqrt(process.step)
        ends, weight, y = np.empty((TUNING.candidates, 2)), np.empty(TUNING.candidates), x.copy()
        for k in range(TUNING.candidates):
            state, z, w = normals(state)
            y[0], y[1] = x[0] + ahead[0] + deviation * z, x[1] + ahead[1] + deviation * w
            outcome, ends[k] = end(grid, process, y), y[:2]
            log_psi = evaluate(grid, y, slope) if outcome == INSIDE else (0.0 if outcome == GOAL else -process.wall)
            passive = ((y[0] - x[0]) ** 2 + (y[1] - x[1]) ** 2) / deviation**2
            weight[k] = log_psi + 0.5 * (z * z + w * w - passive)
        weight = np.exp(weight - weight.max())
        state, u = uniform(state)
        left, k = u * weight.sum(), 0
        while k < TUNING.candidates - 1 and left >= weight[k]:
            left -= weight[k]
            k += 1
        x[:2] = ends[k]
        x[2] += process.step
        return state

    advance = stepwise if discrete else continuous

    @kernel
    def walk(grid, process, markers, tracks, x0, seed, turns, ends, outcome):  # type: ignore[no-untyped-def]
        slope, f, M = np.zeros(x0.shape[0] - 1), np.zeros(x0.shape[0] - 1), markers.shape[0]
        for s in range(outcome.shape[0]):
            state, x = stream(seed, s), x0.copy()
            outcome[s] = end(grid, process, x)
            for _ in range(TUNING.path_steps):
                if outcome[s] != INSIDE:
                    break
                ax, ay, at = x[0], x[1], x[-1]
                state = advance(grid, process, x, slope, f, state)
                for k in range(M):
                    mx, my = markers[k, 0], markers[k, 1]
                    turns[s, k] += turns_of_chord(ax - mx, ay - my, x[0] - mx, x[1] - my)
                for k in range(M, turns.shape[1]):
                    turns[s, k] += turns_of_step(tracks, k - M, (ax, ay, at), (x[0], x[1], x[-1]))
                outcome[s] = end(grid, process, x)
            ends[s] = x

    return walk
