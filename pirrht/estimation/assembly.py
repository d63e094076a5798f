"""Assembly of an estimator: its backend, its guides and proposals, and the predicted world that they share."""

import os
from collections.abc import Callable

from pirrht.arrays import Array
from pirrht.estimation.factory import ProposalFactory
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.rollouts.backend import Backend
from pirrht.rollouts.cpu import Cpu, setup_of
from pirrht.rollouts.tables import PredictedWorld
from pirrht.steering.in_time import homology_of
from pirrht.topology.signature import Signature


def path_integral(
    problem: Problem, space: FreeSpace, sampling: Sampling, *, terminal_cost: Callable[[Array], Array] | None = None,
    homology: Signature | None = None, backend: Backend | None = None,
) -> PathIntegral:  # fmt: skip
    """Assemble the estimator of a problem.

    Args:
        terminal_cost: costs (k,) [cost] of states (k, n) at the end of the grid; None: a path that has not arrived by
            then weighs nothing.
        homology: of the problem's paths; None: where obstacles move, with bases at the best speed.
        backend: simulates paths; None: compiled kernels on this machine (`Cpu`).
    """
    classes = homology_of(problem, space) if homology is None else homology
    world = PredictedWorld((setup_of(problem, space, bridge=sampling.exit == "bridge"), classes))
    threads = sampling.threads or len(os.sched_getaffinity(0))
    proposals = ProposalFactory(problem, space, sampling, world)
    if backend is None:
        backend = Cpu.of(problem, world.setup, classes.table.kernels, threads, fitted=sampling.fitted)
    return PathIntegral(proposals, backend, threads=threads, terminal_cost=terminal_cost)
