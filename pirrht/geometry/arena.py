"""What a path asks about the world: how far the nearest wall is, and whether it has arrived.

Rollouts ask for the arena at the end of every step: `at` is where a world in motion would enter. What is made before a
path runs, ways, pushes, a car's guides, grids and the tree, asks the field of a standing world.
"""

from __future__ import annotations

from typing import NamedTuple, cast

from pirrht.geometry.field import Field
from pirrht.geometry.scene import Goal
from pirrht.jit.jit import inlined


class Arena(NamedTuple):
    """A clearance field and the goal's disc, as numbers and addresses that kernels can take cheaply."""

    field: Field
    goal: tuple[float, float]  # centre [m]
    radius: float  # of the goal's disc [m]

    @classmethod
    def of(cls, field: Field, goal: Goal) -> Arena:
        """The arena of a field and a goal of centre (2,) [m]."""
        return cls(field, (float(goal.center[0]), float(goal.center[1])), float(goal.radius))

    def at(self, time: float) -> Arena:
        """The arena at a time [s] after now."""
        return cast(Arena, at(self, time))


@inlined
def at(arena, time):  # type: ignore[no-untyped-def]
    """The same for kernels, time in [s]. Every world stands still so far, so it is the same at all times."""
    return arena
