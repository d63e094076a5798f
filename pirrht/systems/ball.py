"""A ball that is pushed around in space."""

from dataclasses import dataclass

from pirrht.jit.jit import jitable
from pirrht.systems.single_integrator import SingleIntegrator


@jitable
def straight_home(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Head straight for the goal from x (3,) at the best speed, under equal noise in all directions."""
    away = 1e-12
    for k in range(3):
        out[k] = aim[k] - x[k]
        away += out[k] * out[k]
    scale = (2.0 * rate / away) ** 0.5
    for k in range(3):
        out[k] *= scale


@dataclass(frozen=True, eq=False)
class Ball(SingleIntegrator):
    """A ball in space: dx = u dt + b dw, b > 0, x (3,) [m], u (3,) [m/s]."""

    n = 3
    m = 3
    states = ("x", "y", "z")
    position = (0, 1, 2)
    homing = staticmethod(straight_home)
