"""What a plan needs before anything large is made: refused is what fits into no memory, and what would never end."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from pirrht.errors import OptionError
from sim.options.table import BY_SETTING
from sim.settings import Settings

GIB = 2.0**30
SHARE = 0.5  # of the memory of a machine may go to one plan
STEPS = 100_000  # of one path
WORK = 1e9  # steps of all paths of a plan
TAIL = 40.0  # paths are cut so many lambda after the cheapest reference (`pirrht.estimation.sampler`)
DOUBLINGS = 16  # of --samples under --target-error, without --budget


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """What a plan depends on besides its settings."""

    states: int  # n
    controls: int  # m
    obstacles: int  # M
    classes: int  # H, those allowed at the start
    distance: float  # from start to goal [m]
    speed: float  # at which it is driven [m/s]
    temperature: float  # lambda [cost]
    rate: float  # least q [cost/s]

    def seconds(self, settings: Settings) -> float:
        """About how long paths are before they are cut [s]."""
        if settings.method == "mppi":
            return settings.horizon
        return (2.0 * self.distance / self.speed + TAIL * self.temperature) / self.rate

    def steps(self, settings: Settings) -> float:
        """How many rollout steps that is."""
        return max(1.0, self.seconds(settings) / settings.dt)

    def samples(self, settings: Settings) -> float:
        """How many samples a plan draws at most."""
        most = settings.samples * DOUBLINGS if settings.budget is None else settings.budget
        return self.classes * float(settings.samples if settings.target_error is None else most)

    def sampling(self, settings: Settings) -> float:
        """What samples and what they follow take, and their weights under each other's proposals [bytes]."""
        n, m, steps = self.states, self.controls, self.steps(settings)
        proposals = self.classes if settings.method in ("pi-rrht", "best-class") else 1
        each = 8.0 * (6 + 2 * m + 3 * proposals)
        if settings.method == "mppi":
            each += 8.0 * (steps + 1) * n  # those under way at the end of the tape are traced
        return self.samples(settings) * each + proposals * steps * 8.0 * (2 * m + 9)

    def tree(self, settings: Settings) -> float:
        """What vertices, their nodes and the edges between them take [bytes]."""
        near = 2.0 * math.e * math.log(settings.vertices + 1.0)
        nodes = min(4, settings.classes or 4)
        return settings.vertices * (8.0 * self.obstacles + 120.0 * nodes + 92.0 * near)


def check(settings: Settings, size: Size, memory: float | None = None) -> None:
    """Refuse a plan that is too large.

    Args:
        memory: of the machine [bytes]; None: look.

    Raises:
        OptionError: tells the size, the limit, and which option to change.
    """
    if settings.method == "optimal":
        return
    limit = SHARE * (physical() if memory is None else memory)
    steps, work = size.steps(settings), size.steps(settings) * size.samples(settings)
    if steps > STEPS:
        loud = settings.method != "mppi" and TAIL * size.temperature > 2.0 * size.distance / size.speed
        ways = ["lower --noise"] if loud else ["lower --horizon"] if settings.method == "mppi" else []
        longest = BY_SETTING["dt"].bounds
        if not ways or longest is None or size.seconds(settings) <= STEPS * longest.high:
            ways = ["raise --dt", *ways]
        raise OptionError(
            f"--dt {settings.dt:g}: a path of {size.seconds(settings):.3g} s has {steps:.3g} steps, and at most "
            f"{STEPS:,} are possible; {' or '.join(ways)}"
        )
    _refuse(size.tree(settings), limit, f"a tree of {settings.vertices} --vertices", "lower --vertices")
    drawn = f"{size.samples(settings):.3g} samples around {size.classes} classes"
    remedy = "--budget or --samples" if settings.target_error is not None else "--samples or --classes"
    _refuse(size.sampling(settings), limit, f"a plan of {drawn}", f"lower {remedy}")
    if work > WORK:
        raise OptionError(
            f"a plan of {drawn} takes {work:.3g} steps, and at most {WORK:.0e} are possible; lower {remedy}, or "
            "raise --dt"
        )


def physical() -> float:
    """The memory of this machine [bytes]."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):  # no such question on this system
        return 8.0 * GIB


def _refuse(needed: float, limit: float, what: str, remedy: str) -> None:
    if needed > limit:
        raise OptionError(
            f"{what} would take about {needed / GIB:.3g} GiB of memory, and at most {limit / GIB:.3g} GiB of this "
            f"machine's are given to it; {remedy}"
        )
