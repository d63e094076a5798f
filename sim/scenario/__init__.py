"""A scene with a robot, a problem and settings, and what a run makes of them."""

from sim.scenario.prepared import prepare
from sim.scenario.scenario import Driver, Scenario

__all__ = ["Driver", "Scenario", "prepare"]
