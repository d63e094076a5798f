"""NumPy's npz files read with suspicion: nothing is made room for before the file itself has that much to say.

A flipped bit in a header can ask for terabytes, and a few kilobytes of zeros unpack to gigabytes. Headers, sizes and
the zip's own sums are therefore held against each other first.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np

Arrays = dict[str, np.ndarray[Any, Any]]

MOST = 2 << 30  # bytes of all arrays together: some million vertices
DEFLATED = 1032  # a byte of deflate is at most so many of what it stands for
KINDS = "biufU"  # of numbers and texts
BROKEN = (zipfile.BadZipFile, zlib.error, EOFError)


def read_arrays(stream: BinaryIO) -> Arrays:
    """The arrays of an npz file by name.

    Raises:
        OSError, zipfile.BadZipFile, zlib.error, EOFError: it cannot be read, or what is read is not what was written.
        ValueError, RuntimeError: it is a zip file of another kind; says why.
    """
    if not zipfile.is_zipfile(stream):
        raise ValueError("it is no zip file")
    with zipfile.ZipFile(stream) as archive:
        members = archive.infolist()
        _check_sizes(members, stream.seek(0, os.SEEK_END))
        return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}


def checksum(arrays: Mapping[str, np.ndarray[Any, Any]], about: Mapping[str, Any]) -> str:
    """SHA-256 of arrays, their names, kinds and shapes, and of a JSON record beside them."""
    known = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        known.update(f"\0{name}\0{array.dtype.str}\0{array.shape}\0".encode())
        known.update(array.tobytes())
    return known.hexdigest()


def _check_sizes(members: list[zipfile.ZipInfo], length: int) -> None:
    if len({member.filename for member in members}) != len(members):
        raise zipfile.BadZipFile("a name is there twice")
    if any(m.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for m in members):
        raise ValueError("it is packed in another way")
    if sum(m.compress_size for m in members) > length:
        raise zipfile.BadZipFile("its parts are longer than the file")
    if any(m.file_size > DEFLATED * (m.compress_size + 1) for m in members):
        raise zipfile.BadZipFile("a part cannot unpack to what it is said to")
    total = sum(m.file_size for m in members)
    if total > MOST:
        raise ValueError(f"it unpacks to {total / 2**30:.3g} GB, and a tree has {MOST / 2**30:g} at most")


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray[Any, Any]:
    with archive.open(member) as part:
        version = np.lib.format.read_magic(part)  # type: ignore[no-untyped-call]
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"{member.filename} has a header of version {version}")
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        try:
            shape, fortran, dtype = header(part)  # type: ignore[no-untyped-call]
        except Exception as error:  # NumPy reads it as Python source, and says whatever the tokenizer says
            raise ValueError(f"{member.filename} has a header that cannot be read") from error
        if dtype.kind not in KINDS or any(length < 0 for length in shape):
            raise ValueError(f"{member.filename} holds {dtype}")
        size = math.prod(shape) * dtype.itemsize
        if part.tell() + size != member.file_size:
            raise zipfile.BadZipFile(f"{member.filename} is not as long as its header says")
        content = part.read(size)
        if len(content) != size or part.read(1):
            raise EOFError(f"{member.filename} breaks off")
    flat = np.frombuffer(content, dtype) if size else np.empty(0, dtype)
    return flat.reshape(shape, order="F" if fortran else "C")
