"""Ends of paths, common to rollouts and runs in MuJoCo."""

from enum import IntEnum


class Outcome(IntEnum):
    """End of a path: at the goal, in a wall or outside the workspace, or out of time."""

    TIMEOUT = 0
    GOAL = 1
    COLLISION = 2

    def __repr__(self) -> str:
        return f"Outcome.{self.name}"
