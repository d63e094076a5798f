"""Backend in NumPy: the paper's Euler rollouts of a point in an empty room, an oracle for compiled ones."""

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.outcome import Outcome
from pirrht.rollouts.tables import Chosen, Origin, Paths, ProposalTables, Setup, empty_paths


class Euler:
    """Simulates dx = u dt + B dw under control sequences; exits are judged at the ends of steps (paper, III-A)."""

    def sample(self, setup: Setup, tables: ProposalTables, origin: Origin) -> Paths:
        """Simulate all S samples."""
        own, _, y, taken, outcome = self._simulated(setup, tables, origin)
        (S, T, m), dt = y.shape, np.diff(tables.times)
        paths, early = empty_paths(S, len(tables.control), m), np.arange(T) < tables.window
        paths.outcome[:], paths.steps[:], paths.work[:] = outcome, taken, setup.rate * tables.times[taken]
        under_way = np.arange(T) < taken[:, None]
        for g, a in enumerate(tables.drift):
            step = np.einsum("stm,tm->st", y, a) - 0.5 * dt * (a**2).sum(axis=1)
            paths.log_ratio[:, g] = (under_way * step).sum(axis=1)
        paths.start_control[:] = tables.drift[own, 0] @ setup.inverse.T
        counted = (under_way & early)[..., None]
        paths.span[:] = (counted[..., 0] * dt).sum(axis=1)
        noise = (counted * (y - tables.drift[own] * dt[:, None])).sum(axis=1)
        paths.now[:] = noise @ setup.inverse.T + paths.span[:, None] * paths.start_control
        return paths

    def trace(self, setup: Setup, tables: ProposalTables, origin: Origin, number: IntArray) -> tuple[Array, IntArray]:
        """Return states (c, T+1, n) and steps taken (c,)."""
        _, states, _, taken, _ = self._simulated(setup, tables, origin)
        return states[number], taken[number]

    def controls(
        self, setup: Setup, tables: ProposalTables, origin: Origin, chosen: Chosen, groups: int
    ) -> tuple[Array, Array]:
        """Return weighted controls (groups, T, m) and the weight under way (groups, T)."""
        _, _, y, taken, _ = self._simulated(setup, tables, origin)
        T, m = y.shape[1:]
        total, alive = np.zeros((groups, T, m)), np.zeros((groups, T))
        under_way = (np.arange(T) < taken[chosen.number][:, None]) * chosen.weight[:, None]
        np.add.at(alive, chosen.group, under_way)
        controls = y[chosen.number] @ setup.inverse.T / np.diff(tables.times)[:, None]
        np.add.at(total, chosen.group, under_way[..., None] * controls)
        return total, alive

    def _simulated(self, setup: Setup, tables: ProposalTables, origin: Origin):  # type: ignore[no-untyped-def]
        """Return references (S,), states (S, T+1, m), increments y = a dt + dw (S, T, m), steps (S,), outcomes (S,)."""
        S, dt, (_, T, m) = int(tables.first[-1]), np.diff(tables.times), tables.control.shape
        own = np.searchsorted(tables.first, np.arange(S), side="right") - 1
        noise = np.random.default_rng(int(origin.seed)).normal(size=(S, T, m)) * np.sqrt(dt)[:, None]
        y = tables.drift[own] * dt[:, None] + noise
        states = origin.x + np.concatenate([np.zeros((S, 1, m)), np.cumsum(y @ setup.diffusion.T, axis=1)], axis=1)
        px, py = states[:, 1:, 0], states[:, 1:, 1]
        room, (gx, gy) = setup.world.field, setup.world.goal
        hit = (px <= room.left) | (px >= room.right) | (py <= room.low) | (py >= room.high)
        arrived = ~hit & (np.hypot(px - gx, py - gy) <= setup.world.radius)
        ended = hit | arrived
        last = np.where(ended.any(axis=1), np.argmax(ended, axis=1), T - 1)
        outcome = np.select(
            [hit[np.arange(S), last], arrived[np.arange(S), last]], [Outcome.COLLISION, Outcome.GOAL], Outcome.TIMEOUT
        )
        return own, states, y, last + 1, outcome
