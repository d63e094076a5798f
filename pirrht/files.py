"""Files that are replaced only once their new content is complete."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from pirrht.errors import OptionError


@contextmanager
def replaced(path: Path, option: str) -> Iterator[BinaryIO]:
    """A stream whose content becomes that of a file; an old file stays until then, and if anything goes wrong.

    Raises:
        OptionError: it cannot be written; names the option.
    """
    part = None
    try:
        handle, part = tempfile.mkstemp(prefix=path.name, suffix=".part", dir=path.resolve().parent)
        with os.fdopen(handle, "wb") as stream:
            yield stream
        os.chmod(part, 0o666 & ~_umask())
        os.replace(part, path)
        part = None
    except OSError as error:
        raise OptionError(f"{option} {path}: {error.strerror or error}; choose another place") from None
    finally:
        if part is not None:
            with suppress(OSError):
                os.unlink(part)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
