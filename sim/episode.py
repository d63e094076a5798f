"""The driving loop under its public name; it lives in `sim.drive.episode`."""

from sim.drive.episode import Frame, Tally, run

__all__ = ["Frame", "Tally", "run"]
