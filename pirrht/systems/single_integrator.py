"""A point that is pushed around (paper, first example)."""

from dataclasses import dataclass

from pirrht.arrays import Array
from pirrht.systems.dynamics import IsotropicNoise, no_drift


@dataclass(frozen=True, eq=False)
class SingleIntegrator(IsotropicNoise):
    """A point that is pushed around: dx = u dt + b dw, b > 0, x (2,) [m], u (2,) [m/s] (paper, first example)."""

    b: float = 0.1  # noise [m/sqrt(s)]

    n = 2
    m = 2
    drift = staticmethod(no_drift)
    control_kind = "velocity"

    def twist(self, x: Array, rate: Array) -> Array:
        """World velocities (vx, vy), (2,) [m/s]."""
        return rate

    def brake(self, x: Array, place: Array, within: float) -> Array:
        """The velocity (2,) [m/s] that shrinks the distance to a place (2,) [m] within a time constant [s]."""
        return (place - x) / within
