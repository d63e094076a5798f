"""When the steps of a march end: at every row of every motion, and often enough in between."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.motion import Motion, Mover

SHORT = 0.5  # no step is shorter than this share of the longest
MARGIN = 5  # steps of the longest kind beyond the end, for frames that come next
LONGEST = 200.0  # common period of motions that start over at most [s]
CLOSE = 1e-6  # periods that differ by less are one [s]
BEFORE = 1e-9  # a body arrives at a jump so much before it [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timetable:
    """Ends of steps."""

    times: Array  # (F + 1,) from 0 on [s]
    last: float  # when all stands still for good [s]; infinite where motions start over
    first: float  # when all that moves starts over ...
    period: float  # ... every so many seconds; 0 where nothing does [s]
    again: int  # place in `times` of the time one period before the last one; 0 where nothing starts over

    @property
    def before(self) -> Array:
        """The same times just before a body that starts over jumps [s]."""
        return self.times - BEFORE if self.period > 0.0 else self.times

    @property
    def after(self) -> Array:
        """The same just after it [s]."""
        return self.times + BEFORE if self.period > 0.0 else self.times


def timetable(movers: tuple[Mover, ...], longest: float) -> Timetable:
    """Steps of at most `longest` [s] for the motions of bodies.

    Raises:
        OptionError: motions start over with periods that have no common multiple of a useful length.
    """
    motions = [mover.motion for mover in movers]
    repeated = [m for m in motions if m.repeat]
    still = max([0.0, *(-m.lead if m.repeat else m.last for m in motions)])
    lead = _steps(_knots(motions, 0.0, still), longest)
    margin = MARGIN * longest
    if not repeated:
        rest = still + longest * np.arange(1, MARGIN + 1)
        return Timetable(times=np.concatenate([lead, rest]), last=still, first=0.0, period=0.0, again=0)
    period = _common([float(m.rows[-1, 0]) for m in repeated])
    cycle = _steps(_knots(motions, still, still + period), longest)
    more = cycle[1 : 2 + int(np.searchsorted(cycle, still + margin))] + period
    times = np.concatenate([lead[:-1], cycle, more])
    return Timetable(times=times, last=math.inf, first=still, period=period, again=len(lead) - 1 + len(more))


def _common(periods: list[float]) -> float:
    """The least common multiple of periods [s].

    Raises:
        OptionError: it is too long.
    """
    longest = max(periods)
    for n in range(1, math.floor(LONGEST / longest) + 1):
        if all(abs(n * longest / p - round(n * longest / p)) * p < CLOSE for p in periods):
            return n * longest
    raise OptionError(
        f"motions start over every {', '.join(f'{p:g}' for p in periods)} s, which has no common multiple up to "
        f"{LONGEST:g} s; choose periods that have one"
    )


def _knots(motions: list[Motion], begin: float, end: float) -> Array:
    """Times from begin to end [s], both included, at which a motion has a row."""
    found = [np.array([begin, end])]
    for m in motions:
        rows, period = m.rows[:, 0] - m.lead, float(m.rows[-1, 0])
        first, last = ((t - rows[0]) / period for t in (begin, end)) if m.repeat else (0.0, 0.0)
        found += [rows + k * period for k in range(max(math.floor(first), 0), math.floor(last) + 1)]
    every = np.unique(np.concatenate(found))
    return every[(every >= begin) & (every <= end)]


def _steps(knots: Array, longest: float) -> Array:
    """Steps of at most `longest` [s] that end at knots [s]; of knots that are closer than SHORT one is left out."""
    kept = [float(knots[0])]
    for t in knots[1:-1]:
        if min(t - kept[-1], knots[-1] - t) >= SHORT * longest:
            kept.append(float(t))
    out = [np.array(kept[:1])]
    for a, b in itertools.pairwise([*kept, *([float(knots[-1])] if knots[-1] > kept[-1] else [])]):
        out.append(np.linspace(a, b, math.ceil((b - a) / longest - CLOSE) + 1)[1:])
    return np.concatenate(out)
