"""Limit a control that is held for a step where walls are near.

The law's drift off a wall grows as b^2 / c. Held for a step h it throws the robot c / a^2 far from a wall that is
a deviations b sqrt(h) away, in a narrow gap into the wall on the other side. What such a step gains is gained by
a few deviations, and in a gap by half of the way to its middle line.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Law
from pirrht.proposals.wall_drift import WallDrift

THROW = 2.2  # deviations of a step off a wall at most; at a flat wall 5 % more collisions than without the limit
NEAR_WALL = 6.0  # deviations of a step from a wall beyond which the drift is small


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldLaw:
    """A law whose controls are held for a step, and move the robot off a wall no farther than that can help."""

    law: Law
    walls: WallDrift
    step: float  # time for which a control is held [s]
    deviation: float  # of the position after it [m]

    @classmethod
    def of(cls, law: Law, walls: WallDrift, step: float, x: Array) -> Self:
        """Limit a law that is held for a step [s] near x (n,)."""
        deviation = walls.problem.dynamics.position_spread(x) * math.sqrt(step)
        return cls(law=law, walls=walls, step=step, deviation=deviation)

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        s += self.step if self.walls.moving.J else 0.0  # walls that move are judged where the step ends
        u = self.law(x, s)
        c, nx, ny, d, mx, my = map(float, self.walls.walls(x, s, closest=-np.inf))
        if c > NEAR_WALL * self.deviation:
            return u
        most, away = THROW * self.deviation, np.array([nx, ny])
        if nx * mx + ny * my < -0.5:  # a gap
            most = min(most, max(0.5 * (d - c), 0.0))
        G = self.walls.problem.dynamics.G_c(x)[:2]
        excess = self.step * float(away @ G @ u) - most
        return u if excess <= 0.0 else u - np.linalg.pinv(G) @ away * (excess / self.step)
