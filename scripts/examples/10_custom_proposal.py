"""Add a proposal of your own to the mixture of every class, wider noise, and check that v agrees."""

import numpy as np

from pirrht import Controller
from pirrht.proposals.proposal import Wrapped
from pirrht.rollouts.tables import LawRows
from sim.scenario import prepare

SCALE = 1.05  # factor on the standard deviation of the noise


class Wider(Wrapped):
    """Another proposal's control under wider noise; `pack` writes its density, so the weights stay exact."""

    def pack(self, tables, h):
        super().pack(tables, h)
        modes = self.guide.modes.shape[1]
        law = LawRows.of(tables, h, len(self.guide.metric), modes)
        law.deviation[:] *= SCALE
        law.inverse[:] /= SCALE
        law.log_det[:] += modes * np.log(SCALE)


def wider(x, default):
    """Return another proposal of a class next to its default, or None."""
    return None if default.guide is None else Wider(default)


scenario = prepare("slit", robot="unicycle", given={"samples": 1000, "vertices": 400})
estimates = {}
for name, propose in ("default", []), ("with wider noise", [wider]):
    controller = Controller(
        scenario.problem, scenario.space, scenario.grown_tree(), scenario.sampling, propose=propose,
        rng=np.random.default_rng(1),
    )  # fmt: skip
    estimates[name] = one = controller.plan(scenario.start).estimate
    print(f"{name}: v = {one.value:.4f} +- {one.value_error:.4f}, ESS {one.ess:.0f} of {len(one.weight)}")
first, second = estimates.values()
apart = abs(second.value - first.value) / np.hypot(first.value_error, second.value_error)
print(f"{apart:.1f} standard errors apart: {'within 3' if apart < 3.0 else 'BIASED'}")
