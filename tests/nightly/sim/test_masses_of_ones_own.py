"""A mass of one's own: MPPI knows its way home from rest, and one that noise cannot move is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tug import Tug

from pirrht.errors import OptionError
from pirrht.steering.double_integrator import MassSteering
from pirrht.systems.double_integrator import DoubleIntegrator
from sim.scenario import Scenario, prepare
from sim.systems import System, registry


class Forgetful(DoubleIntegrator):
    """One that does not say that its velocity moves it."""

    @staticmethod
    def drift(x, p, out):
        out[0], out[1], out[2], out[3] = 0.0, 0.0, 0.0, 0.0


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is registered is forgotten afterwards."""
    monkeypatch.setattr(registry, "_known", dict(registry._known))


def scenario(kind: type[DoubleIntegrator], **given: Any) -> Scenario:
    """One of a system that nobody has told a way home."""
    system = System(
        name=kind.__name__.lower(), dynamics=lambda settings: kind(b=settings.noise), steering=MassSteering.of,
        R=2.0 * np.eye(2), states=("x", "y", "vx", "vy"), defaults={"period": 0.05, "vertices": 60, "samples": 20},
    )  # fmt: skip
    return prepare("slit", robot="hover", system=system, given={"plant": "sde", **given})


def test_mppi_drives_a_mass_of_ones_own_that_begins_at_rest():
    mine = scenario(Tug, method="mppi")
    estimate = mine.driver().plan(mine.start).estimate
    assert estimate is not None
    assert np.isfinite(estimate.value)


def test_a_drift_that_forgets_what_velocities_are_for_is_refused():
    lost = scenario(Forgetful)
    with pytest.raises(OptionError, match=r"^Forgetful: its noise never reaches x, y; its drift must say how"):
        lost.controller(lost.grown_tree())
