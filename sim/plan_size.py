"""Size of a plan: what fits no memory or would never end is refused before it is made."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from pirrht.errors import OptionError
from sim.settings import BY_SETTING, PLACES, Settings

GIB = 2.0**30
MEMORY_SHARE = 0.5  # of the memory of a machine may go to one plan
PATH_STEPS = 100_000  # steps of one path at most
PLAN_STEPS = 1e9  # steps of all paths of a plan at most
TAIL = 40.0  # paths are cut so many lambda after the cheapest reference (`pirrht.estimation.sampler`)
DOUBLINGS = 16  # of --samples under --target-error, without --budget


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """Size of a plan, besides its settings."""

    states: int  # n
    controls: int  # m
    obstacles: int  # M
    classes: int  # H, those allowed at the start
    distance: float  # from start to goal [m]
    speed: float  # at which it is driven [m/s]
    temperature: float  # lambda [cost]
    rate: float  # least q [cost/s]

    def seconds(self, s: Settings) -> float:
        """Estimate the length of paths before they are cut [s]."""
        tail = (2.0 * self.distance / self.speed + TAIL * self.temperature) / self.rate
        return s.horizon if s.method == "mppi" else tail

    def samples(self, s: Settings) -> float:
        """Count the samples that a plan draws at most."""
        most = s.samples * DOUBLINGS if s.budget is None else s.budget
        return self.classes * float(s.samples if s.target_error is None else most)

    def sampling(self, s: Settings) -> float:
        """Estimate the memory of samples, their proposals, and their weights under all of these [bytes]."""
        n, m, steps = self.states, self.controls, max(1.0, self.seconds(s) / s.dt)
        proposals = self.classes if s.method in ("pi-rrht", "best-class") else 1
        each = 8.0 * (6 + 2 * m + 3 * proposals)
        if s.method == "mppi":
            each += 8.0 * (steps + 1) * n  # paths that outlast the control sequence are traced
        return self.samples(s) * each + proposals * steps * 8.0 * (2 * m + 9)

    def tree(self, s: Settings) -> float:
        """Estimate the memory of vertices, their nodes and the edges between them [bytes]."""
        near = 2.0 * math.e * math.log(s.vertices + 1.0)
        return s.vertices * (8.0 * self.obstacles + 120.0 * min(4, s.classes or 4) + 92.0 * near)


def check(s: Settings, size: Size, memory: float | None = None) -> None:
    """Refuse a plan that is too large.

    Args:
        memory: of the machine [bytes]; None: as the system has it.

    Raises:
        OptionError: tells the size, the limit, and which option to change.
    """
    if s.method == "optimal":
        return
    seconds, drawn = size.seconds(s), f"a plan of {size.samples(s):.3g} samples around {size.classes} classes"
    steps = max(1.0, seconds / s.dt)
    if steps > PATH_STEPS:
        remedies = ["lower --horizon"] if s.method == "mppi" else []
        if s.method != "mppi" and TAIL * size.temperature > 2.0 * size.distance / size.speed:
            remedies = ["lower --noise"]
        if not remedies or seconds <= PATH_STEPS * (BY_SETTING["dt"].bounds or PLACES)[1]:
            remedies = ["raise --dt", *remedies]
        raise OptionError(
            f"--dt {s.dt:g}: a path of {seconds:.3g} s has {steps:.3g} steps, and at most {PATH_STEPS:,} are possible; "
            f"{' or '.join(remedies)}"
        )
    fewer = f"lower {'--budget or --samples' if s.target_error is not None else '--samples or --classes'}"
    limit = MEMORY_SHARE * (physical() if memory is None else memory)
    for needed, what, remedy in (
        (size.tree(s), f"a tree of {s.vertices} --vertices", "lower --vertices"), (size.sampling(s), drawn, fewer)
    ):  # fmt: skip
        if needed > limit:
            raise OptionError(
                f"{what} would take about {needed / GIB:.3g} GiB of memory, and at most {limit / GIB:.3g} GiB of this "
                f"machine's are given to it; {remedy}"
            )
    if (work := steps * size.samples(s)) > PLAN_STEPS:
        raise OptionError(
            f"{drawn} takes {work:.3g} steps, and at most {PLAN_STEPS:.0e} are possible; {fewer}, or raise --dt"
        )


def physical() -> float:
    """The memory of this machine [bytes]."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):  # no such question on this system
        return 8.0 * GIB
