"""Files that end nowhere, or are none."""

import os
from pathlib import Path


def put(kind: str, file: Path) -> None:
    """Make a file a pipe, a folder or a device without an end; nothing for any other kind."""
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    elif kind == "device":
        file.symlink_to("/dev/zero")
