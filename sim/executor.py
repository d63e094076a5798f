"""The plants under their public name; they live in `sim.drive.executor`."""

from sim.drive.executor import Advance, Analytic, Executor, Plant

__all__ = ["Advance", "Analytic", "Executor", "Plant"]
