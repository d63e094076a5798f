"""Importance-sampled path integrals: the value, the control and the class weights at a state (paper, III and IV-C).

With S samples drawn around H references, psi = E_P[W]. The paper averages H estimators, each weighing its samples
by dP/dQ_h. The balance heuristic weighs every sample by dP / (1/S sum_g N_g dQ_g) instead: with finitely many
samples the plain average is too high by up to lambda ln H, since samples around one reference practically never
visit the classes of the others. Only the estimate of psi is unbiased; u is a ratio and v a logarithm.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.threads import mapped
from pirrht.estimation.estimate import OTHER, Estimate, Rollouts, log_weights, normalised, weigh
from pirrht.estimation.sampling import EXITS, GUIDES, WEIGHTS, Sampling
from pirrht.freespace import FreeSpace
from pirrht.geometry.field import clearance
from pirrht.guidance.gates import gates_of
from pirrht.guidance.tracking import Guidance, Guide
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.rollouts.backend import Guides, Kernels, World, empty_paths, kernels_for
from pirrht.rollouts.first_exit import survivors_slope

__all__ = ["EXITS", "GUIDES", "OTHER", "WEIGHTS", "Estimate", "PathIntegral", "Rollouts", "Sampling"]

ANTICIPATION = 0.25  # walls push as far as noise carries a path in this time [s]; much longer makes weights uneven
TAIL = 40.0  # paths longer than the cheapest reference plus so many lambda are cut: they weigh exp(-40)
AVERAGED = 0.02  # near walls and goal the control now is averaged over leading steps of this length together [s]
SHARE = 0.25  # of the time in which noise carries a path to the nearest of them
SHARPER = 0.2  # of a rollout step's noise: nearer than half of that a wall pushes the robot no harder
NEGLIGIBLE = 1e-6  # normalised weights below this do not contribute to the tape


class PathIntegral:
    """Draws and weighs samples around references; the problem and its scene stay fixed.

    Args:
        beyond: costs (k,) of going on from states (k, n) at the end of the grid; None: a path that has not arrived
            by then weighs nothing.
    """

    def __init__(
        self,
        problem: Problem,
        space: FreeSpace,
        sampling: Sampling,
        *,
        beyond: Callable[[Array], Array] | None = None,
    ) -> None:
        self.problem, self.space, self.sampling, self.beyond = problem, space, sampling, beyond
        self.temperature = problem.temperature
        self.kernels: Kernels = kernels_for(problem)
        self.world = _world(problem, space, sampling.exit == "bridge")
        steered = sampling.guide == "feedback" and Guidance.suits(problem)
        self.guidance = Guidance(problem, self.world) if steered else None
        self.threads = sampling.threads or len(os.sched_getaffinity(0))

    def warm_up(self) -> None:
        """Compile what sampling, weighing and tracing need, so that the first plan takes no longer than the others."""
        d = self.problem.dynamics
        x = self.problem.scene.start[: d.n]
        if self.guidance is not None:
            self.guidance.warm_up(x)
        rollouts = self.rollout(x, np.arange(3.0), np.zeros((1, 2, d.m)), 0, counts=[1])
        self.tapes(rollouts, [np.ones(1, dtype=np.bool_)])
        self.trace(rollouts, np.zeros(1, dtype=np.int64))
        clearance(self.space.field, x[0], x[1])
        survivors_slope(self.space.field, 1.0, 1.0, x[0], x[1])

    def grid(self, reference_cost: float) -> Array:
        """Ends of the rollout steps (T+1,) [s], up to T_max = (c_ref + 40 lambda) / q_min where a path weighs nothing.

        A control read off the first step is the mean over that step. Where the plan is made anew more often than
        every dt, the first dt is cut finer, since near a wall the mean over dt is much weaker than the control now.
        """
        return self.steps((reference_cost + TAIL * self.temperature) / self.problem.least_rate)

    def steps(self, horizon: float) -> Array:
        """Ends of the rollout steps (T+1,) [s] up to a horizon [s], the first dt cut finer where it is to be."""
        dt = self.sampling.dt
        steps = max(1, int(np.ceil(horizon / dt)))
        parts = 1 if self.sampling.first is None else max(1, round(dt / self.sampling.first))
        fine = np.arange(parts) * (dt / parts)
        return np.concatenate([fine, np.arange(1, steps + 1) * dt])

    def rollout(
        self,
        x: Array,
        times: Array,
        controls: Array,
        seed: int,
        *,
        counts: Sequence[int] | None = None,
        corners: Sequence[Array] | None = None,
        guides: Sequence[Guide | None] | None = None,
    ) -> Rollouts:
        """Sample paths from x (n,) around H references.

        Args:
            times: ends of the steps, (T+1,) from 0 [s].
            controls: tapes, (H, T, m).
            seed: of this call; equal seeds give equal paths.
            counts: samples around each reference, (H,); default N.
            corners: polylines (k, 2) into the goal; under feedback guidance samples head for their corners, one
                after the other, and are pushed away from walls, instead of following the tapes.
            guides: of a car, one per reference: samples follow their feedback instead of the tapes where there is one.
        """
        H = len(controls)
        number = np.full(H, self.sampling.samples) if counts is None else np.asarray(counts)
        first = np.concatenate([[0], np.cumsum(number)]).astype(np.int64)
        leads = self._guides(x, times, np.array(controls, dtype=float), first, corners, guides)
        S = int(first[-1])
        paths, log_weight = empty_paths(S, H, self.problem.dynamics.m), np.empty(S)
        x0 = np.ascontiguousarray(x, dtype=float)

        def work(part: tuple[int, int]) -> None:
            self.kernels.sample(self.world, leads, x0, np.uint64(seed), part[0], part[1], paths)
            log_weight[slice(*part)] = log_weights(self.problem, self.sampling.weights, paths, first, part)

        _in_parallel(work, S, self.threads if self.kernels.alone < S else 1)
        rollouts = Rollouts(x0=x0, seed=seed, guides=leads, paths=paths, log_weight=log_weight)
        return rollouts if self.beyond is None else self._completed(rollouts, self.beyond)

    def _completed(self, rollouts: Rollouts, beyond: Callable[[Array], Array]) -> Rollouts:
        """The same, with paths that are under way at the end of the grid charged what the rest costs."""
        paths = rollouts.paths
        under_way = np.flatnonzero(paths.outcome == Outcome.TIMEOUT)
        if len(under_way) == 0:
            return rollouts
        work, outcome = paths.work.copy(), paths.outcome.copy()
        work[under_way] += beyond(self.trace(rollouts, under_way)[0][:, -1])
        outcome[under_way] = Outcome.GOAL
        arrived = paths._replace(work=work, outcome=outcome)
        return replace(
            rollouts, log_weight=log_weights(self.problem, self.sampling.weights, arrived, rollouts.guides.first)
        )

    def estimate(self, rollouts: Rollouts, classes: Mapping[int, str] | None = None) -> Estimate:
        """Weigh the samples; `classes` maps additive class keys to the names of the references' classes.

        Raises:
            NoSurvivingSample: no sample has any weight.
        """
        return weigh(self, [rollouts], classes)

    def trace(self, rollouts: Rollouts, chosen: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
        """States (c, T+1, n) of chosen samples (c,), and the number of steps each took, (c,)."""
        T = rollouts.guides.control.shape[1]
        states = np.zeros((len(chosen), T + 1, len(rollouts.x0)))
        steps = np.zeros(len(chosen), np.int64)
        self.kernels.trace(
            self.world,
            rollouts.guides,
            rollouts.x0,
            np.uint64(rollouts.seed),
            chosen,
            states,
            steps,
        )
        return states, steps

    def _guides(
        self,
        x: Array,
        times: Array,
        control: Array,
        first: NDArray[np.int64],
        corners: Sequence[Array] | None,
        leaders: Sequence[Guide | None] | None,
    ) -> Guides:
        H, T = control.shape[:2]
        feedback = self.sampling.guide == "feedback" and self.problem.dynamics.n == self.problem.dynamics.m == 2
        lines = [np.asarray(line) for line in corners] if feedback and corners is not None else []
        gates = gates_of(lines or [np.zeros((0, 2))] * H, x, self._decay(x))
        law, led = np.zeros((H, T, 9)), np.zeros(H, np.int64)
        for h, leader in enumerate(leaders or ()):
            if leader is not None:
                led[h] = leader.length
                law[h, :, 0], law[h, :, 1:4], law[h, :, 4:7] = leader.control, leader.gains, leader.states[:-1]
                law[h, :, 7], law[h, :, 8] = leader.spread, np.log(leader.spread)
                law[h, :, :4] *= self.world.gain[0, 0]
        control[(gates.count > 0) | (led > 0)] = 0.0
        busy = np.any(control != 0.0, axis=2)
        active = np.where(busy.any(axis=1), T - np.argmax(busy[:, ::-1], axis=1), 0)
        return Guides(
            control=control,
            drift=np.ascontiguousarray(control @ self.world.gain.T),
            times=np.ascontiguousarray(times, dtype=float),
            active=active.astype(np.int64),
            first=first,
            gates=gates,
            speed=self._speed(x),
            reach=self._reach(x) if feedback else 0.0,
            window=self._window(x, times) if feedback else 1,
            mirrored=self.sampling.draws == "antithetic",
            law=law,
            led=led,
        )

    def _window(self, x: Array, times: Array) -> int:
        """Leading steps over which the control now is averaged, at least one.

        Besides the guide, which is followed exactly, the optimal control changes near walls and goal: about as fast as
        noise carries a path there.
        """
        goal = self.space.scene.goal
        near = min(
            float(clearance(self.space.field, x[0], x[1])), float(np.hypot(*(x[:2] - goal.center))) - goal.radius
        )
        longest = min(max(SHARE * near**2 / self._noise(x), AVERAGED), self.sampling.window)
        return max(1, int(np.searchsorted(times, longest + 1e-9, side="right")) - 1)

    def push(self, x: Array, guides: Guides) -> Array:
        """The part of the control at x (n,) that the nearest wall accounts for, (m,); none without feedback guidance.

        It changes fast with the position, so it is taken at x itself; the rest of the control, which samples tell,
        changes slowly and is averaged over the leading steps.
        """
        d = self.problem.dynamics
        if guides.reach <= 0.0:
            return np.zeros(d.m)
        field = self.space.field
        c = float(clearance(field, x[0], x[1]))
        if c >= 3.0 * guides.reach:
            return np.zeros(d.m)
        B = d.B_c(x)
        # A robot that reacts between plans may come closer than a rollout's step would let it.
        widest = SHARPER * float(np.sqrt((B @ B.T).diagonal().max() * guides.times[1]))
        slope = np.array(survivors_slope(field, guides.reach, widest, x[0], x[1])[:2])
        return np.asarray(np.linalg.solve(d.G_c(x), B @ B.T @ slope))

    def _speed(self, x: Array) -> float:
        """Speed that balances q against u'Ru/2."""
        R = self.problem.control_cost(x)
        return float(np.sqrt(2.0 * self.problem.least_rate / (np.trace(R) / len(R))))

    def _noise(self, x: Array) -> float:
        """Variance per second of an actuated state, their mean."""
        B = self.problem.dynamics.B_c(x)
        return float(np.trace(B @ B.T)) / len(B)

    def _decay(self, x: Array) -> float:
        """k of psi = exp(-k r) in free space [1/m]; gates, of points that noise moves, are its only use."""
        return float(np.sqrt(2.0 * self.problem.least_rate / (self.temperature * self._noise(x))))

    def _reach(self, x: Array) -> float:
        """How far noise carries a path in the time over which walls are anticipated [m]."""
        return float(np.sqrt(2.0 * self._noise(x) * ANTICIPATION))

    def tapes(self, rollouts: Rollouts, groups: Sequence[NDArray[np.bool_]]) -> tuple[Array, Array, Array]:
        """Open-loop controls of groups of samples, each with weights normalised within the group.

        Args:
            groups: disjoint masks (S,) of samples.

        Returns:
            controls (G, T, m), the weight still under way at each step (G, T), effective sample sizes (G,).
        """
        T, m = rollouts.guides.control.shape[1:]
        total, alive, ess = np.zeros((len(groups), T, m)), np.zeros((len(groups), T)), np.zeros(len(groups))
        weight, group = np.zeros(rollouts.size), np.full(rollouts.size, -1, dtype=np.int64)
        for g, mask in enumerate(groups):
            weight[mask], ess[g] = normalised(rollouts.log_weight[mask])
            group[mask] = g
        chosen = np.flatnonzero(weight > NEGLIGIBLE)
        self.kernels.control(
            self.world, rollouts.guides, rollouts.x0, np.uint64(rollouts.seed), chosen, group[chosen],
            weight[chosen], total, alive,
        )  # fmt: skip
        return total, alive, ess


def _world(problem: Problem, space: FreeSpace, bridge: bool) -> World:
    d = problem.dynamics
    x = np.zeros(d.n)
    constant = d.constant
    return World(
        field=space.field,
        goal=(float(space.scene.goal.center[0]), float(space.scene.goal.center[1])),
        goal_radius=float(space.scene.goal.radius),
        cuts=space.homology.cuts,
        parameters=np.asarray(d.parameters, dtype=float),
        inverse=np.asarray(np.linalg.solve(d.G_c(x), d.B_c(x)) if constant else np.zeros((d.m, d.m))),
        gain=np.asarray(np.linalg.solve(d.B_c(x), d.G_c(x)) if constant else np.zeros((d.m, d.m))),
        diffusion=np.asarray(d.B_c(x)) if constant else np.zeros((d.m, d.m)),
        rate=0.0 if callable(problem.q) else float(problem.q),
        bridge=bridge,
    )


def _in_parallel(work, count: int, threads: int) -> None:  # type: ignore[no-untyped-def]
    """Split a range of samples over threads; what a sample is does not depend on the split."""
    if threads == 1:
        work((0, count))
        return
    edges = np.linspace(0, count, 2 * threads + 1).astype(int)
    mapped(work, zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True), threads)
