"""Tables of a batch for the kernels: its leads, its steps, and how these are split."""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.factory import ProposalFactory
from pirrht.moving.broad_phase import NO_NEARBY, REACHES, Nearby
from pirrht.proposals.controls import LinearFeedback
from pirrht.proposals.guide import DDPGuide
from pirrht.proposals.proposal import Batch
from pirrht.proposals.tuning import TUNING as PROPOSALS
from pirrht.proposals.wall_drift import Scales, squeezed, trust, under_way, window
from pirrht.rollouts.tables import FINER, ProposalTables, Snapshot
from pirrht.rollouts.ways import no_ways


class Packer:
    """Packs the batches of one sampler into tables; a batch that differs in numbers of samples only reuses the last."""

    def __init__(self, proposals: ProposalFactory) -> None:
        self.proposals, self.tuning = proposals, proposals.tuning
        self.problem, self.sampling = proposals.problem, proposals.sampling
        guidance = proposals.guidance
        self._width = 0 if guidance is None else guidance.law_width
        self._pushes = proposals.climbs or (guidance is not None and guidance.gated)
        self._last: tuple[Snapshot | None, Batch | None, ProposalTables | None] = None, None, None

    def __call__(self, batch: Batch) -> ProposalTables:
        """Return the tables of a batch, under the current prediction of the world."""
        snapshot, (before, known, tables) = self.proposals.world.snapshot, self._last
        first = np.concatenate([[0], np.cumsum(batch.counts)]).astype(np.int64)
        if tables is None or snapshot is not before or not _alike(known, batch):
            tables = self._made(batch)
        self._last = snapshot, batch, tables
        return tables._replace(first=first)

    def _made(self, batch: Batch) -> ProposalTables:
        (setup, homology), x = self.proposals.world.snapshot, batch.state
        times, m = batch.times, self.problem.dynamics.m
        H, T = len(batch.proposals), len(times) - 1
        C = max([1, *(proposal.lead.sections for proposal in batch.proposals)])
        scales = self.proposals.scales(x)
        bridge, end = self.sampling.exit == "bridge", self.problem.least_rate * float(times[-1])
        pointlike = self.proposals.pointlike
        near = self.proposals.nearest(x, batch.time) if pointlike else np.inf
        leads = ProposalTables(
            control=np.zeros((H, T, m)), drift=np.zeros((H, T, m)), times=np.ascontiguousarray(times, dtype=float),
            active=np.zeros(H, dtype=np.int64), first=np.zeros(H + 1, dtype=np.int64),
            ways=no_ways(H, C, PROPOSALS.nodes, scales.decay), reach=scales.reach if self._pushes else 0.0,
            beyond=self.proposals.beyond, least=self._least(scales) if self.sampling.fitted else np.inf,
            weighed=bridge and self.problem.phi > end,
            window=self._window(batch, scales, near) if pointlike else 1,
            mirrored=self.sampling.draws == "antithetic", law=np.zeros((H, T * FINER, self._width)),
            led=np.zeros(H, np.int64),
            marks=homology.rays(x, times + batch.time), nearby=NO_NEARBY,
            trust=trust(scales.noise, near) if pointlike and self._moving else 1.0,
        )  # fmt: skip
        leads = leads._replace(counted=self._counted(batch, leads, scales), nearby=self._nearby(batch, leads))
        for h, proposal in enumerate(batch.proposals):
            proposal.lead.pack(leads, h)
        busy = np.any(leads.control != 0.0, axis=2)
        leads.active[:] = np.where(busy.any(axis=1), T - np.argmax(busy[:, ::-1], axis=1), 0)
        leads.drift[:] = leads.control @ setup.gain.T
        return leads

    @property
    def _moving(self) -> bool:
        return self.proposals.world.moving

    def _window(self, batch: Batch, scales: Scales, near: float) -> int:
        """Return the number of leading steps over which the control of a point is averaged, `near` [m] to an exit.

        Arrived paths apply no control and would bias a mean over all: it ends before they are many.
        """
        shortest = PROPOSALS.averaged_moving if self._moving else PROPOSALS.averaged
        most = window(scales.noise, near, batch.times, self.sampling.window, shortest)
        if not self.proposals.steady:
            return most
        times = batch.times[1 : most + 1]
        for _, guide in _guides(batch):
            most = min(most, under_way(scales.noise, self.proposals.from_goal(_places(guide, times)), times))
        return max(most, window(scales.noise, 0.0, batch.times, self.sampling.window, shortest))

    def _counted(self, batch: Batch, leads: ProposalTables, scales: Scales) -> float:
        """Return the share of a law that counts in the control now by its value at the start.

        For a steady point it is zero, unless it comes near other walls meanwhile, whose bias is not corrected.
        """
        if not self.proposals.steady:
            return leads.trust
        guides = _guides(batch)
        if not guides:
            return 0.0
        _, guide = max(guides, key=lambda one: one[0])
        times = float(leads.times[leads.window]) * (np.arange(1, self.tuning.moments + 1) / self.tuning.moments)
        room = [self.proposals.room(x, batch.time + t) for x, t in zip(_places(guide, times), times, strict=True)]
        return leads.trust * squeezed(scales.noise, np.array(room), times)

    def _nearby(self, batch: Batch, leads: ProposalTables) -> Nearby:
        """Return the moving obstacles that steps may meet, by the reach of noise, the fastest guide and wall drift."""
        if not self._moving:
            return NO_NEARBY
        setup = self.proposals.world.setup
        traffic, field, d, spread = setup.world.moving, setup.world.field, self.problem.dynamics, 0.0
        if d.noisy_position:
            B = d.B_c(batch.state)[: 2 - (d.n - d.rows)]
            spread = self.tuning.deviations * float(np.sqrt(np.sum(B**2) * np.diff(leads.times).max()))
        ways = [np.diff(guide.states[: guide.length + 1, :2], axis=0) for _, guide in _guides(batch)]
        way = max((float(np.hypot(*steps.T).max()) for steps in ways), default=0.0)
        reach = max(spread + self.tuning.faster * way, REACHES * leads.reach, traffic.robot)
        frame = field.left, field.low, field.right, field.high
        return Nearby.of(traffic, frame, leads.times + batch.time, reach)

    def _least(self, scales: Scales) -> float:
        """Return the length of the shortest steps near walls [s]."""
        least = self.tuning.least_step * self.sampling.dt
        if not self._moving or not self.problem.dynamics.noisy_position:
            return least
        return max(least, (self.tuning.least_move * self.problem.scene.robot_radius) ** 2 / scales.noise)


def _guides(batch: Batch) -> list[tuple[int, DDPGuide]]:
    """Return the guides that samples follow, each after their number."""
    return [(one.count, one.lead.guide) for one in batch.proposals if isinstance(one.lead, LinearFeedback)]


def _places(guide: DDPGuide, times: Array) -> Array:
    """Return places (k, 2) [m] of a guide at times (k,) [s] since the plan."""
    return np.stack([np.interp(times, guide.times, column) for column in guide.states.T[:2]], axis=1)


def _alike(one: Batch | None, other: Batch) -> bool:
    """Check that two batches differ in nothing but numbers of samples."""
    if one is None or one.state is not other.state or one.times is not other.times or one.time != other.time:
        return False
    pairs = zip(one.proposals, other.proposals, strict=False)
    return len(one.proposals) == len(other.proposals) and all(a.lead is b.lead for a, b in pairs)
