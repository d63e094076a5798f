"""Solve for a mass on a line: dp = v dt, dv = u dt + b dw between a wall at p = 0 and a goal at p = 1.

psi(p, v) solves -(q/lambda) psi + v psi_p + (b^2/2) psi_vv = 0 with lambda = r b^2. A path ends only where it leaves:
in the wall (p = 0, v < 0: psi = exp(-phi/lambda)) or in the goal (p = 1, v > 0: psi = 1), at any velocity; where v
points inward there is no condition. In a step, noise of half of it changes v, then p moves along v over all of it, then
the other half follows (Strang). The noise's Gaussian is a sum over velocities closer than it is wide, exact but for
rounding. Kept, and interpolated along p between the values around, is -lambda log psi, since psi underflows: the scheme
is monotone. A second grid of half the spacing and step tells the error.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact.grid import cubic, slopes
from pirrht.jit.jit import inlined, kernel

SPACING = 0.005  # of the finer grid: v is within 0.1 % [m]
STEP = 4.0  # a step takes so many spacings at 1 m/s
DENSE = 0.7  # velocities are so many deviations of half a step's noise apart
REACH = 7.0  # deviations up to which a step's noise is summed
QUICK = 8.0  # and beyond them what accelerations up to this do in it [m/s^2]
MOST = 2_000_000  # points of the finer grid, which is solved for in about a minute
CEILING = 1e3  # v where the wall cannot be missed [cost]
ACCURACY = 1e-7  # sweeps end when they change v by less [cost]
SWEEPS = 2000
LOST = 1e-20  # a sum of weights below this is dominated by where the Gaussian has been too far away to scale by


class Strip(NamedTuple):
    """v on a grid of positions and velocities."""

    value: Array  # (np, nv) [cost]
    first: float  # velocity of column 0 [m/s]
    apart: float  # from one column to the next [m/s]
    spacing: float  # from one row to the next; row 0 is the wall [m]


class Motion(NamedTuple):
    """One step as sweeps need it."""

    first: float  # as in `Strip`
    apart: float
    cells: float  # rows that a step at 1 m/s passes [s/m]
    cost: float  # q tau [cost]
    temperature: float  # lambda [cost]
    phi: float  # at the wall, at most CEILING [cost]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MassOnLine:
    """log psi of a mass on a line as a function of position [m] and velocity [m/s]."""

    temperature: float  # lambda [cost]
    r: float
    fine: Strip
    coarse: Strip  # of twice the spacing

    def value(self, p: float, v: float) -> float:
        """v = -lambda log psi [cost] at position p from 0 to 1 [m] and velocity v [m/s]; OptionError off the grid."""
        return self._look(self.fine, p, v)[0]

    def error(self, p: float, v: float) -> float:
        """Error of `value` there: the change by the last halving of the spacing [cost].

        Errors fall fourfold with it where the wall is far, about twofold where it is grazed; so this is not too little.
        """
        return abs(self.value(p, v) - self._look(self.coarse, p, v)[0])

    def log_psi(self, p: float, v: float) -> float:
        """log psi there [nats]."""
        return -self.value(p, v) / self.temperature

    def control(self, p: float, v: float) -> float:
        """The optimal acceleration u* = b^2 d(log psi)/dv there [m/s^2]."""
        return -self._look(self.fine, p, v)[1] / self.r

    def _look(self, strip: Strip, p: float, v: float) -> tuple[float, float]:
        fastest = abs(strip.first)
        if not (0.0 <= p <= 1.0 and abs(v) <= fastest):
            raise OptionError(
                f"p = {p:g}, v = {v:g} is beside the grid, which has p from 0 to 1 and |v| up to {fastest:g}; "
                "solve with a greater `fastest`"
            )
        return _at(strip, float(p), float(v))  # type: ignore[no-any-return]


def mass_on_line(
    *,
    b: float,
    q: float = 1.0,
    r: float = 2.0,
    phi: float = math.inf,
    fastest: float = 3.0,
    spacing: float = SPACING,
) -> MassOnLine:
    """Solve for psi of a mass between a wall at p = 0 and a goal at p >= 1 that counts at any velocity.

    Args:
        b: noise of the velocity [m/s/sqrt(s)].
        q: cost rate [cost/s].
        r: weight of the control, which costs r u^2 / 2 [cost/s].
        phi: cost of ending in the wall [cost].
        fastest: the grid knows velocities up to this [m/s]; paths that get faster count as lost.
        spacing: of positions on the finer of two grids [m]; errors fall with it as `MassOnLine.error` says.

    Raises:
        OptionError: a number is out of range, or the grid would be too large; says what would work.
    """
    for name, number in (("b", b), ("q", q), ("r", r), ("fastest", fastest), ("spacing", spacing)):
        if not (math.isfinite(number) and number > 0):
            raise OptionError(f"{name} is {number:g}; it must be a positive number")
    if not phi >= 0:
        raise OptionError(f"phi is {phi:g}; it must be 0 or more (infinity is allowed)")
    rows = 2 * max(4, round(0.5 / spacing))
    points = (rows + 1) * 2.0 * fastest / (DENSE * b * math.sqrt(0.5 * STEP / rows))
    if points > MOST:
        raise OptionError(
            f"the grid would have {points:,.0f} points and can have {MOST:,}; choose a spacing of "
            f"{1.05 * spacing * (points / MOST) ** (2.0 / 3.0):.2g} or more, or more noise"
        )
    coarse, fine = (_solved(b, q, r, phi, fastest, n) for n in (rows // 2, rows))
    return MassOnLine(temperature=r * b * b, r=r, fine=fine, coarse=coarse)


def _solved(b: float, q: float, r: float, phi: float, fastest: float, n: int) -> Strip:
    """v on n spacings from wall to goal."""
    tau = STEP / n
    whole, half = b * math.sqrt(tau), b * math.sqrt(0.5 * tau)
    apart = DENSE * half
    aside = math.ceil(fastest / apart)
    reach = math.ceil((REACH * whole + QUICK * tau) / apart)
    motion = Motion((0.5 - aside) * apart, apart, tau * n, q * tau, r * b * b, min(phi, CEILING))
    value = np.full((n + 1, 2 * aside), CEILING)
    wide, narrow = (-0.5 * (np.arange(-reach, reach + 1) * apart / s) ** 2 for s in (whole, half))
    for done in range(SWEEPS):
        if _sweep(value, value, motion, wide - np.log(np.exp(wide).sum()), done % 2 == 0) < ACCURACY:
            break
    else:
        raise OptionError(f"the solution has not settled after {SWEEPS} sweeps; choose a larger spacing")
    out = np.empty_like(value)
    _sweep(value, out, motion, narrow - np.log(np.exp(narrow).sum()), True)
    return Strip(out, motion.first, apart, 1.0 / n)


@kernel
def _sweep(value, out, motion, taps, down):  # type: ignore[no-untyped-def]
    """One round over all positions: along the rays, then the noise, whose log weights are taps. Greatest change."""
    rows, columns = value.shape
    reach, last = taps.shape[0] // 2, rows - 1
    ray, weight = np.empty(columns), np.exp(taps)
    change = 0.0
    for a in range(rows):
        i = last - a if down else a
        for k in range(columns):
            ray[k] = _ahead(value, motion, i, k)
        for k in range(columns):
            speed = motion.first + k * motion.apart
            if i == last and speed > 0.0:
                new = 0.0
            elif i == 0 and speed < 0.0:
                new = motion.phi
            else:
                new = min(_mean(ray, weight, taps, k, reach, motion.temperature), CEILING)
            change = max(change, abs(new - value[i, k]))
            out[i, k] = new
    return change


@kernel
def _mean(ray, weight, taps, k, reach, temperature):  # type: ignore[no-untyped-def]
    """-lambda log of the mean of exp(-ray / lambda) over the noise around velocity k [cost]."""
    low, high = max(k - reach, 0), min(k + reach, ray.shape[0] - 1)
    least = CEILING
    for t in range(low, high + 1):
        least = min(least, ray[t])
    total = 0.0
    for t in range(low, high + 1):
        total += weight[t - k + reach] * math.exp((least - ray[t]) / temperature)
    if total > LOST:
        return least - temperature * math.log(total)
    best = math.inf
    for t in range(low, high + 1):
        best = min(best, ray[t] - temperature * taps[t - k + reach])
    total = 0.0
    for t in range(low, high + 1):
        total += math.exp((best - ray[t]) / temperature + taps[t - k + reach])
    return best - temperature * math.log(total)


@inlined
def _ahead(value, motion, i, k):  # type: ignore[no-untyped-def]
    """v after a step along the ray from row i at velocity k, its cost included [cost]."""
    last = value.shape[0] - 1
    passed = (motion.first + k * motion.apart) * motion.cells
    at = i + passed
    if passed > 0.0 and at >= last:
        return motion.cost * (last - i) / passed
    if passed < 0.0 and at <= 0.0:
        return min(motion.cost * i / -passed + motion.phi, CEILING)
    p = min(max(math.floor(at), 0), last - 1)
    u, near, far = at - p, value[p, k], value[p + 1, k]
    if p == 0 and passed < 0.0:  # towards the wall v rises as one over the distance, in which the mass has to brake
        return min(motion.cost + min(far / u, max(motion.phi, far)), CEILING)
    if p == last - 1:
        ahead = _parabola(far, near, value[p - 1, k], 1.0 - u)
    elif p == 0 or (p == 1 and passed < 0.0):
        ahead = _parabola(near, far, value[p + 2, k], u)
    else:
        weight = cubic(u)
        ahead = weight[0] * value[p - 1, k] + weight[1] * near + weight[2] * far + weight[3] * value[p + 2, k]
    return min(motion.cost + min(max(ahead, min(near, far)), max(near, far)), CEILING)


@inlined
def _parabola(zero, one, two, u):  # type: ignore[no-untyped-def]
    """Evaluate at u the parabola through values at 0, 1 and 2."""
    return 0.5 * (1.0 - u) * (2.0 - u) * zero + u * (2.0 - u) * one + 0.5 * u * (u - 1.0) * two


@kernel
def _at(strip, p, v):  # type: ignore[no-untyped-def]
    """v [cost] and its slope along the velocity there, by cubic interpolation."""
    x, y = p / strip.spacing, (v - strip.first) / strip.apart
    i = min(max(math.floor(x), 1), strip.value.shape[0] - 3)
    k = min(max(math.floor(y), 1), strip.value.shape[1] - 3)
    rows, columns, change, total, slope = cubic(x - i), cubic(y - k), slopes(y - k), 0.0, 0.0
    for c in range(4):
        for d in range(4):
            total += rows[c] * columns[d] * strip.value[i + c - 1, k + d - 1]
            slope += rows[c] * change[d] * strip.value[i + c - 1, k + d - 1]
    return total, slope / strip.apart
