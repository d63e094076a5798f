"""Where a recording goes: asked for as a whole, and checked before any work is done."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

from pirrht.errors import OptionError
from pirrht.files import shown, takes_as_it_comes
from sim.files import check_writable
from sim.recording import viewer


@dataclass(frozen=True, slots=True, kw_only=True)
class Sinks:
    """A file, which misses nothing, and viewers, which never hold the drive up."""

    file: Path | None = None  # an .rrd; an existing one is replaced once rows of the drive are on disk
    connect: str | None = None  # URL of a running viewer
    view: bool = False  # start a viewer
    serve: bool = False  # serve browsers of this machine

    def __bool__(self) -> bool:
        """Whether there is any."""
        return self.file is not None or self.connect is not None or self.view or self.serve

    def check(self) -> None:
        """Make sure, without touching anything, that each can be had.

        Raises:
            OptionError: the file cannot be written, no viewer listens at the URL, none can be started or shown.
        """
        if self.file is not None:
            _check_file(self.file)
        if self.connect is not None:
            viewer.probe(self.connect)
        if self.view:
            viewer.check_display()
        if self.view or self.serve:
            viewer.check_installed("--view" if self.view else "--serve")


def _check_file(file: Path) -> None:
    if takes_as_it_comes(file) and not os.path.samefile(file, os.devnull):
        kind = os.stat(file).st_mode
        what = "a pipe" if stat.S_ISFIFO(kind) else "a device" if stat.S_ISCHR(kind) else "taken"
        raise OptionError(
            f"--record {shown(file)} is {what}; give the path of a file, or let a viewer follow with --connect or "
            "--serve"
        )
    check_writable(file, "--record")
    if file.suffix not in ("", ".rrd"):
        raise OptionError(f"--record {shown(file)}: viewers know recordings by their ending; call it {file.stem}.rrd")
