"""What of a drive a recording shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace

SAMPLES = ("all", "some", "none")


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """How much of a drive is drawn, and by what the tree is lifted.

    Raises:
        OptionError: a rate that is not positive, or an unknown choice of samples.
    """

    hz: float = 5.0  # references and samples per simulated second [1/s]
    samples: str = "some"  # sampled paths: "all", "some" or "none"
    truth: bool = False  # whether every frame comes with the exact value and the optimal control
    lift: Sequence[int] | None = None  # obstacles, from 1, whose H is the height of a tree; None: the telling ones

    def __post_init__(self) -> None:
        if not (math.isfinite(self.hz) and self.hz > 0):
            raise OptionError(f"--record-hz is {self.hz:g}; it must be a positive number of pictures per second")
        if self.samples not in SAMPLES:
            raise OptionError(f"--record-samples is {self.samples!r}; it must be one of {', '.join(SAMPLES)}")

    def check(self, space: FreeSpace) -> None:
        """Make sure that the obstacles to lift by are there.

        Raises:
            OptionError: with the numbers that there are.
        """
        M = len(space.obstacles)
        if not all(1 <= k <= M for k in self.lift or ()):
            numbers = ",".join(map(str, self.lift or ()))
            there = f"has the obstacles 1 to {M}; name one or two" if M else "has no obstacles to wind around; leave it"
            raise OptionError(f"--record-lift {numbers}: {space.scene.name} {there}")
