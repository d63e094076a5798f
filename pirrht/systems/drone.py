"""A mass in space that is pushed by forces: what a multicopter is to its planner."""

from dataclasses import dataclass

from pirrht.systems.double_integrator import DoubleIntegrator


@dataclass(frozen=True, eq=False)
class Drone(DoubleIntegrator):
    """A mass of 1 kg in space: dp = v dt, dv = u dt + b dw; x = (p, v) (6,) [m, m/s], u (3,) [m/s^2], b > 0."""

    n = 6
    m = 3
    states = ("x", "y", "z", "vx", "vy", "vz")  # type: ignore[assignment]  # more of them
    position = (0, 1, 2)
    control_kind = ""  # steering methods of accelerations are planar
