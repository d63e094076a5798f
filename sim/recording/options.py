"""Options of a recording: what it shows and where it goes, checked before any work is done."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from sim.files import check_writable, path_text, takes_as_it_comes
from sim.recording import viewer

SAMPLES = ("all", "some", "none")


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """Amount of a run that is drawn, and obstacles by which the tree is lifted; an OptionError if it cannot be."""

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
        """Make sure that the obstacles to lift by are there; the OptionError has the numbers that there are."""
        M = len(space.obstacles)
        if not all(1 <= k <= M for k in self.lift or ()):
            numbers = ",".join(map(str, self.lift or ()))
            there = f"has the obstacles 1 to {M}; name one or two" if M else "has no obstacles to wind around; leave it"
            raise OptionError(f"--record-lift {numbers}: {space.scene.name} {there}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sinks:
    """A file, which misses nothing, and viewers, which never hold the run up."""

    file: Path | None = None  # an .rrd; an existing one is replaced once rows of the run are on disk
    connect: str | None = None  # URL of a running viewer
    view: bool = False  # start a viewer
    serve: bool = False  # serve browsers of this machine

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return self != Sinks()

    def check(self) -> None:
        """Make sure, without touching anything, that each can be had; the OptionError reports why one cannot."""
        if self.file is not None:
            _check_file(self.file)
        if self.connect is not None:
            viewer.probe(self.connect)
        if self.view:
            viewer.check_display()
        if self.view or self.serve:
            viewer.check_installed("--view" if self.view else "--serve")


def _check_file(file: Path) -> None:
    name = f"--record {path_text(file)}"
    if takes_as_it_comes(file) and not os.path.samefile(file, os.devnull):
        what = "a pipe" if file.is_fifo() else "no file to write a recording to"
        raise OptionError(
            f"{name} is {what}; give the path of a file, or let a viewer follow with --connect or --serve"
        )
    check_writable(file, "--record")
    if file.suffix not in ("", ".rrd"):
        raise OptionError(f"{name}: viewers know recordings by their ending; call it {file.stem}.rrd")
