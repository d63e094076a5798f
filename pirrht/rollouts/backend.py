"""Backend: the interface between the estimator and what simulates its sample paths."""

from typing import Protocol, runtime_checkable

from pirrht.arrays import Array, IntArray
from pirrht.rollouts.tables import Origin, Paths, ProposalTables, Setup


@runtime_checkable
class Backend(Protocol):
    """Simulates the sample paths of a batch (paper, Algorithm 4, lines 5 to 13).

    It owns threads, blocks of samples and copies on devices. Sample s with `tables.first[h] <= s < tables.first[h + 1]`
    follows proposal h by row h of the tables. Every path is a function of the origin and its number s alone, whatever
    the number of threads, so that none has to be kept.

    `rollouts.cpu.Cpu` runs compiled kernels on the cores of one machine; `rollouts.plain.Plain` is the same equation in
    plain Python. Tests compare both path by path (`tests/unit/pirrht/rollouts/test_backends.py`): others join there.

    What it is given: `jit.records.without_addresses` turns a setup or tables into numbers and arrays by name, which a
    device copies. Addresses in these records are for compiled kernels of this machine alone. What is free at a place
    (`world.static`, `world.moving`) and which class a step belongs to (`classes`, `marks`) are records whose "program"
    is the name of the class that says how to read them, such as "Disc" or "PlanarTable". Drift, G, B and q are
    functions (x, p, out) of the problem that a backend is made for. The records of a plan do not change.

    What it returns, beyond what `Paths` says of a row:

    * `log_ratio`: of every proposal g, whichever drew the path. It is that up to the exit, or that of all of the step
      in which the path leaves: both have the mean 1 under Q_h. What is below exp(-16) of Q_h may be left out.
    * `now`, `span`: the control now is the weighted mean of `now` over that of `span`. `span` is the time [s] of the
      first `window` steps of the grid up to the exit. `now` is `span` times `start_control`, plus, of these steps, D^-1
      (y - l dt), where D u = a is a control in noise units, y = a dt + dw, and l the part of a_h that changes quickly:
      all of it, or `law_weight` of it among moving obstacles where noise moves a point, and nothing of it if the
      optimal control is a martingale (`Traits.is_martingale`). Where walls push, l dt is the mean of both ends of the
      step: half of it is l at its start, and half is owed until l is known at the start of the next step, whether that
      is within the window or not. Of a step in which the path leaves nothing is owed: all of l dt is that of its start.
    * `start_control`: D^-1 l at the start, without wall drift.
    * `exposure`: the sum over stretches of time, at least `RolloutTuning.stretch` [s] long, of `jit.streams.exposure`,
      from the distances of the nearest wall at the ends of a stretch and the deviation of noise towards it. Only
      `Controller.risk` reads it, and only of systems whose position is noisy.

    Examples:
        >>> import numpy as np
        >>> from pirrht.outcome import Outcome
        >>> from pirrht.rollouts.tables import empty_paths
        >>> class AllArrive:  # at once and at no cost, so that psi is 1
        ...     def sample(self, setup, tables, origin):
        ...         paths = empty_paths(int(tables.first[-1]), *tables.control.shape[::2])
        ...         paths.outcome[:] = Outcome.GOAL
        ...         return paths
        ...     def replay(self, setup, tables, origin, number):
        ...         states = np.tile(origin.x, (len(number), len(tables.times), 1))
        ...         return states, np.zeros((len(number), *tables.control.shape[1:])), np.ones(len(number), np.int64)
        >>> isinstance(AllArrive(), Backend)
        True
    """

    def sample(self, setup: Setup, tables: ProposalTables, origin: Origin) -> Paths:
        """Simulate all S samples of the tables."""

    def replay(
        self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray
    ) -> tuple[Array, Array, IntArray]:
        """Simulate samples of some numbers (c,) again, in any order.

        Return their states (c, T+1, n) at the ends of steps, zero after the exit; the controls carried up to the exit,
        y / dt with the noise, as means over steps (c, T, m); and steps taken, the exit's included (c,).
        """
