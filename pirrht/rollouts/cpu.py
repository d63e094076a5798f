"""Backend of compiled kernels on the cores of this machine, and the record of problem and scene that they read.

In noise units, with a = B_c^-1 G_c u, or s^-1 u in input form, and the path's own increments y = a dt + dw, a step is x
+ f dt + B y, and log dQ_g/dP grows by a_g'y - a_g'a_g dt / 2 for every reference g (paper, Girsanov's theorem). A path
is a function of the seed and its number alone, so that what was not kept is simulated once more.
"""

import os
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.freespace import FreeSpace
from pirrht.geometry.space import SpaceKernels
from pirrht.geometry.world import MovingKernels
from pirrht.jit.jit import as_jitable, kernel, over_ranges
from pirrht.problem import Problem, unit_rate
from pirrht.rollouts.law import straight_home
from pirrht.rollouts.path import Kept, any_path
from pirrht.rollouts.point_block import blocks_for
from pirrht.rollouts.step import KernelSpec
from pirrht.rollouts.tables import Kernels, Origin, Paths, ProposalTables, Setup, empty_paths
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import no_homing
from pirrht.topology.signature import SignatureKernels
from pirrht.traits import Traits

KEPT: Any = Kept


@cache
def loops(one_path: Any, scratch_of: Any, m: int) -> Kernels:
    """Build kernels around one that simulates a path, with `m` controls, in scratch that another makes."""

    @kernel
    def simulate(setup, tables, origin, number, start, stop, paths, states, applied):  # type: ignore[no-untyped-def]
        times = tables.times
        window = tables.window
        first = tables.first
        scratch = scratch_of(setup, tables)
        h = 0

        now = np.zeros((2, m))
        for c in range(start, stop):
            s = number[c]
            if s < first[h]:
                h = 0
            while s >= first[h + 1]:
                h += 1
            now[:] = 0.0
            keep = KEPT(paths.log_ratio[c], states[c], applied[c], now)
            work, key, outcome, taken, last, lasting, exposed = one_path(setup, tables, origin, h, s, keep, scratch)

            paths.work[c] = work
            paths.key[c] = key
            paths.outcome[c] = outcome
            paths.steps[c] = taken

            span = times[taken - 1] + last if taken <= window else times[window]
            paths.log_survival[c], paths.span[c], paths.exposure[c] = lasting, span, exposed
            for j in range(m):
                paths.now[c, j] = now[0, j] + span * now[1, j]
                paths.start_control[c, j] = now[1, j]

    def sample(setup: Setup, tables: ProposalTables, origin: Origin, start: int, stop: int, paths: Paths) -> None:
        states = np.empty((stop, 0, 0))  # nothing is kept under way
        simulate(setup, tables, origin, np.arange(stop), start, stop, paths, states, np.empty((stop, 0, m)))

    def replay(
        setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray, states: Array, applied: Array,
        steps: IntArray,
    ) -> None:  # fmt: skip
        paths = empty_paths(len(number), len(tables.control), m)
        simulate(setup, tables, origin, number, 0, len(number), paths, states, applied)
        steps[:] = paths.steps

    return Kernels(sample, replay, TUNING.alone)


class Cpu(NamedTuple):
    """Backend of compiled kernels: `Cpu.of(problem, setup, homology.table.kernels)`."""

    kernels: Kernels
    threads: int

    @classmethod
    def of(
        cls, problem: Problem, setup: Setup, classes: SignatureKernels, threads: int | None = None, *,
        fitted: bool = True,
    ) -> "Cpu":  # fmt: skip
        """Choose the kernels of a problem and its classes, by default one thread per core, for `Sampling.fitted`."""
        world = setup.world
        kernels = kernels_for(problem, world.static.kernels, world.moving.kernels, classes, fitted=fitted)
        return cls(kernels, threads or len(os.sched_getaffinity(0)))

    def sample(self, setup: Setup, tables: ProposalTables, origin: Origin) -> Paths:
        """Simulate all S samples of the tables, split over the threads."""
        (H, _, m), S = tables.control.shape, int(tables.first[-1])
        paths = empty_paths(S, H, m)

        def work(start: int, stop: int) -> None:
            self.kernels.sample(setup, tables, origin, start, stop, paths)

        over_ranges(work, S, self.threads if self.kernels.alone < S else 1)
        return paths

    def replay(
        self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray
    ) -> tuple[Array, Array, IntArray]:
        """Return states (c, T+1, n), controls carried up to the exit (c, T, m) [control] and steps taken (c,)."""
        (_, T, m), c = tables.control.shape, len(number)

        states = np.zeros((c, T + 1, len(origin.x)))
        applied = np.zeros((c, T, m))
        steps = np.zeros(c, np.int64)

        number = np.ascontiguousarray(number)

        def work(start: int, stop: int) -> None:
            part = slice(start, stop)
            self.kernels.replay(setup, tables, origin, number[part], states[part], applied[part], steps[part])

        over_ranges(work, c, self.threads if self.kernels.alone < c else 1)
        return states, applied, steps


