"""Where psi is solved for."""

from __future__ import annotations

from dataclasses import dataclass

from pirrht.arrays import Array
from pirrht.geometry.scene import Goal, Scene


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Domain:
    """The workspace and the disc on which psi is one; obstacles are told as a clearance."""

    lower: Array  # (2,) corner of the workspace [m]
    upper: Array  # (2,) the opposite one [m]
    goal: Goal

    @classmethod
    def of(cls, scene: Scene) -> Domain:
        """That of a scene."""
        return cls(lower=scene.lower.astype(float), upper=scene.upper.astype(float), goal=scene.goal)
