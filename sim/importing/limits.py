"""What files of other people are held to before anything is made of them."""

from __future__ import annotations

import stat
from pathlib import Path

from pirrht.errors import SceneError
from sim.files import read_bounded

LARGEST_FILE = 32 * 2**20  # bytes; the worlds of the BARN data set have one megabyte
FARTHEST = 1e6  # of any coordinate or measure [m] and angle [rad]: beyond, a double is no longer fine to a micrometre
FINEST = 1e-6  # of any measure [m]
MOST_PIXELS = 25_000_000  # 250 m square at 0.05 m; a pixel takes 64 bytes on the way


def check_regular(path: Path, what: str) -> None:
    """Refuse what could be waited for without end, or is no file at all.

    Raises:
        SceneError: names the path and what is wanted.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SceneError(f"{path}: cannot be read ({reason}); give {what}") from None
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no regular file"
        raise SceneError(f"{path}: cannot be read ({kind}); give {what}")


def content_of(path: Path, what: str) -> bytes:
    """The bytes of a file of bearable size.

    Raises:
        SceneError: names the path and what is wanted.
    """
    check_regular(path, what)
    return read_bounded(path, LARGEST_FILE, what, "remove what is no obstacle")