def kernels_for(
    problem: Problem, space: SpaceKernels, moving: MovingKernels | None = None,
    classes: SignatureKernels | None = None, *, fitted: bool = True,
) -> Kernels:  # fmt: skip
    """Return the compiled rollouts of a problem; built once per kind of dynamics and cost rate (`kind_of`)."""
    if space.isotropic and Traits.of(problem).in_blocks(moving is not None):
        return blocks_for(classes)
    return loops(*any_path(kind_of(problem, space, moving, classes, fitted=fitted)), problem.dynamics.m)


def kind_of(
    problem: Problem, space: SpaceKernels, moving: MovingKernels | None = None,
    classes: SignatureKernels | None = None, *, fitted: bool = True,
) -> KernelSpec:  # fmt: skip
    """Describe a problem for which kernels are compiled, for `Sampling.fitted` or not.

    `space` are kernels of its footprint, `moving` of its moving obstacles, `classes` of the signature of its paths.
    """
    d = problem.dynamics
    traits = Traits.of(problem)
    noise = d.diffusion_block if d.input_matrix is None else d.input_matrix
    # For samples that outlive their law; among moving obstacles points have one too.
    homing = straight_home if moving is not None and traits.free_point and d.homing is no_homing else d.homing
    return KernelSpec(
        drift=as_jitable(d.drift),
        control_block=None if traits.constant_gain else as_jitable(_function(d.control_block)),
        diffusion_block=None if traits.constant_blocks else as_jitable(_function(noise)),
        q=as_jitable(problem.q) if callable(problem.q) else unit_rate, n=d.n, m=d.m, traits=traits, space=space,
        reads=d.reads(space.turns),
        angles=sum(1 << i for i in d.angles), homing=as_jitable(homing), stratonovich=d.stratonovich, moving=moving,
        curved_step=traits.drifts and not traits.noisy_position and fitted, classes=classes,
    )  # fmt: skip


def _function(block: Array | Callable[..., None]) -> Callable[..., None]:
    return _filling(block.astype(float).tobytes(), len(block)) if isinstance(block, np.ndarray) else block


@cache  # kernels are built once per matrix
def _filling(data: bytes, m: int) -> Callable[..., None]:
    matrix = np.frombuffer(data).reshape(m, m)

    def fill(x, p, out):  # type: ignore[no-untyped-def]
        out[:, :] = matrix

    return fill


def setup_of(problem: Problem, space: FreeSpace, *, bridge: bool) -> Setup:
    """Collect what rollouts need of a problem and its scene, exits judged along the step (`bridge`) or at its end."""
    d = problem.dynamics
    x = np.zeros(d.n)
    traits = Traits.of(problem)
    known = traits.constant_gain
    return Setup(
        world=space.world, parameters=np.asarray(d.parameters, dtype=float),
        inverse=d.control_gain(x) if known else np.zeros((d.m, d.m)),
        gain=d.noise_gain(x) if known else np.zeros((d.m, d.m)),
        diffusion=np.asarray(d.B_c(x)) if traits.constant_blocks else np.zeros((d.rows, d.m)),
        rate=0.0 if callable(problem.q) else float(problem.q), bridge=bridge,
        least_rate=problem.least_rate / problem.temperature,
    )  # fmt: skip
