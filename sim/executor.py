"""The plants under their public name; they live in `sim.drive.executor`."""

from sim.drive.executor import Executor
from sim.drive.plant import Advance, Analytic, Plant

__all__ = ["Advance", "Analytic", "Executor", "Plant"]
