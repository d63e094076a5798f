"""What a path asks about the world while it runs: how far the walls are, and the goal."""

from __future__ import annotations

from typing import NamedTuple

from pirrht.compiled.jit import inlined
from pirrht.geometry.field import Field


class Arena(NamedTuple):
    """Walls and goal at one time, as numbers that kernels can take cheaply."""

    field: Field  # clearance of the robot's centre
    goal: tuple[float, float]  # centre of the goal's disc [m]
    radius: float  # of the goal's disc [m]


@inlined
def at(arena, time):  # type: ignore[no-untyped-def]
    """The arena at a time [s]; a world that stands still is the same at all of them."""
    return arena
