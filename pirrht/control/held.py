"""Limit a control that is held for a step where walls are near.

The law's drift off a wall grows as b^2 / c. Held for a step h it throws the robot c / a^2 far from a wall that is
a deviations b sqrt(h) away, in a narrow gap into the wall on the other side. What such a step gains is gained by
a few deviations, and in a gap by half of the way to its middle line.

Seen from a wall, moving or not, psi is odd in the distance c, so that the drift off it is b^2 / c + O(c). What a plan
found farther off is carried to the wall as a constant. There, where it points at a moving wall, it falls like c.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Law
from pirrht.estimation.risk import CLOSEST
from pirrht.geometry.world import steepest
from pirrht.proposals.wall_drift import WallDrift

THROW = 2.2  # deviations of a step off a wall at most; at a flat wall 5 % more collisions than without the limit
SAME = 1e-6  # by which distances of one wall differ by rounding [m]
NEAR_WALL = 6.0  # deviations of a step from a wall beyond which the drift is small


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldLaw:
    """A law whose controls are held for a step, and move the robot off a wall no farther than that can help."""

    law: Law
    walls: WallDrift
    step: float  # time for which a control is held [s]
    deviation: float  # of the clearance after it [m]

    @classmethod
    def of(cls, law: Law, walls: WallDrift, step: float, x: Array) -> Self:
        """Limit a law that is held for a step [s] near x (n,)."""
        return cls(law=law, walls=walls, step=step, deviation=walls.problem.clearance_spread(x) * math.sqrt(step))

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        moving = self.walls.moving
        position = self.walls.static.kernels.position
        s += self.step if moving.J else 0.0  # walls that move are judged where the step ends
        u = self.law(x, s)
        nearest, direction, other, opposite = self.walls.walls(x, s, closest=-np.inf)
        c = float(nearest)
        d = float(other)
        near = NEAR_WALL * self.deviation
        if c > near:
            return u

        most = THROW * self.deviation
        away = np.array(direction, dtype=float)
        gap = bool(away @ np.array(opposite, dtype=float) < -0.5)

        if gap:
            most = min(most, max(0.5 * (d - c), 0.0))
        G = self.walls.gains(x)
        wanted = thrown = self.step * float(away @ G @ u)
        if moving.J:
            rest = thrown - self.deviation**2 * (1.0 / max(c, CLOSEST * self.deviation) - (1.0 / d if gap else 0.0))
            for row in moving.walls(self.walls.pose(x), self.walls.time + s, near):
                if row[0] <= c + SAME:
                    rest -= self.step * float(row[4 : 4 + position] @ away[:position])
            wanted -= min(rest, 0.0) * (1.0 - max(c, 0.0) / near)
        wanted = min(wanted, most)
        off = steepest(away)
        along = self.step * (G @ u) - thrown * off
        change = (wanted - thrown) * off
        swing = self.walls.problem.scene.footprint.reach * along[position:]  # of corners
        far = math.hypot(*along[:position], *swing)

        if far > THROW * self.deviation:  # a law that is rough at walls
            change += (THROW * self.deviation / far - 1.0) * along
        return u + np.linalg.pinv(G) @ change / self.step if change.any() else u
