"""A proposal of the user's: the control of another one, under noise whose deviations are larger by a factor."""

from __future__ import annotations

import numpy as np

from pirrht.proposals.proposal import ProposalControl, Wrapped
from pirrht.rollouts.tables import LawRows, ProposalTables


class Wider(Wrapped):
    """Feedback around a guide under wider noise."""

    def __init__(self, lead: ProposalControl, scale: float) -> None:
        super().__init__(lead)
        self.scale = scale

    def pack(self, leads: ProposalTables, h: int) -> None:
        """Write the law of the feedback with a covariance of scale^2 times its own."""
        super().pack(leads, h)
        modes, n = self.guide.modes.shape[1], len(self.guide.metric)
        law = LawRows.of(leads, h, n, modes)
        law.deviation[:] *= self.scale
        law.inverse[:] /= self.scale
        law.log_det[:] += modes * np.log(self.scale)
