"""Output files, refused before any work is done; `pirrht.files.replaced` writes them once that is done."""

from __future__ import annotations

import json
import math
import os
import stat
import sys
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.errors import OptionError
from pirrht.files import has_reader, path_text, replaced, takes_as_it_comes, target_of


def check_writable(path: Path, option: str) -> None:
    """Refuse an output path before any work is done.

    Raises:
        OptionError: the name is none that the system takes, the folder is missing or may not be written to, or the
            path is a folder, a disk, or a pipe that nobody reads.
    """
    found = checked_name(path, option)
    name, folder, straight = f"{option} {path_text(path)}", target_of(path).parent, takes_as_it_comes(path)
    mode = 0 if found is None else found.st_mode
    if stat.S_ISDIR(mode) or stat.S_ISBLK(mode):
        raise OptionError(f"{name} is a {'folder' if stat.S_ISDIR(mode) else 'disk'}; give the path of a file")
    if stat.S_ISFIFO(mode) and not has_reader(path):
        raise OptionError(f"{name} is a pipe that nobody reads; start its reader first, or give the path of a file")
    if not straight and not folder.is_dir():
        raise OptionError(f"{name}: the folder {path_text(folder)} does not exist; create it first")
    if (not straight and not os.access(folder, os.W_OK)) or (found is not None and not os.access(path, os.W_OK)):
        raise OptionError(f"{name} may not be written; choose another place or fix the permissions")


def checked_name(path: Path, option: str) -> os.stat_result | None:
    """Query the system for a path; None if there is none.

    Raises:
        OptionError: the name is too long, not UTF-8 or leads nowhere.
    """
    try:
        str(path).encode()
        return os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except UnicodeEncodeError:
        raise OptionError(f"{option} {path_text(path)}: the name is not UTF-8; give one that is") from None
    except (OSError, ValueError) as error:  # ValueError: a null character
        raise refused(option, path, error) from None


def refused(option: str, path: Path, error: OSError | ValueError) -> OptionError:
    """Make the error where the system refuses a path that an option names, or what is done with it."""
    text = path_text(path)
    short = text if len(text) <= 80 else f"{text[:40]}...{text[-30:]}"
    return OptionError(f"{option} {short}: {getattr(error, 'strerror', None) or error}; choose another place")


def write_json(path: Path, value: Any) -> None:
    """Write JSON so that the old file stays until the new one is complete."""
    text = json.dumps(plain(value), indent=2, allow_nan=False) + "\n"
    sys.stdout.flush()  # lines come first where both go to one place
    with replaced(path, "--json") as stream:
        stream.write(text.encode())


def plain(value: Any) -> Any:
    """A value that JSON can hold: arrays as lists, infinities and NaN as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
