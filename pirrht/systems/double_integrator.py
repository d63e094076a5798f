"""A point with mass that is pushed by forces: velocity is state, acceleration is control.

The cost of an optimal motion that takes T seconds is J(T) = q T + A / T^3 + B / T^2 + C / T (Webb and van den Berg
2013; `steering.double_integrator` has the coefficients). It may have two minima.
"""

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import inlined, jitable, kernel
from pirrht.systems.dynamics import HOMING, IsotropicNoise

PRECISE = 1e-13  # relative change of T that ends iterations


@inlined
def _quartic(T, a, b, c):  # type: ignore[no-untyped-def]
    return ((T * T - c) * T - b) * T - a


@kernel
def _root(low, high, a, b, c):  # type: ignore[no-untyped-def]
    """The root between `low`, where the quartic is negative, and `high`: Newton's steps, halves where they leave."""
    T = high
    for _ in range(100):  # a few do
        value = _quartic(T, a, b, c)
        slope = (4.0 * T * T - 2.0 * c) * T - b
        low, high = (low, T) if value > 0.0 else (T, high)
        step = value / slope if slope > 0.0 else np.inf
        if min(abs(step), high - low) <= PRECISE * T:
            break
        T = T - step if low < T - step < high else 0.5 * (low + high)
    return T


@kernel
def best_duration(q, A, B, C):  # type: ignore[no-untyped-def]
    """The duration T > 0 [s] of least J(T) = q T + A / T^3 + B / T^2 + C / T, and that J [cost]; A, C >= 0."""
    a = 3.0 * A / q
    b = 2.0 * B / q
    c = C / q

    b = -b if b == 0.0 else b
    bend = math.sqrt(c / 6.0)  # from here on the quartic is convex
    # Extrema of the quartic: 4 T^3 - 2 c T - b = 0, three if the discriminant is positive, the first of them negative.
    if c * c * c > 3.375 * b * b:
        angle = math.acos(max(-1.0, min(1.0, 0.75 * b / (c * bend)))) / 3.0
        middle = 2.0 * bend * math.cos(angle - 2.0 * math.pi / 3.0)
        last = 2.0 * bend * math.cos(angle)
    else:
        half = 0.125 * b
        root = math.sqrt(max(half * half - c * c * c / 216.0, 0.0))
        middle, last = -1.0, np.cbrt(half + root) + np.cbrt(half - root)
    best, T = np.inf, 0.0
    if middle > 0.0 and _quartic(middle, a, b, c) > 0.0:
        T = _root(0.0, middle, a, b, c)
        best = q * T + ((A / T + B) / T + C) / T
    if not (middle > 0.0 and last > 0.0 and _quartic(last, a, b, c) > 0.0):
        low = max(last, bend)
        high = max(max((3.0 * a) ** 0.25, np.cbrt(max(3.0 * b, 0.0))), max(math.sqrt(3.0 * c), 1.001 * low))
        if bend > last and _quartic(bend, a, b, c) > 0.0:
            low, high = max(last, 0.0), bend
        other = _root(low, high, a, b, c)
        cost = q * other + ((A / other + B) / other + C) / other
        if cost < best:
            best, T = cost, other
    return T, best


@jitable
def coasting(x, p, out):  # type: ignore[no-untyped-def]
    """f = [v, 0] at x = (p, v) (2 d,), written to out (2 d,) [m/s, m/s^2]."""
    d = out.shape[0] // 2
    for k in range(d):
        out[k] = x[d + k]
        out[d + k] = 0.0


@jitable
def into_goal(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Begin the best motion from x (2 d,) into the goal, at any velocity there; written to out (d,) [1/sqrt(s)].

    With D = p1 - p0 it is 3 (D - v T) / T^2 over the noise b. p1 is where coasting enters the goal's disc or ball; if
    it misses that, a point as far off the middle as a share of the radius.
    """
    d = out.shape[0]
    b = B[0, 0]

    speed = 0.0
    ahead = 0.0
    for k in range(d):
        speed += x[d + k] * x[d + k]
        ahead += (aim[k] - x[k]) * x[d + k]
    way = math.sqrt(speed) + 1e-9
    ahead /= way

    square = 0.0
    for k in range(d):
        out[k] = aim[k] - x[k] - ahead * x[d + k] / way  # across the way
        square += out[k] * out[k]
    off = math.sqrt(square) + 1e-9
    aside = min(off, HOMING.aim * radius)
    depth = math.sqrt(radius * radius - aside * aside)
    depth = depth if ahead > depth else 0.0

    square = 0.0
    along = 0.0
    for k in range(d):
        out[k] = aim[k] - x[k] - aside * out[k] / off - depth * x[d + k] / way
        square += out[k] * out[k]
        along += out[k] * x[d + k]
    r = 1.0 / (b * b * rate)  # of the control, for q = 1
    T, _ = best_duration(1.0, 1.5 * r * square, -3.0 * r * along, 1.5 * r * speed)
    scale = 3.0 / max(T * T * b, 1e-9)
    for k in range(d):
        out[k] = scale * (out[k] - x[d + k] * T)


@dataclass(frozen=True, eq=False)
class DoubleIntegrator(IsotropicNoise):
    """A mass of 1 kg pushed around: dp = v dt, dv = u dt + b dw; x = (p, v) (4,) [m, m/s], u (2,) [m/s^2], b > 0."""

    b: float = 0.1  # noise [m/s/sqrt(s)]

    n = 4
    m = 2
    states = ("x", "y", "vx", "vy")
    drift = staticmethod(coasting)
    control_kind = "acceleration"
    homing = staticmethod(into_goal)

    def twist(self, x: Array, rate: Array) -> Array:
        """Accelerations along the axes of the world, (m,) [m/s^2]: forces on a mass of 1 kg [N]."""
        return rate

    def brake(self, x: Array, place: Array, within: float) -> Array:
        """Critically damped: the acceleration (m,) [m/s^2] of a spring and a damper at a place (m,) [m]."""
        return ((place - x[: self.m]) / within - 2.0 * x[self.m :]) / within
