"""Backend: the interface between the estimator and what simulates its sample paths."""

from typing import Protocol, runtime_checkable

from pirrht.arrays import Array, IntArray
from pirrht.rollouts.tables import Chosen, Origin, Paths, ProposalTables, Setup


@runtime_checkable
class Backend(Protocol):
    """Simulates the sample paths of a batch (paper, Algorithm 4, lines 5 to 13).

    It owns threads, blocks of samples and copies on devices; arguments and results are plain arrays. Sample s belongs
    to reference h with `tables.first[h] <= s < tables.first[h + 1]` and follows row h of the tables. Every path is a
    function of the origin and its number s alone, whatever the number of threads, so that none has to be kept.

    `rollouts.cpu.Cpu` runs compiled kernels on the cores of one machine. Another backend implements the four methods.

    Examples:
        >>> import numpy as np
        >>> from pirrht.outcome import Outcome
        >>> from pirrht.rollouts.tables import empty_paths
        >>> class AllArrive:  # at once and at no cost, so that psi is 1
        ...     def sample(self, setup, tables, origin):
        ...         paths = empty_paths(int(tables.first[-1]), *tables.control.shape[::2])
        ...         paths.outcome[:] = Outcome.GOAL
        ...         return paths
        ...     def trace(self, setup, tables, origin, number):
        ...         return np.tile(origin.x, (len(number), len(tables.times), 1)), np.ones(len(number), np.int64)
        ...     def replay(self, setup, tables, origin, number):
        ...         states, steps = self.trace(setup, tables, origin, number)
        ...         return states, np.zeros((len(number), *tables.control.shape[1:])), steps
        ...     def controls(self, setup, tables, origin, chosen, groups):
        ...         T, m = tables.control.shape[1:]
        ...         return np.zeros((groups, T, m)), np.zeros((groups, T))
    """

    def sample(self, setup: Setup, tables: ProposalTables, origin: Origin) -> Paths:
        """Simulate all S samples of the tables."""

    def trace(self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray) -> tuple[Array, IntArray]:
        """Simulate samples of some numbers (c,) again; return their states (c, T+1, n) and steps taken (c,)."""

    def replay(
        self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray
    ) -> tuple[Array, Array, IntArray]:
        """Simulate samples again; return states (c, T+1, n), controls up to the exit (c, T, m) and steps taken (c,)."""

    def controls(
        self, setup: Setup, tables: ProposalTables, origin: Origin, chosen: Chosen, groups: int
    ) -> tuple[Array, Array]:
        """Simulate chosen samples again; sums by group of weight times control (groups, T, m), and weight under way."""
