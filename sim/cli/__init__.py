"""The command `pirrht`."""

from sim.cli.parser import main

__all__ = ["main"]
