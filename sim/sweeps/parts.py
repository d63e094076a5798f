"""Files of a dataset: Parquet tables and others that are whole or absent, whoever else writes beside them.

A file is written beside its place, forced to disk and then given its name.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pirrht
from pirrht.errors import OptionError
from pirrht.files import why_unreadable
from sim.sweeps.columns import COLUMNS

FORMAT = 1


def schema() -> Any:
    """The columns of the rows, with their units and descriptions."""
    import pyarrow as pa

    fields = [
        pa.field(c.name, pa.type_for_alias(c.kind), metadata={"unit": c.unit, "description": c.text}) for c in COLUMNS
    ]
    return pa.schema(fields, metadata={"pirrht": json.dumps({"format": FORMAT, "version": pirrht.__version__})})


def read(file: Path) -> Any:
    """The table of a file.

    Raises:
        OptionError: it cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    why = why_unreadable(file)
    if why is not None:
        raise _unreadable(file, f"it {why}")
    try:
        table = pq.read_table(file, schema=schema())
    except (OSError, pa.ArrowException) as error:
        raise _unreadable(file, " ".join(str(error).split())) from None
    empty = [name for name in ("scene", "method", "noise", "seed") if table[name].null_count]
    if empty:
        raise _unreadable(file, f"it has rows without {empty[0]}")
    return table


def _unreadable(file: Path, reason: str) -> OptionError:
    return OptionError(f"{file} cannot be read ({reason}); remove it, and its runs are made again")


def parquet(table: Any) -> Callable[[Any], object]:
    """What writes a table to a stream."""
    import pyarrow.parquet as pq

    return lambda stream: pq.write_table(table, stream, compression="zstd")


def add(folder: Path, write: Callable[[Any], object]) -> None:
    """Write another file of rows, under a number that no file has, whoever else writes there."""
    with _whole(folder, ".part-") as part:
        _filled(part, write)
        taken = (file.stem.removeprefix("part-") for file in folder.glob("part-*.parquet"))
        number = 1 + max((int(text) for text in taken if text.isdecimal()), default=-1)
        while not _linked(part, folder / f"part-{number:06d}.parquet"):
            number += 1


def _linked(part: Path, file: Path) -> bool:
    """Give a file its name, unless another has it."""
    try:
        os.link(part, file)
    except FileExistsError:
        return False
    except OSError:  # a file system without hard links
        if file.exists():
            return False
        os.replace(part, file)
    return True


def replace(file: Path, write: Callable[[Any], object]) -> None:
    """Write a file so that it is whole whenever it is seen, even after a loss of power."""
    with _whole(file.parent, f".{file.name}-") as part:
        _filled(part, write)
        os.replace(part, file)


def _filled(part: Path, write: Callable[[Any], object]) -> None:
    """Write a new file and force it to disk."""
    with part.open("xb") as stream:
        write(stream)
        stream.flush()
        os.fsync(stream.fileno())


@contextmanager
def _whole(folder: Path, prefix: str) -> Iterator[Path]:
    """The path of a new file beside those of a folder, which is gone afterwards unless it got another name."""
    part = folder / f"{prefix}{os.getpid()}-{secrets.token_hex(4)}"
    try:
        yield part
    finally:
        with suppress(OSError):
            part.unlink()
    with suppress(OSError):  # not every file system lets a folder be forced to disk
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
