"""Output files: refused before any work is done, and replaced only once their new content is complete."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.errors import OptionError
from pirrht.files import replaced


def check_writable(path: Path, option: str) -> None:
    """Refuse an output path before any work is done.

    Raises:
        OptionError: the folder is missing or may not be written to, or the path is a folder.
    """
    folder = path.resolve().parent
    if path.is_dir():
        raise OptionError(f"{option} {path} is a folder; give the path of a file")
    if not folder.is_dir():
        raise OptionError(f"{option} {path}: the folder {folder} does not exist; create it first")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise OptionError(f"{option} {path} may not be written; choose another place or mend the permissions")


def write_json(path: Path, value: Any) -> None:
    """Write JSON so that the old file stays until the new one is complete."""
    text = json.dumps(plain(value), indent=2, allow_nan=False) + "\n"
    with replaced(path, "--json") as stream:
        stream.write(text.encode())


def plain(value: Any) -> Any:
    """A value that JSON can hold: arrays as lists, infinities and NaN as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
